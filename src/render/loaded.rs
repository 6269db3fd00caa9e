//! Renders a scene line to pixels, for callers that hold the whole scene in memory.

use crate::job::{SceneJob, render_partials};
use crate::merge::{MergeError, Tuple, combine};
use crate::scene::{LoadError, LoadedScene, SceneFiles, load, read_files};
use crate::shard::ShardLayout;
use crate::trace::Isa;
use glasshouse_line::layer::PerLayer;
use glasshouse_line::{LayerSet, Roots, SceneLine};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Side of the tiles of [`Loaded::render`], px. No pixel depends on this size.
const TILE_PX: u32 = 64;

/// A scene line and its decoded files, which together determine the pixels.
///
/// ```
/// use render::Loaded;
/// use render::formats::{NamedBytes, PhotographFiles};
/// use glasshouse_line::layer::{Layer, PerLayer};
/// use glasshouse_line::{LayerSet, parse_scene};
/// use render::scene::{SceneFiles, SideFiles};
///
/// // A grey wall, 2 m away, on both sides of the pane: PFM files of 2 x 2 px.
/// let pfm = |kind: &str, value: f32, count: usize| {
///     let header = format!("{kind}\n2 2\n-1.0\n").into_bytes();
///     let bytes = [header, value.to_le_bytes().repeat(count)].concat();
///     NamedBytes { path: "wall.pfm".into(), bytes }
/// };
/// let wall = || SideFiles::Photograph(PhotographFiles {
///     color: pfm("PF", 0.5, 12),
///     depth: pfm("Pf", 2.0, 4),
///     mask: None,
/// });
/// let side = r#"{"color": "c", "depth": "d", "transfer": "linear",
///                "intrinsics": {"fx": 2, "fy": 2, "cx": 1, "cy": 1}}"#;
/// let line = parse_scene(&format!(r#"{{
///     "schema": "glasshouse.scene/1", "id": "wall", "seed": 1,
///     "film": {{"width": 8, "height": 6, "spp": 16}},
///     "camera": {{"focal_length_mm": 55, "aperture_radius_m": 0.01, "focus": {{"distance_m": 2}}}},
///     "glass": {{"distance_m": 0.3, "thickness_m": 0.01, "ior": 1.5}},
///     "front": {side}, "back": {side}}}"#))?;
/// let mut scene = Loaded::new(line, &SceneFiles::new(wall(), wall()))?;
///
/// let mut images = PerLayer::default();
/// scene.render(7, 64, LayerSet::default(), &mut images)?;
/// assert_eq!(images[Layer::Transmission], [[0.5; 3]; 48]);
/// // The glass does not absorb light, so it transmits all light that it does not reflect.
/// assert!((images[Layer::Input][0][0] - 0.5).abs() < 1e-4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Loaded {
    line: SceneLine,
    scene: Arc<LoadedScene>,
    /// Number of tracing threads. No pixel depends on this number.
    pub threads: usize,
}

impl Loaded {
    /// Decodes the files of `line`.
    pub fn new(line: SceneLine, files: &SceneFiles) -> Result<Self, LoadError> {
        let scene = Arc::new(load(&line, files)?);
        Ok(Self { line, scene, threads: 1 })
    }

    /// Reads and decodes the files of `line`. Relative paths start from `base`.
    pub fn read(line: SceneLine, roots: &Roots, base: &Path) -> Result<Self, LoadError> {
        let files = read_files(&line, roots, base)?;
        Self::new(line, &files)
    }

    /// Returns the scene, its facts, and the digests of its files.
    pub fn scene(&self) -> &LoadedScene {
        &self.scene
    }

