//! A plot area: a rectangle with two axes.

use super::axis::Axis;
use maud::{Markup, html};

/// Axes and labels of a plot area. `x.ends` holds its left and right edges, and `y.ends` its bottom and top edges, px.
pub(crate) struct Panel<'a> {
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    /// Quantity and unit of the horizontal axis, below on the right.
    pub(crate) x_label: &'a str,
    /// Quantity and unit of the vertical axis, above on the left.
    pub(crate) y_label: &'a str,
}

/// Style of a line.
pub(crate) struct Stroke<'a> {
    pub(crate) colour: &'a str,
    /// Width, px.
    pub(crate) width: f64,
    /// `stroke-dasharray`; empty for a solid line.
    pub(crate) dash: &'a str,
}

/// Draws a plot of `width` x `height` px. `label` is its accessible name.
pub(crate) fn plot([width, height]: [f64; 2], label: &str, content: &Markup) -> Markup {
    // A phone scales wide plots down, so they need larger text.
    let font_size = if width > 400.0 { 13 } else { 11 };
    html! {
        svg.plot viewBox={ "0 0 " (width) " " (height) } role="img" aria-label=(label)
            font-size=(font_size) fill="currentColor" { (content) }
    }
}

/// Draws names and colours in a row that ends at `x` and has its baseline at `y`.
pub(crate) fn legend([x, y]: [f64; 2], entries: &[(&str, &str)]) -> Markup {
    let mut right = x;
    let placed = entries.iter().rev().map(|(name, colour)| {
        let at = right;
        right -= 9.0 * name.chars().count() as f64 + 26.0;
        (at, name, colour)
    });
    html! {
        @for (x, name, colour) in placed {
            text x=(format_args!("{x:.1}")) y=(y) text-anchor="end" font-weight="bold" {
                tspan fill=(colour) { "\u{25a0}" } " " (name)
            }
        }
    }
}

impl Panel<'_> {
    /// Draws the ticks with their numbers, the frame and both labels.
    pub(crate) fn frame(&self) -> Markup {
        let ([left, right], [bottom, top]) = (self.x.ends, self.y.ends);
        html! {
            @for tick in self.x.ticks() {
                path d=(format_args!("M{:.1} {top}V{bottom}", tick.at)) stroke="currentColor" stroke-opacity="0.15" {}
                text x=(format_args!("{:.1}", tick.at)) y=(bottom + 16.0) text-anchor="middle" { (tick.label) }
            }
            @for tick in self.y.ticks() {
                path d=(format_args!("M{left} {:.1}H{right}", tick.at)) stroke="currentColor" stroke-opacity="0.15" {}
                text x=(left - 7.0) y=(format_args!("{:.1}", tick.at + 4.0)) text-anchor="end" { (tick.label) }
            }
            rect x=(left) y=(top) width=(right - left) height=(bottom - top)
                fill="none" stroke="currentColor" stroke-opacity="0.5" {}
            text x=(left) y=(top - 9.0) { (self.y_label) }
            text x=(right) y=(bottom + 33.0) text-anchor="end" { (self.x_label) }
        }
    }

    /// Returns the position of a data point, px.
    pub(crate) fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (self.x.at(x), self.y.at(y))
    }

    /// Draws a line through positions.
    pub(crate) fn line(points: &[(f64, f64)], stroke: &Stroke) -> Markup {
        let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
        let dash = Some(stroke.dash).filter(|dash| !dash.is_empty());
        html! {
            @if !path.is_empty() {
                path d={ "M" (path.join("L")) } fill="none" stroke=(stroke.colour)
                    stroke-width=(stroke.width) stroke-dasharray=[dash] {}
            }
        }
    }

    /// Draws a dot at each position.
    pub(crate) fn dots(points: &[(f64, f64)], colour: &str, radius: f64) -> Markup {
        html! {
            @for (x, y) in points {
                circle cx=(format_args!("{x:.1}")) cy=(format_args!("{y:.1}")) r=(radius) fill=(colour) {}
            }
        }
    }

    /// Writes names beside positions (`y`, `x`, name, colour), and moves names down where they would overlap.
    pub(crate) fn names(mut names: Vec<(f64, f64, &str, &str)>) -> Markup {
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut lowest = f64::NEG_INFINITY;
        let placed = names.into_iter().map(|(y, x, name, colour)| {
            lowest = y.max(lowest + 13.0);
            (lowest, x, name, colour)
        });
        html! {
            @for (y, x, name, colour) in placed {
                text x=(format_args!("{:.1}", x + 7.0)) y=(format_args!("{:.1}", y + 4.0))
                    fill=(colour) font-weight="bold" { (name) }
            }
        }
    }
}
