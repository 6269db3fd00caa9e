//! From hits to radiance: texture coordinates in lanes, then four texels a sample, summed in a fixed order.

use super::lanes::{LANES, Lane, exp_neg, floor, max, min};
use super::means::Sums;
use super::scene::View;
use super::slab::Order;
use super::texture::Texture;
use std::ops::Range;

/// From one bundle's relative grid coordinates to texels.
pub(super) struct TexelMap {
    scale: [f32; 2],
    offset: [f32; 2],
    min: [f32; 2],
    max: [f32; 2],
    base: [i32; 2],
    stride: i32,
    last: u32,
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
            last: texture.last_cell(),
        }
    }
}

/// Where sixteen hits fall into a texture.
pub(super) struct Cells {
    /// Upper left texel, at most the texture's last cell.
    cell: [u32; LANES],
    /// Bilinear shares of the upper left and the upper right texel.
    upper: [[f32; 2]; LANES],
    /// Of the two below.
    lower: [[f32; 2]; LANES],
}

/// What each of sixteen rays' radiance is multiplied by.
pub(super) enum Weights<'a> {
    /// 1.
    One,
    /// The same for all colours.
    Grey(&'a Lane),
    /// Red, green, blue.
    Colour(&'a [Lane; 3]),
}

impl Cells {
    /// `u`, `v`: relative grid coordinates.
    #[inline(always)]
    pub(super) fn new(map: &TexelMap, u: &Lane, v: &Lane) -> Self {
        let mut cells = Self {
            cell: [0; LANES],
            upper: [[0.0; 2]; LANES],
            lower: [[0.0; 2]; LANES],
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
            let (right, below) = (x - x0, y - y0);
            let (left, above) = (1.0 - right, 1.0 - below);
            cells.upper[l] = [left * above, right * above];
            cells.lower[l] = [left * below, right * below];
            let cell = ((j + map.base[1]) * map.stride + i + map.base[0]) as u32;
            cells.cell[l] = cell.min(map.last);
        }
        cells
    }

    /// Adds the weighted radiance of samples `lanes` to `sum`, and with `BARE` their radiance itself to `bare`.
    #[inline(always)]
    fn add<const AVX2: bool, const BARE: bool>(
        &self,
        texture: &Texture,
        lanes: Range<usize>,
        weights: &Weights,
        sum: &mut [f64; 3],
        bare: &mut [f64; 3],
    ) {
        let [weighted, plain] = match weights {
            Weights::One => self.sums::<AVX2, false>(texture, lanes, &[1.0; LANES]),
            Weights::Grey(weight) if BARE => self.sums::<AVX2, true>(texture, lanes, weight),
            Weights::Grey(weight) => self
                .scaled(weight)
                .sums::<AVX2, false>(texture, lanes, weight),
            Weights::Colour(colour) => {
                let mut plain = [0.0; 4];
                if BARE {
                    plain = self.sums::<AVX2, true>(texture, lanes.clone(), &colour[0])[1];
                }
                let mut weighted = [0.0; 4];
                for (k, weight) in colour.iter().enumerate() {
                    let cells = self.scaled(weight);
                    weighted[k] = cells.sums::<AVX2, false>(texture, lanes.clone(), weight)[0][k];
                }
                [weighted, plain]
            }
        };
        for k in 0..3 {
            sum[k] += f64::from(weighted[k]);
            if BARE {
                bare[k] += f64::from(plain[k]);
            }
        }
    }

    /// The same hits with all shares multiplied by a weight.
    #[inline(always)]
    fn scaled(&self, weight: &Lane) -> Self {
        let mut scaled = Self {
            cell: self.cell,
            upper: self.upper,
            lower: self.lower,
        };
        for l in 0..LANES {
            for side in 0..2 {
                scaled.upper[l][side] *= weight[l];
                scaled.lower[l][side] *= weight[l];
            }
        }
        scaled
    }

    /// Sums of radiance over `lanes`. Without `PLAIN` only the first is filled, and not weighted; with it the
    /// first is weighted, the second not.
    ///
    /// Two texels side by side are one vector of eight, so a bilinear value is two products and one sum; left and
    /// right are added up only at the end. Four f32 accumulators over at most sixteen samples: the order is fixed by
    /// the sample's place in its group alone, and the same on every instruction set.
    #[inline(always)]
    fn sums<const AVX2: bool, const PLAIN: bool>(
        &self,
        texture: &Texture,
        lanes: Range<usize>,
        weight: &Lane,
    ) -> [[f32; 4]; 2] {
        #[cfg(target_arch = "x86_64")]
        if AVX2 && lanes.len() == LANES {
            // SAFETY: `AVX2` is only set inside a function that is compiled for AVX2 (`tile::trace_avx2`).
            #[allow(unsafe_code, reason = "calling a function compiled for AVX2")]
            return unsafe { self.sums_avx2::<PLAIN>(texture, weight) };
        }
        let mut parts = [[[0f32; 8]; 4]; 2];
        for l in lanes {
            let part = l % 4;
            #[allow(unsafe_code, reason = "see Texture::quad")]
            // SAFETY: `new` pulled the cell in to the last one; a pair of texels is eight floats in a row, and
            // `[f32; 8]` asks for no more than a float's alignment.
            let (upper, lower) = unsafe {
                let [upper, lower] = texture.quad(self.cell[l]);
                (&*upper, &*lower)
            };
            for k in 0..8 {
                let value = upper[k] * self.upper[l][k / 4] + lower[k] * self.lower[l][k / 4];
                if PLAIN {
                    parts[0][part][k] += value * weight[l];
                    parts[1][part][k] += value;
                } else {
                    parts[0][part][k] += value;
                }
            }
        }
        parts.map(|p| {
            let side = |k: usize| (p[0][k] + p[1][k]) + (p[2][k] + p[3][k]);
            [0, 1, 2, 3].map(|k| side(k) + side(k + 4))
        })
    }

    /// [`Cells::sums`] of all lanes in 256-bit vectors: the compiler does not find them by itself.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    #[inline]
    #[allow(unsafe_code, reason = "vector loads through pointers")]
    fn sums_avx2<const PLAIN: bool>(&self, texture: &Texture, weight: &Lane) -> [[f32; 4]; 2] {
        use std::arch::x86_64::{
            __m256, _mm_add_ps, _mm_storeu_ps, _mm256_add_ps, _mm256_castpd_ps,
            _mm256_castps256_ps128, _mm256_extractf128_ps, _mm256_loadu_ps, _mm256_mul_ps,
            _mm256_permutevar_ps, _mm256_set_epi32, _mm256_set1_pd, _mm256_set1_ps,
            _mm256_setzero_ps,
        };
        let halves = _mm256_set_epi32(1, 1, 1, 1, 0, 0, 0, 0);
        let mut parts = [[_mm256_setzero_ps(); 4]; 2];
        // A pair [left, right] as four times left, four times right.
        let spread = |pair: &[f32; 2]| -> __m256 {
            // SAFETY: a pair of floats is eight readable bytes.
            let pair = unsafe { pair.as_ptr().cast::<f64>().read_unaligned() };
            _mm256_permutevar_ps(_mm256_castpd_ps(_mm256_set1_pd(pair)), halves)
        };
        for quad in 0..LANES / 4 {
            for part in 0..4 {
                let l = quad * 4 + part;
                // SAFETY: `new` pulled the cell in to the last one, so both pointers lead to eight floats.
                let (upper, lower) = unsafe {
                    let [upper, lower] = texture.quad(self.cell[l]);
                    (_mm256_loadu_ps(upper.cast()), _mm256_loadu_ps(lower.cast()))
                };
                let value = _mm256_add_ps(
                    _mm256_mul_ps(upper, spread(&self.upper[l])),
                    _mm256_mul_ps(lower, spread(&self.lower[l])),
                );
                if PLAIN {
                    let weighted = _mm256_mul_ps(value, _mm256_set1_ps(weight[l]));
                    parts[0][part] = _mm256_add_ps(parts[0][part], weighted);
                    parts[1][part] = _mm256_add_ps(parts[1][part], value);
                } else {
                    parts[0][part] = _mm256_add_ps(parts[0][part], value);
                }
            }
        }
        parts.map(|p| {
            let sides = _mm256_add_ps(_mm256_add_ps(p[0], p[1]), _mm256_add_ps(p[2], p[3]));
            let total = _mm_add_ps(
                _mm256_castps256_ps128(sides),
                _mm256_extractf128_ps::<1>(sides),
            );
            let mut sums = [0.0; 4];
            // SAFETY: four floats.
            unsafe { _mm_storeu_ps(sums.as_mut_ptr(), total) };
            sums
        })
    }

    /// Adds the samples before `ends[0]`, from there to `ends[1]`, and from there to `ends[2]` to the three sums.
    #[inline(always)]
    pub(super) fn add_parts<const AVX2: bool, const BARE: bool>(
        &self,
        texture: &Texture,
        ends: [usize; 3],
        weights: &Weights,
        sums: &mut Sums,
        bare: &mut Sums,
    ) {
        // Nearly always a group belongs to one part as a whole.
        let whole = [(0, ends[0]), (ends[0], ends[1]), (ends[1], ends[2])];
        for part in 0..3 {
            if whole[part] == (0, LANES) {
                let (sum, bare) = (&mut sums[part], &mut bare[part]);
                return self.add::<AVX2, BARE>(texture, 0..LANES, weights, sum, bare);
            }
        }
        for part in 0..3 {
            let (start, end) = whole[part];
            if start < end {
                let (sum, bare) = (&mut sums[part], &mut bare[part]);
                self.add::<false, BARE>(texture, start..end, weights, sum, bare);
            }
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
