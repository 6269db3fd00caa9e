//! Finds the zones of a scene.

use super::super::camera::survey;
use super::super::cover::Card;
use super::super::groups::lists;
use super::super::lanes::{CHUNK, LANES};
use super::super::lines::{Path, points};
use super::super::orders::FollowedOrder;
use super::super::rough::Forms;
use super::super::scene::{Pose, Scene, Surface, View};
use super::super::slab::Order;
use super::{ZONE_PX, Zones};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// Share by which the bounds of rays are wider than those of the rays that are tried, on either side.
const MARGIN: f32 = 0.5;
/// Share of the rays behind facets that are left out on either side of the bounds.
const RARE: f64 = 1.0 / 512.0;

/// Largest dimness, at which even the brightest lights are dark.
const MOST_DIMNESS: u8 = 40;

/// Bounds `[least, most]` of the rays of an order: directions relative to the centres of their pixels, tangents, and points in the plane z = 0, m, across and down.
#[derive(Clone, Copy)]
struct Spread {
    direction: [[f64; 2]; 2],
    point: [[f64; 2]; 2],
}

impl Scene {
    /// Joins orders whose lines are close (see [`Scene::join_orders`]), and finds the zones of the scene.
    pub fn finish_orders(&mut self, nearest_m: f64, max_radiance: [f64; 2], tolerance: f64) {
        self.join_orders(nearest_m, max_radiance, tolerance);
        self.find_zones(max_radiance);
    }

    /// Finds the zones of the scene, whose orders are planned for these largest radiances of front and back.
    pub fn find_zones(&mut self, max_radiance: [f64; 2]) {
        self.zones = Zones { forms: Forms::new(&self.film), ..Zones::default() };
        let orders: Vec<FollowedOrder> =
            lists(self).into_iter().flatten().map(|(of, _)| of).collect();
        let gains = |of: &FollowedOrder, d: u8| of.thinning(d.into()) > of.thinning(0);
        if !orders.iter().any(|of| gains(of, MOST_DIMNESS)) {
            return;
        }
        let spreads = self.spreads();
        let [columns, rows] = [self.film.width, self.film.height].map(|px| px.div_ceil(ZONE_PX));
        let mut zones = Zones { columns, ..std::mem::take(&mut self.zones) };
        let mut kinds = BTreeMap::new();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)))
        {
            let corner = [column, row].map(|v| v * ZONE_PX);
            let dimness: Vec<u8> = orders
                .iter()
                .zip(&spreads)
                .map(|(of, spread)| {
                    let Some(spread) = spread.as_ref().filter(|_| gains(of, MOST_DIMNESS)) else {
                        return 0;
                    };
                    let side = usize::from(matches!(of.order, Order::Reflected(_)));
                    let most = max_radiance[side];
                    let light = self.brightest_of(side, corner, spread).unwrap_or(most);
                    let is_darker = |d: &u8| light <= most / (2u64 << d) as f64;
                    let dimness = (0..MOST_DIMNESS).take_while(is_darker).count() as u8;
                    // The least with as many samples, so that there are few kinds of zones.
                    (0..dimness)
                        .find(|d| of.thinning((*d).into()) == of.thinning(dimness.into()))
                        .unwrap_or(dimness)
                })
                .collect();
            let next = kinds.len();
            zones.kinds.push(*kinds.entry(dimness).or_insert_with_key(|dimness| {
                zones.dimness.push(dimness.clone());
                next
            }));
        }
        self.zones = zones;
    }

    /// Bounds the rays of all orders, in turn; `None` for those without light.
    fn spreads(&self) -> Vec<Option<Spread>> {
        let normal = self.slab.normal.as_vec3().to_array();
        let paths: Vec<Path<'_>> =
            lists(self).into_iter().flatten().map(|(_, path)| path).collect();
        // Directions and points of each order's rays, one list for each axis.
        let mut rays = vec![[const { Vec::<f32>::new() }; 4]; paths.len()];
        survey(self, self.rough.as_ref(), self.smeared.as_ref(), |patch, camera| {
            for (path, lists) in paths.iter().zip(&mut rays) {
                let light = match *path {
                    Path::Rough(way) => Some(camera.rough.weights(way)),
                    Path::Smeared(way) => Some(camera.smeared.weights(way)),
                    _ => None,
                };
                for s in 0..CHUNK {
                    let free = path.free_rays(&self.slab, patch, camera, s);
                    let [direction, point] = if let Some(rays) = free {
                        [rays.relative, rays.point]
                    } else {
                        let direction = [0, 1].map(|k| camera.direction[k][s]);
                        [direction, points(*path, &patch.center, normal, camera, s)]
                    };
                    for l in 0..LANES {
                        // Rays without light lead anywhere.
                        if light.is_none_or(|of| of.iter().any(|of| of[s][l] > 0.0)) {
                            let ray = [direction[0][l], direction[1][l], point[0][l], point[1][l]];
                            lists.iter_mut().zip(ray).for_each(|(list, v)| list.push(v));
                        }
                    }
                }
            }
        });
        rays.into_iter()
            .zip(&paths)
            .map(|(lists, path)| {
                let share =
                    if matches!(path, Path::Rough(_) | Path::Smeared(_)) { RARE } else { 0.0 };
                let [x, y, px, py] = lists.map(|list| bounds(list, share));
                Some(Spread { direction: [x?, y?], point: [px?, py?] })
            })
            .collect()
    }

    /// Bounds the radiance that the rays of a zone meet on a side; `None` if it may be any.
    fn brightest_of(&self, side: usize, corner: [u32; 2], spread: &Spread) -> Option<f64> {
        let Surface::Sheet(view) = [&self.front, &self.back][side] else { return None };
        let [x, y] = corner.map(f64::from);
        let last = [self.film.width, self.film.height];
        let [right, down] = [0, 1].map(|k| f64::from((corner[k] + ZONE_PX).min(last[k])) - 0.5);
        let (first, last) = (self.film.tangent(x + 0.5, y + 0.5), self.film.tangent(right, down));
        let direction = [0, 1].map(|k| {
            let [least, most] = spread.direction[k];
            [first[k] + least, last[k] + most]
        });
        let texels = texels_of(view, direction, spread.point)?;
        let of_surface = view.texture.max_between(texels[0], texels[1]);
        let of_cards = self.cover.cards[side].iter().map(Card::max_radiance);
        Some(f64::from(of_cards.fold(of_surface, f32::max)))
    }
}

