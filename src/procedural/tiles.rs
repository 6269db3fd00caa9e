//! Binning of the outlines of solids into tiles of the picture.

use super::camera::{Camera, Ray};
use super::shape::Solid;
use glam::Vec3;

/// Side of a tile, px.
pub(super) const TILE: usize = 16;
/// Distance of the near plane of outlines, m.
const NEAR_M: f32 = 0.05;

/// A visible point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Index of the solid.
    pub(super) solid: u32,
    pub(super) depth_m: f32,
}

/// Solids by tile, nearest first.
#[derive(Debug)]
pub(super) struct Tiles {
    across: usize,
    /// Pairs (lower bound of the depth, index of the solid) of each tile.
    lists: Vec<Vec<(f32, u32)>>,
}

impl Tiles {
    pub(super) fn new(solids: &[Solid], camera: &Camera, width: usize, height: usize) -> Self {
        let across = width.div_ceil(TILE);
        let down = height.div_ceil(TILE);
        let mut lists = vec![Vec::new(); across * down];
        let mut order: Vec<(f32, u32, [f32; 4])> = solids
            .iter()
            .enumerate()
            .filter_map(|(i, s)| outline(s, camera).map(|(z, r)| (z, i as u32, r)))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (z, solid, [u0, v0, u1, v1]) in order {
            // The margin of one pixel is for the antialiasing samples.
            for j in tile_range(v0 - 1.0, v1 + 1.0, down) {
                for i in tile_range(u0 - 1.0, u1 + 1.0, across) {
                    lists[j * across + i].push((z, solid));
                }
            }
        }
        Self { across, lists }
    }

    /// Returns the first intersection of a ray through pixel (i, j).
    #[inline]
    pub(super) fn nearest(&self, solids: &[Solid], ray: &Ray, i: usize, j: usize) -> Option<Hit> {
        let mut best = None;
        let mut depth_m = f32::MAX;
        for &(z, solid) in &self.lists[j / TILE * self.across + i / TILE] {
            if z > depth_m {
                break;
            }
            if let Some(t) = solids[solid as usize].intersect(ray, depth_m) {
                depth_m = t;
                best = Some(Hit { solid, depth_m });
            }
        }
        best
    }
}

/// Returns the indices of the tiles that pixels `from..=to` touch, in a row of `count` tiles.
fn tile_range(from: f32, to: f32, count: usize) -> std::ops::Range<usize> {
    if to < 0.0 {
        return 0..0;
    }
    // The cast saturates: outlines left of the picture start at its first tile.
    let first = (from / TILE as f32) as usize;
    let last = (to / TILE as f32) as usize;
    first..last.saturating_add(1).min(count)
}

/// Returns a lower depth bound and the image rectangle of a solid's box; `None` if the box is behind the near plane.
fn outline(solid: &Solid, camera: &Camera) -> Option<(f32, [f32; 4])> {
    let half = solid.half();
    let corner = |k: usize| {
        let sign = |bit: usize| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let local = half * Vec3::new(sign(0), sign(1), sign(2));
        camera.local(solid.centre + solid.axes * local)
    };
    let corners: [Vec3; 8] = std::array::from_fn(corner);
    let (mut u0, mut v0, mut u1, mut v1) = (f32::MAX, f32::MAX, f32::MIN, f32::MIN);
    let mut any = false;
    let mut add = |p: Vec3| {
        let u = camera.cx + camera.fx * p.x / p.z;
        let v = camera.cy - camera.fy * p.y / p.z;
        u0 = u0.min(u);
        u1 = u1.max(u);
        v0 = v0.min(v);
        v1 = v1.max(v);
        any = true;
    };
    for k in 0..8 {
        if corners[k].z >= NEAR_M {
            add(corners[k]);
        }
        for bit in 0..3 {
            let (a, b) = (corners[k], corners[k ^ (1 << bit)]);
            if a.z < NEAR_M && b.z >= NEAR_M {
                let mut p = a.lerp(b, (NEAR_M - a.z) / (b.z - a.z));
                p.z = NEAR_M;
                add(p);
            }
        }
    }
    let z = corners.iter().map(|c| c.z).fold(f32::MAX, f32::min);
    any.then_some((z.max(0.0) * 0.999, [u0, v0, u1, v1]))
}
