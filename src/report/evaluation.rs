//! Scores of trained networks, and what they make of some pictures.

use super::picture::{decode_png_within, img, shrunk};
use super::text::{evenly, table};
use crate::html::{Html, cut};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Longest side of a grid of pictures, as it is read and as it is shown, px.
const MOST_PX: u32 = 16_384;
const SHOWN_PX: u32 = 1820;
/// Pictures in the table of single ones.
const PICTURES_SHOWN: usize = 24;

/// Means, single pictures' scores, and a grid of pictures.
pub(super) fn evaluation(run: &Path) -> String {
    let folder = run.join("train").join("evaluation");
    let json = fs::read(folder.join("evaluation.json")).ok();
    let json = json.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
    let scores = json.as_ref().map(scores).unwrap_or_default();
    if scores.is_empty() {
        return "<p class=\"dim\">Nothing was scored: <code>glasshouse evaluate RUN</code> does it.</p>\n"
            .to_owned();
    }
    let mut html = scores;
    if let Ok(png) = fs::read(folder.join("evaluation.png")) {
        let columns = json.as_ref().map(columns).unwrap_or_default();
        html += &grid(
            &png,
            "Pictures that were scored: input, what each method makes of it, truth",
            &format!("Some of the pictures that were scored, evenly drawn: {columns}."),
        );
    }
    if let Ok(csv) = fs::read_to_string(folder.join("evaluation.csv")) {
        html += &single(&csv);
    }
    html
}

/// A grid of pictures. What cannot be read is said in its place.
pub(super) fn grid(png: &[u8], alt: &str, caption: &str) -> String {
    let picture = decode_png_within(png, MOST_PX);
    let tag = picture.and_then(|picture| img(&shrunk(picture, SHOWN_PX), alt));
    match tag {
        Ok(tag) => format!(
            "<figure class=\"grid\"><div class=\"box\" role=\"region\" aria-label=\"{alt}\" tabindex=\"0\">{tag}</div>\
             <figcaption>{caption}</figcaption></figure>\n"
        ),
        Err(reason) => format!(
            "<p class=\"bad\">{alt}: the picture cannot be read ({}).</p>\n",
            Html(&reason)
        ),
    }
}

/// Names of the grid's columns.
fn columns(evaluation: &Value) -> String {
    let rows = evaluation["rows"].as_array().into_iter().flatten();
    let methods = rows.filter_map(|row| row["method"].as_str());
    let names: Vec<String> = methods
        .map(|name| Html(&cut(name, 80)).to_string())
        .chain(["truth".to_owned()])
        .collect();
    names.join(", ")
}

/// The rows of `evaluation.json`; empty if it has none.
fn scores(evaluation: &Value) -> String {
    let Some(all) = evaluation["rows"].as_array() else {
        return String::new();
    };
    let mut rows = String::new();
    for row in all {
        let number = |key: &str, digits: usize| match row[key].as_f64() {
            Some(value) => format!("<data value=\"{value}\">{value:.digits$}</data>"),
            None => Html(row[key].as_str().unwrap_or("?")).to_string(),
        };
        let _ = writeln!(
            rows,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            Html(&cut(row["method"].as_str().unwrap_or_default(), 200)),
            number("psnr_colour_db", 2),
            number("ssim_grey", 4),
            number("psnr_channels_db", 2),
            number("ssim_channels", 4),
        );
    }
    format!(
        "<p>T* against T of {} {} scenes, 8-bit sRGB, not resized. The input as it is comes first: what scores less makes \
         pictures worse.</p>\n{}",
        evaluation["images"].as_u64().unwrap_or(0),
        Html(evaluation["split"].as_str().unwrap_or_default()),
        table(
            "Scores",
            &[
                "method",
                "#PSNR, dB",
                "#SSIM, grey",
                "#PSNR, mean of channels, dB",
                "#SSIM, mean of channels",
            ],
            &rows
        ),
    )
}

