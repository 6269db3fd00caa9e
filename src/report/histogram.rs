//! Histograms as SVG.

use crate::plot::{Axis, Panel, number, plot};
use maud::{Markup, html};

/// Size of the picture, in SVG user units.
const SIZE: [f64; 2] = [300.0, 170.0];
const X_ENDS: [f64; 2] = [34.0, 288.0];
const Y_ENDS: [f64; 2] = [128.0, 34.0];

/// Draws a histogram of finite `values`; returns `None` unless two of them differ. Positive values with a range above a
/// factor of 30 get a logarithmic axis if this axis spreads them better.
pub(super) fn histogram(name: &str, unit: &str, values: &[f64]) -> Option<Markup> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (&least, &most) = (sorted.first()?, sorted.last()?);
    if least == most {
        return None;
    }
    let median = sorted[sorted.len() / 2];
    let mut x = Axis::linear([least, most].into_iter(), X_ENDS);
    if least > 0.0 && most / least > 30.0 {
        let log = Axis::log_between([least, most], X_ENDS);
        // The axis with its middle nearer to the median spreads the values better.
        let is_off = |axis: &Axis| (axis.place(median) - 0.5).abs();
        if is_off(&log) < is_off(&x) {
            x = log;
        }
    }
    let bins = ((values.len() as f64).sqrt() as usize).clamp(6, 24);
    let mut counts = vec![0u32; bins];
    for &value in values {
        counts[((x.place(value) * bins as f64) as usize).min(bins - 1)] += 1;
    }
    let highest = counts.iter().copied().max().unwrap_or(1).max(1);
    let with_unit = match unit {
        "" => String::new(),
        unit => format!(" {unit}"),
    };
    let x_label = match (unit, x.is_log()) {
        ("", false) => String::new(),
        ("", true) => "logarithmic".to_owned(),
        (unit, false) => unit.to_owned(),
        (unit, true) => format!("{unit}, logarithmic"),
    };
    let panel = Panel {
        x,
        // Counts are integers, but a shorter axis would have ticks between them.
        y: Axis::linear([0.0, f64::from(highest.max(4))].into_iter(), Y_ENDS),
        x_label: &x_label,
        y_label: "scenes",
    };
    let label = format!(
        "Histogram of {name}: {} to {}{with_unit}, median {}",
        number(least),
        number(most),
        number(median)
    );
    let width = (X_ENDS[1] - X_ENDS[0]) / bins as f64;
    let median_x = panel.x.at(median);
    let content = html! {
        text x="0" y="12" font-size="12" font-weight="600" { (name) }
        text x=(X_ENDS[1]) y="12" text-anchor="end" { "median " (number(median)) (with_unit) }
        @for (bin, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            @let top = panel.y.at(f64::from(count));
            rect.bin x=(format_args!("{:.1}", X_ENDS[0] + bin as f64 * width + 0.5)) y=(format_args!("{top:.1}"))
                width=(format_args!("{:.1}", width - 1.0)) height=(format_args!("{:.1}", Y_ENDS[0] - top)) {}
        }
        (panel.frame())
        path d=(format_args!("M{median_x:.1} {}V{}", Y_ENDS[1], Y_ENDS[0])) stroke="currentColor" stroke-dasharray="3 2" {}
    };
    Some(plot(SIZE, &label, &content))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histograms_have_bars_ranges_and_suitable_axes() {
        let values: Vec<f64> = (0..100).map(f64::from).collect();
        let svg = histogram("ior", "", &values).unwrap().into_string();
        assert_eq!(svg.matches("class=\"bin\"").count(), 10);
        assert!(svg.contains("0 to 99, median 50"), "{svg}");
        assert!(!svg.contains("logarithmic"));
        let spread: Vec<f64> = (0..64).map(|k| 2f64.powi(k % 8)).collect();
        let svg = histogram("f", "m", &spread).unwrap().into_string();
        assert!(svg.contains("1 to 128 m"), "{svg}");
        assert!(svg.contains(">m, logarithmic<"), "{svg}");
        assert!(histogram("same", "", &[1.0; 9]).is_none());
        assert!(histogram("none", "", &[]).is_none());
    }
}
