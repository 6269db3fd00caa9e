//! One histogram as SVG: bars, an axis with its unit, the median.

use std::fmt::Write;

/// Size of the picture, px of its own coordinates.
const WIDTH: f64 = 240.0;
const HEIGHT: f64 = 120.0;
/// Room for the labels.
const FOOT: f64 = 30.0;
const HEAD: f64 = 18.0;

/// A histogram of `values`, which must be finite; `None` if they are all the same. Values above 0 that reach over more than
/// a factor of 30 get a logarithmic axis if it spreads them better.
pub(super) fn histogram(name: &str, unit: &str, values: &[f64]) -> Option<String> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (&least, &most) = (sorted.first()?, sorted.last()?);
    if least == most {
        return None;
    }
    let median = sorted[sorted.len() / 2];
    let linear = |v: f64| (v - least) / (most - least);
    let log = |v: f64| (v / least).ln() / (most / least).ln();
    // Where the median stands tells which axis spreads the values better.
    let is_off = |place: f64| (place - 0.5).abs();
    let is_log = least > 0.0 && most / least > 30.0 && is_off(log(median)) < is_off(linear(median));
    let place = |v: f64| if is_log { log(v) } else { linear(v) };
    let bins = ((values.len() as f64).sqrt() as usize).clamp(6, 24);
    let mut counts = vec![0u32; bins];
    for &value in values {
        counts[((place(value) * bins as f64) as usize).min(bins - 1)] += 1;
    }
    let highest = counts.iter().copied().max().unwrap_or(1).max(1);
    let floor = HEIGHT - FOOT;
    let mut svg = format!(
        "<svg class=\"plot\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"Histogram of {name}\">\
         <text x=\"0\" y=\"12\" class=\"name\">{name}</text>\
         <text x=\"{WIDTH}\" y=\"12\" text-anchor=\"end\">at most {highest}</text>"
    );
    let width = WIDTH / bins as f64;
    for (bin, &count) in counts.iter().enumerate() {
        let height = (floor - HEAD) * f64::from(count) / f64::from(highest);
        let _ = write!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\"/>",
            bin as f64 * width + 0.5,
            floor - height,
            width - 1.0,
        );
    }
    let at = place(median) * WIDTH;
    let _ = write!(
        svg,
        "<path d=\"M0 {floor}H{WIDTH}M{at:.1} {HEAD}V{floor}\"/>\
         <text x=\"0\" y=\"{y}\">{}</text><text x=\"{WIDTH}\" y=\"{y}\" text-anchor=\"end\">{}{}</text>\
         <text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">median {}{}</text></svg>",
        short(least),
        short(most),
        suffix(unit),
        at.clamp(50.0, WIDTH - 50.0),
        HEIGHT - 3.0,
        short(median),
        if is_log { ", log" } else { "" },
        y = floor + 13.0,
    );
    Some(svg)
}

fn suffix(unit: &str) -> String {
    if unit.is_empty() {
        String::new()
    } else {
        format!(" {unit}")
    }
}

/// Three significant digits.
pub(super) fn short(value: f64) -> String {
    let digits = if value == 0.0 {
        0
    } else {
        (2 - value.abs().log10().floor() as i32).clamp(0, 6)
    };
    let text = format!("{value:.*}", digits as usize);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_in_one_bar() {
        let values: Vec<f64> = (0..100).map(f64::from).collect();
        let svg = histogram("ior", "", &values).unwrap();
        assert_eq!(svg.matches("<rect").count(), 10);
        assert!(
            svg.contains("at most 10") && svg.contains("median 50"),
            "{svg}"
        );
        assert!(!svg.contains("log"));
        let spread: Vec<f64> = (0..64).map(|k| 2f64.powi(k % 8)).collect();
        let svg = histogram("f", "m", &spread).unwrap();
        assert!(
            svg.contains("at most 8") && svg.contains(", log") && svg.contains("128 m"),
            "{svg}"
        );
        assert!(histogram("same", "", &[1.0; 9]).is_none());
        assert!(histogram("none", "", &[]).is_none());
    }

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.3, "0.3"),
            (1234.5, "1234"),
            (0.00893, "0.00893"),
            (-1.25, "-1.25"),
            (0.0, "0"),
        ] {
            assert_eq!(short(value), text);
        }
    }
}