    /// Replaces the line's seed, `spp` and layers, and renders these layers. The images of other layers become empty.
    ///
    /// Labels of the set are not returned; [`Self::tuple`] has them. The images have the same bits as in a run of a line with this seed, `spp` and these layers.
    /// Panics if `spp` is not a power of two.
    pub fn render(
        &mut self,
        seed: u64,
        spp: u32,
        layers: LayerSet,
        images: &mut PerLayer<Vec<[f32; 3]>>,
    ) -> Result<(), MergeError> {
        assert!(spp.is_power_of_two(), "spp is {spp}, not a power of two");
        let film = &mut self.line.film;
        (self.line.seed, film.spp, film.layers) = (seed, spp, layers);
        Arc::get_mut(&mut self.scene)
            .expect("no job outlives the call that made it")
            .resample(&self.line);
        let tuple = self.tuple(TILE_PX, Isa::detect(), &AtomicBool::new(false), &|| {});
        *images = tuple.expect("`stop` is never set")?.layers;
        Ok(())
    }

    /// Renders the line into a tuple, in tiles of `tile_px`, and calls `on_shard` after each shard.
    ///
    /// Returns `None` if `stop` ended the work before all shards were finished.
    pub fn tuple(
        &self,
        tile_px: u32,
        isa: Isa,
        stop: &AtomicBool,
        on_shard: &(dyn Fn() + Sync),
    ) -> Option<Result<Tuple, MergeError>> {
        let layout = ShardLayout::of(&self.line, tile_px);
        let job = SceneJob::new(&self.line, layout, Arc::clone(&self.scene));
        let partials = render_partials(&job, self.threads, isa, stop, on_shard)?;
        Some(combine(&self.line, tile_px, &partials))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::{NamedBytes, PanoramaFiles};
    use crate::scene::SideFiles;
    use glasshouse_line::layer::Layer;
    use glasshouse_line::parse_scene;

    /// Returns a striped panorama of 8 x 4 px.
    fn stripes() -> SideFiles {
        let values = (0..96u8).flat_map(|k| (f32::from(k % 7) * 0.1).to_le_bytes());
        let bytes = b"PF\n8 4\n-1.0\n".iter().copied().chain(values).collect();
        let path = "stripes.pfm".into();
        SideFiles::Panorama(PanoramaFiles { panorama: NamedBytes { path, bytes }, depth: None })
    }

    fn loaded(seed: u64, spp: u32, more: &str) -> Loaded {
        let side = r#"{"panorama":"p","transfer":"linear","depth_m":3}"#;
        let line = format!(
            r#"{{"schema":"glasshouse.scene/1","id":"s","seed":{seed},
            "film":{{"width":70,"height":9,"spp":{spp}{more}}},
            "camera":{{"focal_length_mm":55,"aperture_radius_m":0.01,"focus":{{"distance_m":3}}}},
            "glass":{{"distance_m":0.3,"thickness_m":0.01,"ior":1.5}},"front":{side},"back":{side}}}"#
        );
        let files = SceneFiles::new(stripes(), stripes());
        Loaded::new(parse_scene(&line).unwrap(), &files).unwrap()
    }

    fn tuple(scene: &Loaded, tile_px: u32) -> Tuple {
        let never = AtomicBool::new(false);
        let tuple = scene.tuple(tile_px, Isa::Baseline, &never, &|| {});
        tuple.unwrap().unwrap()
    }

    #[test]
    fn render_gives_the_bits_of_a_line_with_its_seed_and_spp() {
        let mut scene = loaded(1, 16, "");
        scene.threads = 2;
        let before = tuple(&scene, 64);
        // Two ranges of samples, one range with two layers, and the original line.
        for (seed, spp, more) in
            [(5, 512, ""), (6, 64, r#","layers":["input","clean_reflection"]"#), (1, 16, "")]
        {
            let own = loaded(seed, spp, more);
            let expected = tuple(&own, 96);
            let mut images = PerLayer::default();
            let layers = own.line.film.layers;
            scene.render(seed, spp, layers, &mut images).unwrap();
            assert!(images == expected.layers);
            assert_eq!(scene.scene().facts, own.scene().facts);
            assert_eq!(images[Layer::Transmission].is_empty(), !more.is_empty());
        }
        assert!(tuple(&scene, 64) == before);
    }
}
