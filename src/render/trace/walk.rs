//! Walks rays over the depth grid, from near to far, until they pass below the sheet.
//!
//! A ray is (u, v) = p + s w with decreasing w. Every cell of the sheet has two triangles, which meet on the diagonal
//! from (i + 1, j) to (i, j + 1). At an edge that two cells share, a walk does not test again whether the ray is above
//! the sheet, so no ray leaks between two cells. Outside the grid, the border's inverse depth continues to infinity in
//! the outermost columns and rows of cells, so every ray ends on a surface and crosses at most nx + ny + 2 cells.
//!
//! Coordinates are relative to an integer grid point near each pixel's centre direction. Their rounding errors in f32 are
//! about 1e-6 px; those of absolute coordinates would be 6e-5 px.

mod approach;
mod group;

pub(crate) use approach::approach;
pub(crate) use group::{GridLanes, Group, LaneSpans, Lines, Span};

use super::grid::Grid;
use super::isa::{AVX512, BASELINE};
use super::lanes::{LANES, Lane, floor, max, min};

/// Least magnitude of a slope, so that reciprocals stay finite.
const TINY: f32 = 1.0e-20;

#[inline(always)]
fn nonzero(s: f32) -> f32 {
    if s.abs() < TINY { if s < 0.0 { -TINY } else { TINY } } else { s }
}

/// Number of rays that step together; more would not fit into the registers.
const RAYS: usize = 8;
/// The same of registers of 512 bits.
const WIDE_RAYS: usize = 16;

/// Number of parts of [`RAYS`] or [`WIDE_RAYS`] in a bundle of 256.
const PARTS: usize = 32;
const WIDE_PARTS: usize = 16;

/// State of `N` rays during a walk.
#[derive(Clone, Copy)]
struct Rays<const N: usize> {
    x: [f32; N],
    y: [f32; N],
    sx: [f32; N],
    sy: [f32; N],
    inv_sx: [f32; N],
    inv_sy: [f32; N],
    inv_sd: [f32; N],
    /// Edges at which a ray leaves cell (0, 0), and the cell's diagonal, relative to the line's origin.
    edge_x: [f32; N],
    edge_y: [f32; N],
    edge_d: [f32; N],
    step_i: [f32; N],
    step_j: [f32; N],
    step_row: [i32; N],
    /// 1 if a ray enters a cell through its lower triangle.
    lower_first: [u32; N],
    /// Cell of a ray, relative to the base, and its index in the grid.
    i: [f32; N],
    j: [f32; N],
    cell: [i32; N],
    /// Inverse depth at which a ray enters its cell.
    w_in: [f32; N],
    hit_w: [f32; N],
    active: [u32; N],
}

impl<const N: usize> Rays<N> {
    const fn new() -> Self {
        Self {
            x: [0.0; N],
            y: [0.0; N],
            sx: [0.0; N],
            sy: [0.0; N],
            inv_sx: [0.0; N],
            inv_sy: [0.0; N],
            inv_sd: [0.0; N],
            edge_x: [0.0; N],
            edge_y: [0.0; N],
            edge_d: [0.0; N],
            step_i: [0.0; N],
            step_j: [0.0; N],
            step_row: [0; N],
            lower_first: [0; N],
            i: [0.0; N],
            j: [0.0; N],
            cell: [0; N],
            w_in: [0.0; N],
            hit_w: [0.0; N],
            active: [0; N],
        }
    }
}

/// State of the rays of one bundle, in parts of both sizes. All bundles reuse this memory.
pub(crate) struct Walkers {
    parts: Vec<Rays<RAYS>>,
    wide: Vec<Rays<WIDE_RAYS>>,
}

impl Walkers {
    pub(crate) fn new() -> Self {
        Self { parts: vec![Rays::new(); PARTS], wide: vec![Rays::new(); WIDE_PARTS] }
    }
}

fn as_array<T, const N: usize>(parts: &mut [T]) -> &mut [T; N] {
    parts.first_chunk_mut().expect("all parts")
}

