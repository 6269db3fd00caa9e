//! Cost and error of a recipe's scenes, by feature of the pane and by stage of the work.
//!
//! Each scene is rendered as drawn, with its stack made flat, smooth and clean, and with a plain pane of 4 mm without covers,
//! in turns: so the ratios do not depend on the machine, and little on its other work.

use super::clock::median;
use super::error::BenchError;
use super::render::{Work, render};
use super::scenes::BenchScene;
use crate::farm::{FarmError, WorkOptions, work};
use crate::run::Run;
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::Layer;
use glasshouse_line::{GlassLayer, SceneLine};
use render::scene::{LoadError, Negligible, SceneFiles, decode};
use render::trace::Sampling;
use serde::Serialize;
use std::collections::BTreeMap;

/// Thickness of the plain pane, m, and its index of refraction.
const PLAIN: (f64, f64) = (0.004, 1.52);

/// A scene's costs with each of three panes.
#[derive(Clone, Debug, Serialize)]
pub struct SceneCost {
    pub scene: String,
    /// What the drawn pane has beyond a flat stack, and its number of glasses, such as `wave + wedge, two glasses`.
    pub features: String,
    pub drawn: PaneCost,
    /// The same stack and covers, but flat, smooth and clean.
    pub flat: PaneCost,
    /// A plain pane of 4 mm at the same place, without covers.
    pub plain: PaneCost,
}

/// Cost and error of a scene with one pane.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PaneCost {
    /// CPU seconds of the tracer with the set-up of the scene, on one thread: the median of the rounds.
    pub cpu_seconds: f64,
    /// The set-up alone.
    pub setup_cpu_seconds: f64,
    /// Stated error of I, linear RMS; `null` if the scene has no I.
    pub error_rms: Option<f64>,
}

/// Measures one scene. `read` reads the files of a line. Returns `None` if `work` was stopped.
pub fn scene_cost(
    line: &SceneLine,
    rounds: usize,
    read: &dyn Fn(&SceneLine) -> Result<SceneFiles, LoadError>,
    work: &Work,
) -> Result<Option<SceneCost>, BenchError> {
    let mut scenes = Vec::new();
    for line in [line.clone(), flat(line), plain(line)] {
        let photographs = decode(&line, &read(&line)?)?;
        scenes.push(BenchScene { name: line.id.to_string(), line, photographs });
    }
    let mut times = vec![Vec::new(); scenes.len()];
    let mut tuples = Vec::new();
    for round in 0..rounds {
        // Each round begins with another pane, so that none always runs first.
        for at in (0..scenes.len()).map(|k| (k + round) % scenes.len()) {
            let scene = &scenes[at];
            let Some(made) = render(scene, &scene.line, Sampling::default(), work)? else {
                return Ok(None);
            };
            times[at].push([made.cpu_s + made.setup_s, made.setup_s]);
            if round == 0 {
                tuples.push(made.tuple);
            }
        }
    }
    let [drawn, flat, plain] = [0, 1, 2].map(|at| {
        let of = |which: usize| median(&times[at].iter().map(|t| t[which]).collect::<Vec<_>>());
        let input = tuples[at].record.layers.get(Layer::Input.name());
        PaneCost {
            cpu_seconds: of(0),
            setup_cpu_seconds: of(1),
            error_rms: input.and_then(|layer| layer.error_rms),
        }
    });
    let features = features(line, &tuples[0].record.facts.negligible);
    Ok(Some(SceneCost { scene: line.id.to_string(), features, drawn, flat, plain }))
}

/// Returns the line with its stack and covers, but with flat, smooth and clean faces.
fn flat(line: &SceneLine) -> SceneLine {
    let mut line = line.clone();
    let glass = &mut line.glass;
    (glass.wave, glass.bow_radius_m, glass.roughness, glass.smudges) = (None, None, None, None);
    for layer in &mut glass.layers {
        let (GlassLayer::Glass { wedge_deg, .. } | GlassLayer::Gap { wedge_deg, .. }) = layer;
        *wedge_deg = [0.0; 2];
    }
    // A single layer without a wedge is a pane without layers.
    let layers = glass.layers.clone();
    if !layers.is_empty() {
        glass.set_stack(&layers);
    }
    line
}

/// Returns the line with a plain pane of [`PLAIN`] in the same pose, without covers.
fn plain(line: &SceneLine) -> SceneLine {
    let mut line = flat(line);
    let glass = &mut line.glass;
    glass.set_stack(&[GlassLayer::Glass {
        glass_m: PLAIN.0,
        ior: PLAIN.1,
        absorption_per_m: [0.0; 3],
        wedge_deg: [0.0; 2],
    }]);
    (glass.glazing, glass.outline) = (None, None);
    glass.coatings.clear();
    line.front.cards_mut().clear();
    line.back.cards_mut().clear();
    line
}

