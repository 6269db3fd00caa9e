//! The contact sheet: tuples at even distances in the run, each with its noise map, if any.

use super::label_picture;
use super::noise_picture::{noise_picture, scale};
use super::picture::{MUCH_SMALLER, QUALITY, decode_png, exact_img, img, shrunk};
use super::survey::{Survey, parse};
use super::text::{error, evenly};
use crate::plot::{PAPER_SYMBOLS, number};
use crate::run::{Run, keys};
use crate::store::{Store, StoreError};
use glasshouse_line::color::{SrgbEncoder, srgb_to_linear};
use glasshouse_line::ids::SceneId;
use glasshouse_line::label::LabelSet;
use glasshouse_line::layer::Layer;
use glasshouse_line::{Glass, GlazingName, Roughness, SceneLine, Side, Sketch};
use image::RgbImage;
use maud::{Markup, html};
use rayon::prelude::*;
use render::merge::{
    LayerRecord, NoiseMap, RAW, TupleRecord, decode_tuple_labels, photographed_layer, photographs,
};
use std::fmt::Write as _;
use std::path::Path;

/// Maximum number of tuples on the sheet.
const SHOWN: usize = 32;
/// Approximate maximum size of the sheet, bytes. Larger pictures leave space for fewer rows.
const BUDGET: usize = 7 << 20;
/// Brightness of the second picture of the reflection, relative to the first.
pub(super) const GAIN: f32 = 8.0;
/// Maximum side of a picture on the page, px. Larger pictures are scaled down.
pub(super) const THUMBNAIL_PX: u32 = 256;

pub(super) struct Sheet {
    pub(super) html: Markup,
    pub(super) shown: usize,
    /// Number of shown tuples with a noise map.
    pub(super) noise_maps: usize,
    /// Scenes with tuples that cannot be shown, and the reasons.
    pub(super) damaged: Vec<(SceneId, String)>,
}

/// A tuple on the sheet.
struct Row {
    html: Markup,
    has_map: bool,
}

enum Lack {
    Store(StoreError),
    Damaged(SceneId, String),
}

/// Reads and draws tuples. Lists damaged tuples instead of drawing them.
pub(super) fn sheet(run: &Run, store: &Store, survey: &Survey) -> Result<Sheet, StoreError> {
    let drawn = evenly(survey.done.len(), SHOWN);
    let encoder = SrgbEncoder::new();
    let made: Vec<Result<Row, Lack>> = drawn
        .par_iter()
        .map(|&place| {
            let line = &run.lines[survey.done[place].index];
            row(line, store, survey.noise.contains(&line.id), &encoder)
        })
        .collect();
    let (mut rows, mut damaged) = (Vec::new(), Vec::new());
    for made in made {
        match made {
            Ok(row) => rows.push(row),
            Err(Lack::Damaged(scene, reason)) => damaged.push((scene, reason)),
            Err(Lack::Store(error)) => return Err(error),
        }
    }
    let length: usize = rows.iter().map(|row| row.html.0.len()).sum();
    let fitting = (rows.len() * BUDGET / length.max(1)).max(1);
    let kept = evenly(rows.len(), fitting);
    let rows: Vec<&Row> = kept.iter().map(|&k| &rows[k]).collect();
    let noise_maps = rows.iter().filter(|row| row.has_map).count();
    Ok(Sheet {
        html: content(&rows, survey.done.len(), noise_maps),
        shown: rows.len(),
        noise_maps,
        damaged,
    })
}

fn content(rows: &[&Row], done: usize, noise_maps: usize) -> Markup {
    if rows.is_empty() {
        return html! { p.dim { "The run has no tuple yet." } };
    }
    html! {
        p {
            (rows.len()) " of " (done) " tuples, at even distances in the manifest. Linear light, sRGB-coded and clipped \
            at white for the screen, at most " (THUMBNAIL_PX) " px a side; JPEG of quality " (QUALITY)
            " where it takes less than 1/" (MUCH_SMALLER) " of the bytes of a PNG. "
            b { "I" } " is the camera's image; " b { "T" } " is the scene behind the glass, bent but not weakened by it; "
            b { (PAPER_SYMBOLS[Layer::GlassReflection]) } " is the scene reflected by both faces of the glass, through \
            the lens; " b { "R" } " is the reflected scene without glass and lens. The error below a layer is its stated \
            RMS error over film and colours, in linear radiance."
        }
        @if noise_maps > 0 {
            p {
                "A " b { "noise map" } " shows the change of the means of each 2 \u{d7} 2 px at the last doubling of \
                their samples (RMS over pixels and colours), scaled so that the map's RMS is the layer's stated error."
            }
            div.scale { (scale()) }
        }
        @for row in rows { (row.html) }
    }
}

