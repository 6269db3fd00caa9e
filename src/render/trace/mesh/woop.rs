//! Intersects sixteen rays with a triangle, without gaps along shared edges.
//!
//! The method is that of Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013: a shear turns
//! the ray into the w axis, and three two-dimensional edge functions decide. It needs no choice of axes here, because
//! every ray of projective space runs along w. The sheared position of a corner depends only on the ray and the corner,
//! and reversing an edge only changes the sign of its edge function (products round alike, and the sign of a difference
//! is exact), so both triangles of an edge decide alike. If f32 rounds an edge function to zero, f64 decides, because
//! it computes the products exactly.

use super::super::lanes::{LANES, Lane, max, min};

/// Corners of a triangle in projective space: (u, v, w).
pub(super) type Corners = [[f32; 3]; 3];

/// Least magnitude of a slope, so that reciprocals stay finite.
const TINY: f32 = 1.0e-20;

/// Sixteen rays (u, v) = d + w p, with the constants of the box test.
pub(super) struct Rays {
    d: [Lane; 2],
    p: [Lane; 2],
    inverse_p: [Lane; 2],
    /// d minus a margin for the rounding of the shear; `d_high` is d plus this margin.
    d_low: [Lane; 2],
    d_high: [Lane; 2],
}

/// Nearest hits so far.
pub(super) struct Hits {
    /// Inverse depth, 1/m; 0 without a hit.
    pub(super) w: Lane,
    /// Index of the hit triangle, in the tree's order.
    pub(super) triangle: [u32; LANES],
    /// Weight of the triangle's second corner, in projective space.
    pub(super) b: Lane,
    /// Weight of the triangle's third corner, in projective space.
    pub(super) c: Lane,
}

impl Hits {
    /// Makes a state without hits; rays from `count` on have infinite w, so that they hit nothing.
    #[inline(always)]
    pub(super) fn none(count: usize) -> Self {
        let mut hits =
            Self { w: [0.0; LANES], triangle: [u32::MAX; LANES], b: [0.0; LANES], c: [0.0; LANES] };
        for l in count..LANES {
            hits.w[l] = f32::INFINITY;
        }
        hits
    }
}

impl Rays {
    /// Makes rays with directions (`d`, 1) through points `p` of the plane z = 0, for triangles with w up to `top`.
    #[inline(always)]
    pub(super) fn new(d: [Lane; 2], p: [Lane; 2], top: f32) -> Self {
        let mut rays = Self { d, p, inverse_p: [[0.0; LANES]; 2], d_low: d, d_high: d };
        for k in 0..2 {
            for l in 0..LANES {
                let slope = p[k][l];
                let slope = if slope.abs() < TINY { TINY } else { slope };
                rays.inverse_p[k][l] = 1.0 / slope;
                // The shear rounds three times, by at most 2^-24 of |u| (see the boxes' margin), |d| and |p w|.
                let margin = (d[k][l].abs() + p[k][l].abs() * top) * super::tree::MARGIN;
                rays.d_low[k][l] = d[k][l] - margin;
                rays.d_high[k][l] = d[k][l] + margin;
            }
        }
        rays
    }

    /// True if any ray may have a hit in the box that is at least as near as the ray's nearest hit so far.
    #[inline(always)]
    pub(super) fn touch(&self, low: [f32; 3], high: [f32; 3], hits: &Hits) -> bool {
        let mut any = 0u32;
        for l in 0..LANES {
            let mut near = high[2];
            let mut far = max(low[2], hits.w[l]);
            for k in 0..2 {
                let a = (low[k] - self.d_high[k][l]) * self.inverse_p[k][l];
                let b = (high[k] - self.d_low[k][l]) * self.inverse_p[k][l];
                near = min(max(a, b), near);
                far = max(min(a, b), far);
            }
            // The factor covers the seven roundings, each at most 2^-24, of both sides.
            any |= u32::from(far <= near * 1.000_001);
        }
        any != 0
    }

