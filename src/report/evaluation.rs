//! Scores of trained networks, and pictures of their results.

use super::picture::{decode_png_within, img, shrunk};
use super::text::{evenly, exact, table};
use crate::text::{csv_cells, cut};
use maud::{Markup, html};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum side of a grid of pictures in the file and on the page, px.
const MOST_PX: u32 = 16_384;
const SHOWN_PX: u32 = 1820;
/// Maximum number of pictures in the table of single pictures.
const PICTURES_SHOWN: usize = 24;

/// Draws the section: mean scores, a grid of pictures, and the scores of single pictures.
pub(super) fn evaluation(run: &Path) -> Markup {
    let folder = run.join("train").join("evaluation");
    let json = match render::input_file::read_if_there(&folder.join("evaluation.json")) {
        Ok(json) => json.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok()),
        Err(error) => return html! { p.bad { "The scores cannot be read: " (error) "." } },
    };
    let Some(json) = json.filter(|json| json["rows"].is_array()) else {
        return html! { p.dim { "The run has no scores yet; " code { "glasshouse evaluate RUN" } " computes them." } };
    };
    html! {
        (scores(&json))
        @if let Ok(png) = render::input_file::read(&folder.join("evaluation.png")) {
            (grid(
                &png,
                "Scored pictures: input, output of each method, truth",
                &format!("Scored pictures, a selection at even distances: {}.", columns(&json)),
            ))
        }
        @if let Ok(csv) = render::input_file::read_to_string(&folder.join("evaluation.csv")) { (single(&csv)) }
    }
}

/// Draws a grid of pictures, or the error of reading it.
pub(super) fn grid(png: &[u8], alt: &str, caption: &str) -> Markup {
    let picture = decode_png_within(png, MOST_PX);
    match picture.and_then(|picture| img(&shrunk(picture, SHOWN_PX), alt)) {
        Ok(tag) => html! {
            figure.grid {
                div.box role="region" aria-label=(alt) tabindex="0" { (tag) }
                figcaption { (caption) }
            }
        },
        Err(reason) => html! { p.bad { (alt) ": the picture cannot be read (" (reason) ")." } },
    }
}

/// Lists the names of the grid's columns.
fn columns(evaluation: &Value) -> String {
    let names = evaluation["columns"].as_array().into_iter().flatten();
    let names = names.filter_map(Value::as_str).map(|name| cut(name, 80));
    let names: Vec<String> = names.chain(["truth".to_owned()]).collect();
    names.join(", ")
}

fn number(value: &Value, digits: usize) -> Markup {
    html! {
        @if let Some(number) = value.as_f64() {
            (exact(number, &format!("{number:.digits$}")))
        } @else {
            (value.as_str().unwrap_or("-"))
        }
    }
}

/// Draws two counts as `12 / 9`.
fn counts(row: &Value, keys: [&str; 2]) -> Markup {
    let [raw, own] = keys.map(|key| row[key].as_u64());
    html! { @if let (Some(raw), Some(own)) = (raw, own) { (raw) " / " (own) } @else { "-" } }
}

/// Draws a mean and its interval as `+0.16 [-0.11, +0.41]`.
fn interval(interval: &Value) -> Markup {
    let part = |key: &str| match interval[key].as_f64() {
        Some(value) => format!("{value:+.2}"),
        None => interval[key].as_str().unwrap_or("?").to_owned(),
    };
    html! {
        @if interval.is_object() {
            (part("mean")) " [" (part("low")) ", " (part("high")) "]"
        } @else { "-" }
    }
}

