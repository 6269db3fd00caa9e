//! Adaptive sampling: each cell of 8 x 8 px takes samples until its error reaches the target.
//!
//! A cell takes aligned power-of-two blocks of one sequence: first 16 samples, then blocks that double the number.
//! The front (for I and T), the back (for I and R~) and R have separate sample counts. A part takes more samples while
//! its own layer (T, R~ or R) has an error above the target, or while I has one and the part causes most of it. The
//! decision uses only the cell's own samples, and cells lie on a fixed grid, so tiles and threads change no pixel.

use super::closed::ClosedForm;
use super::labels::{self, Ghosts};
use super::means::{Components, Means, PixelMeans, Wanted};
use super::scene::Scene;
use super::tile::{Tile, TileResult, patches};
use super::tracer::Tracer;
use glasshouse_line::layer::{Layer, PerLayer};

/// Side of a cell, px. Tiles of an adaptive scene begin at multiples of this length.
pub const CELL_PX: u32 = 8;

/// Number of samples in the first round, unless the scene has fewer.
const FIRST: u32 = 16;

/// A part of a cell with its own sample count.
#[derive(Clone, Copy)]
struct Part {
    samples: u32,
    goes_on: bool,
}

/// A cell: the means of its pixels, and the state of its front, back and R.
struct Cell {
    pixels: Vec<Components>,
    parts: [Part; 3],
}

/// Traces `tile` until the error of every cell in every layer is at most `target` (RMS over the cell, linear) or the
/// cell has taken all samples of the scene.
#[inline(always)]
pub(super) fn trace<const ISA: u8>(scene: &Scene, tile: Tile, target: f64) -> TileResult {
    assert!(
        tile.x.is_multiple_of(CELL_PX) && tile.y.is_multiple_of(CELL_PX),
        "tiles of an adaptive scene begin at multiples of {CELL_PX} px"
    );
    let closed = ClosedForm::new(scene, tile.columns(), tile.rows());
    let all = Wanted::of(scene.layers);
    let (mut closed_paths, mut closed_misses) = (0, 0);
    let mut tracer = Tracer::<ISA>::new(scene);
    let mut pixels = vec![PixelMeans::default(); (tile.width * tile.height) as usize];
    let mut labels = labels::of_tile(scene, tile, &(0..scene.spp));
    let mut ghosts = Ghosts::new(scene, pixels.len());
    let (mut samples, mut sums) = (PerLayer([0u32; 4]), PerLayer([0u64; 4]));
    for y in (0..tile.height).step_by(CELL_PX as usize) {
        for x in (0..tile.width).step_by(CELL_PX as usize) {
            let (width, height) = (CELL_PX.min(tile.width - x), CELL_PX.min(tile.height - y));
            let area = Tile { x: tile.x + x, y: tile.y + y, width, height };
            let closed = closed.as_ref().filter(|closed| {
                let corners = patches(area.y, height)
                    .flat_map(|y| patches(area.x, width).map(move |x| (x, y)));
                corners.into_iter().all(|corner| closed.has(scene, corner))
            });
            let wanted = Wanted { clean: all.clean && closed.is_none(), ..all };
            let mut cell = Cell::new(wanted, width * height);
            while cell.round(&mut tracer, scene, area, wanted) {
                cell.decide(scene, target);
            }
            for (q, components) in (0..).zip(&cell.pixels) {
                let (x, y) = (x + q % width, y + q / width);
                let index = (y * tile.width + x) as usize;
                pixels[index] = components.pixel(scene.layers);
                ghosts.set(index, components);
                if let Some(closed) = closed {
                    closed.write(index, &mut pixels[index]);
                    let [of_pixel, beyond] = closed.paths(index);
                    (closed_paths, closed_misses) =
                        (closed_paths + of_pixel, closed_misses + beyond);
                }
            }
            for (layer, &count) in cell.samples(scene, area).iter() {
                samples[layer] = samples[layer].max(count);
                sums[layer] += u64::from(count) * u64::from(width * height);
            }
        }
    }
    let (mut paths, mut misses) = tracer.counts();
    paths[Layer::CleanReflection] += closed_paths;
    misses[Layer::CleanReflection] += closed_misses;
    ghosts.join(&mut labels);
    TileResult { pixels, samples, sample_sums: Some(sums), paths, misses, labels }
}

