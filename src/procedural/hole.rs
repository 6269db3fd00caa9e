//! Simulation of holes in a scanner's depth image: glass, sky, edges, grazing surfaces and surfaces out of range.

use super::random::{lattice, unit};

/// Least depth that a scanner measures, m.
const NEAREST_M: f32 = 0.5;

/// The surface at one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Return {
    pub(super) depth_m: f32,
    /// Cosine of the angle between the ray and the surface normal.
    pub(super) cos: f32,
    pub(super) glass: bool,
    /// Least and largest depth of the neighbour pixels that have a surface, m.
    pub(super) neighbours_m: (f32, f32),
}

/// True if a scanner measures a depth at pixel (i, j).
pub(super) fn is_valid(r: &Return, range_m: f32, [i, j]: [i32; 2], seed: i32) -> bool {
    if r.glass || r.depth_m < NEAREST_M || r.depth_m > range_m {
        return false;
    }
    let chance = unit(lattice(i, j, seed));
    let (nearest_m, farthest_m) = r.neighbours_m;
    // At an edge, the beam covers both sides, so some returns are lost, mainly on the far side.
    let far_side = nearest_m < 0.85 * r.depth_m;
    let near_side = farthest_m > 1.2 * r.depth_m;
    let loss = if far_side {
        0.35
    } else if near_side {
        0.1
    } else if r.cos < 0.05 {
        0.3
    } else {
        0.0
    };
    chance >= loss
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn glass_and_far_surfaces_are_holes() {
        let wall = Return { depth_m: 3.0, cos: 0.9, glass: false, neighbours_m: (3.0, 3.0) };
        assert!(is_valid(&wall, 60.0, [1, 2], 3));
        assert!(!is_valid(&wall, 2.0, [1, 2], 3));
        let glass = Return { glass: true, ..wall };
        assert!(!is_valid(&glass, 60.0, [1, 2], 3));
    }
}