/// Draws the rows of `evaluation.json` as a table.
fn scores(evaluation: &Value) -> Markup {
    let list = || evaluation["rows"].as_array().into_iter().flatten();
    let has_groups = list().any(|row| row["group"] != "all");
    let rows = html! {
        @for row in list() {
            tr {
                @if has_groups { td { (cut(row["group"].as_str().unwrap_or_default(), 80)) } }
                td { (cut(row["method"].as_str().unwrap_or_default(), 200)) }
                td.n { (number(&row["psnr_colour_db"], 2)) }
                td.n { (number(&row["psnr_own_factor_db"], 2)) }
                td.n { (number(&row["ssim_grey"], 4)) }
                td.n { (counts(row, ["wins", "wins_own_factor"])) }
                td.n { (counts(row, ["wins_veil", "wins_veil_own_factor"])) }
                td.n { (interval(&row["over_veil_db"])) }
                td.n { (interval(&row["over_veil_own_factor_db"])) }
            }
        }
    };
    let mut heads = vec![
        "method",
        "#PSNR, dB",
        "#after own factor, dB",
        "#SSIM, grey",
        "#wins over the input",
        "#over the veil rule",
        "#PSNR minus the veil rule's, dB",
        "#after own factors, dB",
    ];
    if has_groups {
        heads.insert(0, "group");
    }
    html! {
        p {
            "T* against T of " (evaluation["images"].as_u64().unwrap_or(0)) " "
            (evaluation["split"].as_str().unwrap_or_default())
            " scenes, 8-bit sRGB. The first row scores the input; a method with lower scores does harm. A network must
            also beat the input times a factor and the veil rule, which know nothing of reflections; rows of oracles are
            chosen on the scored pictures. Counts are raw / after each picture's own best factor; intervals are 95 % of a
            paired bootstrap over the pictures."
        }
        (table("Scores", &heads, &rows))
    }
}

/// Draws a table of the PSNR of single pictures for every method, from `evaluation.csv`.
fn single(csv: &str) -> Markup {
    let mut lines = csv.lines().map_while(csv_cells);
    let head = lines.next().unwrap_or_default();
    let place = |name: &str| head.iter().position(|cell| cell == name);
    let (Some(method), Some(image), Some(psnr)) =
        (place("method"), place("image"), place("psnr_colour_db"))
    else {
        return html! {};
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
        // The rows are sorted by method, and every method has all images.
        if methods.len() == 1 {
            images.push(image.clone());
        }
        values.insert((image, method), psnr);
    }
    let psnr = |image: &String, method: &String| {
        let value = values.get(&(image.clone(), method.clone()));
        let shown = value.and_then(|v| v.parse::<f64>().ok());
        shown.map_or_else(|| "?".to_owned(), |v| format!("{v:.2}"))
    };
    let rows = html! {
        @for place in evenly(images.len(), PICTURES_SHOWN) {
            @let image = &images[place];
            tr {
                td.mono { (cut(image, 200)) }
                @for method in &methods { td.n { (psnr(image, method)) } }
            }
        }
    };
    let mut heads = vec!["picture".to_owned()];
    heads.extend(methods.iter().map(|method| format!("#{}", cut(method, 80))));
    html! {
        h3 { "PSNR of single pictures, dB" }
        p {
            (images.len().min(PICTURES_SHOWN)) " of " (images.len()) " pictures, at even distances; "
            code { "evaluation.csv" } " has all of them."
        }
        (table("PSNR of single pictures", &heads, &rows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_of_all_methods_are_shown() {
        let folder = tempfile::tempdir().unwrap();
        let page = || evaluation(folder.path()).into_string();
        assert!(page().contains("has no scores yet"));
        let inside = folder.path().join("train/evaluation");
        render::atomic_file::create_dir(&inside).unwrap();
        let put = |name: &str, bytes: &[u8]| {
            render::atomic_file::write(&inside.join(name), bytes).unwrap();
        };
        let json = br#"{"split":"test","images":2,"columns":["input","<b>"],"rows":[{"method":"input","group":"all",
            "psnr_colour_db":20.126,"psnr_own_factor_db":"inf","ssim_grey":0.9},{"method":"<b>","group":"all",
            "psnr_colour_db":25.0,"wins":12,"wins_own_factor":9,
            "over_veil_db":{"mean":0.156,"low":-0.1,"high":"inf"}}]}"#;
        put("evaluation.json", json);
        put(
            "evaluation.csv",
            b"method,image,psnr_colour_db\ninput,x,20.0\ninput,y,20.25\n\"<b>\",x,24\n\"<b>\",y,26\n",
        );
        put("evaluation.png", b"no picture");
        let html = page();
        for part in [
            "<data value=\"20.126\">20.13</data>",
            ">inf<",
            ">26.00<",
            ">12 / 9<",
            ">+0.16 [-0.10, inf]<",
            "&lt;b&gt;",
            "the picture cannot be read",
        ] {
            assert!(html.contains(part), "no {part} in {html}");
        }
        assert!(!html.contains("<b>"));
    }
}