/// Names what the pane has beyond a flat stack, without features that are off in this scene, and its glasses.
fn features(line: &SceneLine, off: &Negligible) -> String {
    let glass = &line.glass;
    let has_wedge = glass.layers.iter().any(|layer| layer.wedge_deg() != [0.0; 2]);
    let uneven: Vec<&str> = [
        ("bow", glass.bow_radius_m.is_some() && off.bow.is_none()),
        ("wave", glass.wave.is_some() && off.wave.is_none()),
        ("wedge", has_wedge && off.wedge.is_none()),
        ("rough", glass.roughness.is_some() && off.roughness.is_none()),
        ("smudges", glass.smudges.is_some()),
    ]
    .into_iter()
    .filter_map(|(name, is_on)| is_on.then_some(name))
    .collect();
    let glasses =
        glass.layers.iter().filter(|layer| matches!(layer, GlassLayer::Glass { .. })).count();
    let stack = match glasses {
        0 | 1 => "one glass",
        2 => "two glasses",
        _ => "more glasses",
    };
    let coated = if glass.coatings.is_empty() { "" } else { ", coated" };
    let uneven = if uneven.is_empty() { "flat".to_owned() } else { uneven.join(" + ") };
    format!("{uneven}, {stack}{coated}")
}

/// The costs of scenes with the same features.
#[derive(Clone, Debug, Serialize)]
pub struct FeatureRow {
    /// As in [`SceneCost::features`]; `all` for the sum.
    pub features: String,
    pub scenes: usize,
    /// CPU seconds of a scene, mean.
    pub cpu_seconds: f64,
    /// CPU seconds of all these scenes over those of their flat stacks, and the largest such ratio of a scene.
    pub over_flat: f64,
    pub worst_over_flat: f64,
    /// The same over plain panes.
    pub over_plain: f64,
    pub worst_over_plain: f64,
    /// Stated errors of I, root mean squares over the scenes: as drawn, flat, plain.
    pub error_rms: [Option<f64>; 3],
}

/// Sums costs by feature, the dearest features first, and then over all scenes.
pub fn by_feature(scenes: &[SceneCost]) -> Vec<FeatureRow> {
    let mut groups: BTreeMap<&str, Vec<&SceneCost>> = BTreeMap::new();
    for scene in scenes {
        groups.entry(&scene.features).or_default().push(scene);
    }
    let mut rows: Vec<FeatureRow> = groups.iter().map(|(name, of)| row(name, of)).collect();
    rows.sort_by(|a, b| b.over_plain.total_cmp(&a.over_plain));
    rows.push(row("all", &scenes.iter().collect::<Vec<_>>()));
    rows
}

