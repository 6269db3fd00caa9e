//! Groups of sixteen rays: their lines, the spans of their walks, and the grid points to which they are relative.

use super::super::grid::Grid;
use super::super::lanes::{LANES, Lane};

/// Lines of sixteen rays in a grid's projective space: `(u, v) = (x, y) + w (sx, sy)`, in relative grid coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Lines {
    pub(crate) x: Lane,
    pub(crate) y: Lane,
    pub(crate) sx: Lane,
    pub(crate) sy: Lane,
}

impl Lines {
    pub(crate) const ZERO: Self =
        Self { x: [0.0; LANES], y: [0.0; LANES], sx: [0.0; LANES], sy: [0.0; LANES] };
}

/// Range of w that contains the hits: the lines are above the sheet at `hi`, and not above it at `lo`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    pub(crate) hi: f32,
    pub(crate) lo: f32,
    /// True if the whole walk stays inside the grid, so that indices need no clamping.
    pub(crate) inside: bool,
}

/// Spans of sixteen rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaneSpans {
    pub(crate) hi: Lane,
    pub(crate) lo: Lane,
    /// True if all walks stay inside the grid.
    pub(crate) inside: bool,
}

impl LaneSpans {
    pub(crate) const EMPTY: Self = Self { hi: [0.0; LANES], lo: [0.0; LANES], inside: true };
}

impl From<Span> for LaneSpans {
    #[inline(always)]
    fn from(Span { hi, lo, inside }: Span) -> Self {
        Self { hi: [hi; LANES], lo: [lo; LANES], inside }
    }
}

/// Positions of sixteen grid points, to which the coordinates of sixteen rays are relative.
pub(crate) struct GridLanes {
    /// Column and row of the grid points.
    pub(crate) base: [[i32; LANES]; 2],
    /// Relative coordinates of the first column and row.
    pub(super) first: [Lane; 2],
    /// Relative coordinates of the last column and row.
    pub(super) last: [Lane; 2],
    /// Index of the grid points.
    pub(super) cell: [i32; LANES],
}

impl GridLanes {
    #[inline(always)]
    pub(crate) fn new(grid: &Grid, base: [[i32; LANES]; 2]) -> Self {
        let n = [grid.nx() as i32, grid.ny() as i32];
        let (mut first, mut last) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
        let mut cell = [0; LANES];
        for l in 0..LANES {
            for k in 0..2 {
                first[k][l] = -base[k][l] as f32;
                last[k][l] = (n[k] - 1 - base[k][l]) as f32;
            }
            cell[l] = base[1][l].wrapping_mul(n[0]).wrapping_add(base[0][l]);
        }
        Self { base, first, last, cell }
    }
}

/// What the sixteen rays of a group walk with: their grid points and spans.
#[derive(Clone, Copy)]
pub(crate) struct Group<'a> {
    pub(crate) lanes: &'a GridLanes,
    pub(crate) spans: &'a LaneSpans,
}
