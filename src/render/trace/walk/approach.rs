//! Moves rays on over blocks of the grid that lie below them, so that a walk begins near its hit.
//!
//! The span of a bundle begins where the first of its rays may hit the sheet. Behind rough glass, the rays of a bundle spread, and most of them would
//! cross dozens of cells before their own hits.

use super::super::grid::Grid;
use super::super::lanes::{LANES, floor, max, min};
use super::{GridLanes, LaneSpans, Lines, nonzero};

/// Largest number of blocks that a ray passes.
const MOST_BLOCKS: usize = 64;

/// Lowers the near ends of the spans of sixteen lines to where each may first hit the sheet.
///
/// A line passes a block if it stays above its ceiling, the largest w of the block and of the quads around it. Since these overlap
/// neighbouring blocks by a quad, the rounding of positions has no effect.
#[inline(always)]
pub(crate) fn approach(grid: &Grid, lanes: &GridLanes, lines: &Lines, spans: &mut LaneSpans) {
    let ceilings = grid.ceilings();
    let side = ceilings.side as f32;
    let [last_i, last_j] = ceilings.last().map(|last| last as f32);
    let mut at = [[0f32; LANES]; 2];
    let (mut origin, mut inverse) = ([[0f32; LANES]; 2], [[0f32; LANES]; 2]);
    let (mut step, mut ahead) = ([[0f32; LANES]; 2], [[0f32; LANES]; 2]);
    let mut w_in = spans.hi;
    let mut active = [true; LANES];
    for (k, (start, slope)) in
        [(&lines.x, &lines.sx), (&lines.y, &lines.sy)].into_iter().enumerate()
    {
        for l in 0..LANES {
            let slope = nonzero(slope[l]);
            // w decreases along the walk.
            let rises = slope < 0.0;
            origin[k][l] = start[l] + lanes.base[k][l] as f32;
            inverse[k][l] = 1.0 / slope;
            step[k][l] = if rises { 1.0 } else { -1.0 };
            ahead[k][l] = if rises { 1.0 } else { 0.0 };
            at[k][l] = floor((origin[k][l] + slope * spans.hi[l]) / side).0;
        }
    }
    for _ in 0..MOST_BLOCKS {
        let mut index = [0i32; LANES];
        for l in 0..LANES {
            // Outside the grid, its border continues.
            let i = floor(min(max(at[0][l], 0.0), last_i)).1;
            let j = floor(min(max(at[1][l], 0.0), last_j)).1;
            index[l] = j * ceilings.columns as i32 + i;
        }
        let mut ceiling = [0f32; LANES];
        for l in 0..LANES {
            ceiling[l] = ceilings.w[(index[l] as usize).min(ceilings.w.len() - 1)];
        }
        let mut any = false;
        for l in 0..LANES {
            let edge = |k: usize| ((at[k][l] + ahead[k][l]) * side - origin[k][l]) * inverse[k][l];
            let (wx, wy) = (edge(0), edge(1));
            let w_out = min(max(wx, wy), w_in[l]);
            // In this form, NaN also ends the approach.
            let passes = active[l] & (w_out > ceiling[l]) & (w_out > spans.lo[l]);
            let over_x = wx >= wy;
            at[0][l] += if passes & over_x { step[0][l] } else { 0.0 };
            at[1][l] += if passes & !over_x { step[1][l] } else { 0.0 };
            w_in[l] = if passes { w_out } else { w_in[l] };
            active[l] = passes;
            any |= passes;
        }
        if !any {
            break;
        }
    }
    for l in 0..LANES {
        // By some ulps above the end of the last block, as spans are.
        spans.hi[l] = min(w_in[l] * 1.000_001, spans.hi[l]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::isa::BASELINE;
    use super::super::{Group, Walkers, walk_bundle};
    use super::*;

    /// A sheet of steps and slopes, with spikes of one vertex.
    fn grid() -> Grid {
        let (nx, ny) = (150, 90);
        let w = (0..nx * ny).map(|q| {
            let (i, j) = (q % nx, q / nx);
            let spike = if (i * 7 + j * 13) % 331 == 0 { 1.3 } else { 0.0 };
            0.3 + 0.002 * i as f32 + if j > 40 { 0.4 } else { 0.0 } + spike
        });
        Grid::new(nx, ny, w.collect())
    }

    #[test]
    fn rays_hit_where_they_hit_without_it() {
        let grid = grid();
        let [bottom, top] = grid.extremes();
        let (mut moved, mut count) = (0.0, 0);
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        for _ in 0..4_000 {
            let base = [0, 1].map(|_| [0; LANES].map(|_| (random() * 200.0) as i32 - 20));
            let lanes = GridLanes::new(&grid, base);
            let mut lines = Lines::ZERO;
            for l in 0..LANES {
                let slope = |v: f32| match v {
                    v if v < 0.1 => 0.0,
                    v if v < 0.2 => 1e-6,
                    v => (v - 0.6) * 400.0,
                };
                (lines.sx[l], lines.sy[l]) = (slope(random()), slope(random()));
                (lines.x[l], lines.y[l]) = (random() * 40.0 - 20.0, random() * 40.0 - 20.0);
            }
            let whole = LaneSpans {
                hi: [top * 1.000_001; LANES],
                lo: [bottom * 0.999_999; LANES],
                inside: false,
            };
            let mut short = whole;
            approach(&grid, &lanes, &lines, &mut short);
            let hits = [whole, short].map(|spans| {
                let group = Group { lanes: &lanes, spans: &spans };
                let mut hits = [[0.0; LANES]];
                walk_bundle::<BASELINE>(&grid, |_| group, &[lines], &mut Walkers::new(), &mut hits);
                hits[0]
            });
            for l in 0..LANES {
                assert!(short.hi[l] <= whole.hi[l]);
                moved += whole.hi[l] - short.hi[l];
                count += 1;
                // A ray along the edge of a spike may hit either side of it.
                assert!(
                    (hits[0][l] - hits[1][l]).abs() < 2e-6 * hits[0][l],
                    "{} {} {:?}",
                    hits[0][l],
                    hits[1][l],
                    (lines.x[l], lines.y[l], lines.sx[l], lines.sy[l])
                );
            }
        }
        assert!(moved / count as f32 > 0.3 * (top - bottom), "the approach is idle");
    }
}
