//! Tabulates the shifts and weights of the followed orders of a stack over the film.
//!
//! Both are smooth functions of the cosine of incidence, so piecewise cubic polynomials replace them (error: `MAX_ERROR`). The number
//! of their cells doubles until the error is small. Each number of cells has its own search ([`super::select`]), as long as this is
//! little work; then the orders stay, and only the light of their paths is computed at more cosines.

use super::super::camera::CameraChunk;
use super::super::lanes::{LANES, Lane, floor, max, min};
use super::super::orders::OrderPlan;
use super::super::slab::Order;
use super::paths::Paths;
use super::select::{Candidate, Searched, Selection, largest, select};
use super::{Exit, Stack, StackOrder, shift_m};

/// Largest error of a tabulated weight, and of a shift in units of 0.1 m, before coefficients are rounded to f32.
const MAX_ERROR: f64 = 1.0e-7;
/// Smallest and largest number of cells of the tables.
const CELLS: [usize; 2] = [8, 4096];
/// Points of a cell for its polynomial (even) and for its error (odd): sixths of the cell.
const POINTS: usize = 6;
/// Largest product of the numbers of states and cosines of a search for more cells. More work keeps the orders of the search before.
const MOST_WORK: usize = 4_000_000;
/// The same of the paths of orders that stay. More work keeps the cells.
const MOST_WORK_OF_PATHS: usize = 8_000_000;

/// Coefficients of a cell by power of the position in it: weights of red, green and blue, and shift (m).
type Cell = [[f32; 4]; 4];

/// The followed orders of a stack, over the cosines of incidence of a film.
#[derive(Clone, Debug, PartialEq)]
pub struct StackOptics {
    /// Tables of the orders of [`OrderPlan::front`] and [`OrderPlan::back`].
    pub(in super::super) tables: [Vec<StackTable>; 2],
    /// Least cosine of incidence.
    least_cos: f64,
    /// Number of cells per unit of the cosine.
    cells_per_unit: f64,
    cells: usize,
    is_coloured: bool,
}

/// Shift and weights of one order.
#[derive(Clone, Debug, PartialEq)]
pub struct StackTable {
    order: StackOrder,
    thickness_m: f64,
    crossed: Vec<(f64, f64)>,
    cells: Vec<Cell>,
}

impl StackOptics {
    /// Selects and tabulates the orders of `stack` for cosines of incidence from `least_cos` to `most_cos`, the largest radiances of
    /// the front and the back scene, and the film's tolerance.
    pub fn new(
        stack: &Stack,
        [least_cos, most_cos]: [f64; 2],
        max_radiance: [f64; 2],
        tolerance: f64,
    ) -> (Self, OrderPlan) {
        // An interval of length 0, of a film of one ray, still needs a scale.
        let span = (most_cos - least_cos).max(1.0e-6);
        let mut search_was_bounded = false;
        let mut cells = CELLS[0];
        // The selection of the last search, and the paths of its orders.
        let mut fixed: Option<(Selection, Paths)> = None;
        loop {
            let step = span / (cells * POINTS) as f64;
            let at = |i: usize| (least_cos + step * i as f64).min(1.0);
            let cosines: Vec<f64> = (0..=cells * POINTS).map(at).collect();
            let (selection, paths) = if let Some((selection, paths)) = &fixed {
                (selection.at(stack, paths, &cosines), None)
            } else {
                let Searched { selection, paths, was_cut } =
                    select(stack, &cosines, max_radiance, tolerance);
                search_was_bounded |= was_cut;
                (selection, Some(paths))
            };
            let (tables, error) = tabulate(stack, &selection, &cosines);
            if error > MAX_ERROR && cells < CELLS[1] {
                let next = 2 * cells * POINTS + 1;
                let of_orders = paths
                    .filter(|paths| paths.states() * next > MOST_WORK)
                    .map(|paths| paths.of_orders(selection.orders()));
                let known = of_orders.as_ref().or(fixed.as_ref().map(|(_, paths)| paths));
                if known.map_or(0, |paths| paths.states() * next) <= MOST_WORK_OF_PATHS {
                    if let Some(paths) = of_orders {
                        fixed = Some((selection, paths));
                    }
                    cells *= 2;
                    continue;
                }
                search_was_bounded = true;
            }
            let optics = Self {
                tables,
                least_cos,
                cells_per_unit: cells as f64 / span,
                cells,
                is_coloured: stack.is_coloured(),
            };
            let plan = plan(&selection, max_radiance, tolerance);
            return (optics, OrderPlan { search_was_bounded, ..plan });
        }
    }

    /// Returns the followed orders of the front (0) or the back (1), as in the [`OrderPlan`].
    pub fn orders(&self, side: usize) -> Vec<&StackOrder> {
        self.tables[side].iter().map(|table| &table.order).collect()
    }

    /// True if the weights of the three colours differ.
    pub(in super::super) fn is_coloured(&self) -> bool {
        self.is_coloured
    }

    /// Returns the table of an order that the tracer follows.
    pub(in super::super) fn table(&self, order: Order, index: usize) -> &StackTable {
        &self.tables[usize::from(matches!(order, Order::Reflected(_)))][index]
    }

