//! Selects the orders of a stack that the tracer follows, and tabulates their shifts and weights over the film.
//!
//! A stack has many orders, each below the film's tolerance, whose sum is not. Each side's orders are therefore taken from the
//! strongest on until the sum of the others is below the tolerance, and the light of the others, known in closed form, joins the
//! longest order that is followed. Both functions of the cosine of incidence are smooth, so piecewise cubic polynomials
//! replace them (error: `MAX_ERROR`).

use super::super::camera::CameraChunk;
use super::super::lanes::{LANES, Lane, floor, max, min};
use super::super::orders::{MAX_ORDERS, OrderPlan};
use super::super::slab::Order;
use super::{Exit, Stack, StackOrder, shift_m};

/// Largest error of a tabulated weight, and of a shift in units of 0.1 m, before coefficients are rounded to f32.
const MAX_ERROR: f64 = 1.0e-7;
/// Smallest and largest number of cells of the tables.
const CELLS: [usize; 2] = [8, 4096];
/// Points of a cell for its polynomial (even) and for its error (odd): sixths of the cell.
const POINTS: usize = 6;
/// Largest number of layers that a path crosses. The light of longer paths joins the last order, too.
const MOST_PASSAGES: usize = 64;

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

/// Samples of an order's weights over the cosines.
struct Candidate {
    order: StackOrder,
    weights: Vec<[f64; 3]>,
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
        let mut cells = CELLS[0];
        loop {
            let step = span / (cells * POINTS) as f64;
            let at = |i: usize| (least_cos + step * i as f64).min(1.0);
            let cosines: Vec<f64> = (0..=cells * POINTS).map(at).collect();
            let sides = select(stack, &cosines, max_radiance, tolerance);
            let tabulate = |candidate: &Candidate| StackTable::new(stack, candidate, &cosines);
            let tables = [0, 1]
                .map(|side: usize| -> Vec<_> { sides[side].0.iter().map(tabulate).collect() });
            let errors = tables.iter().flatten().map(|(_, error)| *error);
            if errors.fold(0.0, f64::max) > MAX_ERROR && cells < CELLS[1] {
                cells *= 2;
                continue;
            }
            let optics = Self {
                tables: tables.map(|side| side.into_iter().map(|(table, _)| table).collect()),
                least_cos,
                cells_per_unit: cells as f64 / span,
                cells,
                is_coloured: stack.is_coloured(),
            };
            return (optics, plan(&sides, max_radiance, tolerance));
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

/// Selects the orders of each side, from the shortest to the longest; the last one takes the light of the dropped orders. Also
/// returns a bound of this light, as a share.
fn select(
    stack: &Stack,
    cosines: &[f64],
    max_radiance: [f64; 2],
    tolerance: f64,
) -> [(Vec<Candidate>, f64); 2] {
    let brightest = max_radiance[0].max(max_radiance[1]);
    let least = (1e-3 * tolerance / brightest.max(f64::MIN_POSITIVE)).clamp(1.0e-9, 1.0e-6);
    let mut sides = [vec![], vec![]];
    for (order, weights) in stack.weights(cosines, least, MOST_PASSAGES) {
        sides[usize::from(order.exit == Exit::Reflected)].push(Candidate { order, weights });
    }
    let totals: Vec<_> = cosines.iter().map(|&cos_i| stack.totals(cos_i)).collect();
    let straight = stack.straight();
    let mut side = 0;
    sides.map(|candidates| {
        let (of_totals, radiance) = (1 - side, max_radiance[side]);
        side += 1;
        let rest: Vec<[f64; 3]> = totals.iter().map(|total| total[of_totals]).collect();
        keep(stack, candidates, rest, (&straight, radiance, tolerance))
    })
}

/// Keeps the orders whose light, with that of t_0 or r_0, leaves less than the tolerance of the total light `rest`.
fn keep(
    stack: &Stack,
    mut candidates: Vec<Candidate>,
    mut rest: Vec<[f64; 3]>,
    (straight, radiance, tolerance): (&StackOrder, f64, f64),
) -> (Vec<Candidate>, f64) {
    let is_first = |order: &StackOrder| {
        order == straight
            || order.exit == Exit::Reflected && order.lengths_fm.iter().all(|l| *l == 0)
    };
    candidates.sort_by(|a, b| {
        let key = |c: &Candidate| (is_first(&c.order), largest(&c.weights));
        let ((first_a, a), (first_b, b)) = (key(a), key(b));
        first_b.cmp(&first_a).then(b.total_cmp(&a))
    });
    let mut kept: Vec<Candidate> = vec![];
    for candidate in candidates {
        let is_needed = largest(&rest) * radiance >= tolerance.max(f64::MIN_POSITIVE);
        let is_t_0 = candidate.order == *straight;
        if !is_t_0 && (!is_needed || kept.len() == MAX_ORDERS as usize) {
            break;
        }
        for (rest, weight) in rest.iter_mut().zip(&candidate.weights) {
            (0..3).for_each(|c| rest[c] -= weight[c]);
        }
        kept.push(candidate);
    }
    kept.sort_by(|a, b| {
        let shift_m = |c: &Candidate| stack.kappa_m(&c.order, 1.0);
        shift_m(b).total_cmp(&shift_m(a)).then_with(|| a.order.cmp(&b.order))
    });
    let dropped = largest(&rest).max(0.0);
    if let Some(last) = kept.last_mut() {
        for (weight, rest) in last.weights.iter_mut().zip(&rest) {
            (0..3).for_each(|c| weight[c] += rest[c].max(0.0));
        }
    }
    (kept, dropped)
}

fn largest(weights: &[[f64; 3]]) -> f64 {
    weights.as_flattened().iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// Lists the selected orders. The orders of a side are counted from the shortest.
fn plan(sides: &[(Vec<Candidate>, f64); 2], max_radiance: [f64; 2], tolerance: f64) -> OrderPlan {
    let weights = [0, 1].map(|side: usize| {
        sides[side].0.iter().map(|candidate| largest(&candidate.weights)).collect::<Vec<f64>>()
    });
    let weights = weights.each_ref().map(Vec::as_slice);
    OrderPlan::of_weights(weights, sides.each_ref().map(|side| side.1), max_radiance, tolerance)
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
