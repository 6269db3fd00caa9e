//! Sixteen rays walk the depth grid from near to far until they pass below the sheet.
//!
//! A ray is (u, v) = p + s w with w falling; the sheet is two triangles a cell, split along the diagonal from
//! (i + 1, j) to (i, j + 1). What is carried from cell to cell is one fact, "the ray is above the sheet", and it
//! is never derived a second time at a shared edge: so no ray can slip between two cells. Outside the grid the
//! border's inverse depth continues, so every ray ends on a surface: the outermost columns and rows of cells reach
//! to infinity, and so a ray crosses at most nx + ny + 2 cells, however far away it passes.
//!
//! Coordinates are relative to an integer grid point near the pixel's bundle, which keeps f32 exact to about
//! 1e-6 px where absolute ones would be off by 6e-5.

use super::grid::Grid;
use super::lanes::{LANES, Lane, floor, max, min};

/// Lines of sixteen rays in a grid's projective space: `(u, v) = (x, y) + w (sx, sy)`, relative grid coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Lines {
    pub(crate) x: Lane,
    pub(crate) y: Lane,
    pub(crate) sx: Lane,
    pub(crate) sy: Lane,
}

impl Lines {
    pub(crate) const ZERO: Self = Self {
        x: [0.0; LANES],
        y: [0.0; LANES],
        sx: [0.0; LANES],
        sy: [0.0; LANES],
    };
}

/// The part of the lines in which the sheet must lie: above it at `hi`, not above it at `lo`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    pub(crate) hi: f32,
    pub(crate) lo: f32,
    /// The whole walk stays inside the grid, so indices need no clamping.
    pub(crate) inside: bool,
}

/// Slope that stands in for 0, so that reciprocals stay finite.
const TINY: f32 = 1.0e-20;

#[inline(always)]
fn nonzero(s: f32) -> f32 {
    if s.abs() < TINY {
        if s < 0.0 { -TINY } else { TINY }
    } else {
        s
    }
}

/// Rays that one walk carries: sixteen would not fit into the registers.
const RAYS: usize = 8;

/// Inverse depths at which the sixteen lines meet the sheet. `base` is the grid point of relative (0, 0).
#[inline(always)]
pub(crate) fn walk<const AVX2: bool>(
    grid: &Grid,
    base: [i32; 2],
    lines: &Lines,
    span: Span,
) -> Lane {
    let mut w = [0.0; LANES];
    for first in (0..LANES).step_by(RAYS) {
        let part = if span.inside {
            walk_cells::<AVX2, false>(grid, base, lines, first, span)
        } else {
            walk_cells::<AVX2, true>(grid, base, lines, first, span)
        };
        w[first..first + RAYS].copy_from_slice(&part);
    }
    w
}