/// PSNR of single pictures by every method, from `evaluation.csv`.
fn single(csv: &str) -> String {
    let mut lines = csv.lines().map(cells);
    let head = lines.next().unwrap_or_default();
    let place = |name: &str| head.iter().position(|cell| cell == name);
    let (Some(method), Some(image), Some(psnr)) =
        (place("method"), place("image"), place("psnr_colour_db"))
    else {
        return String::new();
    };
    let mut methods: Vec<String> = Vec::new();
    let mut images: Vec<String> = Vec::new();
    let mut values: BTreeMap<(String, String), String> = BTreeMap::new();
    for line in lines {
        let [Some(method), Some(image), Some(psnr)] =
            [method, image, psnr].map(|k| line.get(k).cloned())
        else {
            continue;
        };
        if !methods.contains(&method) {
            methods.push(method.clone());
        }
        // The methods come one after the other, each with all images.
        if methods.len() == 1 {
            images.push(image.clone());
        }
        values.insert((image, method), psnr);
    }
    let mut rows = String::new();
    for place in evenly(images.len(), PICTURES_SHOWN) {
        let image = &images[place];
        let _ = write!(
            rows,
            "<tr><td class=\"mono\">{}</td>",
            Html(&cut(image, 200))
        );
        for method in &methods {
            let value = values.get(&(image.clone(), method.clone()));
            let shown = value.and_then(|v| v.parse::<f64>().ok());
            let shown = shown.map_or_else(|| "?".to_owned(), |v| format!("{v:.2}"));
            let _ = write!(rows, "<td class=\"n\">{shown}</td>");
        }
        rows += "</tr>\n";
    }
    let heads: Vec<String> = methods
        .iter()
        .map(|method| format!("#{}", Html(&cut(method, 80))))
        .collect();
    let heads: Vec<&str> = ["picture"]
        .into_iter()
        .chain(heads.iter().map(String::as_str))
        .collect();
    let shown = images.len().min(PICTURES_SHOWN);
    format!(
        "<h3>PSNR of single pictures, dB</h3>\n<p>{shown} of {}, evenly drawn; <code>evaluation.csv</code> has all.</p>\n{}",
        images.len(),
        table("PSNR of single pictures", &heads, &rows)
    )
}

/// Cells of a line of CSV (RFC 4180).
fn cells(line: &str) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut is_quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        let last = cells.len() - 1;
        match c {
            '"' if is_quoted && characters.peek() == Some(&'"') => {
                characters.next();
                cells[last].push('"');
            }
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => cells.push(String::new()),
            c => cells[last].push(c),
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_may_be_quoted() {
        assert_eq!(cells("a,\"b, \"\"c\"\"\",,1"), ["a", "b, \"c\"", "", "1"]);
    }

    #[test]
    fn scores_of_all_methods_are_shown() {
        let folder = tempfile::tempdir().unwrap();
        assert!(evaluation(folder.path()).contains("Nothing was scored"));
        let inside = folder.path().join("train/evaluation");
        render::atomic_file::create_dir(&inside).unwrap();
        let put = |name: &str, bytes: &[u8]| {
            render::atomic_file::write(&inside.join(name), bytes).unwrap();
        };
        let json = br#"{"split":"test","images":2,"rows":[{"method":"input","psnr_colour_db":20.126,"ssim_grey":0.9,
            "psnr_channels_db":"inf","ssim_channels":0.8},{"method":"<b>","psnr_colour_db":25.0}]}"#;
        put("evaluation.json", json);
        put(
            "evaluation.csv",
            b"method,image,psnr_colour_db\ninput,x,20.0\ninput,y,20.25\n\"<b>\",x,24\n\"<b>\",y,26\n",
        );
        put("evaluation.png", b"no picture");
        let html = evaluation(folder.path());
        for part in [
            "<data value=\"20.126\">20.13</data>",
            ">inf<",
            ">26.00<",
            "&lt;b&gt;",
            "the picture cannot be read",
        ] {
            assert!(html.contains(part), "no {part} in {html}");
        }
        assert!(!html.contains("<b>"));
    }
}
