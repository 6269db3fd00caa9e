//! `report/index.html`: the run at a glance and a contact sheet of its tuples.

use super::histogram::short;
use super::parameters::{parameters, rejections};
use super::training::training;
use crate::atomic_file::{self, WriteError};
use crate::farm::{Run, read_rejected, run_status};
use crate::merge::{SrgbEncoder, TupleRecord, srgb_to_linear};
use crate::trace::LAYERS;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Tuples on the contact sheet; more are spread evenly over the manifest.
const SHOWN: usize = 48;
/// How much brighter the reflection is shown a second time.
const GAIN: f32 = 8.0;
/// Width of a picture on the page, px; larger ones are scaled down.
const THUMBNAIL_PX: u32 = 256;

/// The report cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A tuple's file is damaged.
    #[error("cannot read {}: {reason}; delete its tuple folder and run `work` again", path.display())]
    Tuple {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// Writes the page and returns its path.
pub fn write_report(run: &Run) -> Result<PathBuf, ReportError> {
    let status = run_status(run);
    let merged: Vec<_> = run
        .lines
        .iter()
        .filter(|line| crate::merge::is_written(&run.dir.tuple(&line.id), line))
        .collect();
    let step = merged.len().div_ceil(SHOWN).max(1);
    let mut rows = String::new();
    for line in merged.iter().step_by(step) {
        row(&mut rows, &run.dir.tuple(&line.id), line.id.as_str())?;
    }
    let mut page = String::new();
    let shown = merged.len().div_ceil(step);
    let _ = write!(
        page,
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{name} - Glasshouse</title>\n<style>{STYLE}</style></head>\n<body><main>\n\
         <h1>{name}</h1>\n\
         <p class=\"glance\"><b>{}</b> of {} tuples &middot; <b>{}</b> of {} shards &middot; <b>{}</b> in quarantine \
         &middot; tile {} px &middot; tracer {}</p>\n",
        status.merged,
        status.scenes,
        status.shards_done,
        status.shards,
        status.quarantined.len(),
        run.spec.tile_px,
        run.spec.tracer_version,
        name = escape(&run.spec.name),
    );
    if !status.quarantined.is_empty() {
        page += "<h2>Quarantine</h2>\n<ul class=\"quarantine\">\n";
        for scene in &status.quarantined {
            let _ = writeln!(
                page,
                "<li><b>{}</b> {}</li>",
                escape(&scene.scene),
                escape(&scene.reason)
            );
        }
        page += "</ul>\n";
    }
    page += &parameters(&run.lines);
    let rejected =
        read_rejected(&run.dir).map_err(|(path, reason)| ReportError::Tuple { path, reason })?;
    page += &rejections(run.lines.len(), &rejected);
    page += &training(run.dir.root());
    let _ = write!(
        page,
        "<h2>Contact sheet</h2>\n<p>{shown} of {} tuples. Linear light, sRGB-coded and clipped at white for the screen. \
         <b>I</b> is what the camera sees; <b>T</b> the scene behind the glass, bent as by it; <b>R&#771;</b> the scene \
         reflected by both faces of the glass, through the lens; <b>R</b> the same without glass and lens.</p>\n",
        merged.len(),
    );
    page += &rows;
    page += "</main></body></html>\n";
    atomic_file::create_dir(&run.dir.report())?;
    let path = run.dir.report().join("index.html");
    atomic_file::write_relaxed(&path, page.as_bytes())?;
    Ok(path)
}

const STYLE: &str = ":root{color-scheme:light dark;--dim:#667;--line:#8883}\
body{font:15px/1.5 system-ui,sans-serif;margin:0}main{max-width:1400px;margin:auto;padding:1.2rem}\
h1{font-size:1.6rem;margin:.2rem 0}h2{font-size:1.1rem;margin:1.6rem 0 .4rem}.glance{color:var(--dim)}\
.tuple{border-top:1px solid var(--line);padding:.8rem 0}.tuple h3{font-size:1rem;margin:0 0 .3rem}\
.tuple small{color:var(--dim);font-weight:normal}.strip{display:grid;grid-template-columns:repeat(5,1fr);gap:.5rem}\
figure{margin:0}img{width:100%;display:block;border-radius:3px}figcaption{font-size:.8rem;color:var(--dim)}\
.plots{display:grid;grid-template-columns:repeat(auto-fill,minmax(240px,1fr));gap:1rem}\
.plot{width:100%;fill:currentColor;font-size:10px}.plot .name{font-size:12px;font-weight:600}.plot rect{fill:#4a86c8}\
.plot path{stroke:currentColor;stroke-width:.7;fill:none}.curves{grid-template-columns:repeat(auto-fit,minmax(min(100%,400px),1fr))}.grid img{width:auto;max-width:100%}\
.plot .line{stroke:#4a86c8;stroke-width:1.6}\
h3{font-size:1rem;margin:1rem 0 .3rem}table{border-collapse:collapse;font-size:.9rem}\
th,td{text-align:left;padding:.15rem .8rem .15rem 0;border-bottom:1px solid var(--line);vertical-align:top}\
@media(max-width:640px){.strip{grid-template-columns:repeat(2,1fr)}}";

const SYMBOLS: [&str; 4] = ["I", "T", "R&#771;", "R"];

fn row(html: &mut String, folder: &Path, id: &str) -> Result<(), ReportError> {
    let bad = |path: &Path, reason: &dyn std::fmt::Display| ReportError::Tuple {
        path: path.to_owned(),
        reason: reason.to_string(),
    };
    let path = folder.join("tuple.json");
    let text = std::fs::read_to_string(&path).map_err(|e| bad(&path, &e))?;
    let record: TupleRecord = serde_json::from_str(&text).map_err(|e| bad(&path, &e))?;
    let focus = record
        .facts
        .focus_distance_m
        .map_or("infinity".to_owned(), |z| format!("{z:.2} m"));
    let glass = &record.scene.glass;
    let orders: Vec<&str> = record
        .facts
        .orders
        .iter()
        .map(|o| o.order.as_str())
        .collect();
    let _ = writeln!(
        html,
        "<section class=\"tuple\"><h3>{} <small>{} &middot; {} spp &middot; focus {focus} &middot; glass {} mm, n {} at \
         {} m &middot; orders {}</small></h3><div class=\"strip\">",
        escape(id),
        record.scene.split,
        record.scene.film.spp,
        short(glass.thickness_m * 1e3),
        short(glass.ior),
        short(glass.distance_m),
        orders.join(" "),
    );
    for (name, symbol) in LAYERS.iter().zip(SYMBOLS) {
        let Some(layer) = record.layers.get(*name) else {
            continue;
        };
        let path = folder.join(format!("{name}.png"));
        let png = std::fs::read(&path).map_err(|e| bad(&path, &e))?;
        let png = thumbnail(png).map_err(|e| bad(&path, &e))?;
        let error = layer
            .error_rms
            .map_or("unknown".to_owned(), |e| format!("{e:.1e}"));
        let mut numbers = format!("error {error}");
        for (what, share) in [
            ("missed", layer.miss_share),
            ("clipped", layer.clipped_share),
        ] {
            if share > 0.0 {
                let _ = write!(numbers, " &middot; {what} {:.2} %", share * 100.0);
            }
        }
        figure(
            html,
            &format!("{name} of {}", escape(id)),
            symbol,
            name,
            &numbers,
            &png,
        );
        if *name == "glass_reflection" {
            let bright = brightened(&png).map_err(|e| bad(&path, &e))?;
            let symbol = format!("{symbol} &times; {GAIN}");
            figure(
                html,
                &format!("{name} of {}, brightened", escape(id)),
                &symbol,
                "to see it",
                "",
                &bright,
            );
        }
    }
    html.push_str("</div></section>\n");
    Ok(())
}

fn figure(html: &mut String, alt: &str, symbol: &str, name: &str, numbers: &str, png: &[u8]) {
    let _ = writeln!(
        html,
        "<figure><img loading=\"lazy\" alt=\"{alt}\" src=\"data:image/png;base64,{}\"><figcaption><b>{symbol}</b> \
         {name}<br>{numbers}</figcaption></figure>",
        STANDARD.encode(png),
    );
}

/// The reflection as if the back scene were [`GAIN`] times as bright, from its 8-bit picture.
fn brightened(png: &[u8]) -> Result<Vec<u8>, image::ImageError> {
    let mut picture = image::load_from_memory(png)?.into_rgb8();
    let encoder = SrgbEncoder::new();
    let codes: Vec<u8> = (0..=255u8)
        .map(|code| encoder.encode(srgb_to_linear(code) * GAIN))
        .collect();
    for value in picture.iter_mut() {
        *value = codes[usize::from(*value)];
    }
    encode(&picture)
}

/// The picture itself, or a smaller one.
fn thumbnail(png: Vec<u8>) -> Result<Vec<u8>, image::ImageError> {
    let picture = image::load_from_memory(&png)?.into_rgb8();
    if picture.width() <= THUMBNAIL_PX {
        return Ok(png);
    }
    let height = (picture.height() * THUMBNAIL_PX / picture.width()).max(1);
    encode(&image::imageops::thumbnail(&picture, THUMBNAIL_PX, height))
}

fn encode(picture: &image::RgbImage) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
        .write_image(
            picture.as_raw(),
            picture.width(),
            picture.height(),
            image::ExtendedColorType::Rgb8,
        )?;
    Ok(bytes)
}

pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
