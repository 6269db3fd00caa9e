//! The training in the report: curves, scores, pictures.

use super::histogram::short;
use super::html::escape;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// Size of a curve, px of its own coordinates.
const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 180.0;
const LEFT: f64 = 46.0;
const FOOT: f64 = 28.0;
const HEAD: f64 = 20.0;

/// Points of a curve at most; each is a mean.
const POINTS: usize = 240;

/// A number at a step.
type Point = (f64, f64);

/// The section; empty if nothing was trained.
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
        let _ = writeln!(html, "<h3>{title}</h3>\n<div class=\"plots curves\">");
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
            let _ = writeln!(
                html,
                "<figure class=\"grid\"><img loading=\"lazy\" alt=\"What the networks make of validation scenes at step {step}\" \
                 src=\"data:image/png;base64,{}\"><figcaption>Validation scenes at step {step}: {columns}. \
                 * is what the networks make.</figcaption></figure>",
                STANDARD.encode(png)
            );
        }
    }
    let evaluation = fs::read(folder.join("evaluation").join("evaluation.json")).ok();
    let evaluation = evaluation.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
    if let Some(evaluation) = evaluation {
        html += &scores(&evaluation);
    }
    if html.is_empty() {
        return html;
    }
    format!("<h2>Training</h2>\n{html}")
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
    let least = means.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
    let most = means.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
    let span = (most - least).max(1e-9);
    let steps = (last.0 - first.0).max(1.0);
    let floor = HEIGHT - FOOT;
    let mut path = String::new();
    for (k, (step, value)) in means.iter().enumerate() {
        let x = LEFT + (WIDTH - LEFT - 4.0) * (step - first.0) / steps;
        let y = floor - (floor - HEAD) * (value - least) / span;
        let _ = write!(path, "{}{x:.1} {y:.1}", if k == 0 { "M" } else { "L" });
    }
    let unit_of = if unit.is_empty() {
        String::new()
    } else {
        format!(", {unit}")
    };
    format!(
        "<svg class=\"plot curve\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{name} against steps\">\
         <text x=\"0\" y=\"12\" class=\"name\">{name}{unit_of}</text>\
         <text x=\"{WIDTH}\" y=\"12\" text-anchor=\"end\">last {}</text>\
         <path d=\"M{LEFT} {HEAD}V{floor}H{WIDTH}\"/><path class=\"line\" d=\"{path}\"/>\
         <text x=\"{x}\" y=\"{floor}\" text-anchor=\"end\">{}</text>\
         <text x=\"{x}\" y=\"{}\" text-anchor=\"end\">{}</text>\
         <text x=\"{LEFT}\" y=\"{foot}\">{}</text><text x=\"{WIDTH}\" y=\"{foot}\" text-anchor=\"end\">step {}</text></svg>\n",
        short(last.1),
        short(least),
        HEAD + 8.0,
        short(most),
        first.0,
        last.0,
        x = LEFT - 4.0,
        foot = floor + 14.0,
    )
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

/// The rows of `evaluation.json`.
fn scores(evaluation: &Value) -> String {
    let Some(rows) = evaluation["rows"].as_array() else {
        return String::new();
    };
    let mut html = format!(
        "<h3>Scores on {} {} scenes</h3>\n<table><tr><th>method</th><th>PSNR, dB</th><th>SSIM, grey</th>\
         <th>PSNR, mean of channels, dB</th><th>SSIM, mean of channels</th></tr>\n",
        evaluation["images"],
        escape(evaluation["split"].as_str().unwrap_or_default()),
    );
    for row in rows {
        let number = |key: &str, digits: usize| {
            row[key].as_f64().map_or_else(
                || escape(row[key].as_str().unwrap_or("?")),
                |value| format!("{value:.digits$}"),
            )
        };
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(row["method"].as_str().unwrap_or_default()),
            number("psnr_colour_db", 2),
            number("ssim_grey", 4),
            number("psnr_channels_db", 2),
            number("ssim_channels", 4),
        );
    }
    html += "</table>\n<p>T* against T, 8-bit sRGB, not resized. The input as it is comes first: what scores less makes pictures \
             worse.</p>\n";
    html
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
        assert!(svg.contains("step 2") && svg.contains("0.5"), "{svg}");
        assert_eq!(curve("loss", "", &[]), "");
    }

    #[test]
    fn a_run_without_training_has_no_section() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(training(dir.path()), "");
        let folder = dir.path().join("train/backtrack");
        fs::create_dir_all(&folder).unwrap();
        crate::atomic_file::write(&folder.join("metrics.csv"), b"step,total\n1,0.5\n").unwrap();
        assert!(training(dir.path()).contains("BT-net alone"));
    }
}
