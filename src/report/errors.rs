//! Stated errors of all tuples: how they are distributed, and what they cost.

use super::survey::{DoneScene, Survey};
use super::text::{Exact, error, evenly, quantile, table};
use crate::html::Html;
use crate::plot::{Axis, LAYER_COLOURS, LAYER_SYMBOLS, Panel, Stroke, legend, number, open};
use crate::run::Run;
use render::trace::LAYERS;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Size of a plot, px of its own coordinates, and its area.
const SIZE: [f64; 2] = [480.0, 270.0];
const X_ENDS: [f64; 2] = [60.0, 466.0];
const Y_ENDS: [f64; 2] = [222.0, 46.0];
/// Where the names of the layers end.
const LEGEND: [f64; 2] = [466.0, 16.0];
/// Steps of a curve, points of a cloud.
const STEPS: usize = 200;
const POINTS: usize = 800;

/// CPU seconds of tracing a scene, by its place in the manifest.
pub(super) type Costs = BTreeMap<usize, f64>;

/// Plots and a table.
pub(super) fn errors(run: &Run, survey: &Survey) -> String {
    let layers: Vec<Layer> = (0..4).filter_map(|k| Layer::of(k, &survey.done)).collect();
    if layers.is_empty() {
        return "<p class=\"dim\">No tuple states an error yet.</p>\n".to_owned();
    }
    let costs = costs(run, survey);
    let mut plots = distribution(&layers);
    let known = survey.done.iter().filter(|s| costs.contains_key(&s.index));
    let known = known.count();
    if known > 0 {
        plots += &cloud(
            survey,
            "Stated error against CPU seconds of tracing a scene",
            "CPU seconds of tracing a scene, all its layers",
            |scene, _| costs.get(&scene.index).copied(),
        );
    }
    if layers.iter().any(Layer::samples_differ) {
        plots += &cloud(
            survey,
            "Stated error against samples a pixel",
            "samples a pixel",
            |scene, k| Some(scene.layers[k].as_ref()?.samples),
        );
    }
    let known = match known {
        0 => "Workers have not told yet what single scenes cost.".to_owned(),
        n if n == survey.done.len() => String::new(),
        n => format!(
            "Of {n} scenes it is known what they cost; of the others a part was traced by who left no log."
        ),
    };
    format!(
        "<p>The stated error of a layer is the estimated RMS error over its film and colours, in linear radiance (white is \
         1), from <code>tuple.json</code>. It is told from how far means moved at the last two doublings of their \
         samples. {known}</p>\n<div class=\"plots wide\">{plots}</div>\n{}",
        summary(run, &layers)
    )
}

/// One layer's errors.
struct Layer {
    /// Which.
    k: usize,
    /// Error and the scene's place in the manifest, by error.
    sorted: Vec<(f64, usize)>,
    /// Samples a pixel, sorted.
    samples: Vec<f64>,
}

impl Layer {
    fn of(k: usize, done: &[DoneScene]) -> Option<Self> {
        let made = done
            .iter()
            .filter_map(|scene| Some((scene.layers[k].as_ref()?, scene.index)));
        let (mut sorted, mut samples) = (Vec::new(), Vec::new());
        for (facts, index) in made {
            samples.push(facts.samples);
            let error = facts.error_rms.filter(|e| e.is_finite() && *e >= 0.0);
            sorted.extend(error.map(|error| (error, index)));
        }
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        samples.sort_by(f64::total_cmp);
        (!sorted.is_empty()).then_some(Self { k, sorted, samples })
    }

    fn samples_differ(&self) -> bool {
        self.samples.first() != self.samples.last()
    }
}

/// Share of the scenes whose stated error is at most so large.
fn distribution(layers: &[Layer]) -> String {
    let all = layers.iter().flat_map(|layer| &layer.sorted);
    let positive = all.map(|(error, _)| *error).filter(|error| *error > 0.0);
    if positive.clone().next().is_none() {
        return String::new();
    }
    let panel = Panel {
        x: Axis::log(positive, X_ENDS),
        y: Axis::linear([0.0, 100.0].into_iter(), Y_ENDS),
        x_label: "stated RMS error of a layer, linear radiance",
        y_label: "% of the scenes state at most this error",
    };
    let mut svg = open(SIZE, "Distribution of the stated errors of each layer");
    panel.frame(&mut svg);
    let mut entries = Vec::new();
    for layer in layers {
        let count = layer.sorted.len();
        let (mut points, mut below) = (Vec::new(), 0.0);
        let mut places = evenly(count, STEPS);
        if places.last() != Some(&(count - 1)) {
            places.push(count - 1);
        }
        for place in places {
            // An error of 0 stands at the left end.
            let error = layer.sorted[place].0.max(panel.x.values[0]);
            let share = 100.0 * (place + 1) as f64 / count as f64;
            points.extend([panel.at((error, below)), panel.at((error, share))]);
            below = share;
        }
        let colour = LAYER_COLOURS[layer.k];
        let stroke = Stroke {
            colour,
            width: 2.0,
            dash: "",
        };
        Panel::line(&mut svg, &points, &stroke);
        entries.push((LAYER_SYMBOLS[layer.k], colour));
    }
    legend(&mut svg, LEGEND, &entries);
    svg + "</svg>\n"
}

