//! Plots error against CPU seconds on logarithmic axes, as plain SVG.

use super::ladder::{LayerRow, VARIANTS};
use crate::plot::{Axis, LAYER_COLOURS, Panel, Stroke};
use glasshouse_line::layer::Layer;
use maud::{Markup, html};

/// Dash patterns of the variants, in their order: solid, dashed, dotted.
const DASHES: [&str; 3] = ["", "7 4", "1.5 4"];

const SIZE: [f64; 2] = [960.0, 480.0];
const PANEL: [f64; 2] = [360.0, 340.0];
const TOP: f64 = 64.0;
const LEFTS: [f64; 2] = [72.0, 544.0];

/// Function that returns the plotted value of a row.
type Measure = fn(&LayerRow) -> f64;

/// Plots the RMSE of whole layers on the left and of their worst 8 x 8 px on the right, with one line for each layer
/// and variant.
///
/// `title` is plain text. The plot omits values that are not positive.
pub fn error_plot(rows: &[LayerRow], title: &str) -> String {
    let panels: [(&str, Measure); 2] = [
        ("RMSE of the layer, linear light", |row| row.deviation.rmse),
        ("RMSE of its worst 8 x 8 px", |row| row.deviation.cell_rmse_worst),
    ];
    let is_drawn = |row: &&LayerRow| row.deviation.rmse > 0.0 && row.cpu_s > 0.0;
    let drawn: Vec<&LayerRow> = rows.iter().filter(is_drawn).collect();
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (SIZE[0]) " " (SIZE[1]) }
            font-family="sans-serif" font-size="12" color="#222" fill="currentColor" {
            rect width="100%" height="100%" fill="white" {}
            text x=(LEFTS[0]) y="22" font-size="14" { (title) }
            @if !drawn.is_empty() {
                @for ((label, measure), left) in panels.into_iter().zip(LEFTS) {
                    (panel(&drawn, label, measure, left))
                }
            }
            (legend(&drawn))
        }
    };
    svg.into_string() + "\n"
}

fn panel(rows: &[&LayerRow], label: &str, measure: Measure, left: f64) -> Markup {
    let (right, bottom) = (left + PANEL[0], TOP + PANEL[1]);
    let mut x = Axis::log(rows.iter().map(|row| row.cpu_s), [left, right]);
    // Leaves space for the names at the ends of lines.
    x.values[1] *= 1.25;
    let panel = Panel {
        x,
        y: Axis::log(rows.iter().map(|row| measure(row)), [bottom, TOP]),
        x_label: "CPU seconds of the tracer, all four layers",
        y_label: label,
    };
    let points = |variant: usize, layer: Layer| -> Vec<(f64, f64)> {
        let is_of = |row: &&&LayerRow| {
            row.variant == VARIANTS[variant].name && row.layer == layer.name() && measure(row) > 0.0
        };
        let of = rows.iter().filter(is_of);
        of.map(|row| panel.at((row.cpu_s, measure(row)))).collect()
    };
    let lines = (0..VARIANTS.len()).flat_map(|v| Layer::ALL.map(move |layer| (v, layer)));
    // The first variant's lines have dots, and names at their ends.
    let names = Layer::ALL.into_iter().filter_map(|layer| {
        let (x, y) = *points(0, layer).last()?;
        Some((y, x, layer.symbol(), LAYER_COLOURS[layer]))
    });
    html! {
        (panel.frame())
        @for (v, layer) in lines {
            @let points = points(v, layer);
            (Panel::line(&points, &Stroke { colour: LAYER_COLOURS[layer], width: 1.8, dash: DASHES[v % DASHES.len()] }))
            @if v == 0 { (Panel::dots(&points, LAYER_COLOURS[layer], 2.4)) }
        }
        (Panel::names(names.collect()))
    }
}

fn legend(rows: &[&LayerRow]) -> Markup {
    let y = SIZE[1] - 16.0;
    let mut right = LEFTS[0];
    let shown = VARIANTS.iter().enumerate();
    let shown = shown.filter(|(_, variant)| rows.iter().any(|row| row.variant == variant.name));
    let placed = shown.map(|(v, variant)| {
        let x = right;
        right += 42.0 + 6.5 * variant.title.len() as f64 + 24.0;
        (x, DASHES[v % DASHES.len()], variant.title)
    });
    html! {
        @for (x, dash, title) in placed {
            path d=(format_args!("M{x} {}h34", y - 4.0)) stroke="currentColor" stroke-width="1.8" stroke-dasharray=(dash) {}
            text x=(x + 42.0) y=(y) { (title) }
        }
    }
}