fn row(line: &SceneLine, store: &Store, has_map: bool, encoder: &SrgbEncoder) -> Result<Row, Lack> {
    let damaged = |reason: String| Lack::Damaged(line.id.clone(), reason);
    let get = |file: &str| -> Result<Vec<u8>, Lack> {
        let bytes = store.get(&keys::tuple(&line.id, file)).map_err(Lack::Store)?;
        let bytes = bytes.ok_or_else(|| damaged(format!("{file} is missing")))?;
        Ok(bytes.to_vec())
    };
    let record = parse(line, &get("tuple.json")?).map_err(damaged)?;
    let id = line.id.as_str();
    let mut figures = Vec::new();
    for (name, symbol) in Layer::NAMES.iter().zip(PAPER_SYMBOLS.0) {
        let Some(layer) = record.layers.get(*name) else {
            continue;
        };
        let file = format!("{name}.png");
        let wrong = |reason: String| damaged(format!("{file} cannot be read: {reason}"));
        let size = [line.film.width, line.film.height];
        let bytes = get(&file)?;
        let picture = decode_png(&bytes, size).map_err(wrong)?;
        record.check_file(&file, &bytes).map_err(wrong)?;
        let picture = shrunk(picture, THUMBNAIL_PX);
        let tag = img(&picture, &format!("{name} of {id}")).map_err(wrong)?;
        figures.push(figure(&tag, symbol, name, Some(&numbers(layer))));
        if *name == "glass_reflection" {
            let alt = format!("{name} of {id}, {GAIN} times as bright");
            let tag = img(&brightened(picture, encoder), &alt).map_err(wrong)?;
            let symbol = format!("{symbol} \u{d7} {GAIN}");
            figures.push(figure(&tag, &symbol, "brightened", None));
        }
    }
    for name in photographs(line).into_iter().filter(|name| *name != RAW) {
        let wrong = |reason: String| damaged(format!("{name} cannot be read: {reason}"));
        let bytes = get(name)?;
        record.check_file(name, &bytes).map_err(wrong)?;
        let picture = compose::decode_picture(Path::new(name), bytes);
        let picture = shrunk(picture.map_err(|e| wrong(e.to_string()))?, THUMBNAIL_PX);
        let tag = img(&picture, &format!("{name} of {id}")).map_err(wrong)?;
        if let Some(layer) = photographed_layer(name) {
            let symbol = format!("{} photographed", PAPER_SYMBOLS[layer]);
            figures.push(figure(&tag, &symbol, layer.name(), None));
        }
    }
    if line.film.layers.labels() != LabelSet::default() {
        let wrong = |reason: String| damaged(format!("tuple.exr cannot be read: {reason}"));
        let labels = decode_tuple_labels(&get("tuple.exr")?, &record).map_err(wrong)?;
        figures.extend(label_picture::figures(&labels, line, encoder).map_err(wrong)?);
    }
    let noise = if has_map { noise(line, store)? } else { None };
    if let Some(Ok((tag, symbols))) = &noise {
        figures.push(figure(tag, "noise map", symbols, None));
    }
    let html = html! {
        section.tuple id={ "tuple-" (id) } {
            h3 { (id) " " small { (parameters(&record)) } }
            div.strip style={ "--n:" (figures.len()) } { @for figure in &figures { (figure) } }
            @match &noise {
                Some(Ok(_)) => {}
                Some(Err(reason)) => {
                    p.dim { "Its noise map cannot be read (" (reason) "); nothing else depends on the map." }
                }
                None => { p.dim { "It has no noise map." } }
            }
        }
    };
    Ok(Row { html, has_map: matches!(noise, Some(Ok(_))) })
}

