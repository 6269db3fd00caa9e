//! The estimator: one pixel's samples as one bundle, four layers from the same camera samples.
//!
//! ```text
//! camera sample s = (film point, lens point)                       -> ray
//! T  = mean over s of F(t_0 line)                                  (virtual glass: bent, weight 1)
//! F_ = sum over orders k of mean over s of weight_k(s) F(t_k line)
//! R~ = sum over orders k of mean over s of weight_k(s) B(r_k line)
//! I  = F_ + R~
//! R  = mean over film points of B(mirrored pinhole ray)            (no glass, no lens)
//! ```
//!
//! F and B are the photographs' radiances where the line first meets their sheet (or mesh): a path ends there, because
//! the photograph's radiance is what leaves the surface (the paper's Eq. 1), so there is no other transport.

use super::camera::{CameraBlock, Pixel};
use super::lanes::LANES;
use super::lines::{LineMaker, Path};
use super::mesh;
use super::orders::FollowedOrder;
use super::sampler::BLOCK;
use super::scene::{Scene, Surface};
use super::shade::{Cells, Sums, TexelMap, Weights, absorbed, weights};
use super::slab::Order;
use super::walk::walk;
use std::ops::Range;

/// Linear radiance of a pixel in the four layers: I, T, R~, R.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelMeans {
    /// Mean over all of the range's samples.
    pub mean: [[f32; 3]; 4],
    /// Mean over the first half of them: half the difference to the whole's other half is the error estimate.
    pub half: [[f32; 3]; 4],
}

/// Sums of both halves; nothing yet.
const NOTHING: Sums = [[0.0; 3]; 2];

/// Traces pixels of a scene and counts paths.
///
/// `AVX2` chooses kernels and is only set inside a function that is compiled for AVX2.
pub(super) struct Tracer<'a, const AVX2: bool> {
    scene: &'a Scene,
    samples: Range<u32>,
    /// Samples of R's share of the sequence that fall into the range.
    clean: u32,
    camera: Box<CameraBlock>,
    front: Vec<Sums>,
    back: Vec<Sums>,
    paths: [u64; 4],
    misses: [u64; 4],
}

/// One order (or R's pinhole path) with one block of samples.
struct Bundle<'a> {
    surface: &'a Surface,
    path: Path,
    order: Option<Order>,
    /// Samples, the first of the block.
    count: u32,
    /// Those of them that belong to the first half of the pixel's samples.
    half: u32,
}

impl<'a, const AVX2: bool> Tracer<'a, AVX2> {
    pub(super) fn new(scene: &'a Scene, samples: Range<u32>) -> Self {
        let clean = scene
            .orders
            .clean_spp(scene.spp)
            .clamp(samples.start, samples.end)
            - samples.start;
        Self {
            scene,
            samples,
            clean,
            camera: CameraBlock::new(),
            front: vec![NOTHING; scene.orders.front.len()],
            back: vec![NOTHING; scene.orders.back.len()],
            paths: [0; 4],
            misses: [0; 4],
        }
    }

    /// Samples, paths and missed paths of the layers.
    pub(super) fn counts(self) -> ([u32; 4], [u64; 4], [u64; 4]) {
        let n = self.samples.end - self.samples.start;
        let block = n.min(BLOCK as u32);
        let strongest = self.scene.orders.back.first();
        let reflected = strongest.map_or(n, |order| order.samples_of_block(block) * (n / block));
        ([n, n, reflected, self.clean], self.paths, self.misses)
    }

