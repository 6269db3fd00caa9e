//! Error against CPU seconds as a log-log plot in SVG: no script, no style sheet, no font of its own.

use super::ladder::{LayerRow, VARIANTS};
use crate::html::Html;
use crate::plot::{Axis, LAYER_COLOURS, LAYER_SYMBOLS, Panel, Stroke};
use render::trace::LAYERS;
use std::fmt::Write;

/// Lines of the variants, in their order: solid, dashed, dotted.
const DASHES: [&str; 3] = ["", "7 4", "1.5 4"];

const SIZE: [f64; 2] = [960.0, 480.0];
const PANEL: [f64; 2] = [360.0, 340.0];
const TOP: f64 = 64.0;
const LEFTS: [f64; 2] = [72.0, 544.0];

/// What a panel shows of a row.
type Measure = fn(&LayerRow) -> f64;

/// The plot: RMSE of the whole layer on the left, of its worst 8 x 8 px on the right; a line for each layer and variant.
///
/// `title` is text. Rows without an error above 0 are left out.
pub fn error_plot(rows: &[LayerRow], title: &str) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"12\" color=\"#222\" fill=\"currentColor\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{}\" y=\"22\" font-size=\"14\">{}</text>\n",
        SIZE[0],
        SIZE[1],
        LEFTS[0],
        Html(title)
    );
    let panels: [(&str, Measure); 2] = [
        ("RMSE of the layer, linear light", |row| row.deviation.rmse),
        ("RMSE of its worst 8 x 8 px", |row| {
            row.deviation.cell_rmse_worst
        }),
    ];
    let is_drawn = |row: &&LayerRow| row.deviation.rmse > 0.0 && row.cpu_s > 0.0;
    let drawn: Vec<&LayerRow> = rows.iter().filter(is_drawn).collect();
    if !drawn.is_empty() {
        for ((label, measure), left) in panels.into_iter().zip(LEFTS) {
            panel(&mut svg, &drawn, label, measure, left);
        }
    }
    legend(&mut svg, &drawn);
    svg += "</svg>\n";
    svg
}

fn panel(svg: &mut String, rows: &[&LayerRow], label: &str, measure: Measure, left: f64) {
    let (right, bottom) = (left + PANEL[0], TOP + PANEL[1]);
    let mut x = Axis::log(rows.iter().map(|row| row.cpu_s), [left, right]);
    // Room for the names at the lines' ends.
    x.values[1] *= 1.25;
    let panel = Panel {
        x,
        y: Axis::log(rows.iter().map(|row| measure(row)), [bottom, TOP]),
        x_label: "CPU seconds of the tracer, all four layers",
        y_label: label,
    };
    panel.frame(svg);
    let mut names = Vec::new();
    for (v, variant) in VARIANTS.iter().enumerate() {
        for (k, layer) in LAYERS.iter().enumerate() {
            let is_of = |row: &&&LayerRow| {
                row.variant == variant.name && row.layer == *layer && measure(row) > 0.0
            };
            let of = rows.iter().filter(is_of);
            let points: Vec<(f64, f64)> =
                of.map(|row| panel.at((row.cpu_s, measure(row)))).collect();
            let Some(&(end_x, end_y)) = points.last() else {
                continue;
            };
            let stroke = Stroke {
                colour: LAYER_COLOURS[k],
                width: 1.8,
                dash: DASHES[v % DASHES.len()],
            };
            Panel::line(svg, &points, &stroke);
            if v == 0 {
                Panel::dots(svg, &points, LAYER_COLOURS[k], 2.4);
                names.push((end_y, end_x, LAYER_SYMBOLS[k], LAYER_COLOURS[k]));
            }
        }
    }
    // Names at the ends of the first variant's lines.
    Panel::names(svg, names);
}

fn legend(svg: &mut String, rows: &[&LayerRow]) {
    let y = SIZE[1] - 16.0;
    let mut x = LEFTS[0];
    for (v, variant) in VARIANTS.iter().enumerate() {
        if !rows.iter().any(|row| row.variant == variant.name) {
            continue;
        }
        let _ = writeln!(
            svg,
            "<path d=\"M{x} {}h34\" stroke=\"currentColor\" stroke-width=\"1.8\" stroke-dasharray=\"{}\"/>\
             <text x=\"{}\" y=\"{y}\">{}</text>",
            y - 4.0,
            DASHES[v % DASHES.len()],
            x + 42.0,
            Html(variant.title),
        );
        x += 42.0 + 6.5 * variant.title.len() as f64 + 24.0;
    }
}
