//! Scenes of the benchmarks: built-in scenes, so that benchmarks run anywhere, or scenes from files.

use super::error::BenchError;
use glasshouse_line::{SceneLine, parse_scene};
use procedural::{Place, SamplePhotograph};
use render::formats::{NamedBytes, PhotographFiles};
use render::scene::{
    DecodedScene, InputDigests, LoadedScene, SceneFiles, Sheet, SideFiles, assemble_decoded, decode,
};
use render::trace::{Grid, Sampling, Texture};
use serde_json::{Value, json};

/// Seed of the built-in photographs.
const PHOTOGRAPHS_SEED: u64 = 2020;

/// A scene line with decoded photographs. Variants of the line can use the same photographs.
#[derive(Clone)]
pub struct BenchScene {
    pub name: String,
    pub line: SceneLine,
    pub photographs: DecodedScene,
}

impl BenchScene {
    /// Assembles `line` with this scene's photographs.
    pub fn assemble(
        &self,
        line: &SceneLine,
        sampling: Sampling,
    ) -> Result<LoadedScene, BenchError> {
        let (mut scene, facts) = assemble_decoded(line, self.photographs.clone())?;
        scene.sampling = sampling;
        let inputs = self.photographs.inputs.clone();
        Ok(LoadedScene { scene, facts, inputs })
    }
}

/// Builds the default scene of `bench error`: an indoor photograph in front and an outdoor photograph behind.
///
/// The photographs have `size` px, and the square film has a side of `film_px`. Lens and pane are those of the paper.
pub fn pair(size: [u32; 2], film_px: u32) -> Result<BenchScene, BenchError> {
    procedural("pair", [Place::Indoors, Place::Outdoor], size, film_px)
}

pub fn indoor(size: [u32; 2], film_px: u32) -> Result<BenchScene, BenchError> {
    procedural("indoor", [Place::Indoors; 2], size, film_px)
}

pub fn outdoor(size: [u32; 2], film_px: u32) -> Result<BenchScene, BenchError> {
    procedural("outdoor", [Place::Outdoor; 2], size, film_px)
}

/// Builds a scene of blocks of 4 x 4 px with independent inverse depths, uniform between 1/50 and 1/0.6 per metre, and
/// focus at 0.8 m: every ray crosses a depth step every few cells.
pub fn stress(film_px: u32) -> BenchScene {
    const BLOCK_PX: usize = 4;
    const SIZE: [u32; 2] = [1024, 768];
    // The photographs have a larger field of view than the film.
    let intrinsics = json!({"fx": 1365.0, "fy": 1365.0, "cx": 512.0, "cy": 384.0});
    let mut line = line("stress", film_px, &intrinsics, [false; 2]);
    line.camera.focus = glasshouse_line::Focus::Distance { distance_m: 0.8 };
    let sheet_intrinsics = serde_json::from_value(intrinsics).expect("intrinsics are numbers");
    let hash = |mut x: u32| {
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
        x ^ (x >> 16)
    };
    let [width, height] = SIZE.map(|n| n as usize);
    let sheet = |salt: u32| {
        let block = |q: usize| (q / width / BLOCK_PX) * 7919 + (q % width / BLOCK_PX);
        let unit = |x: u32| f64::from(hash(x ^ salt)) / 4_294_967_296.0;
        let (far, near) = (1.0 / 50.0, 1.0 / 0.6);
        let w = |q: usize| (far + (near - far) * unit(block(q) as u32)) as f32;
        let texel = |q: usize| {
            let byte = |k: u32| (hash(q as u32 ^ salt.wrapping_add(k)) >> 24) as f32 / 255.0;
            [byte(1), byte(2), byte(3), 0.0]
        };
        let radiance: Vec<[f32; 4]> = (0..width * height).map(texel).collect();
        Sheet {
            width,
            height,
            grid: Grid::new(width, height, (0..width * height).map(w).collect()).into(),
            valid: vec![true; width * height].into(),
            filled_share: 0.0,
            relative: None,
            texture: Texture::from_vec(width, height, radiance).into(),
            intrinsics: sheet_intrinsics,
            front_center_z_m: 0.8,
        }
    };
    let photographs = DecodedScene {
        front: sheet(0x51ab).into(),
        back: sheet(0x3c6e_f372).into(),
        smudges: None,
        inputs: InputDigests::default(),
    };
    BenchScene { name: "stress".to_owned(), line, photographs }
}

fn procedural(
    name: &str,
    places: [Place; 2],
    size: [u32; 2],
    film_px: u32,
) -> Result<BenchScene, BenchError> {
    let listing = procedural::listing(8, PHOTOGRAPHS_SEED);
    let of = |place: Place, skip: usize| {
        let found = listing.iter().filter(|p| p.place == place).nth(skip);
        found.expect("four of the eight photographs show each place")
    };
    let front = of(places[0], 0);
    let back = of(places[1], usize::from(places[0] == places[1]));
    let intrinsics = serde_json::to_value(procedural::intrinsics(size[0], size[1]))
        .expect("intrinsics are numbers");
    let is_far = places.map(|place| place == Place::Outdoor);
    let line = line(name, film_px, &intrinsics, is_far);
    let of = |which| photograph(which, size).map(SideFiles::Photograph);
    let files = SceneFiles::new(of(front)?, of(back)?);
    let photographs = decode(&line, &files)?;
    Ok(BenchScene { name: name.to_owned(), line, photographs })
}

/// Encodes the files of a procedural photograph in memory.
pub(super) fn photograph(
    which: &SamplePhotograph,
    size: [u32; 2],
) -> Result<PhotographFiles, BenchError> {
    let files = procedural::encode(which, size[0], size[1])?;
    let named = |path, bytes| NamedBytes { path, bytes };
    Ok(PhotographFiles {
        color: named(which.color_path(), files.color),
        depth: named(which.depth_path(), files.depth),
        mask: Some(named(which.mask_path(), files.mask)),
    })
}

/// Builds a line with the paper's camera and pane. On a side with `is_far`, holes (the sky) get the farthest depth.
fn line(name: &str, film_px: u32, intrinsics: &Value, is_far: [bool; 2]) -> SceneLine {
    let [front, back] = is_far.map(|is_far| {
        json!({
            "color": "built in", "depth": "built in", "mask": "built in",
            "fill": if is_far { "far" } else { "smooth" }, "intrinsics": intrinsics,
        })
    });
    let line = json!({
        "schema": "glasshouse.scene/1", "id": name, "seed": 1,
        "film": {"width": film_px, "height": film_px, "spp": 256},
        "camera": {"focal_length_mm": 55.0, "aperture_radius_m": 0.00893, "focus": {"at": "front_center"}},
        "glass": {"distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6},
        "front": front, "back": back,
    });
    parse_scene(&line.to_string()).expect("the line of a built-in scene is valid")
}