/// Grid of a bundle's walks.
struct Ground<'a> {
    w: &'a [f32],
    nx: i32,
    /// Largest index of a vertex with right, lower and lower right neighbours.
    last_cell: u32,
}

/// Computes the inverse depths at which a bundle's lines (at most 256) hit the sheet. `of` returns the grid points and spans
/// of a group of lines.
///
/// All parts take a step, then the parts with unfinished rays take one more step a round. Steps of different parts
/// are independent, so they can overlap, and no branch depends on the length of a single walk.
#[inline(always)]
pub(crate) fn walk_bundle<'a, const ISA: u8>(
    grid: &Grid,
    of: impl Fn(usize) -> Group<'a>,
    lines: &[Lines],
    walkers: &mut Walkers,
    hits: &mut [Lane],
) {
    if ISA == AVX512 {
        let parts: &mut [_; WIDE_PARTS] = as_array(&mut walkers.wide);
        walk_groups::<ISA, false, _, _>(grid, &of, lines, parts, hits);
        walk_groups::<ISA, true, _, _>(grid, &of, lines, parts, hits);
    } else {
        let parts: &mut [_; PARTS] = as_array(&mut walkers.parts);
        walk_groups::<ISA, false, _, _>(grid, &of, lines, parts, hits);
        walk_groups::<ISA, true, _, _>(grid, &of, lines, parts, hits);
    }
}

/// Walks the groups that stay inside the grid or, with `CLAMP`, the others.
#[inline(always)]
fn walk_groups<'a, const ISA: u8, const CLAMP: bool, const N: usize, const P: usize>(
    grid: &Grid,
    of: &impl Fn(usize) -> Group<'a>,
    lines: &[Lines],
    parts: &mut [Rays<N>; P],
    hits: &mut [Lane],
) {
    let ground = Ground::new(grid);
    let mut waiting = [0u8; P];
    let mut count = 0;
    for (g, lines) in lines.iter().enumerate() {
        let group = of(g);
        if group.spans.inside == CLAMP {
            continue;
        }
        for half in 0..LANES / N {
            let part = g * (LANES / N) + half;
            let rays = &mut parts[part];
            ground.start::<CLAMP, N>(group, lines, half * N, rays);
            let any = ground.step::<ISA, CLAMP, N>(group, half * N, rays);
            waiting[count] = part as u8;
            count += usize::from(any != 0);
        }
    }
    while count > 0 {
        let waited = count;
        count = 0;
        for k in 0..waited {
            let part = waiting[k];
            let (g, half) = (usize::from(part) / (LANES / N), usize::from(part) % (LANES / N));
            let rays = &mut parts[usize::from(part) % P];
            let any = ground.step::<ISA, CLAMP, N>(of(g), half * N, rays);
            waiting[count] = part;
            count += usize::from(any != 0);
        }
    }
    for (g, hits) in hits.iter_mut().enumerate().take(lines.len()) {
        if of(g).spans.inside == CLAMP {
            continue;
        }
        for half in 0..LANES / N {
            hits[half * N..][..N].copy_from_slice(&parts[g * (LANES / N) + half].hit_w);
        }
    }
}

/// Calls [`walk_bundle`] for sixteen lines relative to one grid point.
#[cfg(test)]
pub(crate) fn walk<const ISA: u8>(grid: &Grid, base: [i32; 2], lines: &Lines, span: Span) -> Lane {
    let lanes = GridLanes::new(grid, base.map(|v| [v; LANES]));
    walk_lanes::<ISA>(grid, &lanes, lines, span)
}

/// Calls [`walk_bundle`] for sixteen lines.
#[cfg(test)]
pub(crate) fn walk_lanes<const ISA: u8>(
    grid: &Grid,
    lanes: &GridLanes,
    lines: &Lines,
    span: Span,
) -> Lane {
    let mut hits = [[0.0; LANES]];
    let lines = std::slice::from_ref(lines);
    let spans = span.into();
    let of = |_| Group { lanes, spans: &spans };
    walk_bundle::<ISA>(grid, of, lines, &mut Walkers::new(), &mut hits);
    hits[0]
}

