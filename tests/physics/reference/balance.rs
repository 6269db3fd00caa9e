//! The balance of orders behind facets: the weights of a pixel add up as if all orders took all samples.

use super::{Reference, Scattered};
use crate::rough::RoughReference;
use glam::DVec3;
use render::trace::{Cut, LARGEST_BALANCE, OrderPlan, PixelSeed, RoughPane, sample};
use std::collections::BTreeMap;

impl Reference<'_> {
    /// Returns the factors of orders behind facets by block and thinning: what orders of more samples leave of the light of all their samples, over
    /// what they leave of the order's own.
    pub(super) fn balance(
        &self,
        (plan, pane, is_smeared): (&OrderPlan, Option<&RoughPane>, bool),
        of_orders: &[u32],
        (x, y): (u32, u32),
        seed: &PixelSeed,
    ) -> BTreeMap<(u32, u32), [f64; 3]> {
        let mut factors = BTreeMap::new();
        let reference = if is_smeared { &self.smeared } else { &self.rough };
        let (Some(pane), Some((reference, cuts))) = (pane, reference) else { return factors };
        if !pane.has_facets() {
            return factors;
        }
        let spp = self.scene.spp;
        let block = spp.min(256);
        let followed: Vec<_> = plan.front.iter().chain(&plan.back).enumerate().collect();
        let mut thinnings = of_orders.to_vec();
        thinnings.sort_unstable();
        thinnings.dedup();
        for of_block in 0..spp / block {
            let samples = |thinning: u32| (block / thinning).max(1);
            let mut left: Vec<[f64; 3]> = (0..block)
                .map(|s| {
                    let (_, lens, d) = self.camera(x, y, sample(seed, of_block * block + s));
                    [if is_smeared { reference.share(lens, d) } else { 1.0 }; 3]
                })
                .collect();
            let shares = left.clone();
            let mean = |left: &[[f64; 3]], n: u32| {
                let sums = left[..n as usize].iter();
                let sum = |sum: [f64; 3], left: &[f64; 3]| [0, 1, 2].map(|c| sum[c] + left[c]);
                sums.fold([0.0; 3], sum).map(|sum| (sum / f64::from(n)).max(0.0))
            };
            let (mut factor, mut missing) = ([1.0; 3], [0.0; 3]);
            let mut kept = mean(&left, samples(thinnings[0]));
            for pair in thinnings.windows(2) {
                for (number, of) in
                    followed.iter().filter(|(number, _)| of_orders[*number] == pair[0])
                {
                    let side = usize::from(*number >= plan.front.len());
                    let index = number - side * plan.front.len();
                    let paths = pane.paths(of.order, index);
                    for s in 0..samples(pair[0]) {
                        let number = of_block * block + s;
                        let (_, lens, d) = self.camera(x, y, sample(seed, number));
                        let rays = (paths.as_slice(), (seed, number));
                        let pane = (reference, cuts);
                        let weight =
                            scattered_weight(pane, side, of.carries_dropped, rays, lens, d);
                        let s = s as usize;
                        (0..3).for_each(|c| left[s][c] -= shares[s][c] * weight[c]);
                    }
                }
                let [before, own] = [pair[0], pair[1]].map(|of| mean(&left, samples(of)));
                for c in 0..3 {
                    if pair[0] == thinnings[0] {
                        kept[c] -= before[c];
                    }
                    let target = factor[c] * before[c];
                    factor[c] *= (before[c] / own[c]).min(LARGEST_BALANCE);
                    missing[c] += target - factor[c] * own[c];
                }
                factors.insert((of_block, pair[1]), factor);
            }
            // Without smudges in the pixel, nothing is kept.
            let first = [0, 1, 2].map(|c| 1.0 + missing[c].max(0.0) / kept[c].max(1e-9));
            factors.insert((of_block, thinnings[0]), first);
        }
        factors
    }
}

/// Returns the weight of an order of one side along these paths through a pane; `is_last` has the light of cuts.
pub(super) fn scattered_weight(
    (pane, cuts): (&RoughReference, &Vec<Cut>),
    side: usize,
    is_last: bool,
    (paths, of): Scattered<'_>,
    origin: DVec3,
    d: DVec3,
) -> [f64; 3] {
    let mut weight = [0.0; 3];
    // The light of cuts has an order of its own, with the line of the order before it.
    if is_last && !cuts.is_empty() {
        for cut in cuts {
            let light = pane.follow(&cut.meetings, of, origin, d).weight();
            (0..3).for_each(|c| weight[c] += light[c] * cut.division[side][c]);
        }
        return weight;
    }
    for path in paths {
        let light = pane.follow(path, of, origin, d).weight();
        (0..3).for_each(|c| weight[c] += light[c]);
    }
    weight
}
