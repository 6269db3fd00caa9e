//! Which orders of the glass a scene needs, and how many samples each: model only what can be seen.
//!
//! Every order that is followed is followed by every ray, never chosen at random, so there is no Fresnel noise.
//! An order whose weight times the largest radiance of its side stays below the film's tolerance is dropped; the
//! closed-form sum of what was dropped is recorded with the tuple.

use super::slab::{Order, Slab};

/// Round trips that are followed at most, on either side.
const MAX_ROUND_TRIPS: u32 = 16;

/// An order is *weak* while weight x radiance stays below one 8-bit step at white: then its noise cannot be seen
/// and a sixteenth of the samples is enough.
const WEAK_RADIANCE: f64 = 1.0 / 255.0;

/// One order that is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowedOrder {
    /// Which.
    pub order: Order,
    /// Its largest weight over the film.
    pub max_weight: f64,
    /// It takes only the first sixteenth (at least 1) of each aligned block of 256 samples.
    pub weak: bool,
}

/// The orders of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderPlan {
    /// Transmitted orders, t_0 first; it is always there, because T needs its line.
    pub front: Vec<FollowedOrder>,
    /// Reflected orders.
    pub back: Vec<FollowedOrder>,
    /// Bound of what the dropped orders of the front would add to I, linear radiance.
    pub front_tail: f64,
    /// The same for the back (I and R~).
    pub back_tail: f64,
    /// R, which has no lens, takes fewer samples (see [`OrderPlan::clean_spp`]).
    pub thin_clean_reflection: bool,
}

impl OrderPlan {
    /// Decides for a slab, the cosines of incidence that the film sees (a dense set) and the largest radiance
    /// of the front and the back scene.
    pub fn new(slab: &Slab, cosines: &[f64], max_radiance: [f64; 2], tolerance: f64) -> Self {
        let max_of = |order: Order| {
            let weight = |&c: &f64| slab.weight(order, c).into_iter().fold(0.0, f64::max);
            cosines.iter().map(weight).fold(0.0, f64::max)
        };
        let follow = |make: fn(u32) -> Order, radiance: f64| -> Vec<FollowedOrder> {
            (0..MAX_ROUND_TRIPS)
                .map(|k| (make(k), max_of(make(k))))
                .filter(|(order, weight)| {
                    *order == Order::Transmitted(0)
                        || weight * radiance >= tolerance.max(f64::MIN_POSITIVE)
                })
                .map(|(order, max_weight)| {
                    let first = matches!(order, Order::Transmitted(0) | Order::Reflected(0));
                    let weak = !first && max_weight * radiance < WEAK_RADIANCE;
                    FollowedOrder {
                        order,
                        max_weight,
                        weak,
                    }
                })
                .collect()
        };
        let front = follow(Order::Transmitted, max_radiance[0]);
        let back = follow(Order::Reflected, max_radiance[1]);
        let tail = |followed: &[FollowedOrder], total: &dyn Fn(f64) -> [f64; 3], radiance: f64| {
            let dropped = |&c: &f64| {
                let mut rest = total(c);
                for f in followed {
                    let weight = slab.weight(f.order, c);
                    (0..3).for_each(|k| rest[k] -= weight[k]);
                }
                rest.into_iter().fold(0.0, f64::max)
            };
            cosines.iter().map(dropped).fold(0.0, f64::max) * radiance
        };
        let front_tail = tail(&front, &|c| slab.total_transmittance(c), max_radiance[0]);
        let back_tail = tail(&back, &|c| slab.total_reflectance(c), max_radiance[1]);
        let thin_clean_reflection = max_radiance[1] <= 1.0;
        Self {
            front,
            back,
            front_tail,
            back_tail,
            thin_clean_reflection,
        }
    }

    /// Samples that R takes of `spp`: max(n/4, min(n, 128)), the first of the sequence; all where a light is
    /// brighter than white.
    pub fn clean_spp(&self, spp: u32) -> u32 {
        if self.thin_clean_reflection {
            (spp / 4).max(spp.min(128))
        } else {
            spp
        }
    }
}

impl FollowedOrder {
    /// Samples that the order takes of an aligned block of `samples` (at most 256).
    pub fn samples_of_block(&self, samples: u32) -> u32 {
        if self.weak {
            (samples / 16).max(1)
        } else {
            samples
        }
    }
}
