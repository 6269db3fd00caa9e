//! Inference on images of any size.

use super::generator::{Generator, Norms, REACH_PX, Statistics};
use super::separation_net::SeparationNet;
use super::tiles::{Tiling, by_tiles, tensor_of};
use super::vgg::Vgg;
use candle_core::{Result, Tensor};
use compose::shrink_to;
use examples::Picture;
use examples::Planes;
use glasshouse_line::color::{decode_srgb, linear_to_srgb};
use rayon::prelude::*;

/// Least side of an image for VGG-19 with its four pools, px.
pub const LEAST_PX: usize = 16;

/// The networks of a checkpoint.
#[derive(Clone, Copy)]
pub struct Networks<'a> {
    /// Feature network, if the networks use features.
    pub vgg: Option<&'a Vgg>,
    pub separation: Option<&'a SeparationNet>,
    /// BT-net; `None` beside a U-Net.
    pub backtrack: Option<&'a Generator>,
}

impl Networks<'_> {
    /// Returns the least side of tiles, px, of which the networks keep a part.
    pub fn least_tile_px(&self) -> usize {
        let separation = self.separation.map(|net| net.tiling(0).least_px());
        let backtrack = self.backtrack.map(|_| backtrack_tiling(0).least_px());
        separation.max(backtrack).unwrap_or(0)
    }

    /// Computes T* and R~* of an image, clamped to [0, 1]; R~* of a network with T* alone is the light of I less that of
    /// T*, at least 0. Divides an image larger than `tile_px` a side into tiles, whose outputs equal those of the whole
    /// image except for features at the cuts; norms use the statistics of the whole image, reduced to the size of a tile.
    ///
    /// # Errors
    ///
    /// Fails if the network makes values that are not finite.
    pub fn separate(&self, image: &Picture, tile_px: usize) -> Result<[Picture; 2]> {
        let Some(separation) = self.separation else {
            candle_core::bail!(
                "the checkpoint has no SP-net: use a checkpoint of the separation stage"
            );
        };
        let has_one = separation.has_transmission_alone();
        let pass = |tile: &Tensor, norms: &mut Norms| {
            let features =
                if separation.needs_features() { self.features(tile)? } else { Vec::new() };
            let made = separation.forward_frozen(tile, &features, norms)?;
            match &made.glass_reflection {
                Some(r) => Tensor::cat(&[&made.transmission, r], 1),
                None => Ok(made.transmission),
            }
        };
        let outputs = if has_one { 3 } else { 6 };
        let network =
            Pass { tiling: separation.tiling(tile_px), outputs, has_norms: separation.has_norms() };
        let mut t = network.planes(image, pass)?;
        let r =
            if has_one { difference_of_light(&image.planes, &t) } else { t.split_off(t.len() / 2) };
        Ok([t, r].map(|planes| Picture { planes, ..*image }))
    }

    /// Computes R* of an R~ or R~*, clamped to [0, 1].
    pub fn track_back(&self, reflection: &Picture, tile_px: usize) -> Result<Picture> {
        let Some(backtrack) = self.backtrack else {
            candle_core::bail!("the checkpoint has a U-Net, which has no BT-net");
        };
        let tiling = backtrack_tiling(tile_px);
        let network = Pass { tiling, outputs: 3, has_norms: true };
        let planes = network.planes(reflection, |tile, norms| {
            backtrack.forward_frozen(tile, &self.features(tile)?, norms)
        })?;
        Ok(Picture { planes, ..*reflection })
    }

    fn features(&self, tile: &Tensor) -> Result<Vec<Tensor>> {
        self.vgg.map_or_else(|| Ok(Vec::new()), |vgg| vgg.features(tile))
    }
}

/// Returns tiles for BT-net.
fn backtrack_tiling(tile_px: usize) -> Tiling {
    Tiling { tile_px, reach_px: REACH_PX, period_px: 1 }
}

/// What a network needs to process an image.
struct Pass {
    tiling: Tiling,
    /// Number of output channels.
    outputs: usize,
    has_norms: bool,
}

impl Pass {
    fn planes(
        &self,
        image: &Picture,
        forward: impl Fn(&Tensor, &mut Norms) -> Result<Tensor>,
    ) -> Result<Planes> {
        if image.rows < LEAST_PX || image.columns < LEAST_PX {
            candle_core::bail!(
                "an image of {} x {} px is too small: each side needs {LEAST_PX} px",
                image.columns,
                image.rows
            );
        }
        let Self { tiling, outputs, has_norms } = *self;
        if !has_norms || !tiling.divides(image) {
            return by_tiles(image, tiling, outputs, |tile| forward(tile, &mut Norms::Batch));
        }
        let small = shrink_to(image.to_rgb(), tiling.tile_px.try_into().unwrap_or(u32::MAX));
        let small = Picture::from_rgb(&small);
        let whole = tensor_of(&small, &(0..small.rows), &(0..small.columns))?;
        let mut statistics = Statistics::default();
        forward(&whole, &mut Norms::Record(&mut statistics))?;
        by_tiles(image, tiling, outputs, |tile| forward(tile, &mut Norms::Given(&statistics)))
    }
}

