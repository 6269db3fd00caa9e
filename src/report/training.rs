//! Curves and pictures of the training.

use super::evaluation::grid;
use crate::plot::{Axis, Panel, Stroke, number, plot};
use maud::{Markup, html};
use std::fs;
use std::path::{Path, PathBuf};

/// Size of a curve's picture and ends of its axes, in SVG user units.
const SIZE: [f64; 2] = [480.0, 230.0];
const X_ENDS: [f64; 2] = [60.0, 466.0];
const Y_ENDS: [f64; 2] = [182.0, 30.0];

/// Maximum number of points of a curve. A longer curve shows means of consecutive points.
const POINTS: usize = 240;

/// Step and value.
type Point = (f64, f64);

/// Draws the section: curves and the newest pictures of both stages.
pub(super) fn training(run: &Path) -> Markup {
    let stages = [
        ("backtrack", "BT-net alone", "R\u{303}, R*, R"),
        ("separation", "SP-net and BT-net", "I, T*, T, R\u{303}*, R\u{303}, R*, R"),
    ];
    let trained: Vec<Markup> = stages
        .into_iter()
        .filter_map(|(name, title, columns)| stage(&run.join("train").join(name), title, columns))
        .collect();
    html! {
        @if trained.is_empty() { p.dim { "Nothing was trained in this folder." } }
        @for stage in trained { (stage) }
    }
}

/// Draws the curves and the newest pictures of a stage, if it was trained.
fn stage(folder: &Path, title: &str, columns: &str) -> Option<Markup> {
    let csv = match render::input_file::read_if_there(&folder.join("metrics.csv")) {
        Ok(csv) => String::from_utf8_lossy(&csv?).into_owned(),
        Err(error) => {
            let bad = html! { p.bad { "The metrics cannot be read: " (error) "." } };
            return Some(html! { h3 { (title) } (bad) });
        }
    };
    let validation = column(&csv, "validation_psnr_db");
    let shown = if validation.is_empty() { "training" } else { "validation" };
    Some(html! {
        h3 { (title) }
        div.plots.wide {
            (curve("loss", "", &column(&csv, "total")))
            @if !validation.is_empty() { (curve("PSNR on validation scenes", "dB", &validation)) }
        }
        @if let Some((step, png)) = newest_picture(folder) {
            (grid(
                &png,
                &format!("Outputs of the networks for {shown} scenes at step {step}"),
                &format!("Scenes of the {shown} split at step {step}: {columns}. * marks outputs of the networks."),
            ))
        }
    })
}

/// Reads the steps and the finite values of a column of `metrics.csv`.
fn column(csv: &str, name: &str) -> Vec<Point> {
    let mut lines = csv.lines();
    let head: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let Some(place) = head.iter().position(|n| *n == name) else {
        return Vec::new();
    };
    let point = |line: &str| {
        let mut cells = line.split(',');
        let step: f64 = cells.next()?.parse().ok()?;
        let value: f64 = cells.nth(place.checked_sub(1)?)?.parse().ok()?;
        value.is_finite().then_some((step, value))
    };
    lines.filter_map(point).collect()
}

/// Draws a curve as SVG, from means of consecutive points if it has more than [`POINTS`] points.
fn curve(name: &str, unit: &str, points: &[Point]) -> Markup {
    let at_once = points.len().div_ceil(POINTS).max(1);
    let means: Vec<Point> = points
        .chunks(at_once)
        .map(|chunk| {
            let count = chunk.len() as f64;
            let sum = chunk.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0, y + p.1));
            (sum.0 / count, sum.1 / count)
        })
        .collect();
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return html! {};
    };
    let with_unit = match unit {
        "" => String::new(),
        unit => format!(", {unit}"),
    };
    let y_label = match at_once {
        1 => format!("{name}{with_unit}"),
        n => format!("{name}{with_unit}, means of {n} points"),
    };
    let panel = Panel {
        x: Axis::linear([first.0, last.0].into_iter(), X_ENDS),
        y: Axis::linear(means.iter().map(|p| p.1), Y_ENDS),
        x_label: "step",
        y_label: &y_label,
    };
    let label = format!(
        "{name}{with_unit} against steps: {} at step {}, {} at step {}",
        number(first.1),
        first.0,
        number(last.1),
        last.0
    );
    let line: Vec<Point> = means.iter().map(|point| panel.at(*point)).collect();
    let stroke = Stroke { colour: "var(--busy)", width: 1.8, dash: "" };
    let content = html! {
        text x=(X_ENDS[1]) y=(Y_ENDS[1] - 9.0) text-anchor="end" {
            "last " (number(last.1)) (with_unit.replacen(',', "", 1))
        }
        (panel.frame())
        (Panel::line(&line, &stroke))
        @if line.len() < 30 { (Panel::dots(&line, "var(--busy)", 2.4)) }
    };
    plot(SIZE, &label, &content)
}

/// Reads the newest grid of pictures, with its step.
fn newest_picture(folder: &Path) -> Option<(u64, Vec<u8>)> {
    let entries = fs::read_dir(folder.join("pictures")).ok()?;
    let step = |path: &PathBuf| -> Option<u64> {
        path.file_stem()?.to_str()?.strip_prefix("step-")?.parse().ok()
    };
    let paths = entries.flatten().map(|entry| entry.path());
    let (step, path) = paths.filter_map(|path| Some((step(&path)?, path))).max()?;
    Some((step, render::input_file::read(&path).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_and_gaps_are_skipped() {
        let csv = "step,total,validation_psnr_db,wall_s\n1,0.5,,0.1\n2,0.25,20.5,0.1\nx,1\n3,NaN,21,0.1\n";
        assert_eq!(column(csv, "total"), [(1.0, 0.5), (2.0, 0.25)]);
        assert_eq!(column(csv, "validation_psnr_db"), [(2.0, 20.5), (3.0, 21.0)]);
        assert!(column(csv, "other").is_empty());
        let svg = curve("loss", "", &column(csv, "total")).into_string();
        assert!(svg.contains("0.5 at step 1, 0.25 at step 2"), "{svg}");
        assert_eq!(curve("loss", "", &[]).into_string(), "");
    }

    #[test]
    fn a_section_without_training_has_a_note() {
        let dir = tempfile::tempdir().unwrap();
        let page = || training(dir.path()).into_string();
        assert!(page().contains("Nothing was trained"));
        let folder = dir.path().join("train/backtrack");
        fs::create_dir_all(&folder).unwrap();
        render::atomic_file::write(&folder.join("metrics.csv"), b"step,total\n1,0.5\n").unwrap();
        assert!(page().contains("BT-net alone"));
    }
}
