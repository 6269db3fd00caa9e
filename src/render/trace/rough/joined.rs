//! Orders whose lines lie close together over the film become one.
//!
//! A path joins a stronger one of its side if that costs less than the film's tolerance: with the distance d of their lines on the
//! film, px, at most 0.05, its weight w, and the largest radiance L of the side, which is above the difference of any two
//! neighbouring texels,
//!
//! ```text
//! d w L < tolerance
//! ```
//!
//! The order of both has their mean line, weighted by their light, and takes the light of both. It moves light by 2 d w L at most, which
//! the plan adds to the light that is misplaced. t_0 stays alone, because it is what T sees, and so does r_0 if R~ is asked for with
//! it alone. Distances are measured along the rays that the tracer follows, so that they include waves, wedges and facets.

use super::super::camera::survey;
use super::super::lanes::{CHUNK, LANES};
use super::super::scene::Scene;
use super::RoughPane;

/// Largest distance, px.
const MOST_PX: f32 = 0.05;
/// Factor by which the distance of rays that are not tried may exceed that of those that are.
const SAFETY: f32 = 1.5;

impl Scene {
    /// Joins paths of a pane with rough or turned faces whose lines are close for all surfaces at `nearest_m` or more from the lens, and
    /// plans the orders anew, for the largest radiances of the front and the back and the film's tolerance.
    pub fn join_orders(&mut self, nearest_m: f64, max_radiance: [f64; 2], tolerance: f64) {
        let Some(pane) = self.rough.as_ref().filter(|_| tolerance > 0.0) else { return };
        let lines = self.lines(pane, nearest_m as f32);
        let all = pane.paths.len();
        let of_front = pane.joined.ways.iter().filter(|way| **way < pane.joined.of_front).count();
        let (mut orders, mut moved) = (vec![0; all], [0.0; 2]);
        for (side, paths) in [0..of_front, of_front..all].into_iter().enumerate() {
            let stays_alone =
                |path: usize| path == paths.start && (side == 0 || self.first_reflection_alone);
            let weight = |path: usize| pane.light.max_weights[path];
            let mut by_weight: Vec<usize> = paths.clone().collect();
            by_weight.sort_by(|a, b| weight(*b).total_cmp(&weight(*a)).then(a.cmp(b)));
            // Paths that others join, and the one that each path joins.
            let mut strong: Vec<usize> = vec![];
            let mut joins: Vec<usize> = (0..all).collect();
            for path in by_weight {
                let cost_per_px = weight(path) * max_radiance[side];
                let most_px = MOST_PX.min((tolerance / cost_per_px) as f32);
                let close = strong.iter().filter(|_| !stays_alone(path)).find_map(|other| {
                    let apart_px =
                        SAFETY * distance_px(&lines[path], &lines[*other], most_px / SAFETY)?;
                    Some((*other, apart_px))
                });
                match close {
                    Some((other, apart_px)) => {
                        joins[path] = other;
                        moved[side] += 2.0 * f64::from(apart_px) * cost_per_px;
                    }
                    None if stays_alone(path) => {}
                    None => strong.push(path),
                }
            }
            // Orders come as their strongest paths do.
            for (order, path) in paths.clone().filter(|path| joins[*path] == *path).enumerate() {
                orders[path] = order;
            }
            for path in paths {
                orders[path] = orders[joins[path]];
            }
        }
        if let Some(pane) = &mut self.rough {
            pane.join(orders.split_at(of_front).into(), moved);
            self.orders = pane.plan(max_radiance, tolerance);
        }
    }

    /// Follows rays from all over the film along the paths of a pane. Returns for each where the rays are on the film, px: as
    /// those of points at infinity, and of the surface at `nearest_m`. Rays without light have no numbers.
    fn lines(&self, pane: &RoughPane, nearest_m: f32) -> Vec<Vec<[f32; 4]>> {
        let mut lines = vec![vec![]; pane.paths.len()];
        let pixel = self.film.pixel_tangent().map(|tangent| tangent as f32);
        survey(self, Some(pane), None, |_, camera| {
            for (way, lines) in pane.joined.ways.iter().zip(&mut lines) {
                let weights = camera.rough.weights(*way);
                let colours = if camera.rough.is_coloured { 3 } else { 1 };
                for s in 0..CHUNK {
                    let rays = camera.rough.rays(*way, s);
                    for l in 0..LANES {
                        let [far_x, far_y] = [0, 1].map(|k| rays.relative[k][l] / pixel[k]);
                        let at = |k: usize| rays.point[k][l] / (nearest_m * pixel[k]);
                        let near = [far_x + at(0), far_y + at(1)];
                        let line = [far_x, far_y, near[0], near[1]];
                        let has_light = weights[..colours].iter().any(|of| of[s][l] > 0.0);
                        lines.push(if has_light { line } else { [f32::NAN; 4] });
                    }
                }
            }
        });
        lines
    }
}

/// Returns the largest distance of two paths' lines, px, of rays that both have; `None` if one is above `most_px`, or if they have no
/// ray in common.
fn distance_px(one: &[[f32; 4]], other: &[[f32; 4]], most_px: f32) -> Option<f32> {
    let (mut largest, mut is_known) = (0.0f32, false);
    for (a, b) in one.iter().zip(other) {
        // Between the surface and infinity, the distance lies below the larger of both.
        for [x, y] in [[0, 1], [2, 3]].map(|of| of.map(|k: usize| a[k] - b[k])) {
            let square = x * x + y * y;
            if square > most_px * most_px {
                return None;
            }
            largest = largest.max(square);
            is_known |= square >= 0.0;
        }
    }
    is_known.then(|| largest.sqrt())
}