/// The same for the lines `first..first + RAYS`.
#[inline(always)]
#[allow(
    unsafe_code,
    reason = "a bounds check for each corner of each cell would double the loop's cost"
)]
fn walk_cells<const AVX2: bool, const CLAMP: bool>(
    grid: &Grid,
    base: [i32; 2],
    lines: &Lines,
    first: usize,
    span: Span,
) -> [f32; RAYS] {
    let w = grid.inverse_depths_per_m();
    let (nx, ny) = (grid.nx() as i32, grid.ny() as i32);
    // The last index whose right, lower and lower right neighbours exist.
    let last_cell = ((ny - 2) * nx + nx - 2) as u32;
    assert!(nx >= 2 && ny >= 2 && w.len() == (nx * ny) as usize);
    let (x_min, y_min) = (-base[0] as f32, -base[1] as f32);
    let (x_max, y_max) = ((nx - 1 - base[0]) as f32, (ny - 1 - base[1]) as f32);

    let part = |all: &Lane| -> [f32; RAYS] {
        let mut part = [0.0; RAYS];
        part.copy_from_slice(&all[first..first + RAYS]);
        part
    };
    let (x, y) = (part(&lines.x), part(&lines.y));
    let (mut sx, mut sy) = (part(&lines.sx), part(&lines.sy));
    let (mut inv_sx, mut inv_sy, mut inv_sd) = ([0f32; RAYS], [0f32; RAYS], [0f32; RAYS]);
    let (mut i, mut j, mut cell) = ([0f32; RAYS], [0f32; RAYS], [0i32; RAYS]);
    let (mut step_i, mut step_j, mut step_row) = ([0f32; RAYS], [0f32; RAYS], [0i32; RAYS]);
    let (mut edge_x, mut edge_y, mut edge_d) = ([0f32; RAYS], [0f32; RAYS], [0f32; RAYS]);
    let mut lower_first = [0u32; RAYS];
    for l in 0..RAYS {
        sx[l] = nonzero(sx[l]);
        sy[l] = nonzero(sy[l]);
        let sd = nonzero(sx[l] + sy[l]);
        inv_sx[l] = 1.0 / sx[l];
        inv_sy[l] = 1.0 / sy[l];
        inv_sd[l] = 1.0 / sd;
        let (column, column_index) = floor(x[l] + sx[l] * span.hi);
        let (row, row_index) = floor(y[l] + sy[l] * span.hi);
        i[l] = if CLAMP {
            min(max(column, x_min - 1.0), x_max)
        } else {
            column
        };
        j[l] = if CLAMP {
            min(max(row, y_min - 1.0), y_max)
        } else {
            row
        };
        cell[l] = (row_index.wrapping_add(base[1]))
            .wrapping_mul(nx)
            .wrapping_add(column_index + base[0]);
        // w falls, so u rises where its slope is negative: the cell is left over its upper edge.
        step_i[l] = if sx[l] < 0.0 { 1.0 } else { -1.0 };
        step_j[l] = if sy[l] < 0.0 { 1.0 } else { -1.0 };
        step_row[l] = if sy[l] < 0.0 { nx } else { -nx };
        edge_x[l] = (if sx[l] < 0.0 { 1.0 } else { 0.0 }) - x[l];
        edge_y[l] = (if sy[l] < 0.0 { 1.0 } else { 0.0 }) - y[l];
        edge_d[l] = 1.0 - (x[l] + y[l]);
        lower_first[l] = u32::from(sd < 0.0);
    }

    let mut w_in = [span.hi; RAYS];
    let mut hit_w = [f32::MIN; RAYS];
    let mut active = [1u32; RAYS];
    loop {
        // Inverse depths at the four corners of each ray's cell.
        let (mut w00, mut w10) = ([0f32; RAYS], [0f32; RAYS]);
        let (mut w01, mut w11) = ([0f32; RAYS], [0f32; RAYS]);
        if CLAMP {
            let (mut q, mut right, mut down) = ([0u32; RAYS], [0u32; RAYS], [0u32; RAYS]);
            for l in 0..RAYS {
                let (_, column) = floor(min(max(i[l], x_min), x_max));
                let (_, row) = floor(min(max(j[l], y_min), y_max));
                q[l] = ((row + base[1]) * nx + column + base[0]) as u32;
                q[l] = q[l].min((nx * ny - 1) as u32);
                right[l] = u32::from((i[l] >= x_min) & (i[l] < x_max));
                down[l] = if (j[l] >= y_min) & (j[l] < y_max) {
                    nx as u32
                } else {
                    0
                };
            }
            for l in 0..RAYS {
                let (q, right, down) = (q[l] as usize, right[l] as usize, down[l] as usize);
                w00[l] = w[q];
                w10[l] = w[(q + right).min(w.len() - 1)];
                w01[l] = w[(q + down).min(w.len() - 1)];
                w11[l] = w[(q + right + down).min(w.len() - 1)];
            }
        } else {
            let mut q = [0u32; RAYS];
            for l in 0..RAYS {
                q[l] = (cell[l] as u32).min(last_cell);
            }
            // SAFETY: q <= last_cell = (ny - 2) nx + nx - 2, so q + nx + 1 <= ny nx - 1 < w.len(); `AVX2` is only
            // set inside a function that is compiled for AVX2.
            [w00, w10, w01, w11] = unsafe {
                #[cfg(target_arch = "x86_64")]
                if AVX2 {
                    corners_avx2(w, nx as usize, &q)
                } else {
                    corners(w, nx as usize, &q)
                }
                #[cfg(not(target_arch = "x86_64"))]
                corners(w, nx as usize, &q)
            };
        }
        let mut any = 0u32;
        for l in 0..RAYS {
            // Where the line leaves the cell, and where it crosses the diagonal inside it.
            let (mut wx, mut wy) = (
                (i[l] + edge_x[l]) * inv_sx[l],
                (j[l] + edge_y[l]) * inv_sy[l],
            );
            if CLAMP {
                // Nothing lies beyond the outermost columns and rows.
                let (next_i, next_j) = (i[l] + step_i[l], j[l] + step_j[l]);
                let ends_x = (next_i < x_min - 1.0) | (next_i > x_max);
                let ends_y = (next_j < y_min - 1.0) | (next_j > y_max);
                wx = if ends_x { f32::MIN } else { wx };
                wy = if ends_y { f32::MIN } else { wy };
            }
            let w_exit = max(wx, wy);
            // Written so that not-a-number ends the walk too.
            let goes_on = w_exit > span.lo;
            let last = !goes_on;
            let w_out = min(max(w_exit, span.lo), w_in[l]);
            let w_diagonal = max(min((i[l] + j[l] + edge_d[l]) * inv_sd[l], w_in[l]), w_out);
            // The sheet along the line in either triangle: w d = n on it, w d > n above it.
            let (lx, ly) = (x[l] - i[l], y[l] - j[l]);
            let (bl, cl) = (w10[l] - w00[l], w01[l] - w00[l]);
            let (bu, cu) = (w11[l] - w01[l], w11[l] - w10[l]);
            let (dl, nl) = (1.0 - bl * sx[l] - cl * sy[l], w00[l] + bl * lx + cl * ly);
            let (du, nu) = (
                1.0 - bu * sx[l] - cu * sy[l],
                w11[l] + bu * (lx - 1.0) + cu * (ly - 1.0),
            );
            let lower = lower_first[l] != 0;
            let (d1, n1) = if lower { (dl, nl) } else { (du, nu) };
            let (d2, n2) = if lower { (du, nu) } else { (dl, nl) };
            let hit_1 = (w_diagonal < w_in[l]) & (w_diagonal * d1 <= n1);
            let has_2 = w_out < w_diagonal;
            let hit_2 = has_2 & (w_out * d2 <= n2);
            let hit = (active[l] != 0) & (hit_1 | hit_2 | last);
            let in_1 = hit_1 | (!hit_2 & !has_2);
            let (n, d) = if in_1 { (n1, d1) } else { (n2, d2) };
            let (lo, hi) = if in_1 {
                (w_diagonal, w_in[l])
            } else {
                (w_out, w_diagonal)
            };
            let crossing = min(max(n / d, lo), hi);
            // Sums, maxima and masks instead of choices: the compiler makes masked stores of those, which are slow.
            hit_w[l] = max(if hit { crossing } else { f32::MIN }, hit_w[l]);
            active[l] &= !(hit as u32);
            any |= active[l];
            let over_x = wx >= wy;
            i[l] += if over_x { step_i[l] } else { 0.0 };
            j[l] += if over_x { 0.0 } else { step_j[l] };
            if !CLAMP {
                let column = if sx[l] < 0.0 { 1 } else { -1 };
                cell[l] = cell[l].wrapping_add(if over_x { column } else { step_row[l] });
            }
            w_in[l] = w_out;
        }
        if any == 0 {
            return hit_w;
        }
    }
}