/// Returns the codes of the light of `input` less that of `transmission`, at least 0.
fn difference_of_light(input: &[f32], transmission: &[f32]) -> Planes {
    let pairs = input.par_iter().zip(transmission).with_min_len(1 << 12);
    let light = |code: f32| decode_srgb(f64::from(code));
    pairs
        .map(|(i, t)| linear_to_srgb((light(*i) - light(*t)).max(0.0) as f32).min(1.0) as f32)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Generator, GeneratorOptions, RandomTensor, SLOPE, Start, Stream};
    use plan::{NetworkKind, TrainSettings};

    const OPTIONS: GeneratorOptions = GeneratorOptions {
        width: 4,
        outputs: 6,
        features: Vec::new(),
        sampling: crate::ops::Sampling::Centres,
        start: Start::Random,
        slope: SLOPE,
    };

    fn noise(rows: usize, columns: usize) -> Picture {
        let mut stream = Stream::new(1, "picture");
        let planes = (0..3 * rows * columns).map(|_| stream.unit() as f32).collect();
        Picture { rows, columns, planes }
    }

    /// Gives every weight a value that matters.
    fn disturb(variables: Vec<(String, candle_core::Var)>) {
        for (name, variable) in variables {
            let mut stream = Stream::new(3, &name);
            let more = stream.normal_tensor(variable.dims(), 0.2).unwrap();
            variable.set(&(variable.as_tensor() + more).unwrap()).unwrap();
        }
    }

    fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    /// With the same statistics, tiles change nothing but the order of sums, for kernels that reach as far as they can.
    #[test]
    fn tiles_of_a_generator_equal_the_whole_image() {
        let generator = Generator::new(&OPTIONS, 1, "s").unwrap();
        disturb(generator.variables());
        let image = noise(340, 611);
        let whole = tensor_of(&image, &(0..340), &(0..611)).unwrap();
        let mut statistics = Statistics::default();
        let expected = generator
            .forward_frozen(&whole, &[], &mut Norms::Record(&mut statistics))
            .and_then(|made| made.clamp(0.0, 1.0)?.flatten_all()?.to_vec1::<f32>())
            .unwrap();
        let inside = expected.iter().filter(|v| (0.01..0.99).contains(*v)).count();
        assert!(inside > expected.len() / 10, "{inside}");
        let found = |reach_px| {
            let tiling = Tiling { tile_px: 336, reach_px, period_px: 1 };
            let forward =
                |tile: &Tensor| generator.forward_frozen(tile, &[], &mut Norms::Given(&statistics));
            by_tiles(&image, tiling, 6, forward).unwrap()
        };
        let worst = largest_difference(&found(REACH_PX), &expected);
        assert!(worst < 1e-4, "{worst}");
        let short = largest_difference(&found(REACH_PX / 4), &expected);
        assert!(short > 10.0 * worst && short > 1e-3, "{short} {worst}");
    }

    #[test]
    fn tiles_of_a_unet_equal_the_whole_image() {
        let settings =
            TrainSettings { network: NetworkKind::Unet, width: 4, ..TrainSettings::default() };
        let separation = SeparationNet::new(&settings, &OPTIONS).unwrap();
        disturb(separation.variables());
        let networks = Networks { vgg: None, separation: Some(&separation), backtrack: None };
        let image = noise(200, 1201);
        let [whole, _] = networks.separate(&image, 2000).unwrap();
        let [tiled, _] = networks.separate(&image, 576).unwrap();
        assert!(separation.tiling(576).divides(&image));
        let worst = largest_difference(&whole.planes, &tiled.planes);
        assert!(worst < 1e-5, "{worst}");
        assert!(largest_difference(&whole.planes, &image.planes) > 0.1);
    }

    #[test]
    fn tiles_share_the_statistics_of_the_whole_image() {
        let separation = Generator::new(&OPTIONS, 1, "s").unwrap();
        disturb(separation.variables());
        let separation = SeparationNet::of_generator(separation);
        let backtrack = GeneratorOptions { outputs: 3, ..OPTIONS };
        let backtrack = Generator::new(&backtrack, 1, "b").unwrap();
        let networks =
            Networks { vgg: None, separation: Some(&separation), backtrack: Some(&backtrack) };
        // A smooth image keeps its statistics at the size of a tile. One half is dark, so tiles normalised alone differ.
        let (rows, columns) = (330, 660);
        let code = |k: usize| {
            let (x, y) = ((k % columns) as f32, (k / columns % rows) as f32);
            let light = 0.5 + 0.4 * (x / 40.0 + k as f32 / 1e5).sin() * (y / 30.0).cos();
            if x < 330.0 { 0.2 * light } else { light }
        };
        let image = Picture { rows, columns, planes: (0..3 * rows * columns).map(code).collect() };
        let error = |a: &[f32], b: &[f32]| {
            let squares: f32 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
            (squares / a.len() as f32).sqrt()
        };
        let [whole, _] = networks.separate(&image, 1000).unwrap();
        let [tiled, _] = networks.separate(&image, 336).unwrap();
        let alone = by_tiles(&image, separation.tiling(336), 3, |tile| {
            Ok(separation.forward_frozen(tile, &[], &mut Norms::Batch)?.transmission)
        });
        let of_tiles = error(&whole.planes, &tiled.planes);
        let of_alone = error(&whole.planes, &alone.unwrap());
        assert!(of_tiles < 0.6 * of_alone && of_alone > 0.01, "{of_tiles} {of_alone}");
        let small = noise(8, 423);
        assert!(networks.separate(&small, 500).unwrap_err().to_string().contains("too small"));
        assert_eq!(networks.track_back(&image, 336).unwrap().planes.len(), image.planes.len());
    }
}