/// Bounds the numbers of a list with a margin, without a share of `rare` ones at either end; `None` if the list is empty.
fn bounds(mut list: Vec<f32>, rare: f64) -> Option<[f64; 2]> {
    let last = list.len().checked_sub(1)?;
    let skipped = (rare * last as f64) as usize;
    let [least, most] =
        [skipped, last - skipped].map(|k| *list.select_nth_unstable_by(k, f32::total_cmp).1);
    let margin = MARGIN * (most - least);
    Some([least - margin, most + margin].map(f64::from))
}

/// Bounds the texel coordinates, across and down, at which rays with directions and points between these bounds meet the sheet of a view; `None` if one
/// may leave to the side or backwards. A projection keeps convex hulls.
fn texels_of(view: &View, direction: [[f64; 2]; 2], point: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let (rotation, translation_m) = match &view.pose {
        Pose::Aligned { extra_m } => (DMat3::IDENTITY, DVec3::new(0.0, 0.0, -extra_m)),
        Pose::General { rotation, translation_m } => (*rotation, *translation_m),
    };
    let texels = [view.texture.width(), view.texture.height()].map(|n| n as f64);
    let vertices = [view.photograph_size.0, view.photograph_size.1].map(|n| n as f64);
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    let corner = |of: [[f64; 2]; 2], c: usize| [of[0][c % 2], of[1][c / 2]];
    for (d, p) in (0..16).map(|c| (corner(direction, c % 4), corner(point, c / 4))) {
        let along = rotation * DVec3::new(d[0], d[1], 1.0);
        let start = rotation * DVec3::new(p[0], p[1], 0.0) + translation_m;
        if along.z < 0.05 * along.length() {
            return None;
        }
        let far = along.truncate() / along.z;
        for w_per_m in view.grid.extremes().map(f64::from) {
            let at = far + w_per_m * (start.truncate() - start.z * far);
            for (k, v) in at.to_array().into_iter().enumerate() {
                let vertex = view.focal_px[k] * v + view.principal[k];
                let texel = (vertex + 0.5) * texels[k] / vertices[k] - 0.5;
                bounds[k] = [bounds[k][0].min(texel), bounds[k][1].max(texel)];
            }
        }
    }
    Some(bounds)
}