impl<'a> Ground<'a> {
    #[inline(always)]
    fn new(grid: &'a Grid) -> Self {
        let w = grid.inverse_depths_per_m();
        let (nx, ny) = (grid.nx() as i32, grid.ny() as i32);
        assert!(nx >= 2 && ny >= 2 && w.len() == (nx * ny) as usize);
        Self { w, nx, last_cell: ((ny - 2) * nx + nx - 2) as u32 }
    }

    /// Places lines `first..first + N` at the start of the bundle's span.
    #[inline(always)]
    fn start<const CLAMP: bool, const N: usize>(
        &self,
        group: Group,
        lines: &Lines,
        first: usize,
        r: &mut Rays<N>,
    ) {
        let [first_x, first_y] = part::<N>(&group.lanes.first, first);
        let [last_x, last_y] = part::<N>(&group.lanes.last, first);
        let hi = some::<_, N>(&group.spans.hi, first);
        let base_cell = some::<_, N>(&group.lanes.cell, first);
        for l in 0..N {
            r.x[l] = lines.x[first + l];
            r.y[l] = lines.y[first + l];
            r.sx[l] = nonzero(lines.sx[first + l]);
            r.sy[l] = nonzero(lines.sy[first + l]);
            let sd = nonzero(r.sx[l] + r.sy[l]);
            r.inv_sx[l] = 1.0 / r.sx[l];
            r.inv_sy[l] = 1.0 / r.sy[l];
            r.inv_sd[l] = 1.0 / sd;
            let (column, column_index) = floor(r.x[l] + r.sx[l] * hi[l]);
            let (row, row_index) = floor(r.y[l] + r.sy[l] * hi[l]);
            r.i[l] = if CLAMP { min(max(column, first_x[l] - 1.0), last_x[l]) } else { column };
            r.j[l] = if CLAMP { min(max(row, first_y[l] - 1.0), last_y[l]) } else { row };
            r.cell[l] = row_index
                .wrapping_mul(self.nx)
                .wrapping_add(column_index)
                .wrapping_add(base_cell[l]);
            // w decreases, so u increases if the slope is negative, and the ray leaves the cell at the larger u.
            r.step_i[l] = if r.sx[l] < 0.0 { 1.0 } else { -1.0 };
            r.step_j[l] = if r.sy[l] < 0.0 { 1.0 } else { -1.0 };
            r.step_row[l] = if r.sy[l] < 0.0 { self.nx } else { -self.nx };
            r.edge_x[l] = (if r.sx[l] < 0.0 { 1.0 } else { 0.0 }) - r.x[l];
            r.edge_y[l] = (if r.sy[l] < 0.0 { 1.0 } else { 0.0 }) - r.y[l];
            r.edge_d[l] = 1.0 - (r.x[l] + r.y[l]);
            r.lower_first[l] = u32::from(sd < 0.0);
            r.w_in[l] = hi[l];
            r.hit_w[l] = f32::MIN;
            r.active[l] = 1;
        }
    }