    /// Tests the triangle with index `triangle`. Among hits at equal w, the lowest of `ranks` wins.
    #[inline(always)]
    pub(super) fn meet(&self, corners: &Corners, triangle: u32, ranks: &[u32], hits: &mut Hits) {
        let [[au, av, aw], [bu, bv, bw], [cu, cv, cw]] = *corners;
        let (mut weight_a, mut weight_b, mut weight_c) =
            ([0f32; LANES], [0f32; LANES], [0f32; LANES]);
        let mut undecided = 0u32;
        for l in 0..LANES {
            let (du, dv) = (self.d[0][l], self.d[1][l]);
            let (pu, pv) = (self.p[0][l], self.p[1][l]);
            let (ax, ay) = (au - du - pu * aw, av - dv - pv * aw);
            let (bx, by) = (bu - du - pu * bw, bv - dv - pv * bw);
            let (cx, cy) = (cu - du - pu * cw, cv - dv - pv * cw);
            weight_a[l] = cx * by - cy * bx;
            weight_b[l] = ax * cy - ay * cx;
            weight_c[l] = bx * ay - by * ax;
            undecided |= u32::from((weight_a[l] == 0.0) | (weight_b[l] == 0.0))
                | u32::from(weight_c[l] == 0.0);
        }
        let mut found = [0u32; LANES];
        let (mut w, mut b, mut c) = ([0f32; LANES], [0f32; LANES], [0f32; LANES]);
        let mut any = 0u32;
        for l in 0..LANES {
            let (x, y, z) = (weight_a[l], weight_b[l], weight_c[l]);
            let inside = ((x > 0.0) & (y > 0.0) & (z > 0.0)) | ((x < 0.0) & (y < 0.0) & (z < 0.0));
            let inverse = 1.0 / (x + y + z);
            b[l] = y * inverse;
            c[l] = z * inverse;
            w[l] = (x * aw + y * bw + z * cw) * inverse;
            found[l] = u32::from(inside);
            any |= found[l];
        }
        if undecided != 0 {
            for l in 0..LANES {
                if weight_a[l] == 0.0 || weight_b[l] == 0.0 || weight_c[l] == 0.0 {
                    let hit = self.meet_exactly(corners, l);
                    found[l] = u32::from(hit.is_some());
                    any |= found[l];
                    [w[l], b[l], c[l]] = hit.unwrap_or_default();
                }
            }
        }
        if any == 0 {
            return;
        }
        let mut ties = 0u32;
        for l in 0..LANES {
            let is_nearer = (found[l] != 0) & (w[l] > hits.w[l]);
            ties |= found[l] & u32::from(w[l] == hits.w[l]);
            hits.w[l] = if is_nearer { w[l] } else { hits.w[l] };
            hits.b[l] = if is_nearer { b[l] } else { hits.b[l] };
            hits.c[l] = if is_nearer { c[l] } else { hits.c[l] };
            hits.triangle[l] = if is_nearer { triangle } else { hits.triangle[l] };
        }
        if ties != 0 {
            for l in 0..LANES {
                let met = hits.triangle[l] as usize;
                if found[l] != 0
                    && w[l] == hits.w[l]
                    && met < ranks.len()
                    && ranks[triangle as usize] < ranks[met]
                {
                    hits.triangle[l] = triangle;
                    hits.b[l] = b[l];
                    hits.c[l] = c[l];
                }
            }
        }
    }

    /// Tests one ray with edge functions in f64. A ray on an edge hits both triangles of the edge.
    #[inline(never)]
    fn meet_exactly(&self, corners: &Corners, l: usize) -> Option<[f32; 3]> {
        let sheared = corners.map(|[u, v, w]| {
            let x = u - self.d[0][l] - self.p[0][l] * w;
            let y = v - self.d[1][l] - self.p[1][l] * w;
            [f64::from(x), f64::from(y)]
        });
        let [[ax, ay], [bx, by], [cx, cy]] = sheared;
        let weights = [cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax];
        let sum = weights[0] + weights[1] + weights[2];
        let inside = weights.iter().all(|v| *v >= 0.0) || weights.iter().all(|v| *v <= 0.0);
        // A triangle seen edge-on has no area; the ray hits its neighbours.
        if !inside || sum == 0.0 {
            return None;
        }
        let [a, b, c] = weights.map(|v| v / sum);
        let w = a * f64::from(corners[0][2]) + b * f64::from(corners[1][2]);
        let w = w + c * f64::from(corners[2][2]);
        Some([w as f32, b as f32, c as f32])
    }
}
