//! A depth image in its own projective space: inverse depth w over the pixel grid.
//!
//! In (u, v, w = 1/z) lines stay lines and triangles stay triangles, so the rubber sheet of a depth image is a
//! height field over a regular grid, and no acceleration structure but a min/max pyramid is needed.

use super::lanes::{max, min};

/// Quads a side of a block in the pyramid's lowest level, as a power of two.
const BLOCK_LOG2: u32 = 2;

/// Inverse depth at the vertices (pixel centres) and its min/max pyramid.
///
/// Vertex (i, j) stands at grid coordinates (i, j). Outside the grid the border's values continue.
pub struct Grid {
    nx: usize,
    ny: usize,
    w: Vec<f32>,
    levels: Vec<Level>,
}

/// Minimum and maximum of w over blocks of quads (their border vertices included).
struct Level {
    nx: usize,
    ny: usize,
    min_max: Vec<[f32; 2]>,
}

impl Grid {
    /// A grid of `nx` x `ny` vertices with inverse depths `w` (1/m, finite and above 0, row by row).
    ///
    /// A side of one vertex is doubled: nothing changes along it. Panics if `w` has another length.
    pub fn new(nx: usize, ny: usize, w: Vec<f32>) -> Self {
        assert!(
            nx > 0 && ny > 0 && w.len() == nx * ny,
            "a grid needs nx * ny inverse depths"
        );
        assert!(
            nx * ny < i32::MAX as usize / 2,
            "grid too large for 32-bit indices"
        );
        let (nx, w) = if nx == 1 {
            (2, w.iter().flat_map(|&v| [v, v]).collect())
        } else {
            (nx, w)
        };
        let (ny, w) = if ny == 1 {
            (2, [&w[..], &w[..]].concat())
        } else {
            (ny, w)
        };
        let mut levels = vec![lowest_level(nx, ny, &w)];
        while let Some(last) = levels.last().filter(|l| l.nx > 1 || l.ny > 1) {
            let next = coarser(last);
            levels.push(next);
        }
        Self { nx, ny, w, levels }
    }

    /// Vertices across.
    pub fn nx(&self) -> usize {
        self.nx
    }

    /// Vertices down.
    pub fn ny(&self) -> usize {
        self.ny
    }

    /// Inverse depths, row by row, 1/m.
    pub fn inverse_depths_per_m(&self) -> &[f32] {
        &self.w
    }

    /// Smallest and largest w of the whole grid.
    pub fn extremes(&self) -> [f32; 2] {
        self.levels.last().map_or([0.0, 0.0], |top| top.min_max[0])
    }

    /// Bounds of w over the quads that the box `[x0, y0, x1, y1]` (grid coordinates) touches.
    #[inline]
    pub(crate) fn bounds(&self, [x0, y0, x1, y1]: [i32; 4]) -> [f32; 2] {
        let clamp = |v: i32, n: usize| v.clamp(0, n as i32 - 2) as usize;
        let (i0, i1) = (clamp(x0, self.nx), clamp(x1, self.nx));
        let (j0, j1) = (clamp(y0, self.ny), clamp(y1, self.ny));
        let extent = (i1 - i0).max(j1 - j0);
        let mut level = 0;
        while (extent >> (BLOCK_LOG2 as usize + level)) >= 4 && level + 1 < self.levels.len() {
            level += 1;
        }
        let shift = BLOCK_LOG2 as usize + level;
        let level = &self.levels[level];
        let (mut lo, mut hi) = (f32::INFINITY, 0.0);
        for b in j0 >> shift..=j1 >> shift {
            for [block_lo, block_hi] in &level.min_max[b * level.nx..][i0 >> shift..=i1 >> shift] {
                lo = min(*block_lo, lo);
                hi = max(*block_hi, hi);
            }
        }
        [lo, hi]
    }
}

fn lowest_level(nx: usize, ny: usize, w: &[f32]) -> Level {
    let side = 1usize << BLOCK_LOG2;
    let (blocks_x, blocks_y) = ((nx - 1).div_ceil(side), (ny - 1).div_ceil(side));
    let mut min_max = Vec::with_capacity(blocks_x * blocks_y);
    let (mut column_lo, mut column_hi) = (vec![0f32; nx], vec![0f32; nx]);
    for b in 0..blocks_y {
        let rows = b * side..=(b * side + side).min(ny - 1);
        column_lo.fill(f32::INFINITY);
        column_hi.fill(0.0);
        for j in rows {
            for ((lo, hi), &v) in column_lo
                .iter_mut()
                .zip(&mut column_hi)
                .zip(&w[j * nx..][..nx])
            {
                *lo = min(v, *lo);
                *hi = max(v, *hi);
            }
        }
        for a in 0..blocks_x {
            let columns = a * side..=(a * side + side).min(nx - 1);
            let lo = column_lo[columns.clone()]
                .iter()
                .fold(f32::INFINITY, |m, &v| min(v, m));
            let hi = column_hi[columns].iter().fold(0.0, |m, &v| max(v, m));
            min_max.push([lo, hi]);
        }
    }
    Level {
        nx: blocks_x,
        ny: blocks_y,
        min_max,
    }
}

fn coarser(fine: &Level) -> Level {
    let (nx, ny) = (fine.nx.div_ceil(2), fine.ny.div_ceil(2));
    let mut min_max = Vec::with_capacity(nx * ny);
    for b in 0..ny {
        for a in 0..nx {
            let mut bounds = [f32::INFINITY, 0.0];
            for y in 2 * b..(2 * b + 2).min(fine.ny) {
                for [lo, hi] in &fine.min_max[y * fine.nx..][2 * a..(2 * a + 2).min(fine.nx)] {
                    bounds = [min(*lo, bounds[0]), max(*hi, bounds[1])];
                }
            }
            min_max.push(bounds);
        }
    }
    Level { nx, ny, min_max }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_hold_for_every_box() {
        let (nx, ny) = (37, 22);
        let w: Vec<f32> = (0..nx * ny)
            .map(|q| 0.1 + ((q * 7919) % 613) as f32 * 0.01)
            .collect();
        let grid = Grid::new(nx, ny, w.clone());
        for &[x0, y0, x1, y1] in &[
            [0, 0, 0, 0],
            [-5, -9, 50, 60],
            [3, 4, 9, 4],
            [30, 19, 36, 21],
            [0, 0, 35, 20],
            [40, 40, 60, 60],
        ] {
            let [lo, hi] = grid.bounds([x0, y0, x1, y1]);
            for y in y0..=y1 + 1 {
                for x in x0..=x1 + 1 {
                    let (x, y) = (x.clamp(0, nx as i32 - 1), y.clamp(0, ny as i32 - 1));
                    let v = w[y as usize * nx + x as usize];
                    assert!(lo <= v && v <= hi);
                }
            }
        }
    }

    #[test]
    fn single_pixels_and_rows_are_grids() {
        assert_eq!(Grid::new(1, 1, vec![0.5]).extremes(), [0.5, 0.5]);
        assert_eq!(Grid::new(1, 3, vec![0.5, 0.1, 0.9]).extremes(), [0.1, 0.9]);
        assert_eq!(
            Grid::new(3, 1, vec![0.5, 0.1, 0.9]).bounds([0, 0, 0, 0]),
            [0.1, 0.9]
        );
    }
}
