//! Traces the pixels of a tile with the kernels of one instruction set.

use super::adaptive;
use super::closed::ClosedForm;
use super::isa::{AVX2, AVX512, BASELINE, Isa};
use super::labels::{self, Ghosts};
use super::lanes::LANES;
use super::means::{PixelMeans, Wanted};
use super::patch::PATCH_PX;
use super::sampler::BLOCK;
use super::scene::Scene;
use super::tracer::Tracer;
use glasshouse_line::label::LabelImages;
use glasshouse_line::layer::{Layer, PerLayer};
use std::ops::Range;

/// A rectangle of the film, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct Tile {
    pub x: u32,
    pub y: u32,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
}

impl Tile {
    pub(super) fn columns(&self) -> Range<u32> {
        self.x..self.x + self.width
    }

    pub(super) fn rows(&self) -> Range<u32> {
        self.y..self.y + self.height
    }

    /// Returns the indices of a patch's pixels in the tile's rows; `None` for pixels outside the tile.
    #[inline(always)]
    pub(super) fn lanes(&self, (x, y): (u32, u32)) -> [Option<usize>; LANES] {
        let mut lanes = [None; LANES];
        for (l, pixel) in (0..).zip(&mut lanes) {
            // The differences of pixels before the tile wrap around to large numbers.
            let column = (x + l % PATCH_PX).wrapping_sub(self.x);
            let row = (y + l / PATCH_PX).wrapping_sub(self.y);
            if column < self.width && row < self.height {
                *pixel = Some((row * self.width + column) as usize);
            }
        }
        lanes
    }
}

/// Returns the first columns (or rows) of the patches that cover `size` columns from `start` on.
pub(super) fn patches(start: u32, size: u32) -> impl Iterator<Item = u32> {
    (start / PATCH_PX * PATCH_PX..start + size).step_by(PATCH_PX as usize)
}

#[derive(Clone, Debug, PartialEq)]
pub struct TileResult {
    /// Pixels in row-major order.
    pub pixels: Vec<PixelMeans>,
    /// Samples per pixel of each layer's strongest order; in an adaptive scene, the largest number of any pixel. 0 if
    /// the scene does not request the layer; 0 for R if the range has no samples of R, or if R is in closed form: then
    /// the range that begins at sample 0 has it.
    pub samples: PerLayer<u32>,
    /// `samples` summed over the pixels, for an adaptive scene.
    pub sample_sums: Option<PerLayer<u64>>,
    /// Number of paths of each layer. In closed form, R has a fixed number for each pixel.
    pub paths: PerLayer<u64>,
    /// Number of paths of each layer that ended on the continuation of the border or hit no triangle of a mesh.
    pub misses: PerLayer<u64>,
    /// Requested labels that need tracing; the depth only in ranges that begin at sample 0.
    pub labels: LabelImages,
}

/// Traces `samples` of each pixel of `tile`: an aligned power-of-two block, or in an adaptive scene up to all samples.
///
/// This is a pure function: the bits of a pixel do not depend on the tile's shape, `isa`, thread, time or machine.
/// Panics if the tile leaves the film, begins inside a cell of an adaptive scene, or `samples` is another range.
pub fn trace_tile(scene: &Scene, tile: Tile, samples: Range<u32>, isa: Isa) -> TileResult {
    assert!(
        tile.x + tile.width <= scene.film.width && tile.y + tile.height <= scene.film.height,
        "tile outside the film"
    );
    let count = samples.end - samples.start;
    assert!(
        count.is_power_of_two() && samples.start.is_multiple_of(count),
        "samples must be an aligned block"
    );
    #[cfg(target_arch = "x86_64")]
    #[allow(unsafe_code, reason = "calling functions compiled for AVX2 and AVX-512")]
    if isa.is_available() {
        match isa {
            // SAFETY: this machine has AVX-512.
            Isa::Avx512 => return unsafe { trace_avx512(scene, tile, samples) },
            // SAFETY: this machine has AVX2.
            Isa::Avx2 => return unsafe { trace_avx2(scene, tile, samples) },
            Isa::Baseline => {}
        }
    }
    trace::<BASELINE>(scene, tile, samples)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn trace_avx2(scene: &Scene, tile: Tile, samples: Range<u32>) -> TileResult {
    trace::<AVX2>(scene, tile, samples)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq,avx512bw")]
fn trace_avx512(scene: &Scene, tile: Tile, samples: Range<u32>) -> TileResult {
    trace::<AVX512>(scene, tile, samples)
}

#[inline(always)]
fn trace<const ISA: u8>(scene: &Scene, tile: Tile, samples: Range<u32>) -> TileResult {
    if let Some(target) = scene.target_error {
        assert!(samples == (0..scene.spp), "an adaptive scene is not cut into ranges of samples");
        return adaptive::trace::<ISA>(scene, tile, target);
    }
    let closed = ClosedForm::new(scene, tile.columns(), tile.rows());
    let all = Wanted::of(scene.layers);
    let count = samples.end - samples.start;
    let clean = scene.orders.clean_spp(scene.spp).clamp(samples.start, samples.end) - samples.start;
    let is_all_closed = closed.as_ref().is_some_and(ClosedForm::is_all);
    let mut tracer = Tracer::<ISA>::new(scene);
    let mut pixels = vec![PixelMeans::default(); (tile.width * tile.height) as usize];
    let mut labels = labels::of_tile(scene, tile, &samples);
    let mut ghosts = Ghosts::new(scene, pixels.len());
    let (mut closed_paths, mut closed_misses) = (0, 0);
    for y in patches(tile.y, tile.height) {
        for x in patches(tile.x, tile.width) {
            let lanes = tile.lanes((x, y));
            let closed = closed.as_ref().filter(|closed| closed.has(scene, (x, y)));
            let wanted = Wanted { clean: all.clean && closed.is_none(), ..all };
            let components = tracer.patch((x, y), &lanes, &samples, clean, wanted);
            for (pixel, components) in lanes.into_iter().zip(components) {
                if let Some(pixel) = pixel {
                    pixels[pixel] = components.pixel(scene.layers);
                    ghosts.set(pixel, components);
                    // Where a part of R is sampled, each range with samples of R has the closed form of the other pixels.
                    let Some(closed) = closed else { continue };
                    if samples.start == 0 || (!is_all_closed && clean > 0) {
                        closed.write(pixel, &mut pixels[pixel]);
                    }
                    if samples.start == 0 {
                        let [of_pixel, beyond] = closed.paths(pixel);
                        (closed_paths, closed_misses) =
                            (closed_paths + of_pixel, closed_misses + beyond);
                    }
                }
            }
        }
    }
    let (mut paths, mut misses) = tracer.counts();
    paths[Layer::CleanReflection] += closed_paths;
    misses[Layer::CleanReflection] += closed_misses;
    let block = count.min(BLOCK as u32);
    let strongest = scene.orders.back.first();
    let reflected = strongest.map_or(count, |o| {
        o.samples_of_block(block, scene.zones.least(scene.orders.front.len())) * (count / block)
    });
    let clean = if is_all_closed { 0 } else { clean };
    let taken = PerLayer([count, count, reflected, clean]);
    ghosts.join(&mut labels);
    TileResult {
        pixels,
        samples: PerLayer::of(|layer| taken[layer] * u32::from(scene.layers[layer])),
        sample_sums: None,
        paths,
        misses,
        labels,
    }
}
