//! Keeps the light of a pane with facets in balance when some of its orders take fewer samples.
//!
//! The weights of all orders of one camera sample add up to 1, less what is lost and absorbed. An order that takes few samples has its weights for these
//! alone, and a rare facet that sends much light along it would make a pixel brighter than any light. What the orders of more samples leave of each sample,
//!
//! ```text
//! U_k(s) = 1 - sum of the weights of the orders in the classes before k
//! ```
//!
//! is known for all samples of the class before k. So the light of class k, with the samples S_k, has the factor
//!
//! ```text
//! f_k = f_(k-1) min(mean of U_k over S_(k-1) / mean of U_k over S_k, LARGEST_BALANCE)        for k > 0
//! ```
//!
//! (a ratio estimator: Cochran, *Sampling Techniques*, 3rd ed., chapter 6). Few samples may meet nearly none of a class's light, and
//! their factor would magnify rounding; what the limit leaves out is light of the class 0. So the light of all classes is that of the sums of weights of all
//! samples, in each pixel: between photographs of one radiance, I has this radiance or less.

use super::lanes::{CHUNK, LANES, Lane};
use super::means::{LaneSums, ends_in_block};
use super::rough::RoughRays;

/// Weights of sixteen pixels for red, green and blue.
type Light = [[f64; LANES]; 3];

/// Largest factor between the light of a class and of that before.
pub const LARGEST_BALANCE: f64 = 4.0;

/// Orders of a pane with the same number of samples.
struct Class {
    thinning: u32,
    /// The ways of the orders.
    ways: Vec<usize>,
    /// Sums of U over the samples of the class before, and over its own: up to the first quarter, the first half, and all.
    sums: [[Light; 3]; 2],
    /// Factors of the light of a block in these three.
    factors: [Light; 3],
}

/// The classes of a pane, from the largest number of samples on.
pub(super) struct Balance(Vec<Class>);

/// Sizes of a range: the number of its blocks, and of the samples of each.
#[derive(Clone, Copy)]
pub(super) struct Blocks {
    pub(super) count: u32,
    pub(super) samples: u32,
}

impl Blocks {
    /// Returns the numbers of samples of a block that are in the first quarter, in the first half and in all samples of orders with this thinning.
    #[inline(always)]
    fn ends(self, thinning: u32, block: u32) -> [usize; 3] {
        let of_block = (self.samples / thinning).max(1);
        ends_in_block(of_block, block, self.count).map(|end| end as usize)
    }
}

impl Balance {
    /// Makes the classes of orders with these thinnings and ways; `None` if all take the same samples, and need no balance.
    pub(super) fn new(orders: impl Iterator<Item = (u32, usize)>) -> Option<Self> {
        let mut classes: Vec<Class> = vec![];
        for (thinning, way) in orders {
            if let Some(class) = classes.iter_mut().find(|class| class.thinning == thinning) {
                class.ways.push(way);
            } else {
                let (sums, factors) = Default::default();
                classes.push(Class { thinning, ways: vec![way], sums, factors });
            }
        }
        classes.sort_by_key(|class| class.thinning);
        (classes.len() > 1).then_some(Self(classes))
    }

    /// Begins a block.
    pub(super) fn begin(&mut self) {
        self.0.iter_mut().for_each(|class| class.sums = Default::default());
    }

    /// Adds the `count` samples from number `first` of a block on. `shares` are those of the light that meets the pane.
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        rays: &RoughRays,
        shares: Option<&[Lane; CHUNK]>,
        (blocks, block): (Blocks, u32),
        (first, count): (usize, usize),
    ) {
        for s in 0..count {
            let share = shares.map_or([1.0; LANES], |shares| shares[s]);
            let mut left = [share; 3];
            let mut of_before = [0; 3];
            for class in &mut self.0 {
                let own = blocks.ends(class.thinning, block);
                for (sums, ends) in class.sums.iter_mut().zip([of_before, own]) {
                    for (sums, end) in sums.iter_mut().zip(ends) {
                        if first + s < end {
                            for c in 0..3 {
                                for l in 0..LANES {
                                    sums[c][l] += f64::from(left[c][l]);
                                }
                            }
                        }
                    }
                }
                if first + s >= own[2] {
                    break;
                }
                for way in &class.ways {
                    let weights = rays.weights(*way);
                    for c in 0..3 {
                        let weights = &weights[if rays.is_coloured { c } else { 0 }][s];
                        for l in 0..LANES {
                            left[c][l] -= share[l] * weights[l];
                        }
                    }
                }
                of_before = own;
            }
        }
    }

    /// Finds the factors of a block.
    #[inline(always)]
    pub(super) fn end(&mut self, (blocks, block): (Blocks, u32)) {
        let ends: Vec<_> = self.0.iter().map(|of| blocks.ends(of.thinning, block)).collect();
        for part in 0..3 {
            for c in 0..3 {
                for l in 0..LANES {
                    let (mut factor, mut missing, mut kept) = (1.0, 0.0, 0.0);
                    for (k, class) in self.0.iter_mut().enumerate() {
                        let mean = |sums: &[Light; 3], k: usize| {
                            (sums[part][c][l] / ends[k][part].max(1) as f64).max(0.0)
                        };
                        let own = mean(&class.sums[1], k);
                        if k == 0 {
                            kept = own;
                        } else if ends[k][part] > 0 {
                            let of_before = mean(&class.sums[0], k - 1);
                            if k == 1 {
                                kept -= of_before;
                            }
                            let target = factor * of_before;
                            factor *= (of_before / own).min(LARGEST_BALANCE);
                            missing += target - factor * own;
                        }
                        class.factors[part][c][l] = factor;
                    }
                    if missing > 0.0 && kept > 0.0 {
                        self.0[0].factors[part][c][l] += missing / kept;
                    }
                }
            }
        }
    }

    /// Scales the sums of a group of orders with this thinning at the end of a block.
    #[inline(always)]
    pub(super) fn scale(&self, thinning: u32, sums: &mut LaneSums) {
        let class = self.0.iter().find(|class| class.thinning == thinning);
        let factors = &class.expect("a class of each group").factors;
        for l in 0..LANES {
            for c in 0..3 {
                let (mut until, mut scaled) = (0.0, 0.0);
                for part in 0..3 {
                    until += sums[part][l][c];
                    let all = factors[part][c][l] * until;
                    sums[part][l][c] = all - scaled;
                    scaled = all;
                }
            }
        }
    }
}
