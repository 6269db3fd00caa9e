//! Error against CPU seconds as a log-log plot in SVG: no script, no style sheet, no font of its own.

use super::ladder::{LayerRow, VARIANTS};
use crate::trace::LAYERS;
use std::fmt::Write;

/// Symbols and colours of the layers (Okabe and Ito's, which colour-blind eyes tell apart).
const STYLES: [(&str, &str); 4] = [
    ("I", "#0072B2"),
    ("T", "#D55E00"),
    ("R~", "#009E73"),
    ("R", "#CC79A7"),
];

/// Lines of the variants, in their order: solid, dashed, dotted.
const DASHES: [&str; 3] = ["", "7 4", "1.5 4"];

const SIZE: [f64; 2] = [960.0, 480.0];
const PANEL: [f64; 2] = [360.0, 340.0];
const TOP: f64 = 64.0;
const LEFTS: [f64; 2] = [72.0, 544.0];

/// A logarithmic axis a little longer than its values.
struct Axis {
    /// Values at the ends.
    values: [f64; 2],
    /// Positions of the ends, px.
    ends: [f64; 2],
}

impl Axis {
    fn new(values: impl Iterator<Item = f64>, ends: [f64; 2]) -> Self {
        let (lo, hi) = values.fold((f64::INFINITY, 0f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
        // At least from one half to double.
        let (lo, hi) = (lo.min(hi / 1.5) / 1.3, hi.max(lo * 1.5) * 1.3);
        Self {
            values: [lo, hi],
            ends,
        }
    }

    fn at(&self, value: f64) -> f64 {
        let [lo, hi] = self.values.map(libm::log10);
        let [a, b] = self.ends;
        a + (b - a) * (libm::log10(value) - lo) / (hi - lo)
    }

    /// All of its numbers can be written without powers of 10.
    fn is_plain(&self) -> bool {
        self.values[0] >= 0.005 && self.values[1] < 2000.0
    }

    /// Digit, exponent and position: every decade, and 2 and 5 where decades are few.
    fn ticks(&self) -> Vec<(i32, i32, f64)> {
        let [lo, hi] = self.values;
        let (first, last) = (
            libm::log10(lo).floor() as i32,
            libm::log10(hi).ceil() as i32,
        );
        let digits: &[i32] = if libm::log10(hi / lo) < 2.2 {
            &[1, 2, 5]
        } else {
            &[1]
        };
        let mut ticks = Vec::new();
        for exponent in first..=last {
            for &digit in digits {
                let value = f64::from(digit) * libm::pow(10.0, f64::from(exponent));
                if (lo..=hi).contains(&value) {
                    ticks.push((digit, exponent, self.at(value)));
                }
            }
        }
        ticks
    }
}

/// What a panel shows of a row.
type Measure = fn(&LayerRow) -> f64;

/// The plot: RMSE of the whole layer on the left, of its worst 8 x 8 px on the right; a line for each layer and variant.
///
/// `title` is text. Rows without an error above 0 are left out.
pub fn error_plot(rows: &[LayerRow], title: &str) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#222\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{}\" y=\"22\" font-size=\"14\">{}</text>\n",
        SIZE[0],
        SIZE[1],
        LEFTS[0],
        escape(title)
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
    let mut x = Axis::new(rows.iter().map(|row| row.cpu_s), [left, right]);
    // Room for the names at the lines' ends.
    x.values[1] *= 1.25;
    let y = Axis::new(rows.iter().map(|row| measure(row)), [bottom, TOP]);
    for (digit, exponent, at) in x.ticks() {
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"#ddd\"/>{}",
            number([at, bottom + 18.0], "middle", digit, exponent, x.is_plain())
        );
    }
    for (digit, exponent, at) in y.ticks() {
        let _ = writeln!(
            svg,
            "<path d=\"M{left} {at:.1}H{right}\" stroke=\"#ddd\"/>{}",
            number([left - 8.0, at + 4.0], "end", digit, exponent, y.is_plain())
        );
    }
    let _ = writeln!(
        svg,
        "<rect x=\"{left}\" y=\"{TOP}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#888\"/>\
         <text x=\"{left}\" y=\"{}\">{label}</text>\
         <text x=\"{right}\" y=\"{}\" text-anchor=\"end\">CPU seconds of the tracer, all four layers</text>",
        PANEL[0],
        PANEL[1],
        TOP - 10.0,
        bottom + 36.0
    );
    let mut labels: Vec<(f64, f64, usize)> = Vec::new();
    for (v, variant) in VARIANTS.iter().enumerate() {
        for (k, layer) in LAYERS.iter().enumerate() {
            let points: Vec<(f64, f64)> = rows
                .iter()
                .filter(|row| {
                    row.variant == variant.name && row.layer == *layer && measure(row) > 0.0
                })
                .map(|row| (x.at(row.cpu_s), y.at(measure(row))))
                .collect();
            let Some(&(end_x, end_y)) = points.last() else {
                continue;
            };
            let path: Vec<String> = points
                .iter()
                .map(|(x, y)| format!("{x:.1} {y:.1}"))
                .collect();
            let colour = STYLES[k].1;
            let dash = DASHES[v % DASHES.len()];
            let _ = writeln!(
                svg,
                "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\" stroke-dasharray=\"{dash}\"/>",
                path.join("L")
            );
            if v == 0 {
                for (x, y) in &points {
                    let _ = writeln!(
                        svg,
                        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.4\" fill=\"{colour}\"/>"
                    );
                }
                labels.push((end_y, end_x, k));
            }
        }
    }
    // Names at the ends of the first variant's lines, pushed apart where they would cover each other.
    labels.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut lowest = f64::NEG_INFINITY;
    for (end_y, end_x, k) in labels {
        let at = end_y.max(lowest + 13.0);
        lowest = at;
        let (symbol, colour) = STYLES[k];
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\" font-weight=\"bold\">{symbol}</text>",
            end_x + 7.0,
            at + 4.0
        );
    }
}

/// A digit times a power of 10, as text.
fn number([x, y]: [f64; 2], anchor: &str, digit: i32, exponent: i32, is_plain: bool) -> String {
    let text = if is_plain {
        let value = f64::from(digit) * libm::pow(10.0, f64::from(exponent));
        format!("{value:.*}", (-exponent).max(0) as usize)
    } else {
        let factor = if digit == 1 {
            String::new()
        } else {
            format!("{digit}\u{b7}")
        };
        let power = exponent.to_string().replace('-', "\u{2212}");
        format!("{factor}10<tspan dy=\"-5\" font-size=\"9\">{power}</tspan>")
    };
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>")
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
            "<path d=\"M{x} {}h34\" stroke=\"#222\" stroke-width=\"1.8\" stroke-dasharray=\"{}\"/>\
             <text x=\"{}\" y=\"{y}\">{}</text>",
            y - 4.0,
            DASHES[v % DASHES.len()],
            x + 42.0,
            escape(variant.title),
        );
        x += 42.0 + 6.5 * variant.title.len() as f64 + 24.0;
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
