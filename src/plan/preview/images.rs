//! The images of a preview and their measures.

use crate::light::luminance;
use compose::ssim_grey;
use glasshouse_line::SceneLine;
use glasshouse_line::color::SrgbEncoder;
use render::scene::{AssembleError, DecodedScene, assemble_decoded};
use render::trace::{Isa, Tile, trace_tile};

/// Largest side of the preview, px.
pub(crate) const PREVIEW_PX: u32 = 64;

/// Largest number of samples per pixel of the preview.
pub(crate) const PREVIEW_SPP: u32 = 16;

/// Small images of a scene's I, T and R~, in linear light.
#[derive(Clone, Debug)]
pub(crate) struct Preview {
    width: usize,
    height: usize,
    input: Vec<[f64; 3]>,
    transmission: Vec<[f64; 3]>,
    glass_reflection: Vec<[f64; 3]>,
}

impl Preview {
    /// Traces the preview of `line` with the exposures and illuminants of the decoded `scene`.
    pub(crate) fn new(
        line: &SceneLine,
        scene: &DecodedScene,
        isa: Isa,
    ) -> Result<Self, AssembleError> {
        let mut small = line.clone();
        let longer = line.film.width.max(line.film.height);
        let side = |px: u32| {
            if longer <= PREVIEW_PX {
                return px;
            }
            let scaled = u64::from(px) * u64::from(PREVIEW_PX) / u64::from(longer);
            (scaled as u32).max(1)
        };
        small.film.width = side(line.film.width);
        small.film.height = side(line.film.height);
        small.film.spp = line.film.spp.min(PREVIEW_SPP);
        small.film.target_error = None;
        small.film.layers = glasshouse_line::LayerSet::default();
        let (scene, _) = assemble_decoded(&small, scene.clone())?;
        let tile = Tile { x: 0, y: 0, width: small.film.width, height: small.film.height };
        let pixels = trace_tile(&scene, tile, 0..small.film.spp, isa).pixels;
        let layer = |k: usize| -> Vec<[f64; 3]> {
            pixels.iter().map(|p| p.mean[k].map(f64::from)).collect()
        };
        Ok(Self {
            width: small.film.width as usize,
            height: small.film.height as usize,
            input: layer(0),
            transmission: layer(1),
            glass_reflection: layer(2),
        })
    }

    /// Multiplies red, green and blue of all layers by `gains`.
    #[must_use]
    pub(crate) fn times(mut self, gains: [f64; 3]) -> Self {
        for layer in [&mut self.input, &mut self.transmission, &mut self.glass_reflection] {
            for pixel in layer {
                for c in 0..3 {
                    pixel[c] *= gains[c];
                }
            }
        }
        self
    }

    /// Computes the mean red, green and blue of I.
    pub(crate) fn mean_color(&self) -> [f64; 3] {
        [0, 1, 2].map(|c| mean(self.input.iter().map(|pixel| pixel[c])))
    }

    /// Finds the value that `percentile` percent of I's pixels do not exceed in their largest channel.
    pub(crate) fn percentile(&self, percentile: f64) -> f64 {
        let mut largest: Vec<f64> = self.input.iter().map(max_of).collect();
        largest.sort_by(f64::total_cmp);
        let rank = (percentile / 100.0 * largest.len() as f64).ceil() as usize;
        largest[rank.clamp(1, largest.len()) - 1]
    }

    /// Computes the mean luminance of R~ divided by that of I; 0 if I is black.
    pub(crate) fn reflected_share(&self) -> f64 {
        ratio(mean(luminances(&self.glass_reflection)), mean(luminances(&self.input)))
    }

    /// Computes the standard deviation of R~'s luminance divided by the mean luminance of I; 0 if I is black.
    pub(crate) fn contrast(&self) -> f64 {
        let middle = mean(luminances(&self.glass_reflection));
        let square = mean(luminances(&self.glass_reflection).map(|v| (v - middle) * (v - middle)));
        ratio(square.sqrt(), mean(luminances(&self.input)))
    }

    /// Computes the share of I's pixels with a channel of 1 or more.
    pub(crate) fn clipped_share(&self) -> f64 {
        mean(self.input.iter().map(|p| f64::from(u8::from(max_of(p) >= 1.0))))
    }

    /// Computes the structural similarity of I and T as 8-bit sRGB grey images.
    pub(crate) fn ssim(&self) -> f64 {
        let encoder = SrgbEncoder::new();
        let grey = |layer: &[[f64; 3]]| -> Vec<f64> {
            let code = |v: f64| f64::from(encoder.encode(v as f32));
            let of = |[r, g, b]: &[f64; 3]| 0.299 * code(*r) + 0.587 * code(*g) + 0.114 * code(*b);
            layer.iter().map(|p| of(p).round()).collect()
        };
        ssim_grey(&grey(&self.input), &grey(&self.transmission), self.width, self.height)
    }
}

fn luminances(layer: &[[f64; 3]]) -> impl Iterator<Item = f64> {
    layer.iter().map(|pixel| luminance(*pixel))
}

fn max_of(pixel: &[f64; 3]) -> f64 {
    pixel.iter().copied().fold(0.0, f64::max)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0u32);
    for value in values {
        sum += value;
        count += 1;
    }
    sum / f64::from(count.max(1))
}

fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}
