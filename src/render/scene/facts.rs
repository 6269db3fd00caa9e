//! Facts about a scene that the program determines while it loads the scene.

use super::aspect::OtherAspect;
use super::far::far_text;
use super::largest_code::largest_code_text;
use super::negligible::Negligible;
use super::place::MeshFacts;
use super::relative::RelativeEnds;
use super::view::OddView;
use crate::trace::{BLOCK, Order, Scene};
use serde::{Deserialize, Serialize};

/// Facts about a loaded scene, stored in partials and `tuple.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Focus distance; `null` for infinity.
    pub focus_distance_m: Option<f64>,
    /// Orders of the glass that the tracer follows.
    pub orders: Vec<OrderFact>,
    /// Bounds of the light of orders that are not followed, from the front and from the back, linear radiance, of any pixel and
    /// colour. This light is in the last followed order of its side, so that it is only misplaced.
    #[serde(alias = "dropped_tail")]
    pub dropped: Sides,
    /// Bound of the light that rough faces lose, linear radiance, of any pixel and colour: what their facets hide, and what leaves
    /// a face on the wrong side. The input lacks it.
    #[serde(default)]
    pub shadowed: f64,
    /// Features of the pane that are off, because they move no line of the film by more than 1e-3 px.
    #[serde(default, skip_serializing_if = "Negligible::is_empty")]
    pub negligible: Negligible,
    /// True if the search of orders ended early, because the pane has too many.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub search_was_bounded: bool,
    /// Share of depth pixels that are filled holes; 0 for a mesh.
    pub filled_share: Sides,
    /// Ends of the depth range in metres, and the share of clamped pixels, for sides with relative depth.
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub relative_depth: SidesWith<RelativeEnds>,
    /// Share of valid depth pixels, or of a mesh's vertices in view, nearer than the pane. The tracer still uses them.
    pub too_near_share: Sides,
    /// Median of the valid depths, m, of photographs where it is above [`super::FAR_MEDIAN_M`]: the unit is probably wrong.
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub far_median_m: SidesWith<f64>,
    /// Share of depth pixels with the largest code of 16 bits, of photographs where it is above 0.1 %: the code probably means
    /// "no depth".
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub largest_code_share: SidesWith<f64>,
    /// Sizes of photographs whose depth image has another aspect ratio than the colour image.
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub other_aspect: SidesWith<OtherAspect>,
    /// Intrinsics of photographs that are probably wrong.
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub odd_view: SidesWith<OddView>,
    /// Largest linear radiance.
    pub max_radiance: Sides,
    /// Facts about the sides that are meshes.
    #[serde(default, skip_serializing_if = "SidesWith::is_empty")]
    pub meshes: SidesWith<MeshFacts>,
}

impl SceneFacts {
    /// States the orders of a scene, with their numbers of samples.
    pub(super) fn state_orders(&mut self, scene: &Scene) {
        let smeared = scene.smeared.as_ref().map(|smeared| &smeared.orders);
        self.orders = order_facts(scene);
        let plans = || std::iter::once(&scene.orders).chain(smeared);
        let [front, back] = [0, 1].map(|side| plans().map(|plan| plan.dropped[side]).sum());
        self.dropped = Sides { front, back };
        self.shadowed = plans().map(|plan| plan.shadowed).sum();
        self.search_was_bounded = plans().any(|plan| plan.search_was_bounded);
    }

    /// Returns remarks on the scene's files.
    pub fn notes(&self) -> Vec<String> {
        let of = |side: &'static str, is_front: bool| {
            let name = format!("{side} photograph");
            [
                self.far_median_m.of(is_front).map(|far_m| far_text(&name, *far_m)),
                self.largest_code_share.of(is_front).map(|share| largest_code_text(&name, *share)),
                self.other_aspect.of(is_front).map(|aspect| aspect.text(&name)),
                self.odd_view.of(is_front).map(|view| view.text(&name)),
            ]
        };
        let bounded = self.search_was_bounded.then(|| {
            "the pane has so many orders of light that their search was cut short; facts.dropped bounds the light of \
             those that are not followed"
                .to_owned()
        });
        let sides = [of("front", true), of("back", false)];
        sides.into_iter().flatten().flatten().chain(bounded).collect()
    }
}

/// One value for each side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sides {
    /// The side behind the pane, seen through it.
    pub front: f64,
    /// The side before the pane, seen by reflection.
    pub back: f64,
}

/// An optional value for each side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SidesWith<T> {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub front: Option<T>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub back: Option<T>,
}

impl<T> Default for SidesWith<T> {
    fn default() -> Self {
        Self { front: None, back: None }
    }
}

impl<T> SidesWith<T> {
    fn of(&self, is_front: bool) -> Option<&T> {
        if is_front { self.front.as_ref() } else { self.back.as_ref() }
    }

    pub fn is_empty(&self) -> bool {
        self.front.is_none() && self.back.is_none()
    }
}

/// An order of the glass that the tracer follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrderFact {
    /// Name of the order: `t0`, `t1`, ..., `r0`, `r1`, ...; of light that meets smudges, `st0`, ..., `sr0`, ...
    pub order: String,
    /// Largest weight over the film.
    pub max_weight: f64,
    pub samples: u32,
}

/// Lists the orders of a scene, each with its number of samples in the zones with most light.
fn order_facts(scene: &Scene) -> Vec<OrderFact> {
    let block = scene.spp.min(BLOCK as u32);
    let smeared = scene.smeared.as_ref().map(|smeared| &smeared.orders);
    let plans = [(Some(&scene.orders), ""), (smeared, "s")];
    let all = plans.into_iter().flat_map(|(plan, prefix)| {
        let orders = plan.into_iter().flat_map(|plan| plan.front.iter().chain(&plan.back));
        orders.map(move |followed| (followed, prefix))
    });
    all.enumerate()
        .map(|(number, (followed, prefix))| OrderFact {
            order: match followed.order {
                Order::Transmitted(k) => format!("{prefix}t{k}"),
                Order::Reflected(k) => format!("{prefix}r{k}"),
            },
            max_weight: followed.max_weight,
            samples: followed.samples_of_block(block, scene.zones.least(number))
                * (scene.spp / block),
        })
        .collect()
}