    /// Returns the cell of sixteen cosines of incidence, and the positions in it, in [0, 1].
    #[inline(always)]
    pub(in super::super) fn locate(&self, cosines: &Lane) -> ([u32; LANES], Lane) {
        let (least, scale) = (self.least_cos as f32, self.cells_per_unit as f32);
        let last = self.cells as f32 - 1.0;
        let (mut cell, mut within) = ([0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let at = (cosines[l] - least) * scale;
            // Rounding can leave the table by a little, where its polynomials still hold.
            let (whole, index) = floor(min(max(at, 0.0), last));
            cell[l] = index as u32;
            within[l] = at - whole;
        }
        (cell, within)
    }
}

impl StackTable {
    /// Tabulates an order from its weights at `cosines`, [`POINTS`] for each cell. Returns also the largest error.
    fn new(stack: &Stack, candidate: &Candidate, cosines: &[f64]) -> (Self, f64) {
        let thickness_m = match candidate.order.exit {
            Exit::Transmitted => stack.thickness_m(),
            Exit::Reflected => 0.0,
        };
        let crossed = stack.crossed(&candidate.order);
        let values = |i: usize| {
            let [r, g, b] = candidate.weights[i];
            [r, g, b, shift_m(thickness_m, &crossed, cosines[i])]
        };
        let (mut cells, mut worst) = (vec![], 0.0f64);
        for start in (0..cosines.len() - 1).step_by(POINTS) {
            let powers = cubic([0, 2, 4, 6].map(|i| values(start + i)));
            for i in [1, 3, 5] {
                let (exact, x) = (values(start + i), i as f64 / POINTS as f64);
                for k in 0..4 {
                    let found = powers.iter().rev().fold(0.0, |sum, power| sum * x + power[k]);
                    let unit = if k == 3 { 0.1 } else { 1.0 };
                    worst = worst.max((found - exact[k]).abs() / unit);
                }
            }
            cells.push(powers.map(|power| power.map(|v| v as f32)));
        }
        (Self { order: candidate.order.clone(), thickness_m, crossed, cells }, worst)
    }

    /// Returns the exact shift of the order's line along the normal, m; it falls if `cos_i` rises.
    pub(in super::super) fn shift_m(&self, cos_i: f64) -> f64 {
        shift_m(self.thickness_m, &self.crossed, cos_i)
    }

    /// Bounds the shift over all angles, m.
    pub(in super::super) fn largest_shift_m(&self) -> f64 {
        self.shift_m(1.0e-3).abs().max(self.shift_m(1.0).abs())
    }

    /// Returns the tabulated shifts of sample `s` of a chunk, m.
    #[inline(always)]
    pub(in super::super) fn shifts(&self, camera: &CameraChunk, s: usize) -> Lane {
        self.column::<3>(camera, s)
    }

    /// Returns the tabulated weights of red of sample `s` of a chunk; those of all colours, if the stack is not coloured.
    #[inline(always)]
    pub(in super::super) fn weights(&self, camera: &CameraChunk, s: usize) -> Lane {
        self.column::<0>(camera, s)
    }

    /// Returns the tabulated weights of red, green and blue of pixel `l` in sample `s` of a chunk, and the shift, m.
    #[inline(always)]
    pub(in super::super) fn colours(&self, camera: &CameraChunk, s: usize, l: usize) -> [f32; 4] {
        let (cell, x) = (&self.cells[camera.cell[s][l] as usize], camera.within[s][l]);
        let mut values = cell[3];
        for power in [&cell[2], &cell[1], &cell[0]] {
            for k in 0..4 {
                values[k] = values[k] * x + power[k];
            }
        }
        values
    }

    #[inline(always)]
    fn column<const K: usize>(&self, camera: &CameraChunk, s: usize) -> Lane {
        let mut lanes = [0.0; LANES];
        for l in 0..LANES {
            let cell = &self.cells[camera.cell[s][l] as usize];
            let x = camera.within[s][l];
            lanes[l] = ((cell[3][K] * x + cell[2][K]) * x + cell[1][K]) * x + cell[0][K];
        }
        lanes
    }
}

/// Returns the coefficients, by power, of the cubic polynomials through four values at 0, 1/3, 2/3 and 1.
fn cubic([a, b, c, d]: [[f64; 4]; 4]) -> [[f64; 4]; 4] {
    let of = |f: fn(f64, f64, f64, f64) -> f64| [0, 1, 2, 3].map(|k| f(a[k], b[k], c[k], d[k]));
    [
        a,
        of(|a, b, c, d| -5.5 * a + 9.0 * b - 4.5 * c + d),
        of(|a, b, c, d| 9.0 * a - 22.5 * b + 18.0 * c - 4.5 * d),
        of(|a, b, c, d| -4.5 * a + 13.5 * b - 13.5 * c + 4.5 * d),
    ]
}

/// Tabulates the selected orders of both sides. Returns also the largest error.
fn tabulate(stack: &Stack, selection: &Selection, cosines: &[f64]) -> ([Vec<StackTable>; 2], f64) {
    let mut worst = 0.0f64;
    let tables = selection.kept.each_ref().map(|side| {
        let table = |candidate: &Candidate| {
            let (table, error) = StackTable::new(stack, candidate, cosines);
            worst = worst.max(error);
            table
        };
        side.iter().map(table).collect()
    });
    (tables, worst)
}

/// Lists the selected orders. The orders of a side are counted from the shortest.
fn plan(selection: &Selection, max_radiance: [f64; 2], tolerance: f64) -> OrderPlan {
    let largest = |candidate: &Candidate| {
        let weight = largest(&candidate.weights);
        (weight, weight)
    };
    let weights =
        selection.kept.each_ref().map(|side| side.iter().map(largest).collect::<Vec<_>>());
    OrderPlan::of_weights(&weights, selection.dropped, max_radiance, tolerance)
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
