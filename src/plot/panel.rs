//! A rectangle with two axes, and what is drawn in it.

use super::axis::Axis;
use crate::html::Html;
use std::fmt::Write;

/// A plot's area and its axes: `x.ends` are left and right, `y.ends` bottom and top, px.
pub(crate) struct Panel<'a> {
    /// Across.
    pub(crate) x: Axis,
    /// Upwards.
    pub(crate) y: Axis,
    /// What is across, with its unit; stands below on the right.
    pub(crate) x_label: &'a str,
    /// What is upwards, with its unit; stands above on the left.
    pub(crate) y_label: &'a str,
}

/// How a line is drawn.
pub(crate) struct Stroke<'a> {
    /// A colour of CSS.
    pub(crate) colour: &'a str,
    /// px.
    pub(crate) width: f64,
    /// `stroke-dasharray`; empty for a solid line.
    pub(crate) dash: &'a str,
}

/// Begins a plot of `size` px of its own coordinates, to stand in a page; `label` is read to who does not see it.
pub(crate) fn open(size: [f64; 2], label: &str) -> String {
    // A phone shows wide plots smaller.
    let font = if size[0] > 400.0 { 13 } else { 11 };
    format!(
        "<svg class=\"plot\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\" font-size=\"{font}\" fill=\"currentColor\">",
        size[0],
        size[1],
        Html(label)
    )
}

/// Names and colours in a row that ends at `x`, with their baseline at `y`.
pub(crate) fn legend(svg: &mut String, [x, y]: [f64; 2], entries: &[(&str, &str)]) {
    let mut right = x;
    for (name, colour) in entries.iter().rev() {
        let _ = writeln!(
            svg,
            "<text x=\"{right:.1}\" y=\"{y}\" text-anchor=\"end\" font-weight=\"bold\">\
             <tspan fill=\"{colour}\">\u{25a0}</tspan> {}</text>",
            Html(name)
        );
        right -= 9.0 * name.chars().count() as f64 + 26.0;
    }
}

impl Panel<'_> {
    /// Ticks with their numbers, the frame and both labels.
    pub(crate) fn frame(&self, svg: &mut String) {
        let ([left, right], [bottom, top]) = (self.x.ends, self.y.ends);
        for tick in self.x.ticks() {
            let _ = writeln!(
                svg,
                "<path d=\"M{0:.1} {top}V{bottom}\" stroke=\"currentColor\" stroke-opacity=\"0.15\"/>\
                 <text x=\"{0:.1}\" y=\"{1}\" text-anchor=\"middle\">{2}</text>",
                tick.at,
                bottom + 16.0,
                tick.label,
            );
        }
        for tick in self.y.ticks() {
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {0:.1}H{right}\" stroke=\"currentColor\" stroke-opacity=\"0.15\"/>\
                 <text x=\"{1}\" y=\"{2:.1}\" text-anchor=\"end\">{3}</text>",
                tick.at,
                left - 7.0,
                tick.at + 4.0,
                tick.label,
            );
        }
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"currentColor\" stroke-opacity=\"0.5\"/>\
             <text x=\"{left}\" y=\"{}\">{}</text><text x=\"{right}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            right - left,
            bottom - top,
            top - 9.0,
            Html(self.y_label),
            bottom + 33.0,
            Html(self.x_label),
        );
    }

    /// Where values stand.
    pub(crate) fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (self.x.at(x), self.y.at(y))
    }

    /// A line through positions.
    pub(crate) fn line(svg: &mut String, points: &[(f64, f64)], stroke: &Stroke) {
        if points.is_empty() {
            return;
        }
        let dash = match stroke.dash {
            "" => String::new(),
            dash => format!(" stroke-dasharray=\"{dash}\""),
        };
        let path: Vec<String> = points
            .iter()
            .map(|(x, y)| format!("{x:.1} {y:.1}"))
            .collect();
        let _ = writeln!(
            svg,
            "<path d=\"M{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"{dash}/>",
            path.join("L"),
            stroke.colour,
            stroke.width,
        );
    }

    /// A dot at each position.
    pub(crate) fn dots(svg: &mut String, points: &[(f64, f64)], colour: &str, radius: f64) {
        for (x, y) in points {
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\"/>"
            );
        }
    }

    /// Names beside positions (`y`, `x`, name, colour), pushed apart where they would cover each other.
    pub(crate) fn names(svg: &mut String, mut names: Vec<(f64, f64, &str, &str)>) {
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut lowest = f64::NEG_INFINITY;
        for (y, x, name, colour) in names {
            let at = y.max(lowest + 13.0);
            lowest = at;
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\" font-weight=\"bold\">{}</text>",
                x + 7.0,
                at + 4.0,
                Html(name),
            );
        }
    }
}
