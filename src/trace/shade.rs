//! From hits to radiance: texture coordinates in lanes, then four texels a sample, summed in a fixed order.

use super::lanes::{LANES, Lane, exp_neg, floor, max, min};
use super::scene::View;
use super::slab::Order;
use std::ops::Range;

/// Sums of radiance over the first and the second half of a pixel's samples.
pub(super) type Sums = [[f64; 3]; 2];

/// From one bundle's relative grid coordinates to texels.
pub(super) struct TexelMap {
    scale: [f32; 2],
    offset: [f32; 2],
    min: [f32; 2],
    max: [f32; 2],
    base: [i32; 2],
    stride: i32,
}

impl TexelMap {
    /// For grid coordinates relative to `base`. Both images cover the same field: grid coordinate g is texel
    /// coordinate (g + 1/2) scale - 1/2.
    #[inline(always)]
    pub(super) fn new(view: &View, base: [i32; 2]) -> Self {
        let texture = &view.texture;
        let texels = [texture.width(), texture.height()].map(|n| n as f64);
        let vertices = [view.photograph_size.0, view.photograph_size.1].map(|n| n as f64);
        let scale = [0, 1].map(|k| texels[k] / vertices[k]);
        let origin = [0, 1].map(|k| (f64::from(base[k]) + 0.5) * scale[k] - 0.5);
        let whole = origin.map(f64::floor);
        Self {
            scale: scale.map(|v| v as f32),
            offset: [0, 1].map(|k| (origin[k] - whole[k]) as f32),
            min: whole.map(|v| -v as f32),
            max: [0, 1].map(|k| (texels[k] - 1.0 - whole[k]) as f32),
            base: whole.map(|v| v as i32),
            stride: texture.stride() as i32,
        }
    }
}

/// Where sixteen hits fall into a texture.
pub(super) struct Cells {
    cell: [u32; LANES],
    fu: Lane,
    fv: Lane,
}

impl Cells {
    /// `u`, `v`: relative grid coordinates.
    #[inline(always)]
    pub(super) fn new(map: &TexelMap, u: &Lane, v: &Lane) -> Self {
        let mut cells = Self {
            cell: [0; LANES],
            fu: [0.0; LANES],
            fv: [0.0; LANES],
        };
        for l in 0..LANES {
            let x = min(
                max(u[l] * map.scale[0] + map.offset[0], map.min[0]),
                map.max[0],
            );
            let y = min(
                max(v[l] * map.scale[1] + map.offset[1], map.min[1]),
                map.max[1],
            );
            let ((x0, i), (y0, j)) = (floor(x), floor(y));
            cells.fu[l] = x - x0;
            cells.fv[l] = y - y0;
            cells.cell[l] = ((j + map.base[1]) * map.stride + i + map.base[0]) as u32;
        }
        cells
    }

    /// Adds the weighted radiance of samples `lanes` to `sum`, and their bare radiance to `bare`.
    ///
    /// Four f32 accumulators over at most sixteen samples, then f64: the order is fixed by the sample's place in
    /// its group alone.
    #[inline(always)]
    fn add<const BARE: bool>(
        &self,
        view: &View,
        lanes: Range<usize>,
        weight: impl Fn(usize) -> [f32; 4],
        sum: &mut [f64; 3],
        bare: &mut [f64; 3],
    ) {
        let mut weighted = [[0f32; 4]; 4];
        let mut plain = [[0f32; 4]; 4];
        for quad in 0..LANES / 4 {
            for part in 0..4 {
                let l = quad * 4 + part;
                if l < lanes.start || l >= lanes.end {
                    continue;
                }
                let value = view.texture.bilinear(self.cell[l], self.fu[l], self.fv[l]);
                let w = weight(l);
                for k in 0..4 {
                    weighted[part][k] += value[k] * w[k];
                    if BARE {
                        plain[part][k] += value[k];
                    }
                }
            }
        }
        let total =
            |a: &[[f32; 4]; 4], k: usize| f64::from((a[0][k] + a[1][k]) + (a[2][k] + a[3][k]));
        for k in 0..3 {
            sum[k] += total(&weighted, k);
            if BARE {
                bare[k] += total(&plain, k);
            }
        }
    }

    /// Adds the first `count` samples, of which the first `half` belong to the first half.
    #[inline(always)]
    pub(super) fn add_halves<const BARE: bool>(
        &self,
        view: &View,
        count: usize,
        half: usize,
        weight: impl Fn(usize) -> [f32; 4],
        sums: &mut Sums,
        bare: &mut Sums,
    ) {
        let half = half.min(count);
        if count == LANES && (half == 0 || half == LANES) {
            let part = usize::from(half == 0);
            self.add::<BARE>(view, 0..LANES, weight, &mut sums[part], &mut bare[part]);
        } else {
            self.add::<BARE>(view, 0..half, &weight, &mut sums[0], &mut bare[0]);
            self.add::<BARE>(view, half..count, &weight, &mut sums[1], &mut bare[1]);
        }
    }
}

/// Weights of an order for sixteen rays, without absorption: the mean over both polarisations (see
/// [`super::slab`]) from the faces' `reflectance` and `transmittance`, each `[s, p]`.
#[inline(always)]
pub(super) fn weights(order: Order, reflectance: [&Lane; 2], transmittance: [&Lane; 2]) -> Lane {
    let (passes, bounces) = match order {
        Order::Transmitted(k) => (true, 2 * k),
        Order::Reflected(0) => (false, 1),
        Order::Reflected(k) => (true, 2 * k - 1),
    };
    let mut product = [[1f32; LANES]; 2];
    for q in 0..2 {
        if passes {
            for l in 0..LANES {
                product[q][l] = transmittance[q][l] * transmittance[q][l];
            }
        }
        for _ in 0..bounces {
            for l in 0..LANES {
                product[q][l] *= reflectance[q][l];
            }
        }
    }
    let mut result = [0.0; LANES];
    for l in 0..LANES {
        result[l] = 0.5 * (product[0][l] + product[1][l]);
    }
    result
}

/// Multiplies `weights` by one colour's absorption over the order's passages.
#[inline(always)]
pub(super) fn absorbed(
    weights: &Lane,
    order: Order,
    optical_depth: f32,
    inverse_cos_t: &Lane,
) -> Lane {
    let passages = match order {
        Order::Transmitted(k) => 2 * k + 1,
        Order::Reflected(k) => 2 * k,
    } as f32;
    let mut result = *weights;
    for l in 0..LANES {
        result[l] *= exp_neg(passages * optical_depth * inverse_cos_t[l]);
    }
    result
}
