//! Adaptive sampling: each cell of 8 x 8 pixels takes samples until its error is below the target.
//!
//! A cell takes aligned power-of-two blocks of one sequence: 16 samples, then as many again, and again. The front
//! through the glass (with T), the back seen in it, and R each have their own count, and each goes on while a layer that
//! it is part of is above the target. The decision rests on the cell's own samples alone, and cells lie on a fixed grid
//! of the film: so pixels depend on neither tiles nor threads nor order.

use super::bundle::Tracer;
use super::means::{Components, Means, NOTHING, PixelMeans, Wanted};
use super::scene::Scene;
use super::tile::{Tile, TileResult};
use crate::layer::{Layer, PerLayer};

/// Side of a cell, px. Tiles of an adaptive scene begin at multiples of it.
pub const CELL_PX: u32 = 8;

/// Samples of the first round.
const FIRST: u32 = 16;

/// One of the parts with a sample count of its own.
#[derive(Clone, Copy)]
struct Part {
    samples: u32,
    goes_on: bool,
}

/// A cell's state: its pixels' means, and how far each part has come.
struct Cell {
    pixels: Vec<Components>,
    parts: [Part; 3],
}

/// Traces `tile` until every cell's error in every layer is at most `target` (RMS over the cell, linear), or the scene's
/// samples are spent.
#[inline(always)]
pub(super) fn trace<const AVX2: bool>(scene: &Scene, tile: Tile, target: f64) -> TileResult {
    assert!(
        tile.x.is_multiple_of(CELL_PX) && tile.y.is_multiple_of(CELL_PX),
        "tiles of an adaptive scene begin at multiples of {CELL_PX} px"
    );
    let mut tracer = Tracer::<AVX2>::new(scene);
    let mut pixels = vec![PixelMeans::default(); (tile.width * tile.height) as usize];
    let (mut samples, mut sums) = (PerLayer([0u32; 4]), PerLayer([0u64; 4]));
    for y in (0..tile.height).step_by(CELL_PX as usize) {
        for x in (0..tile.width).step_by(CELL_PX as usize) {
            let (width, height) = (CELL_PX.min(tile.width - x), CELL_PX.min(tile.height - y));
            let at = |q: u32| (x + q % width, y + q / width);
            let mut cell = Cell::new(scene, width * height);
            while cell.round(&mut tracer, scene, &|q| {
                let (x, y) = at(q);
                (tile.x + x, tile.y + y)
            }) {
                cell.decide(scene, target);
            }
            for (q, components) in cell.pixels.iter().enumerate() {
                let (x, y) = at(q as u32);
                pixels[(y * tile.width + x) as usize] = components.pixel(scene.layers);
            }
            for (layer, &count) in cell.samples(scene).iter() {
                samples[layer] = samples[layer].max(count);
                sums[layer] += u64::from(count) * u64::from(width * height);
            }
        }
    }
    let (paths, misses) = tracer.counts();
    TileResult { pixels, samples, sample_sums: Some(sums), paths, misses }
}

impl Cell {
    fn new(scene: &Scene, pixels: u32) -> Self {
        let wanted = Wanted::of(scene.layers);
        let parts = [wanted.front || wanted.bare, wanted.back, wanted.clean];
        let nothing = Components {
            front: NOTHING,
            bare: NOTHING,
            reflected: NOTHING,
            back: NOTHING,
            clean: NOTHING,
        };
        Self {
            pixels: vec![nothing; pixels as usize],
            parts: parts.map(|goes_on| Part { samples: 0, goes_on }),
        }
    }

    /// Doubles the samples of the parts that go on and have the fewest; false when none goes on.
    #[inline(always)]
    fn round<const AVX2: bool>(
        &mut self,
        tracer: &mut Tracer<AVX2>,
        scene: &Scene,
        at: &impl Fn(u32) -> (u32, u32),
    ) -> bool {
        let waiting = self.parts.iter().filter(|part| part.goes_on);
        let Some(fewest) = waiting.map(|part| part.samples).min() else {
            return false;
        };
        let range = match fewest {
            0 => 0..FIRST.min(scene.spp),
            n => n..2 * n,
        };
        let now = self.parts.map(|part| part.goes_on && part.samples == fewest);
        let all = Wanted::of(scene.layers);
        let wanted = Wanted {
            front: now[0] && all.front,
            bare: now[0] && all.bare,
            back: now[1],
            clean: now[2],
        };
        for (q, pixel) in self.pixels.iter_mut().enumerate() {
            let count = range.end - range.start;
            let new = tracer.pixel(at(q as u32), &range, count, wanted);
            let is_first = fewest == 0;
            for (total, new, is_new) in [
                (&mut pixel.front, new.front, wanted.front),
                (&mut pixel.bare, new.bare, wanted.bare),
                (&mut pixel.reflected, new.reflected, wanted.back),
                (&mut pixel.back, new.back, wanted.back),
                (&mut pixel.clean, new.clean, wanted.clean),
            ] {
                if is_new {
                    *total = if is_first { new } else { doubled(total, &new) };
                }
            }
        }
        for (part, now) in self.parts.iter_mut().zip(now) {
            if now {
                part.samples = range.end;
            }
        }
        true
    }

    /// Which parts go on.
    fn decide(&mut self, scene: &Scene, target: f64) {
        let of = |layer: Layer| self.error(|c| c.layers()[layer]);
        let above = |layer: Layer| scene.layers[layer] && of(layer) > target;
        let is_input_above = above(Layer::Input);
        // I goes on in the part with the larger share of its error.
        let (front, back) = (self.error(|c| c.front), self.error(|c| c.reflected));
        let go_on = [
            above(Layer::Transmission) || (is_input_above && front >= back),
            above(Layer::GlassReflection) || (is_input_above && back > front),
            above(Layer::CleanReflection),
        ];
        for (part, go_on) in self.parts.iter_mut().zip(go_on) {
            part.goes_on = go_on && part.samples < scene.spp;
        }
    }

    /// RMS error of one of the means over the cell: the larger estimate of its last two moves, if the error falls like
    /// that of independent samples. (See [`super::means::square_error`]; so few pixels do not show its rate.) The last
    /// move alone is sometimes small by chance, and the cell would stop too early.
    fn error(&self, means: impl Fn(&Components) -> Means) -> f64 {
        let (mut last, mut before) = (0.0, 0.0);
        for pixel in &self.pixels {
            let [mean, half, quarter] = means(pixel);
            for c in 0..3 {
                last += (half[c] - mean[c]) * (half[c] - mean[c]);
                before += (quarter[c] - half[c]) * (quarter[c] - half[c]);
            }
        }
        let square = f64::max(last, 0.5 * before);
        (square / (3 * self.pixels.len()) as f64).sqrt()
    }

    /// Samples a pixel of each layer's strongest order.
    fn samples(&self, scene: &Scene) -> PerLayer<u32> {
        let [front, back, clean] = self.parts.map(|part| part.samples);
        let thinning = scene.orders.back.first().map_or(1, |order| order.thinning);
        let taken = PerLayer([front.max(back), front, (back / thinning).max(1), clean]);
        PerLayer::of(|layer| taken[layer] * u32::from(scene.layers[layer]))
    }
}

/// Means of 2n samples from those of the first and of the second n.
fn doubled([first, first_half, _]: &Means, [second, ..]: &Means) -> Means {
    let mean = [0, 1, 2].map(|c| 0.5 * (first[c] + second[c]));
    [mean, *first, *first_half]
}