/// A point for each scene and layer: `across` of it, and its stated error.
fn cloud(
    survey: &Survey,
    label: &str,
    x_label: &str,
    across: impl Fn(&DoneScene, usize) -> Option<f64>,
) -> String {
    let mut layers: [Vec<(f64, f64)>; 4] = Default::default();
    for place in evenly(survey.done.len(), POINTS) {
        let scene = &survey.done[place];
        for (k, points) in layers.iter_mut().enumerate() {
            let error = scene.layers[k].as_ref().and_then(|facts| facts.error_rms);
            if let (Some(error), Some(x)) = (error, across(scene, k))
                && error > 0.0
                && x > 0.0
            {
                points.push((x, error));
            }
        }
    }
    let all = || layers.iter().flatten();
    if all().next().is_none() {
        return String::new();
    }
    let panel = Panel {
        x: Axis::log(all().map(|(x, _)| *x), X_ENDS),
        y: Axis::log(all().map(|(_, error)| *error), Y_ENDS),
        x_label,
        y_label: "stated RMS error, linear radiance",
    };
    let mut svg = open(SIZE, label);
    panel.frame(&mut svg);
    let mut entries = Vec::new();
    for (k, points) in layers.iter().enumerate() {
        let at: Vec<(f64, f64)> = points.iter().map(|point| panel.at(*point)).collect();
        Panel::dots(&mut svg, &at, LAYER_COLOURS[k], 2.8);
        if !at.is_empty() {
            entries.push((LAYER_SYMBOLS[k], LAYER_COLOURS[k]));
        }
    }
    legend(&mut svg, LEGEND, &entries);
    svg + "</svg>\n"
}

fn summary(run: &Run, layers: &[Layer]) -> String {
    let mut rows = String::new();
    for layer in layers {
        let errors: Vec<f64> = layer.sorted.iter().map(|(error, _)| *error).collect();
        let (most, worst) = layer.sorted[layer.sorted.len() - 1];
        let [least_samples, samples, most_samples] =
            [0.0, 0.5, 1.0].map(|share| quantile(&layer.samples, share));
        let range = if least_samples == most_samples {
            String::new()
        } else {
            format!(
                "<small>{} to {}</small>",
                number(least_samples),
                number(most_samples)
            )
        };
        let _ = writeln!(
            rows,
            "<tr id=\"errors-{name}\"><td><b style=\"color:{}\">&#9632;</b> {} <small>{name}</small></td>\
             <td class=\"n\">{}</td><td class=\"n\">{}{range}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"mono\">{}</td></tr>",
            LAYER_COLOURS[layer.k],
            LAYER_SYMBOLS[layer.k],
            errors.len(),
            Exact(samples, number(samples)),
            error(errors[0]),
            error(quantile(&errors, 0.5)),
            error(quantile(&errors, 0.95)),
            error(most),
            Html(run.lines[worst].id.as_str()),
            name = LAYERS[layer.k],
        );
    }
    table(
        "Stated errors",
        &[
            "layer",
            "#scenes",
            "#samples a pixel, median",
            "#least error",
            "#median",
            "#95 %",
            "#largest",
            "of scene",
        ],
        &rows,
    )
}

/// What scenes cost, of which the logs tell every shard once.
fn costs(run: &Run, survey: &Survey) -> Costs {
    let mut traced: BTreeMap<&str, (u32, f64)> = BTreeMap::new();
    for scene in survey.logs.iter().flat_map(|log| &log.scenes) {
        let (shards, cpu_s) = traced.entry(scene.scene.as_str()).or_default();
        *shards += scene.shards;
        *cpu_s += scene.cpu_s;
    }
    let lines = run.lines.iter().enumerate();
    let whole = lines.filter_map(|(index, line)| {
        let (shards, cpu_s) = traced.get(line.id.as_str())?;
        (*shards == run.layout(line).len() && *cpu_s > 0.0).then_some((index, *cpu_s))
    });
    whole.collect()
}