/// Formats the stated error of a layer, and its shares of missed paths and clipped values.
fn numbers(layer: &LayerRecord) -> Markup {
    let shares = [("missed", layer.miss_share), ("clipped", layer.clipped_share)];
    let bounds = [("misplaced", layer.dropped), ("lost", layer.shadowed)]
        .map(|(what, bound)| (what, bound.unwrap_or(0.0)));
    html! {
        "error " @match layer.error_rms {
            Some(rms) => { (error(rms)) }
            None => { "unknown" }
        }
        @for (what, share) in shares.into_iter().filter(|(_, share)| *share > 0.0) {
            " \u{b7} " (what) " " (format_args!("{:.2} %", share * 100.0))
        }
        @for (what, bound) in bounds.into_iter().filter(|(_, bound)| *bound > 0.0) {
            " \u{b7} " (what) " at most " (format_args!("{bound:.1e}"))
        }
    }
}

/// A noise map as `<img>` and the order of its parts, or the error of reading the map.
type Map = Result<(Markup, String), String>;

/// Draws the scene's noise map, if it exists.
fn noise(line: &SceneLine, store: &Store) -> Result<Option<Map>, Lack> {
    let bytes = store.get(&keys::noise(&line.id)).map_err(Lack::Store)?;
    let draw = |bytes: &[u8]| {
        let map = NoiseMap::decode(bytes, &line.film)?;
        let (picture, symbols) = noise_picture(&map);
        let rows: Vec<String> = symbols.chunks(2).map(|row| row.join(" ")).collect();
        let tag = exact_img(&picture, &format!("Noise map of {}", line.id))?;
        Ok((tag, rows.join(" / ")))
    };
    Ok(bytes.map(|bytes| draw(&bytes)))
}

/// Formats the scene's split, samples, focus distance, glass and orders.
fn parameters(record: &TupleRecord) -> String {
    let glass = &record.scene.glass;
    let focus =
        record.facts.focus_distance_m.map_or("infinity".to_owned(), |z| format!("{z:.2} m"));
    let tilt = match glass.tilt_deg {
        [0.0, 0.0] => "no tilt".to_owned(),
        [pitch, yaw] => format!("tilt {}\u{b0}, {}\u{b0}", number(pitch), number(yaw)),
    };
    let orders: Vec<&str> = record.facts.orders.iter().map(|o| o.order.as_str()).collect();
    format!(
        "{} \u{b7} {} spp \u{b7} focus {focus} \u{b7} glass {}, ior {}, at {} m, {tilt}{} \u{b7} orders {}{}",
        record.scene.split,
        record.scene.film.spp,
        layers(glass),
        number(glass.first_glass().0),
        number(glass.distance_m),
        cards(&record.scene) + &shapes(&record.scene),
        orders.join(" "),
        sensor(record),
    )
}

/// Formats the assumed shapes of sides without depth; empty for others.
fn shapes(line: &SceneLine) -> String {
    let of = |(name, side): (&str, &Side)| {
        let shape = match side.photograph()?.sketch? {
            Sketch::Plane { plane_m } => format!("plane at {} m", number(rounded(plane_m))),
            Sketch::Ground { wall_m, camera_height_m, .. } => format!(
                "ground {} m below, wall at {} m",
                number(rounded(camera_height_m)),
                number(rounded(wall_m))
            ),
        };
        Some(format!(" \u{b7} {name} assumed: {shape}"))
    };
    [("front", &line.front), ("back", &line.back)].into_iter().filter_map(of).collect()
}

/// Formats the camera of the photographs; empty without one.
fn sensor(record: &TupleRecord) -> String {
    let (Some(sensor), Some(photographs)) = (&record.scene.sensor, &record.photographs) else {
        return String::new();
    };
    format!(
        " \u{b7} photographed by {}, {} DN per electron, exposure {}, JPEG {} {}",
        sensor.name.as_deref().unwrap_or("a sensor"),
        number(rounded(sensor.gain_dn_per_e)),
        number(rounded(photographs.exposure_factor)),
        sensor.jpeg_quality,
        sensor.jpeg_subsampling,
    )
}