impl Cell {
    fn new(wanted: Wanted, pixels: u32) -> Self {
        let parts = [wanted.front || wanted.bare, wanted.back, wanted.clean];
        Self {
            pixels: vec![Components::default(); pixels as usize],
            parts: parts.map(|goes_on| Part { samples: 0, goes_on }),
        }
    }

    /// Starts or doubles the samples of the unfinished parts with the fewest samples. Returns false if no part is left.
    #[inline(always)]
    fn round<const ISA: u8>(
        &mut self,
        tracer: &mut Tracer<ISA>,
        scene: &Scene,
        area: Tile,
        all: Wanted,
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
        let wanted = Wanted {
            front: now[0] && all.front,
            bare: now[0] && all.bare,
            back: now[1],
            clean: now[2],
        };
        let (count, is_first) = (range.end - range.start, fewest == 0);
        for (x, y) in patches(area.y, area.height)
            .flat_map(|y| patches(area.x, area.width).map(move |x| (x, y)))
        {
            let lanes = area.lanes((x, y));
            let components = tracer.patch((x, y), &lanes, &range, count, wanted);
            for (pixel, new) in lanes.into_iter().zip(components) {
                if let Some(pixel) = pixel {
                    self.pixels[pixel].add(new, wanted, is_first);
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

    /// Determines the parts that take more samples.
    fn decide(&mut self, scene: &Scene, target: f64) {
        let of = |layer: Layer| self.error(|c| c.layers()[layer]);
        let above = |layer: Layer| scene.layers[layer] && of(layer) > target;
        let is_input_above = above(Layer::Input);
        // For I, the part with the larger share of the error takes more samples.
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

    /// Estimates the RMS error of a mean over the cell: the larger estimate from the last two moves, at the convergence
    /// rate of independent samples, because so few pixels do not show the true rate (see
    /// [`super::means::square_error`]). The last move alone is sometimes small by chance.
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

    /// Returns the samples per pixel of each layer's strongest order.
    fn samples(&self, scene: &Scene, area: Tile) -> PerLayer<u32> {
        let [front, back, clean] = self.parts.map(|part| part.samples);
        let dimness = scene.zones.dimness((area.x, area.y), scene.orders.front.len());
        let thinning = scene.orders.back.first().map_or(1, |order| order.thinning(dimness));
        let taken = PerLayer([front.max(back), front, (back / thinning).max(1), clean]);
        PerLayer::of(|layer| taken[layer] * u32::from(scene.layers[layer]))
    }
}

impl Components {
    /// Adds the `wanted` components of as many new samples.
    fn add(&mut self, new: &Self, wanted: Wanted, is_first: bool) {
        for (total, new, is_new) in [
            (&mut self.front, &new.front, wanted.front),
            (&mut self.bare, &new.bare, wanted.bare),
            (&mut self.reflected, &new.reflected, wanted.back),
            (&mut self.back, &new.back, wanted.back),
            (&mut self.clean, &new.clean, wanted.clean),
            (&mut self.ghosts, &new.ghosts, wanted.back),
        ] {
            if is_new {
                *total = if is_first { *new } else { doubled(total, new) };
            }
        }
    }
}

/// Combines the means of the first n and of the second n samples into the means of 2n samples.
fn doubled([first, first_half, _]: &Means, [second, ..]: &Means) -> Means {
    let mean = [0, 1, 2, 3].map(|c| 0.5 * (first[c] + second[c]));
    [mean, *first, *first_half]
}
