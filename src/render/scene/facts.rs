//! Facts about a scene that loading determines.

use super::place::MeshFacts;
use super::relative::RelativeEnds;
use crate::trace::{BLOCK, Order, OrderPlan};
use serde::{Deserialize, Serialize};

/// Facts about a loaded scene, stored in partials and `tuple.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Focus distance; `null` is infinity.
    pub focus_distance_m: Option<f64>,
    /// The orders of the glass that are followed.
    pub orders: Vec<OrderFact>,
    /// Bound of the light of the dropped orders, linear radiance: to I from the front, to I and R~ from the back.
    pub dropped_tail: Sides,
    /// Share of depth pixels that are filled holes.
    pub filled_share: Sides,
    /// Of the sides with relative depth: the ends in metres.
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub relative_depth: SidesWith<RelativeEnds>,
    /// Share of valid depth pixels nearer than the pane; they are traced nevertheless.
    pub too_near_share: Sides,
    /// Largest linear radiance.
    pub max_radiance: Sides,
    /// Of the sides that are meshes.
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub meshes: SidesWith<MeshFacts>,
}

/// One value for each side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sides {
    /// Seen through the pane.
    pub front: f64,
    /// Seen reflected in it.
    pub back: f64,
}

/// A value for each side that has one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SidesWith<T> {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub front: Option<T>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub back: Option<T>,
}

impl<T> SidesWith<T> {
    fn is_empty(&self) -> bool {
        self.front.is_none() && self.back.is_none()
    }
}

/// An order of the glass that is followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrderFact {
    /// `t0`, `t1`, ..., `r0`, `r1`, ...
    pub order: String,
    /// Largest weight over the film.
    pub max_weight: f64,
    pub samples: u32,
}

/// The orders of the plan, with the samples that each takes of `spp`.
pub(super) fn order_facts(orders: &OrderPlan, spp: u32) -> Vec<OrderFact> {
    let block = spp.min(BLOCK as u32);
    let all = orders.front.iter().chain(&orders.back);
    all.map(|followed| OrderFact {
        order: match followed.order {
            Order::Transmitted(k) => format!("t{k}"),
            Order::Reflected(k) => format!("r{k}"),
        },
        max_weight: followed.max_weight,
        samples: followed.samples_of_block(block) * (spp / block),
    })
    .collect()
}