    /// The four layers of pixel (`x`, `y`).
    #[inline(always)]
    pub(super) fn pixel(&mut self, x: u32, y: u32) -> PixelMeans {
        let scene = self.scene;
        let pixel = Pixel::new(scene, x, y);
        let count = self.samples.end - self.samples.start;
        let block_samples = count.min(BLOCK as u32);
        let blocks = count / block_samples;
        let mut transmission = NOTHING;
        let mut clean = NOTHING;
        self.front.fill(NOTHING);
        self.back.fill(NOTHING);
        for b in 0..blocks {
            self.camera.fill(
                scene,
                &pixel,
                self.samples.start + b * block_samples,
                block_samples,
            );
            for k in 0..scene.orders.front.len() + scene.orders.back.len() {
                let (list, surface, k) = match k.checked_sub(scene.orders.front.len()) {
                    None => (&scene.orders.front, &scene.front, k),
                    Some(k) => (&scene.orders.back, &scene.back, k),
                };
                let followed = &list[k];
                let n = followed.samples_of_block(block_samples);
                // The first half of the samples: whole blocks, or the first half of the only one.
                let half = if blocks == 1 {
                    n / 2
                } else {
                    n * u32::from(b < blocks / 2)
                };
                let bundle = Bundle {
                    surface,
                    path: self.path(followed),
                    order: Some(followed.order),
                    count: n,
                    half,
                };
                let (sums, misses) = self.follow(&pixel, &bundle, &mut transmission);
                self.count_paths(Some(followed.order), n, misses);
                let total = match followed.order {
                    Order::Transmitted(_) => &mut self.front[k],
                    Order::Reflected(_) => &mut self.back[k],
                };
                for (total, part) in total.iter_mut().flatten().zip(sums.iter().flatten()) {
                    *total += part;
                }
            }
            let n = self
                .clean
                .saturating_sub(b * block_samples)
                .min(block_samples);
            if n > 0 {
                let half = (self.clean / 2).saturating_sub(b * block_samples).min(n);
                let bundle = Bundle {
                    surface: &scene.back,
                    path: Path::Pinhole,
                    order: None,
                    count: n,
                    half,
                };
                let (sums, misses) = self.follow(&pixel, &bundle, &mut transmission);
                self.count_paths(None, n, misses);
                for (total, part) in clean.iter_mut().flatten().zip(sums.iter().flatten()) {
                    *total += part;
                }
            }
        }
        self.means(&transmission, &clean, block_samples, blocks)
    }

    /// Shift of an order's lines as a linear function of gamma.
    fn path(&self, followed: &FollowedOrder) -> Path {
        let constant = self.scene.slab.kappa_m(followed.order, 0.0);
        Path::Lens {
            constant,
            slope: self.scene.slab.kappa_m(followed.order, 1.0) - constant,
        }
    }

