//! Groups of orders that share bundles and sums.
//!
//! A strong order fills bundles of its own. Weak orders of a side with the same few samples share bundles, because spans, walks and
//! radiance then serve many rays at once; their means add up, so that they share sums, too.

use super::bundle::Row;
use super::lines::{Path, path_of, pinhole_path, smooth_path_of};
use super::orders::FollowedOrder;
use super::scene::Scene;
use super::slab::Order;

/// Thinning from which on orders share bundles.
const SHARED_THINNING: u32 = 4;

/// Orders of one side with the same number of samples.
pub(super) struct Group<'a> {
    /// Divisor of the samples (see [`FollowedOrder::thinning`]).
    pub(super) thinning: u32,
    /// One row of each order, of sample 0.
    pub(super) rows: Vec<Row<'a>>,
    pub(super) paths: Vec<Path<'a>>,
}

/// The groups of a scene.
pub(super) struct Groups<'a> {
    /// Groups of the front, t_0 first, and of the back, the first order first. These two orders are alone.
    pub(super) sides: [Vec<Group<'a>>; 2],
    /// The path of T.
    pub(super) bare: Group<'a>,
    /// The path of R.
    pub(super) clean: Group<'a>,
}

impl<'a> Group<'a> {
    fn new(thinning: u32, rows: Vec<Row<'a>>) -> Self {
        let paths = rows.iter().map(|row| row.path).collect();
        Self { thinning, rows, paths }
    }

    /// Returns the number of samples that each order takes of an aligned block (of at most 256).
    pub(super) fn samples_of_block(&self, samples: u32) -> u32 {
        (samples / self.thinning).max(1)
    }

    /// Lists the rows of a chunk. `ends` are the numbers of its samples in the first quarter of a pixel's samples, in the first half, and in
    /// all. The rows of all orders in the first quarter come first, then those in the second, then the rest.
    #[inline(always)]
    pub(super) fn list(&self, ends: [usize; 3], rows: &mut Vec<Row<'a>>) {
        rows.clear();
        for samples in [0..ends[0], ends[0]..ends[1], ends[1]..ends[2]] {
            for row in &self.rows {
                rows.extend(samples.clone().map(|sample| Row { sample, ..*row }));
            }
        }
    }
}

impl<'a> Groups<'a> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        let row = |path, order, carries_dropped| Row { sample: 0, path, order, carries_dropped };
        let bare = Order::Transmitted(0);
        let bare = row(smooth_path_of(scene, bare, 0), Some(bare), false);
        let clean = row(pinhole_path(scene), None, false);
        Self {
            sides: [&scene.orders.front, &scene.orders.back].map(|of| group(scene, of)),
            bare: Group::new(1, vec![bare]),
            clean: Group::new(1, vec![clean]),
        }
    }

    /// Returns the number of groups of both sides, of T and of R.
    pub(super) fn count(&self) -> usize {
        self.sides.iter().map(Vec::len).sum::<usize>() + 2
    }
}

/// Groups the orders of a side.
fn group<'a>(scene: &'a Scene, orders: &'a [FollowedOrder]) -> Vec<Group<'a>> {
    let mut groups: Vec<Group<'a>> = vec![];
    for (index, followed) in orders.iter().enumerate() {
        let FollowedOrder { order, thinning, carries_dropped, .. } = *followed;
        let path = path_of(scene, order, index);
        let row = Row { sample: 0, path, order: Some(order), carries_dropped };
        let shares = thinning >= SHARED_THINNING;
        let others = groups.iter_mut().skip(1).find(|group| group.thinning == thinning);
        match others.filter(|_| shares) {
            Some(group) => {
                group.rows.push(row);
                group.paths.push(path);
            }
            None => groups.push(Group::new(thinning, vec![row])),
        }
    }
    groups
}