fn row(features: &str, scenes: &[&SceneCost]) -> FeatureRow {
    let sum = |of: fn(&SceneCost) -> &PaneCost| -> f64 {
        scenes.iter().map(|scene| of(scene).cpu_seconds).sum()
    };
    let worst = |of: fn(&SceneCost) -> &PaneCost| {
        let ratios = scenes.iter().map(|scene| scene.drawn.cpu_seconds / of(scene).cpu_seconds);
        ratios.fold(f64::NAN, f64::max)
    };
    let error = |of: fn(&SceneCost) -> &PaneCost| {
        let errors: Option<Vec<f64>> = scenes.iter().map(|scene| of(scene).error_rms).collect();
        let errors = errors.filter(|errors| !errors.is_empty())?;
        Some((errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt())
    };
    let drawn = sum(|scene| &scene.drawn);
    FeatureRow {
        features: features.to_owned(),
        scenes: scenes.len(),
        cpu_seconds: drawn / scenes.len() as f64,
        over_flat: drawn / sum(|scene| &scene.flat),
        worst_over_flat: worst(|scene| &scene.flat),
        over_plain: drawn / sum(|scene| &scene.plain),
        worst_over_plain: worst(|scene| &scene.plain),
        error_rms: [
            error(|scene| &scene.drawn),
            error(|scene| &scene.flat),
            error(|scene| &scene.plain),
        ],
    }
}

/// The work on a run by stage.
pub struct StageCosts {
    /// Stages with the CPU seconds of a tuple. The last has what the others leave: the queue, leases and the store's threads.
    pub stages: Vec<(&'static str, f64)>,
    /// Quarantined scenes with the reasons.
    pub quarantined: Vec<(SceneId, String)>,
}

/// Makes all tuples of a run on one thread.
pub fn stage_costs(run: &Run, options: &WorkOptions) -> Result<StageCosts, FarmError> {
    let outcome = work(run, options, &|_| {})?;
    let tuples = outcome.merged.max(1) as f64;
    let stages = outcome.seconds.cpu().into_iter().filter(|(name, _)| *name != "before");
    let stages = stages.map(|(name, seconds)| (name, seconds / tuples)).collect();
    Ok(StageCosts { stages, quarantined: outcome.quarantined })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::scenes::{pair, photograph};
    use procedural::listing;
    use render::scene::SideFiles;
    use render::trace::Isa;
    use serde_json::json;
    use std::sync::atomic::AtomicBool;

    fn pane(glass: serde_json::Value) -> SceneLine {
        let mut line = pair([16, 12], 16).unwrap().line;
        line.glass = serde_json::from_value(glass).unwrap();
        line
    }

    #[test]
    fn flat_panes_keep_their_stack_and_plain_ones_only_their_pose() {
        let stack = json!([{"glass_m": 0.004, "ior": 1.5}, {"gap_m": 0.012}, {"glass_m": 0.006, "ior": 1.6}]);
        let mut wedged = stack.clone();
        wedged[1]["wedge_deg"] = json!([0, 0.1]);
        let coatings =
            json!([{"face": 1, "reflectance": [0.1, 0.1, 0.1], "transmittance": [0.8, 0.8, 0.8]}]);
        let line = pane(json!({
            "distance_m": 0.5, "tilt_deg": [1, 2], "layers": wedged, "coatings": coatings, "roughness": 0.01,
            "wave": {"amplitude_m": 1e-4, "length_m": 0.3},
        }));
        let off = Negligible::default();
        assert_eq!(features(&line, &off), "wave + wedge + rough, two glasses, coated");
        let without = Negligible { wave: Some(1e-5), ..off };
        assert_eq!(features(&line, &without), "wedge + rough, two glasses, coated");
        let flat_one = pane(json!({
            "distance_m": 0.5, "tilt_deg": [1, 2], "layers": stack, "coatings": coatings,
        }));
        assert_eq!(flat(&line), flat_one);
        let plain_one = pane(json!({
            "distance_m": 0.5, "tilt_deg": [1, 2], "thickness_m": 0.004, "ior": 1.52,
            "absorption_per_m": [0, 0, 0],
        }));
        assert_eq!(plain(&line), plain_one);
        assert_eq!(plain(&plain_one), plain_one);
        assert_eq!(features(&plain_one, &off), "flat, one glass");
        // A wedge of a single glass leaves no layers behind.
        let single = json!([{"glass_m": 0.004, "ior": 1.52, "wedge_deg": [0.1, 0]}]);
        let single = pane(json!({"distance_m": 0.5, "tilt_deg": [1, 2], "layers": single}));
        assert_eq!(flat(&single), plain_one);
    }

    #[test]
    fn ratios_are_those_of_sums() {
        let of = |features: &str, seconds: [f64; 3], error: f64| {
            let [drawn, flat, plain] = seconds.map(|cpu_seconds| PaneCost {
                cpu_seconds,
                setup_cpu_seconds: 0.0,
                error_rms: Some(error),
            });
            SceneCost { scene: "s".into(), features: features.into(), drawn, flat, plain }
        };
        let rows = by_feature(&[
            of("wave", [4.0, 2.0, 1.0], 3.0),
            of("wave", [8.0, 2.0, 3.0], 4.0),
            of("flat", [2.0, 2.0, 1.0], 0.0),
        ]);
        let names: Vec<&str> = rows.iter().map(|row| row.features.as_str()).collect();
        assert_eq!(names, ["wave", "flat", "all"]);
        let wave = &rows[0];
        assert_eq!((wave.scenes, wave.cpu_seconds), (2, 6.0));
        assert_eq!((wave.over_flat, wave.worst_over_flat), (3.0, 4.0));
        assert_eq!((wave.over_plain, wave.worst_over_plain), (3.0, 4.0));
        assert_eq!(wave.error_rms, [Some(12.5f64.sqrt()); 3]);
        assert_eq!(rows[2].over_plain, 14.0 / 5.0);
    }

    #[test]
    fn a_plain_pane_costs_itself() {
        let photographs = listing(2, 1).into_iter();
        let photographs: Vec<_> = photographs.map(|p| photograph(&p, [64, 48]).unwrap()).collect();
        let read = |_: &SceneLine| {
            let side = |k: usize| SideFiles::Photograph(photographs[k].clone());
            Ok(SceneFiles::new(side(0), side(1)))
        };
        let mut line = pair([64, 48], 32).unwrap().line;
        line.film.spp = 16;
        let never = AtomicBool::new(false);
        let work = Work { threads: 1, isa: Isa::detect(), stop: &never, on_samples: &|_| {} };
        let cost = scene_cost(&line, 3, &read, &work).unwrap().unwrap();
        assert_eq!(cost.features, "flat, one glass");
        assert!(cost.drawn.setup_cpu_seconds < cost.drawn.cpu_seconds);
        assert_eq!(cost.drawn.error_rms, cost.flat.error_rms);
        assert!(cost.plain.error_rms.unwrap() > 0.0);
    }
}
