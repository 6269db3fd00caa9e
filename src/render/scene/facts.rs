//! What loading a scene finds out about it.

use super::place::MeshSides;
use super::relative::RelativeSides;
use crate::trace::{BLOCK, Order, OrderPlan};
use serde::{Deserialize, Serialize};

/// What loading found out about a scene. Partials and `tuple.json` keep it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Focus distance; `null` is infinity.
    pub focus_distance_m: Option<f64>,
    /// Orders of the glass that were followed.
    pub orders: Vec<OrderFact>,
    /// Bound of what the dropped orders would add, linear radiance: to I from the front, to I and R~ from the back.
    pub dropped_tail: Sides,
    /// Share of depth pixels that were holes and were filled.
    pub filled_share: Sides,
    /// Of the sides whose depth is relative: the metres that it was given.
    #[serde(default, skip_serializing_if = "RelativeSides::is_empty")]
    pub relative_depth: RelativeSides,
    /// Share of valid depth pixels nearer than the pane (they are seen all the same).
    pub too_near_share: Sides,
    /// Largest linear radiance.
    pub max_radiance: Sides,
    /// Of the sides that are meshes.
    #[serde(default, skip_serializing_if = "MeshSides::is_empty")]
    pub meshes: MeshSides,
}

/// One value for each side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sides {
    /// Seen through the pane.
    pub front: f64,
    /// Seen reflected in it.
    pub back: f64,
}

/// An order that was followed.
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
