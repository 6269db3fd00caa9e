//! Inference on images of any size.

use super::example::Planes;
use super::generator::Generator;
use super::picture::Picture;
use super::vgg::Vgg;
use candle_core::{Result, Tensor};

/// Least overlap of neighbouring tiles, px: the combined reach of a generator's convolutions.
const OVERLAP: usize = 128;

/// Least side of an image for VGG-19 with its four pools, px.
pub const LEAST_PX: usize = 16;

/// Least side of a tile, px; smaller settings are raised to it.
pub const LEAST_TILE_PX: usize = 2 * OVERLAP + LEAST_PX;

/// The networks of a checkpoint.
#[derive(Clone, Copy)]
pub struct Networks<'a> {
    /// Feature network, if the networks use features.
    pub vgg: Option<&'a Vgg>,
    pub separation: Option<&'a Generator>,
    pub backtrack: &'a Generator,
}

impl Networks<'_> {
    /// Computes T* and R~* of an image, clamped to [0, 1]. Splits images larger than `tile_px` a side into overlapping
    /// tiles and normalises each tile separately. Fails if the network makes values that are not finite.
    pub fn separate(&self, image: &Picture, tile_px: usize) -> Result<[Picture; 2]> {
        let Some(separation) = self.separation else {
            candle_core::bail!(
                "the checkpoint has no SP-net: use a checkpoint of the separation stage"
            );
        };
        let both = self.by_tiles(separation, image, 6, tile_px)?;
        let (t, r) = both.split_at(both.len() / 2);
        Ok([t, r].map(|planes| Picture {
            rows: image.rows,
            columns: image.columns,
            planes: planes.to_vec(),
        }))
    }

    /// Computes R* of an R~ or R~*, clamped to [0, 1].
    pub fn track_back(&self, reflection: &Picture, tile_px: usize) -> Result<Picture> {
        Ok(Picture {
            planes: self.by_tiles(self.backtrack, reflection, 3, tile_px)?,
            ..*reflection
        })
    }

    fn by_tiles(
        &self,
        network: &Generator,
        image: &Picture,
        outputs: usize,
        tile_px: usize,
    ) -> Result<Planes> {
        if image.rows < LEAST_PX || image.columns < LEAST_PX {
            candle_core::bail!(
                "an image of {} x {} px is too small: each side needs {LEAST_PX} px",
                image.columns,
                image.rows
            );
        }
        let tile = tile_px.max(LEAST_TILE_PX);
        let (down, across) = (starts(image.rows, tile), starts(image.columns, tile));
        let pixels = image.rows * image.columns;
        let mut sums = vec![0.0f32; outputs * pixels];
        let mut weights = vec![0.0f32; pixels];
        for &top in &down {
            for &left in &across {
                let (rows, columns) = (tile.min(image.rows), tile.min(image.columns));
                let made = self.tile(network, image, [top, left], [rows, columns])?;
                let ramp_down = ramp(top, rows, image.rows);
                let ramp_across = ramp(left, columns, image.columns);
                for y in 0..rows {
                    let at = (top + y) * image.columns + left;
                    for x in 0..columns {
                        let weight = ramp_down[y] * ramp_across[x];
                        weights[at + x] += weight;
                        for c in 0..outputs {
                            sums[c * pixels + at + x] +=
                                weight * made[(c * rows + y) * columns + x];
                        }
                    }
                }
            }
        }
        for plane in sums.chunks_exact_mut(pixels) {
            for (sum, weight) in plane.iter_mut().zip(&weights) {
                *sum = (*sum / weight).clamp(0.0, 1.0);
            }
        }
        Ok(sums)
    }

    fn tile(
        &self,
        network: &Generator,
        image: &Picture,
        [top, left]: [usize; 2],
        [rows, columns]: [usize; 2],
    ) -> Result<Vec<f32>> {
        let mut values = Vec::with_capacity(3 * rows * columns);
        for plane in image.planes.chunks_exact(image.rows * image.columns) {
            for y in top..top + rows {
                values.extend_from_slice(&plane[y * image.columns + left..][..columns]);
            }
        }
        let tensor = Tensor::from_vec(values, (1, 3, rows, columns), network.device())?;
        let features = match self.vgg {
            Some(vgg) => vgg.features(&tensor)?,
            None => Vec::new(),
        };
        let out = network.forward_frozen(&tensor, &features)?;
        let values: Vec<f32> = out.flatten_all()?.to_vec1()?;
        // Clamping would turn them into black.
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            candle_core::bail!("the network makes values that are not finite ({value})");
        }
        Ok(values)
    }
}

/// Returns the first pixels of evenly spread tiles that cover `length` and overlap by at least [`OVERLAP`].
fn starts(length: usize, tile: usize) -> Vec<usize> {
    if length <= tile {
        return vec![0];
    }
    let more = (length - tile).div_ceil(tile - OVERLAP);
    (0..=more).map(|k| k * (length - tile) / more).collect()
}

/// Returns the weights of a tile's pixels, with a ramp at edges that another tile overlaps.
fn ramp(start: usize, size: usize, length: usize) -> Vec<f32> {
    let weight = |k: usize| {
        let before = if start == 0 { OVERLAP } else { k + 1 };
        let after = if start + size == length { OVERLAP } else { size - k };
        before.min(after).min(OVERLAP) as f32 / OVERLAP as f32
    };
    (0..size).map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GeneratorOptions, SLOPE, Start, Stream};
    use candle_core::Device;

    #[test]
    fn tiles_cover_every_pixel() {
        for length in [16, 300, 301, 700, 1000, 5000] {
            let starts = starts(length, 300);
            assert_eq!(starts[0], 0);
            assert_eq!(starts.last().unwrap() + 300.min(length), length.max(300.min(length)));
            assert!(starts.windows(2).all(|w| w[1] - w[0] <= 300 - OVERLAP));
            assert!(ramp(0, 300.min(length), length).iter().all(|w| *w > 0.0));
        }
    }

    #[test]
    fn tiling_changes_pixelwise_networks_only_by_rounding() {
        let options = GeneratorOptions {
            width: 4,
            outputs: 6,
            features: Vec::new(),
            start: Start::Identity,
            slope: SLOPE,
        };
        let separation = Generator::new(&options, 1, "s", &Device::Cpu).unwrap();
        let options = GeneratorOptions { outputs: 3, ..options };
        let backtrack = Generator::new(&options, 1, "b", &Device::Cpu).unwrap();
        let networks = Networks { vgg: None, separation: Some(&separation), backtrack: &backtrack };
        let (rows, columns) = (310, 423);
        let mut stream = Stream::new(1, "picture");
        let planes = (0..3 * rows * columns).map(|_| stream.unit() as f32).collect();
        let image = Picture { rows, columns, planes };
        let [whole, _] = networks.separate(&image, 500).unwrap();
        let [tiled, _] = networks.separate(&image, 280).unwrap();
        // These networks process each pixel separately: their kernels are identities, and their norms have weight 0.
        let pairs = whole.planes.iter().zip(&tiled.planes);
        let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-5, "{worst}");
        let small = Picture { rows: 8, columns: 423, planes: vec![0.0; 3 * 8 * 423] };
        assert!(networks.separate(&small, 500).unwrap_err().to_string().contains("too small"));
        assert_eq!(networks.track_back(&image, 500).unwrap().planes.len(), 3 * rows * columns);
    }
}
