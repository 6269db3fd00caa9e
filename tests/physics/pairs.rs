//! Every pair of features of a pane, at 32 x 32 px, against the f64 renderer: the table in docs/physics.md.

use crate::case::{Apex, Case, bumpy};
use crate::cover::{Edges, noisy_card};
use crate::pixels::compare;
use crate::smudges::Smudged;
use crate::stack::{coated_double_pane, double_pane};
use render::trace::{Coating, Smear, Stack, StackLayer};

/// A feature of a pane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Feature {
    Layers,
    Coatings,
    Absorption,
    Tilt,
    Roughness,
    Smudges,
    Outline,
    Cards,
    Bow,
    Wave,
    Wedge,
}

use Feature::{
    Absorption, Bow, Cards, Coatings, Layers, Outline, Roughness, Smudges, Tilt, Wave, Wedge,
};

const ALL: [Feature; 11] =
    [Layers, Coatings, Absorption, Tilt, Roughness, Smudges, Outline, Cards, Bow, Wave, Wedge];

/// Pairs that the line or the recipe refuses by name.
const REFUSED: [[Feature; 2]; 4] = [[Layers, Bow], [Coatings, Bow], [Bow, Wave], [Bow, Wedge]];

/// Returns the layers and coatings of a pane; `None` for a plain one.
fn stack(features: [Feature; 2]) -> Option<Stack> {
    let has = |feature| features.contains(&feature);
    if has(Layers) && (has(Coatings) || has(Absorption)) {
        return Some(coated_double_pane());
    }
    if has(Layers) {
        return Some(double_pane());
    }
    let absorption_per_m = if has(Absorption) { [6.0, 2.0, 4.0] } else { [0.0; 3] };
    let layer = StackLayer { thickness_m: 0.006, ior: 1.52, absorption_per_m };
    let coating = Coating::constant([0.12, 0.06, 0.16], [0.80, 0.86, 0.78]);
    has(Coatings).then(|| Stack::new(vec![layer], vec![None, Some(coating)]))
}

fn case(features: [Feature; 2]) -> Case {
    let has = |feature| features.contains(&feature);
    let mut case = Case::new(bumpy(21, false), bumpy(22, false));
    (case.film, case.spp, case.apex) = ([32, 32], 32, Apex::Camera);
    case.stack = stack(features);
    let faces = case.layers().coatings().len();
    if has(Absorption) {
        case.absorption_per_m = [6.0, 2.0, 4.0];
    }
    if has(Tilt) {
        case.tilt_deg = [12.0, -18.0];
    }
    if has(Roughness) {
        case.roughness = Some(vec![0.02; faces]);
    }
    if has(Smudges) {
        let smear = Smear { roughness: 0.03, share: 0.8, transmittance: 0.7 };
        case.smudges = Some(Smudged::spotted(smear, true));
    }
    if has(Outline) {
        let (x_m, y_m) = ([-0.06, 0.05], [-0.045, 0.07]);
        let edges = Edges { x_m, y_m, frame_m: 0.02, frame_radiance: [0.3, 0.2, 0.1] };
        case.covered.edges = Some(edges);
    }
    if has(Cards) {
        let card = noisy_card(0.7, [0.1, 0.0], 0.4, 3);
        case.covered.cards = [vec![card.clone()], vec![card]];
    }
    if has(Bow) {
        case.bow_radius_m = Some(4.0);
    }
    if has(Wave) {
        case.wave = Some([1e-4, 0.1, 70.0]);
    }
    if has(Wedge) {
        case.turned_deg = vec![[0.0; 2]; faces];
        case.turned_deg[faces - 1] = [0.2, -0.4];
    }
    case
}

#[test]
fn every_pair_of_features_matches() {
    for (k, one) in ALL.into_iter().enumerate() {
        for other in ALL.into_iter().skip(k) {
            if REFUSED.contains(&[one, other]) {
                continue;
            }
            compare(&format!("{one:?} and {other:?}"), &case([one, other]));
        }
    }
}
