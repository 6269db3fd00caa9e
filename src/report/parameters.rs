//! Histograms of the drawn parameters, and the rejected draws.

use super::histogram::histogram;
use super::text::table;
use crate::text::cut;
use glasshouse_line::{Focus, SceneLine};
use maud::{Markup, html};
use plan::RejectedScene;
use std::collections::BTreeMap;

/// Maximum length of a reason on the page, in characters.
const REASON_SHOWN: usize = 500;

/// Name and unit of a parameter, and the function that reads it from a scene.
type Parameter = (&'static str, &'static str, fn(&SceneLine) -> Option<f64>);

const PARAMETERS: [Parameter; 19] = [
    ("glass thickness", "mm", |l| Some(l.glass.total_thickness_m() * 1e3)),
    ("index of refraction", "", |l| Some(l.glass.first_glass().0)),
    ("glass distance", "m", |l| Some(l.glass.distance_m)),
    ("pitch", "degrees", |l| Some(l.glass.tilt_deg[0])),
    ("yaw", "degrees", |l| Some(l.glass.tilt_deg[1])),
    ("absorption of red", "per m", |l| Some(l.glass.first_glass().1[0])),
    ("absorption of green", "per m", |l| Some(l.glass.first_glass().1[1])),
    ("absorption of blue", "per m", |l| Some(l.glass.first_glass().1[2])),
    ("focal length", "mm", |l| Some(l.camera.focal_length_mm)),
    ("aperture radius", "mm", |l| Some(l.camera.aperture_radius_m * 1e3)),
    ("f-number", "", |l| {
        let diameter_mm = l.camera.aperture_radius_m * 2e3;
        (diameter_mm > 0.0).then(|| l.camera.focal_length_mm / diameter_mm)
    }),
    ("drawn focus distance", "m", |l| match l.camera.focus {
        Focus::Distance { distance_m } => Some(distance_m),
        Focus::At { .. } => None,
    }),
    ("exposure of the front", "EV", |l| ev(l.front.exposure())),
    ("exposure of the back", "EV", |l| ev(l.back.exposure())),
    ("back against front", "EV", |l| Some(ev(l.back.exposure())? - ev(l.front.exposure())?)),
    ("exposure of the camera", "EV", |l| ev(l.camera.exposure)),
    ("white balance, red", "", |l| Some(l.camera.white_balance[0])),
    ("white balance, blue", "", |l| Some(l.camera.white_balance[2])),
    ("samples a pixel", "", |l| Some(f64::from(l.film.spp))),
];

fn ev(exposure: f64) -> Option<f64> {
    (exposure > 0.0).then(|| exposure.log2())
}

/// Draws a histogram of every parameter that differs among `lines`.
pub(super) fn parameters(lines: &[SceneLine]) -> Markup {
    let plots = PARAMETERS.iter().filter_map(|(name, unit, of)| {
        let values: Vec<f64> = lines.iter().filter_map(of).collect();
        histogram(name, unit, &values)
    });
    let plots: Vec<Markup> = plots.collect();
    html! {
        @if plots.is_empty() {
            p.dim { "All scenes have the same parameters." }
        } @else {
            p { "Parameters that differ among " (lines.len()) " scenes. The dashed line is the median." }
            div.plots { @for plot in plots { (plot) } }
        }
    }
}

/// Draws the table of rejected draws, or nothing if `rejected` is empty.
pub(super) fn rejections(scenes: usize, rejected: &[RejectedScene]) -> Markup {
    if rejected.is_empty() {
        return html! {};
    }
    let mut rules: BTreeMap<&str, (usize, &str)> = BTreeMap::new();
    for one in rejected {
        rules.entry(&one.rule).or_insert((0, &one.reason)).0 += 1;
    }
    let draws = scenes + rejected.len();
    let percent = |count: usize| format!("{:.1} %", 100.0 * count as f64 / draws as f64);
    let rows = html! {
        @for (rule, (count, reason)) in rules {
            tr {
                td { (rule) }
                td.n { (count) }
                td.n { (percent(count)) }
                td { (cut(reason, REASON_SHOWN)) }
            }
        }
    };
    html! {
        h3 { "Rejected draws" }
        p {
            (draws) " draws were examined for " (scenes) " scenes; " (rejected.len())  " draws ("
            (percent(rejected.len())) ") were rejected and replaced by other draws. "
            code { "rejected.jsonl" } " lists each rejected draw with its reason."
        }
        (table("Rejected draws", &["rule", "#draws", "#of all draws", "for example"], &rows))
    }
}