    /// Sums of one bundle's weighted radiance, and its missed paths. Order t_0 also feeds `transmission`.
    #[inline(always)]
    fn follow(&mut self, pixel: &Pixel, bundle: &Bundle, transmission: &mut Sums) -> (Sums, u64) {
        let (scene, camera) = (self.scene, &*self.camera);
        let view = match bundle.surface {
            Surface::Sheet(view) => view,
            Surface::Mesh(mesh) => {
                let (what, range) = ((bundle.path, bundle.order), (bundle.count, bundle.half));
                return mesh::follow(scene, mesh, (pixel, camera), what, range, transmission);
            }
        };
        let groups = (bundle.count as usize).div_ceil(LANES);
        let maker = LineMaker::new(scene, view, pixel, bundle.path);
        let mut span = None;
        if !maker.is_fixed() {
            span = Some(maker.span(scene, pixel, camera, groups));
        }
        let inside = span.is_some_and(|s| s.inside);
        let map = TexelMap::new(view, maker.base);
        let mut sums = NOTHING;
        let mut unused = NOTHING;
        let mut misses = 0;
        for g in 0..groups {
            let lines = maker.lines(camera, g);
            let (mut u, mut v) = (lines.x, lines.y);
            if let Some(span) = span {
                let w = walk::<AVX2>(&view.grid, maker.base, &lines, span);
                for l in 0..LANES {
                    u[l] = lines.x[l] + lines.sx[l] * w[l];
                    v[l] = lines.y[l] + lines.sy[l] * w[l];
                }
            }
            let count = (bundle.count as usize - g * LANES).min(LANES);
            let half = (bundle.half as usize).saturating_sub(g * LANES).min(count);
            if !inside {
                misses += view.count_outside(maker.base, &u[..count], &v[..count]);
            }
            let cells = Cells::new(&map, &u, &v);
            let texture = &view.texture;
            let Some(order) = bundle.order else {
                cells.add_halves::<AVX2, false>(
                    texture,
                    count,
                    half,
                    &Weights::One,
                    &mut sums,
                    &mut unused,
                );
                continue;
            };
            let slab = &scene.slab;
            let [rs, rp] = &camera.reflectance;
            let [ts, tp] = &camera.transmittance;
            let weight = weights(order, [&rs[g], &rp[g]], [&ts[g], &tp[g]]);
            let colour;
            let weights = if slab.absorbs() {
                let optical_depth = |a: f64| (a * slab.thickness_m) as f32;
                colour = slab
                    .absorption_per_m
                    .map(|a| absorbed(&weight, order, optical_depth(a), &camera.inverse_cos_t[g]));
                Weights::Colour(&colour)
            } else {
                Weights::Grey(&weight)
            };
            if order == Order::Transmitted(0) {
                cells.add_halves::<AVX2, true>(
                    texture,
                    count,
                    half,
                    &weights,
                    &mut sums,
                    transmission,
                );
            } else {
                cells.add_halves::<AVX2, false>(
                    texture,
                    count,
                    half,
                    &weights,
                    &mut sums,
                    &mut unused,
                );
            }
        }
        (sums, misses)
    }

    fn count_paths(&mut self, order: Option<Order>, paths: u32, misses: u64) {
        let layers: &[usize] = match order {
            Some(Order::Transmitted(0)) => &[0, 1],
            Some(Order::Transmitted(_)) => &[0],
            Some(Order::Reflected(_)) => &[0, 2],
            None => &[3],
        };
        for &layer in layers {
            self.paths[layer] += u64::from(paths);
            self.misses[layer] += misses;
        }
    }

    /// Means of the layers from the sums of the orders, each divided by its own samples.
    #[inline(always)]
    fn means(
        &self,
        transmission: &Sums,
        clean: &Sums,
        block_samples: u32,
        blocks: u32,
    ) -> PixelMeans {
        let orders = &self.scene.orders;
        let sum_of = |list: &[FollowedOrder], sums: &[Sums]| {
            let mut total = NOTHING;
            for (followed, sums) in list.iter().zip(sums) {
                let means = means_of(sums, followed.samples_of_block(block_samples) * blocks);
                for (total, mean) in total.iter_mut().flatten().zip(means.iter().flatten()) {
                    *total += mean;
                }
            }
            total
        };
        let front = sum_of(&orders.front, &self.front);
        let back = sum_of(&orders.back, &self.back);
        let input = [0, 1].map(|part| [0, 1, 2].map(|c| front[part][c] + back[part][c]));
        let bare = means_of(transmission, block_samples * blocks);
        let pinhole = if self.clean > 0 {
            means_of(clean, self.clean)
        } else {
            NOTHING
        };
        let layers = [input, bare, back, pinhole];
        PixelMeans {
            mean: layers.map(|layer| layer[0].map(|v| v as f32)),
            half: layers.map(|layer| layer[1].map(|v| v as f32)),
        }
    }
}

/// `[mean, mean of the first half]` of `count` samples (of a single one, the same twice).
fn means_of(sums: &Sums, count: u32) -> [[f64; 3]; 2] {
    let mean = [0, 1, 2].map(|c| (sums[0][c] + sums[1][c]) / f64::from(count));
    let half = match count / 2 {
        0 => mean,
        half => sums[0].map(|v| v / f64::from(half)),
    };
    [mean, half]
}