    /// Returns the inverse depths at the corners of each ray's cell: upper left, upper right, lower left, lower right.
    #[inline(always)]
    #[allow(
        unsafe_code,
        reason = "a bounds check for each corner of each cell would double the loop's cost"
    )]
    fn corners<const ISA: u8, const CLAMP: bool, const N: usize>(
        &self,
        group: Group,
        first: usize,
        r: &Rays<N>,
    ) -> [[f32; N]; 4] {
        let (mut w00, mut w10) = ([0f32; N], [0f32; N]);
        let (mut w01, mut w11) = ([0f32; N], [0f32; N]);
        let [first_x, first_y] = part::<N>(&group.lanes.first, first);
        let [last_x, last_y] = part::<N>(&group.lanes.last, first);
        let mut q = [0u32; N];
        if CLAMP {
            let base_cell = some::<_, N>(&group.lanes.cell, first);
            for l in 0..N {
                let (_, column) = floor(min(max(r.i[l], first_x[l]), last_x[l] - 1.0));
                let (_, row) = floor(min(max(r.j[l], first_y[l]), last_y[l] - 1.0));
                let cell = row.wrapping_mul(self.nx).wrapping_add(column);
                q[l] = (cell.wrapping_add(base_cell[l]) as u32).min(self.last_cell);
            }
        } else {
            for l in 0..N {
                q[l] = (r.cell[l] as u32).min(self.last_cell);
            }
        }
        for first in (0..N).step_by(RAYS) {
            let q = some::<_, RAYS>(&q, first);
            // SAFETY: q <= last_cell = (ny - 2) nx + nx - 2, so q + nx + 1 <= ny nx - 1 < w.len(); only functions
            // compiled for AVX2 have another `ISA` than the baseline.
            let eight = unsafe {
                #[cfg(target_arch = "x86_64")]
                if ISA == BASELINE {
                    corners(self.w, self.nx as usize, q)
                } else {
                    corners_avx2(self.w, self.nx as usize, q)
                }
                #[cfg(not(target_arch = "x86_64"))]
                corners(self.w, self.nx as usize, q)
            };
            for (corner, eight) in [&mut w00, &mut w10, &mut w01, &mut w11].into_iter().zip(&eight)
            {
                corner[first..][..RAYS].copy_from_slice(eight);
            }
        }
        if CLAMP {
            // Beyond the border, a cell has its vertices alone.
            for l in 0..N {
                let (left, right) = (r.i[l] < first_x[l], r.i[l] >= last_x[l]);
                let (above, below) = (r.j[l] < first_y[l], r.j[l] >= last_y[l]);
                let across = |a: f32, b: f32| (if right { b } else { a }, if left { a } else { b });
                let (top, bottom) = (across(w00[l], w10[l]), across(w01[l], w11[l]));
                let down = |a: f32, b: f32| (if below { b } else { a }, if above { a } else { b });
                (w00[l], w01[l]) = down(top.0, bottom.0);
                (w10[l], w11[l]) = down(top.1, bottom.1);
            }
        }
        [w00, w10, w01, w11]
    }

    /// Moves each ray, in lanes `first..first + N`, through its cell. Returns 0 if all rays have hit the sheet.
    #[inline(always)]
    fn step<const ISA: u8, const CLAMP: bool, const N: usize>(
        &self,
        group: Group,
        first: usize,
        r: &mut Rays<N>,
    ) -> u32 {
        let [w00, w10, w01, w11] = self.corners::<ISA, CLAMP, N>(group, first, r);
        let [first_x, first_y] = part::<N>(&group.lanes.first, first);
        let [last_x, last_y] = part::<N>(&group.lanes.last, first);
        let lo = some::<_, N>(&group.spans.lo, first);
        let mut any = 0u32;
        for l in 0..N {
            // Inverse depths at which the line reaches the cell's edges.
            let (mut wx, mut wy) =
                ((r.i[l] + r.edge_x[l]) * r.inv_sx[l], (r.j[l] + r.edge_y[l]) * r.inv_sy[l]);
            if CLAMP {
                // The outermost columns and rows extend to infinity, so they have no outer edge.
                let (next_i, next_j) = (r.i[l] + r.step_i[l], r.j[l] + r.step_j[l]);
                let ends_x = (next_i < first_x[l] - 1.0) | (next_i > last_x[l]);
                let ends_y = (next_j < first_y[l] - 1.0) | (next_j > last_y[l]);
                wx = if ends_x { f32::MIN } else { wx };
                wy = if ends_y { f32::MIN } else { wy };
            }
            let w_exit = max(wx, wy);
            // In this form, NaN also ends the walk.
            let goes_on = w_exit > lo[l];
            let last = !goes_on;
            let w_out = min(max(w_exit, lo[l]), r.w_in[l]);
            let t = r.i[l] + r.j[l] + r.edge_d[l];
            let w_diagonal = max(min(t * r.inv_sd[l], r.w_in[l]), w_out);
            // Along the line, each triangle has w d = n on its plane and w d > n above it.
            let (lx, ly) = (r.x[l] - r.i[l], r.y[l] - r.j[l]);
            let (bl, cl) = (w10[l] - w00[l], w01[l] - w00[l]);
            let excess = (w11[l] - w10[l]) - cl;
            let (dl, nl) = (1.0 - bl * r.sx[l] - cl * r.sy[l], w00[l] + bl * lx + cl * ly);
            let (du, nu) = (dl - excess * (r.sx[l] + r.sy[l]), nl - excess * t);
            let lower = r.lower_first[l] != 0;
            let (d1, n1) = if lower { (dl, nl) } else { (du, nu) };
            let (d2, n2) = if lower { (du, nu) } else { (dl, nl) };
            let hit_1 = (w_diagonal < r.w_in[l]) & (w_diagonal * d1 <= n1);
            let has_2 = w_out < w_diagonal;
            let hit_2 = has_2 & (w_out * d2 <= n2);
            let hit = (r.active[l] != 0) & (hit_1 | hit_2 | last);
            let in_1 = hit_1 | (!hit_2 & !has_2);
            let (n, d) = if in_1 { (n1, d1) } else { (n2, d2) };
            let (lo, hi) = if in_1 { (w_diagonal, r.w_in[l]) } else { (w_out, w_diagonal) };
            let crossing = min(max(n / d, lo), hi);
            // Sums, maxima and masks replace branches, because the compiler turns branches into slow masked stores.
            r.hit_w[l] = max(if hit { crossing } else { f32::MIN }, r.hit_w[l]);
            r.active[l] &= !(hit as u32);
            any |= r.active[l];
            let over_x = wx >= wy;
            r.i[l] += if over_x { r.step_i[l] } else { 0.0 };
            r.j[l] += if over_x { 0.0 } else { r.step_j[l] };
            if !CLAMP {
                let column = if r.sx[l] < 0.0 { 1 } else { -1 };
                r.cell[l] = r.cell[l].wrapping_add(if over_x { column } else { r.step_row[l] });
            }
            r.w_in[l] = w_out;
        }
        any
    }
}

