//! Stages of a worker's time: names, colours, a stacked bar.

use crate::plot::{Axis, plot};
use maud::{Markup, html};

/// Name, colour (most from the palette of Okabe and Ito) and description of each stage.
pub(super) const STAGES: [(&str, &str, &str); 8] = [
    ("read", "#CC79A7", "input files"),
    ("decode", "#E69F00", "pictures and depth to scenes"),
    ("trace", "#0072B2", "samples to partials"),
    ("checkpoint", "#D55E00", "partials to the store"),
    ("merge", "#56B4E9", "partials to tuples"),
    ("encode", "#009E73", "EXR, PNGs and noise maps"),
    ("write", "#B8A800", "tuples to the store"),
    ("rest", "#9A9A9A", "queue, leases, the store's own threads"),
];

/// Name of the stage before work begins (starting, planning, the golden shard), which the cost of tuples excludes.
pub(super) const BEFORE: &str = "before";

/// Colour of stages that do not exist in this version.
const OTHER: &str = "#555555";

/// CPU and thread seconds of a stage.
pub(super) struct Stage {
    pub(super) name: String,
    pub(super) colour: &'static str,
    pub(super) what: &'static str,
    pub(super) cpu_s: f64,
    pub(super) thread_s: f64,
}

impl Stage {
    pub(super) fn known((name, colour, what): (&str, &'static str, &'static str)) -> Self {
        Self { name: name.to_owned(), colour, what, cpu_s: 0.0, thread_s: 0.0 }
    }

    /// Returns the stage `name`; adds it if it is missing.
    pub(super) fn named<'a>(stages: &'a mut Vec<Self>, name: &str) -> &'a mut Self {
        let place = stages.iter().position(|stage| stage.name == name);
        let place = place.unwrap_or_else(|| {
            stages.push(Self::known((name, OTHER, "")));
            stages.len() - 1
        });
        &mut stages[place]
    }
}

/// Draws the CPU seconds of the stages as a stacked bar.
pub(super) fn bar(stages: &[Stage], total: f64) -> Markup {
    const SIZE: [f64; 2] = [480.0, 76.0];
    const HEIGHT: f64 = 30.0;
    let parts: Vec<String> = stages
        .iter()
        .filter(|stage| stage.cpu_s > 0.0)
        .map(|stage| format!("{} {:.1} %", stage.name, 100.0 * stage.cpu_s / total))
        .collect();
    let label = format!("CPU seconds by stage: {}", parts.join(", "));
    let axis = Axis::linear([0.0, 100.0].into_iter(), [12.0, 462.0]);
    let mut right = axis.ends[0];
    let placed = stages.iter().map(|stage| {
        let (left, share) = (right, stage.cpu_s / total.max(f64::MIN_POSITIVE));
        let width = (axis.ends[1] - axis.ends[0]) * share;
        right += width;
        (stage, left, width, share)
    });
    let content = html! {
        @for (stage, left, width, share) in placed.filter(|(_, _, width, _)| *width > 0.0) {
            rect x=(format_args!("{left:.2}")) y="2" width=(format_args!("{width:.2}")) height=(HEIGHT) fill=(stage.colour) {
                title { (stage.name) " " (format_args!("{:.2}", stage.cpu_s)) " CPU s" }
            }
            // Only parts that are wide enough for their names have a label.
            @if width > 8.0 * stage.name.len() as f64 + 50.0 {
                text x=(format_args!("{:.1}", left + width / 2.0)) y="21" text-anchor="middle" fill="#fff" {
                    (stage.name) " " (format_args!("{:.0} %", 100.0 * share))
                }
            }
        }
        @for tick in axis.ticks() {
            path d=(format_args!("M{:.1} {}v4", tick.at, HEIGHT + 2.0)) stroke="currentColor" {}
            text x=(format_args!("{:.1}", tick.at)) y="50" text-anchor="middle" { (tick.label) }
        }
        text x=(axis.ends[1]) y="70" text-anchor="end" { "% of the CPU seconds after the start" }
    };
    html! { div.stack { (plot(SIZE, &label, &content)) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_fill_the_bar() {
        let mut stages: Vec<Stage> = STAGES.iter().map(|known| Stage::known(*known)).collect();
        Stage::named(&mut stages, "trace").cpu_s += 3.0;
        Stage::named(&mut stages, "<new>").cpu_s += 1.0;
        assert_eq!(stages.len(), STAGES.len() + 1);
        let svg = bar(&stages, 4.0).into_string();
        assert!(svg.contains("width=\"337.50\"") && svg.contains("width=\"112.50\""));
        assert!(svg.contains("trace 75 %") && svg.contains("&lt;new&gt; 25.0 %"));
        assert!(!svg.contains("<new>"));
        // A bar without CPU seconds has no parts.
        assert!(!bar(&stages[..1], 0.0).into_string().contains("<rect"));
    }
}
