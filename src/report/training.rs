//! The training in the report: curves and pictures.

use super::evaluation::grid;
use crate::plot::{Axis, Panel, Stroke, number, open};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// Size of a curve, px of its own coordinates, and its area.
const SIZE: [f64; 2] = [480.0, 230.0];
const X_ENDS: [f64; 2] = [60.0, 466.0];
const Y_ENDS: [f64; 2] = [182.0, 30.0];

/// Points of a curve at most; each is a mean.
const POINTS: usize = 240;

/// A number at a step.
type Point = (f64, f64);

/// Curves and the newest pictures of both stages.
pub(super) fn training(run: &Path) -> String {
    let folder = run.join("train");
    let mut html = String::new();
    for (stage, title) in [
        ("backtrack", "BT-net alone"),
        ("separation", "SP-net and BT-net"),
    ] {
        let folder = folder.join(stage);
        let Ok(csv) = fs::read_to_string(folder.join("metrics.csv")) else {
            continue;
        };
        let _ = writeln!(html, "<h3>{title}</h3>\n<div class=\"plots wide\">");
        html += &curve("loss", "", &column(&csv, "total"));
        html += &curve(
            "PSNR on validation scenes",
            "dB",
            &column(&csv, "validation_psnr_db"),
        );
        html += "</div>\n";
        if let Some((step, png)) = newest_picture(&folder) {
            let columns = match stage {
                "backtrack" => "R&#771;, R*, R",
                _ => "I, T*, T, R&#771;*, R&#771;, R*, R",
            };
            html += &grid(
                &png,
                &format!("What the networks make of validation scenes at step {step}"),
                &format!(
                    "Validation scenes at step {step}: {columns}. * is what the networks make."
                ),
            );
        }
    }
    if html.is_empty() {
        return "<p class=\"dim\">Nothing was trained on this run in this folder.</p>\n".to_owned();
    }
    html
}

/// What stands in a column of `metrics.csv`, by step.
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

/// A curve as SVG, of means where there are many points.
fn curve(name: &str, unit: &str, points: &[Point]) -> String {
    let at_once = points.len().div_ceil(POINTS).max(1);
    let means: Vec<Point> = points
        .chunks(at_once)
        .map(|chunk| {
            let count = chunk.len() as f64;
            let sum = chunk
                .iter()
                .fold((0.0, 0.0), |(x, y), p| (x + p.0, y + p.1));
            (sum.0 / count, sum.1 / count)
        })
        .collect();
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return String::new();
    };
    let with_unit = match unit {
        "" => String::new(),
        unit => format!(", {unit}"),
    };
    let y_label = match at_once {
        1 => format!("{name}{with_unit}"),
        n => format!("{name}{with_unit}, means of {n} steps"),
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
    let mut svg = open(SIZE, &label);
    let _ = write!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">last {}{}</text>",
        X_ENDS[1],
        Y_ENDS[1] - 9.0,
        number(last.1),
        with_unit.replacen(',', "", 1),
    );
    panel.frame(&mut svg);
    let line: Vec<Point> = means.iter().map(|point| panel.at(*point)).collect();
    let stroke = Stroke {
        colour: "var(--busy)",
        width: 1.8,
        dash: "",
    };
    Panel::line(&mut svg, &line, &stroke);
    if line.len() < 30 {
        Panel::dots(&mut svg, &line, "var(--busy)", 2.4);
    }
    svg + "</svg>\n"
}

/// The newest grid of pictures, with its step.
fn newest_picture(folder: &Path) -> Option<(u64, Vec<u8>)> {
    let entries = fs::read_dir(folder.join("pictures")).ok()?;
    let step = |path: &PathBuf| -> Option<u64> {
        path.file_stem()?
            .to_str()?
            .strip_prefix("step-")?
            .parse()
            .ok()
    };
    let paths = entries.flatten().map(|entry| entry.path());
    let (step, path) = paths.filter_map(|path| Some((step(&path)?, path))).max()?;
    Some((step, fs::read(path).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_read_by_name_and_gaps_are_left_out() {
        let csv = "step,total,validation_psnr_db,wall_s\n1,0.5,,0.1\n2,0.25,20.5,0.1\nx,1\n3,NaN,21,0.1\n";
        assert_eq!(column(csv, "total"), [(1.0, 0.5), (2.0, 0.25)]);
        assert_eq!(
            column(csv, "validation_psnr_db"),
            [(2.0, 20.5), (3.0, 21.0)]
        );
        assert!(column(csv, "other").is_empty());
        let svg = curve("loss", "", &column(csv, "total"));
        assert!(svg.contains("0.5 at step 1, 0.25 at step 2"), "{svg}");
        assert_eq!(curve("loss", "", &[]), "");
    }

    #[test]
    fn a_run_without_training_says_so() {
        let dir = tempfile::tempdir().unwrap();
        assert!(training(dir.path()).contains("Nothing was trained"));
        let folder = dir.path().join("train/backtrack");
        fs::create_dir_all(&folder).unwrap();
        render::atomic_file::write(&folder.join("metrics.csv"), b"step,total\n1,0.5\n").unwrap();
        assert!(training(dir.path()).contains("BT-net alone"));
    }
}