/// Rounds a number to three digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// Formats the pictures that cover a part of the scene, by the names of their files; empty without cards.
fn cards(line: &SceneLine) -> String {
    let of = |(side, of): (&str, &Side)| {
        let cards = of.cards().iter().map(|card| Path::new(&card.color).file_stem());
        let names: Vec<_> =
            cards.flatten().map(|name| name.to_string_lossy().into_owned()).collect();
        (!names.is_empty()).then(|| format!(" \u{b7} {side} {}", names.join(", ")))
    };
    [("before the front:", &line.front), ("before the back:", &line.back)]
        .into_iter()
        .filter_map(of)
        .collect()
}

/// Formats the thickness of a pane, or of each layer from the camera outwards, and the coated faces.
fn layers(glass: &Glass) -> String {
    let mm = |thickness_m: f64| number(thickness_m * 1e3);
    let mut text = if glass.layers.is_empty() {
        format!("{} mm thick", mm(glass.total_thickness_m()))
    } else {
        let layers: Vec<String> =
            glass.layers.iter().map(|layer| mm(layer.thickness_m())).collect();
        format!("of layers of {} mm", layers.join("-"))
    };
    if let Some(GlazingName(name)) = &glass.glazing {
        text = format!("{name}, {text}");
    }
    for coating in &glass.coatings {
        let _ = write!(text, ", face {} coated", coating.face);
    }
    match &glass.roughness {
        Some(Roughness::All(alpha)) => {
            let _ = write!(text, ", rough {}", number(*alpha));
        }
        Some(Roughness::Faces(_)) => text.push_str(", rough"),
        None => {}
    }
    if let Some(radius_m) = glass.bow_radius_m {
        let _ = write!(text, ", bent to {} m", number(radius_m));
    }
    let is_wedged = glass.layers.iter().any(|layer| layer.wedge_deg() != [0.0; 2]);
    for (is_given, word) in [
        (glass.wave.is_some(), "waved"),
        (is_wedged, "wedged"),
        (glass.smudges.is_some(), "smudged"),
        (glass.outline.is_some(), "framed"),
    ] {
        if is_given {
            let _ = write!(text, ", {word}");
        }
    }
    text
}

pub(super) fn figure(tag: &Markup, symbol: &str, name: &str, numbers: Option<&Markup>) -> Markup {
    html! {
        figure {
            (tag)
            figcaption {
                b { (symbol) } " " (name)
                @if let Some(numbers) = numbers { br; (numbers) }
            }
        }
    }
}

/// Multiplies the radiance of an 8-bit picture by [`GAIN`], as if the back scene were brighter.
fn brightened(mut picture: RgbImage, encoder: &SrgbEncoder) -> RgbImage {
    let codes: Vec<u8> =
        (0..=255u8).map(|code| encoder.encode(srgb_to_linear(code) * GAIN)).collect();
    for value in picture.iter_mut() {
        *value = codes[usize::from(*value)];
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pane_is_described_by_all_that_it_has() {
        let of = |glass: &str| layers(&serde_json::from_str(glass).unwrap());
        assert_eq!(of(r#"{"distance_m":1,"thickness_m":0.004,"ior":1.5}"#), "4 mm thick");
        let rough = r#"{"distance_m":1,"thickness_m":0.004,"ior":1.5,"roughness":0.02,"bow_radius_m":-5,
            "outline":{"x_m":[0,1],"y_m":[0,1]}}"#;
        assert_eq!(of(rough), "4 mm thick, rough 0.02, bent to -5 m, framed");
        let unit = r#"{"distance_m":1,"glazing":"double","layers":[{"glass_m":0.004,"ior":1.5},
            {"gap_m":0.016,"wedge_deg":[0,0.1]},{"glass_m":0.006,"ior":1.5}],
            "coatings":[{"face":1,"reflectance":[0,0,0],"transmittance":[1,1,1]}],
            "wave":{"amplitude_m":0.0001,"length_m":0.3},
            "smudges":{"seed":1,"coverage":0.2,"mark_m":0.05}}"#;
        let expected = "double, of layers of 4-16-6 mm, face 1 coated, waved, wedged, smudged";
        assert_eq!(of(unit), expected);
    }
}
