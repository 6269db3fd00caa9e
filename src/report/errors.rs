//! Distribution and cost of the stated errors of all tuples.

use super::survey::{DoneScene, Survey};
use super::text::{error, evenly, exact, quantile, table};
use crate::plot::{Axis, LAYER_COLOURS, Panel, Stroke, legend, number, plot};
use crate::run::Run;
use glasshouse_line::layer::Layer;
use maud::{Markup, html};
use std::collections::BTreeMap;

/// Size of a plot and the ends of its axes, px.
const SIZE: [f64; 2] = [480.0, 270.0];
const X_ENDS: [f64; 2] = [60.0, 466.0];
const Y_ENDS: [f64; 2] = [222.0, 46.0];
/// Right end and baseline of the legend.
const LEGEND: [f64; 2] = [466.0, 16.0];
/// Maximum number of steps of a curve before its last step, and maximum number of scenes in a scatter plot.
const STEPS: usize = 200;
const POINTS: usize = 800;

/// CPU seconds of tracing, by the scene's index in the manifest.
pub(super) type Costs = BTreeMap<usize, f64>;

/// Draws the section: plots and a table.
pub(super) fn errors(run: &Run, survey: &Survey) -> Markup {
    let layers: Vec<LayerErrors> =
        (0..4).filter_map(|k| LayerErrors::of(k, &survey.done)).collect();
    if layers.is_empty() {
        return html! { p.dim { "No tuple states an error yet." } };
    }
    let costs = costs(run, survey);
    let known = survey.done.iter().filter(|s| costs.contains_key(&s.index));
    let known = known.count();
    let cost = |scene: &DoneScene, _| costs.get(&scene.index).copied();
    let samples = |scene: &DoneScene, k: usize| Some(scene.layers[k].as_ref()?.samples);
    html! {
        p {
            "The stated error of a layer is the estimated RMS error over its film and colours, in linear radiance (white is \
            1), from " code { "tuple.json" } ". The estimate uses the changes of the means at the last two doublings \
            of their samples. "
            @if known == 0 {
                "Workers have not reported the cost of single scenes yet."
            } @else if known < survey.done.len() {
                "The cost is known for " (known) " of " (survey.done.len()) " scenes; the logs lack or \
                repeat shards of the other scenes."
            }
        }
        div.plots.wide {
            (distribution(&layers))
            @if known > 0 {
                (cloud(survey, "Stated error against CPU seconds of tracing a scene",
                    "CPU seconds of tracing a scene, all its layers", cost))
            }
            @if layers.iter().any(LayerErrors::samples_differ) {
                (cloud(survey, "Stated error against samples a pixel", "samples a pixel", samples))
            }
        }
        (summary(run, &layers))
    }
}

struct LayerErrors {
    k: usize,
    /// Errors with the index of the scene in the manifest, sorted.
    sorted: Vec<(f64, usize)>,
    /// Samples per pixel of each scene, sorted.
    samples: Vec<f64>,
}