/// Inverse depths at the corners of eight cells: upper left (index `q`), upper right, lower left, lower right.
///
/// # Safety
///
/// Each `q + nx + 1` is an index of `w`.
#[inline(always)]
#[allow(
    unsafe_code,
    reason = "a bounds check for each corner of each cell would double the loop's cost"
)]
unsafe fn corners(w: &[f32], nx: usize, q: &[u32; RAYS]) -> [[f32; RAYS]; 4] {
    let mut corners = [[0.0; RAYS]; 4];
    for l in 0..RAYS {
        for (corner, offset) in [0, 1, nx, nx + 1].into_iter().enumerate() {
            // SAFETY: promised by the caller.
            corners[corner][l] = unsafe { *w.get_unchecked(q[l] as usize + offset) };
        }
    }
    corners
}

/// [`corners`] with one load for two neighbours.
///
/// # Safety
///
/// The same.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
#[allow(
    unsafe_code,
    reason = "a bounds check for each corner of each cell would double the loop's cost"
)]
unsafe fn corners_avx2(w: &[f32], nx: usize, q: &[u32; RAYS]) -> [[f32; RAYS]; 4] {
    use std::arch::x86_64::{
        __m128d, _mm_set_pd, _mm256_castpd_ps, _mm256_set_m128d, _mm256_shuffle_ps,
        _mm256_storeu_ps,
    };
    let mut corners = [[0.0; RAYS]; 4];
    for row in 0..2 {
        // The pairs of two cells.
        let two = |l: usize, m: usize| -> __m128d {
            let pair = |l: usize| {
                // SAFETY: promised by the caller; a pair of floats is eight readable bytes.
                unsafe {
                    let first = w.as_ptr().add(q[l] as usize + row * nx);
                    first.cast::<f64>().read_unaligned()
                }
            };
            _mm_set_pd(pair(m), pair(l))
        };
        let (low, high) = (
            _mm256_castpd_ps(_mm256_set_m128d(two(4, 5), two(0, 1))),
            _mm256_castpd_ps(_mm256_set_m128d(two(6, 7), two(2, 3))),
        );
        // SAFETY: eight floats each.
        unsafe {
            _mm256_storeu_ps(
                corners[2 * row].as_mut_ptr(),
                _mm256_shuffle_ps::<0b10_00_10_00>(low, high),
            );
            _mm256_storeu_ps(
                corners[2 * row + 1].as_mut_ptr(),
                _mm256_shuffle_ps::<0b11_01_11_01>(low, high),
            );
        }
    }
    corners
}