/// Returns `N` lanes from `first` on.
#[inline(always)]
fn some<T, const N: usize>(lanes: &[T], first: usize) -> &[T; N] {
    lanes[first..].first_chunk().expect("N lanes")
}

/// Returns `N` lanes from `first` on of both axes.
#[inline(always)]
fn part<const N: usize>(lanes: &[Lane; 2], first: usize) -> [&[f32; N]; 2] {
    [some(&lanes[0], first), some(&lanes[1], first)]
}

/// Loads the inverse depths at the corners of eight cells: upper left (`q`), upper right, lower left, lower right.
///
/// # Safety
///
/// Each `q + nx + 1` must be an index of `w`.
#[inline(always)]
#[allow(
    unsafe_code,
    reason = "a bounds check for each corner of each cell would double the loop's cost"
)]
unsafe fn corners(w: &[f32], nx: usize, q: &[u32; RAYS]) -> [[f32; RAYS]; 4] {
    let mut corners = [[0.0; RAYS]; 4];
    for l in 0..RAYS {
        for (corner, offset) in [0, 1, nx, nx + 1].into_iter().enumerate() {
            // SAFETY: the caller guarantees the indices.
            corners[corner][l] = unsafe { *w.get_unchecked(q[l] as usize + offset) };
        }
    }
    corners
}

/// Computes [`corners`] with one load for each pair of neighbours.
///
/// # Safety
///
/// Each `q + nx + 1` must be an index of `w`, and the machine must have AVX2.
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
        // Loads the pairs of two cells into a vector.
        let two = |l: usize, m: usize| -> __m128d {
            let pair = |l: usize| {
                // SAFETY: the caller guarantees the indices; a pair of floats is eight readable bytes.
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
        // SAFETY: each row of `corners` has eight floats.
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
