//! Formats the lines that list the tuples of a split: of imagefolder's `metadata.jsonl` file names, parameters and stated
//! errors as columns, and of `SPLIT.jsonl` beside shards of tensors the whole record of each tuple.

use super::plan::ExportPlan;
use super::request::ExportFormat;
use super::sample::{label_file, layer_file};
use glasshouse_line::Split;
use render::merge::TupleRecord;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Ending of the names of the files of records, which begin with the split.
pub(super) const LINES_ENDING: &str = ".jsonl";

/// Returns the path of the file that lists a split's tuples, if the format has one.
pub(super) fn listing_file(format: ExportFormat, split: Split) -> Option<String> {
    match format {
        ExportFormat::Imagefolder => Some(format!("{split}/metadata.jsonl")),
        ExportFormat::Safetensors => Some(format!("{split}{LINES_ENDING}")),
        ExportFormat::Webdataset | ExportFormat::Pairs | ExportFormat::Exr => None,
    }
}

/// Formats the line of a tuple in [`listing_file`], if the format has one.
pub(super) fn listing_line(plan: &ExportPlan, record: &TupleRecord) -> Option<String> {
    match plan.request.format {
        ExportFormat::Imagefolder => Some(metadata_line(plan, record)),
        ExportFormat::Safetensors => {
            let json = serde_json::to_string(record).expect("a record from JSON is JSON");
            Some(json + "\n")
        }
        ExportFormat::Webdataset | ExportFormat::Pairs | ExportFormat::Exr => None,
    }
}

/// Returns the path of a scene line without folders of a machine. Only plans of older versions have absolute paths.
fn portable(path: &str) -> &str {
    let is_absolute = Path::new(path).is_absolute();
    let file = Path::new(path).file_name().filter(|_| is_absolute);
    file.and_then(|file| file.to_str()).unwrap_or(path)
}

/// Formats the line of a tuple. Arrow requires the same keys and types in every line.
fn metadata_line(plan: &ExportPlan, record: &TupleRecord) -> String {
    let (scene, request) = (&record.scene, &plan.request);
    let mut row = Map::new();
    let mut put = |key: String, value: Value| row.insert(key, value);
    put("id".to_owned(), json!(scene.id));
    let asked = scene.film.layers.asked().0;
    for (layer, name) in plan.layers() {
        let file = layer_file(request.format, request.encoding, scene, layer);
        // Paths are relative to the metadata file.
        let file = file.split_once('/').map(|(_, rest)| rest.to_owned());
        put(format!("{name}_file_name"), json!(file.filter(|_| asked[layer])));
    }
    for label in plan.labels.iter() {
        let file = label_file(request.format, scene, label);
        let file = file.split_once('/').map(|(_, rest)| rest.to_owned());
        let has = scene.film.layers.labels().contains(label);
        // `datasets` opens the files of columns that end in `_file_name`, as pictures.
        put(format!("{label}_npy"), json!(file.filter(|_| has)));
    }
    let glass = &scene.glass;
    let focus = record.facts.focus_distance_m;
    for (key, value) in [
        ("width_px", json!(scene.film.width)),
        ("height_px", json!(scene.film.height)),
        ("samples_per_pixel", json!(scene.film.spp)),
        ("focal_length_mm", json!(scene.camera.focal_length_mm)),
        ("aperture_radius_m", json!(scene.camera.aperture_radius_m)),
        // 0 means infinity, so that the column has numbers without gaps.
        ("inverse_focus_distance_per_m", json!(focus.map_or(0.0, |z| 1.0 / z))),
        ("glass_distance_m", json!(glass.distance_m)),
        ("glass_thickness_m", json!(glass.total_thickness_m())),
        ("glass_ior", json!(glass.first_glass().0)),
        ("glass_absorption_per_m", json!(glass.absorption_per_m)),
        ("glass_pitch_deg", json!(glass.tilt_deg[0])),
        ("glass_yaw_deg", json!(glass.tilt_deg[1])),
        ("front", json!(portable(scene.front.name()))),
        ("back", json!(portable(scene.back.name()))),
    ] {
        put(key.to_owned(), value);
    }
    for (_, name) in plan.layers() {
        let error = record.layers.get(name).and_then(|layer| layer.error_rms);
        put(format!("{name}_error_rms"), json!(error));
    }
    let mut line = Value::Object(row).to_string();
    line.push('\n');
    line
}