impl LayerErrors {
    fn of(k: usize, done: &[DoneScene]) -> Option<Self> {
        let made = done.iter().filter_map(|scene| Some((scene.layers[k].as_ref()?, scene.index)));
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

/// Draws the cumulative distribution of the stated errors.
fn distribution(layers: &[LayerErrors]) -> Markup {
    let all = layers.iter().flat_map(|layer| &layer.sorted);
    let positive = all.map(|(error, _)| *error).filter(|error| *error > 0.0);
    if positive.clone().next().is_none() {
        return html! {};
    }
    let panel = Panel {
        x: Axis::log(positive, X_ENDS),
        y: Axis::linear([0.0, 100.0].into_iter(), Y_ENDS),
        x_label: "stated RMS error of a layer, linear radiance",
        y_label: "% of the scenes state at most this error",
    };
    let steps = |layer: &LayerErrors| {
        let count = layer.sorted.len();
        let (mut points, mut below) = (Vec::new(), 0.0);
        let mut places = evenly(count, STEPS);
        if places.last() != Some(&(count - 1)) {
            places.push(count - 1);
        }
        for place in places {
            // Plots an error of 0 at the left end of the axis.
            let error = layer.sorted[place].0.max(panel.x.values[0]);
            let share = 100.0 * (place + 1) as f64 / count as f64;
            points.extend([panel.at((error, below)), panel.at((error, share))]);
            below = share;
        }
        points
    };
    let entry =
        |layer: &LayerErrors| (Layer::ALL[layer.k].symbol(), LAYER_COLOURS[Layer::ALL[layer.k]]);
    let entries: Vec<_> = layers.iter().map(entry).collect();
    let content = html! {
        (panel.frame())
        @for layer in layers {
            (Panel::line(&steps(layer), &Stroke { colour: LAYER_COLOURS[Layer::ALL[layer.k]], width: 2.0, dash: "" }))
        }
        (legend(LEGEND, &entries))
    };
    plot(SIZE, "Distribution of the stated errors of each layer", &content)
}

/// Draws a scatter plot of at most [`POINTS`] scenes, a point per layer. `across` returns x; y is the stated error.
fn cloud(
    survey: &Survey,
    label: &str,
    x_label: &str,
    across: impl Fn(&DoneScene, usize) -> Option<f64>,
) -> Markup {
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
        return html! {};
    }
    let panel = Panel {
        x: Axis::log(all().map(|(x, _)| *x), X_ENDS),
        y: Axis::log(all().map(|(_, error)| *error), Y_ENDS),
        x_label,
        y_label: "stated RMS error, linear radiance",
    };
    let shown = (0..layers.len()).filter(|&k| !layers[k].is_empty());
    let entries: Vec<_> =
        shown.map(|k| (Layer::ALL[k].symbol(), LAYER_COLOURS[Layer::ALL[k]])).collect();
    let content = html! {
        (panel.frame())
        @for (points, colour) in layers.iter().zip(LAYER_COLOURS.0) {
            @let at: Vec<(f64, f64)> = points.iter().map(|point| panel.at(*point)).collect();
            (Panel::dots(&at, colour, 2.8))
        }
        (legend(LEGEND, &entries))
    };
    plot(SIZE, label, &content)
}

fn summary(run: &Run, layers: &[LayerErrors]) -> Markup {
    let row = |layer: &LayerErrors| {
        let errors: Vec<f64> = layer.sorted.iter().map(|(error, _)| *error).collect();
        let (most, worst) = layer.sorted[layer.sorted.len() - 1];
        let [least_samples, samples, most_samples] =
            [0.0, 0.5, 1.0].map(|share| quantile(&layer.samples, share));
        html! {
            tr id={ "errors-" (Layer::ALL[layer.k].name()) } {
                td {
                    b style={ "color:" (LAYER_COLOURS[Layer::ALL[layer.k]]) } { "\u{25a0}" }
                    " " (Layer::ALL[layer.k].symbol()) " " small { (Layer::ALL[layer.k].name()) }
                }
                td.n { (errors.len()) }
                td.n {
                    (exact(samples, &number(samples)))
                    @if least_samples != most_samples {
                        small { (number(least_samples)) " to " (number(most_samples)) }
                    }
                }
                td.n { (error(errors[0])) }
                td.n { (error(quantile(&errors, 0.5))) }
                td.n { (error(quantile(&errors, 0.95))) }
                td.n { (error(most)) }
                td.mono { (run.lines[worst].id.as_str()) }
            }
        }
    };
    let heads = [
        "layer",
        "#scenes",
        "#samples a pixel, median",
        "#least error",
        "#median",
        "#95 %",
        "#largest",
        "of scene",
    ];
    table("Stated errors", &heads, &html! { @for layer in layers { (row(layer)) } })
}

/// Returns the costs of the scenes for which the logs count as many shards as the scene has.
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
