//! Groups of orders that share bundles and sums.
//!
//! A strong order fills bundles of its own. Weak orders of a side with the same few samples share bundles, because spans, walks and
//! radiance then serve many rays at once; their means add up, so that they share sums, too.

use super::bundle::Row;
use super::lines::{Path, path_of, pinhole_path, smooth_path_of};
use super::orders::{FollowedOrder, OrderPlan};
use super::scene::Scene;
use super::slab::Order;
use super::smudges::SmearedPane;

/// Thinning from which on orders share bundles.
const SHARED_THINNING: u32 = 4;

/// Orders of one side with the same number of samples.
pub(super) struct Group<'a> {
    /// Divisor of the samples (see [`FollowedOrder::thinning`]).
    pub(super) thinning: u32,
    /// True if the light meets smudges.
    pub(super) is_smeared: bool,
    /// One row of each order, of sample 0.
    pub(super) rows: Vec<Row<'a>>,
    pub(super) paths: Vec<Path<'a>>,
}

/// The groups of a scene.
pub(super) struct Groups<'a> {
    /// Groups of the front, t_0 first, and of the back, the first order first; then those under smudges. The first orders are alone.
    pub(super) sides: [Vec<Group<'a>>; 2],
    /// The path of T.
    pub(super) bare: Group<'a>,
    /// The path of R.
    pub(super) clean: Group<'a>,
}

impl<'a> Group<'a> {
    fn new(thinning: u32, row: Row<'a>) -> Self {
        let is_smeared = matches!(row.path, Path::Smeared(_));
        Self { thinning, is_smeared, paths: vec![row.path], rows: vec![row] }
    }

    /// True for t_0 through the clean pane, or beside it.
    pub(super) fn is_t_0(&self) -> bool {
        self.rows[0].is_t_0()
    }

    /// True for the reflection of the front face.
    pub(super) fn is_r_0(&self) -> bool {
        self.rows[0].order == Some(Order::Reflected(0))
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
    /// Makes the groups of zones of this kind.
    pub(super) fn new(scene: &'a Scene, kind: usize) -> Self {
        let row = |path, order, carries_dropped| Row { sample: 0, path, order, carries_dropped };
        let bare = Order::Transmitted(0);
        let bare = row(smooth_path_of(scene, bare, 0), Some(bare), false);
        let clean = row(pinhole_path(scene), None, false);
        let mut sides = [vec![], vec![]];
        let mut number = 0;
        for (list, orders) in lists(scene).into_iter().enumerate() {
            let thinned = orders.into_iter().zip(number..).map(|((followed, path), number)| {
                (followed, path, followed.thinning(scene.zones.of_kind(kind, number)))
            });
            let thinned: Vec<_> = thinned.collect();
            number += thinned.len();
            sides[list % 2].extend(group(&thinned));
        }
        Self { sides, bare: Group::new(1, bare), clean: Group::new(1, clean) }
    }

    /// Returns thinning and way of each order through a pane with facets: the clean one, or that under smudges.
    pub(super) fn ways(&self, is_smeared: bool) -> impl Iterator<Item = (u32, usize)> {
        self.sides.iter().flatten().flat_map(move |group| {
            group.paths.iter().filter_map(move |path| match path {
                Path::Rough(way) if !is_smeared => Some((group.thinning, *way)),
                Path::Smeared(way) if is_smeared => Some((group.thinning, *way)),
                _ => None,
            })
        })
    }

    /// Returns the number of groups of both sides, of T and of R.
    pub(super) fn count(&self) -> usize {
        self.sides.iter().map(Vec::len).sum::<usize>() + 2
    }
}

/// Returns the orders of the front and of the back, and those under smudges, with their paths.
pub(super) fn lists(scene: &Scene) -> [Vec<(FollowedOrder, Path<'_>)>; 4] {
    let OrderPlan { front, back, .. } = &scene.orders;
    let clean = [front, back].map(|orders| {
        let orders = orders.iter().enumerate();
        orders.map(|(index, of)| (*of, path_of(scene, of.order, index))).collect()
    });
    let smeared = [0, 1].map(|side| {
        let Some(SmearedPane { pane, orders, .. }) = &scene.smeared else { return vec![] };
        let orders = [&orders.front, &orders.back][side].iter().enumerate();
        orders.map(|(index, of)| (*of, Path::Smeared(pane.way(of.order, index)))).collect()
    });
    let ([front, back], [smeared_front, smeared_back]) = (clean, smeared);
    [front, back, smeared_front, smeared_back]
}

/// Groups orders, which have these paths and thinnings.
fn group<'a>(orders: &[(FollowedOrder, Path<'a>, u32)]) -> Vec<Group<'a>> {
    let mut groups: Vec<Group<'a>> = vec![];
    for (FollowedOrder { order, carries_dropped, .. }, path, thinning) in orders.iter().copied() {
        let row = Row { sample: 0, path, order: Some(order), carries_dropped };
        let shares = thinning >= SHARED_THINNING;
        let others = groups.iter_mut().skip(1).find(|group| group.thinning == thinning);
        match others.filter(|_| shares) {
            Some(group) => {
                group.rows.push(row);
                group.paths.push(path);
            }
            None => groups.push(Group::new(thinning, row)),
        }
    }
    groups
}
