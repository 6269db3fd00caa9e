//! Formats `croissant.json`, the export's description in MLCommons' Croissant 1.0.
//!
//! Each layer of PNGs has its own record set, linked by `id`, because mlcroissant joins at most two sources.

use super::digest::FileRecord;
use super::finish::Summary;
use super::plan::ExportPlan;
use super::request::{ExportFormat, PixelEncoding};
use serde_json::{Value, json};

const CITATION: &str = "S. Kim, Y. Huo, S.-E. Yoon. Single Image Reflection Removal with Physically-Based Training Images. \
                        CVPR 2020.";

pub(super) fn croissant(plan: &ExportPlan, summary: &Summary) -> String {
    let mut distribution = if has_tars(plan) { shards(summary) } else { Vec::new() };
    let [files, records] = tuples(plan, summary);
    distribution.push(files);
    let mut record_sets = vec![records];
    for (_, layer) in plan.layers() {
        let (files, records) = pictures(plan, summary, layer);
        distribution.push(files);
        record_sets.extend(records);
    }
    for label in plan.labels.iter() {
        let format = "application/octet-stream";
        let includes =
            if has_tars(plan) { format!("*.{label}.npy") } else { format!("*/{label}/*.npy") };
        let files = format!("{label}-files");
        distribution.push(file_set(plan, summary, &files, format, &includes));
    }
    let description = format!(
        "{} tuples of pictures behind glass and their exact layers, for single-image reflection removal. README.md describes \
         how they were made, and the terms that apply.",
        summary.numbers.tuples
    );
    let json = json!({
        "@context": context(),
        "@type": "sc:Dataset",
        "name": plan.request.name,
        "description": description,
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "license": "other: the sources' own terms, see README.md",
        "citeAs": CITATION,
        "version": "1.0.0",
        "distribution": distribution,
        "recordSet": record_sets,
    });
    let mut text = serde_json::to_string_pretty(&json).expect("strings are JSON");
    text.push('\n');
    text
}

fn shards(summary: &Summary) -> Vec<Value> {
    let shard = |shard: &FileRecord| {
        json!({
            "@type": "cr:FileObject", "@id": shard.path, "name": shard.path, "contentUrl": shard.path,
            "contentSize": format!("{} B", shard.bytes), "encodingFormat": "application/x-tar",
            "sha256": shard.sha256,
        })
    };
    summary.shards.iter().map(shard).collect()
}

/// Describes files in the tars, or in folders if the export has no tars.
fn file_set(
    plan: &ExportPlan,
    summary: &Summary,
    name: &str,
    format: &str,
    includes: &str,
) -> Value {
    let mut set = json!({ "@type": "cr:FileSet", "@id": name, "name": name });
    if has_tars(plan) {
        let tars: Vec<Value> = summary.shards.iter().map(|s| json!({ "@id": s.path })).collect();
        set["containedIn"] = json!(tars);
    }
    set["encodingFormat"] = json!(format);
    set["includes"] = json!(includes);
    set
}

fn has_tars(plan: &ExportPlan) -> bool {
    plan.request.format == ExportFormat::Webdataset
}

/// Describes the file set and the record set of the tuples' records.
fn tuples(plan: &ExportPlan, summary: &Summary) -> [Value; 2] {
    if has_tars(plan) {
        let id = id_field("tuples", "tuple-files", r"^(?:.*/)?([^/.]+)\.json$");
        let content = json!({ "fileProperty": "content" });
        let text = field("tuples", "json", "sc:Text", "tuple-files", &content);
        let about = "Each tuple's record, tuple.json, as text.";
        let files = file_set(plan, summary, "tuple-files", "application/json", "*.json");
        return [files, record_set("tuples", about, &[id, text])];
    }
    let format = "application/jsonlines";
    let files = file_set(plan, summary, "metadata-files", format, "*/metadata.jsonl");
    let about = "Each tuple's parameters, a line of metadata.jsonl.";
    [files, record_set("tuples", about, &columns())]
}

/// Describes the file set of a layer's pictures, and their record set if they are PNGs: Croissant cannot read OpenEXR.
fn pictures(plan: &ExportPlan, summary: &Summary, layer: &str) -> (Value, Option<Value>) {
    let is_png = plan.request.encoding != PixelEncoding::Linear;
    let (format, ending) = if is_png { ("image/png", "png") } else { ("image/x-exr", "exr") };
    let includes =
        if has_tars(plan) { format!("*.{layer}.{ending}") } else { format!("*/{layer}/*.png") };
    let files = format!("{layer}-files");
    let set = file_set(plan, summary, &files, format, &includes);
    let records = is_png.then(|| {
        let id = id_field(layer, &files, r"^(?:.*/)?([^/.]+)\.[^/]*$");
        let content = json!({ "fileProperty": "content" });
        let image = field(layer, "image", "sc:ImageObject", &files, &content);
        record_set(layer, "Pictures of the layer; id is the tuple's id.", &[id, image])
    });
    (set, records)
}

fn record_set(name: &str, description: &str, fields: &[Value]) -> Value {
    json!({
        "@type": "cr:RecordSet", "@id": name, "name": name, "description": description,
        "key": { "@id": format!("{name}/id") }, "field": fields,
    })
}

fn field(set: &str, name: &str, data_type: &str, files: &str, extract: &Value) -> Value {
    let id = format!("{set}/{name}");
    json!({
        "@type": "cr:Field", "@id": id, "name": name, "dataType": data_type,
        "source": { "fileSet": { "@id": files }, "extract": extract },
    })
}

/// Describes the scene's id, which Croissant extracts from the file name.
fn id_field(set: &str, files: &str, regex: &str) -> Value {
    let mut id = field(set, "id", "sc:Text", files, &json!({ "fileProperty": "filename" }));
    id["source"]["transform"] = json!({ "regex": regex });
    id
}

/// Describes the scalar columns of `metadata.jsonl` that every export has.
fn columns() -> Vec<Value> {
    let columns = [
        ("id", "sc:Text"),
        ("width_px", "sc:Integer"),
        ("height_px", "sc:Integer"),
        ("samples_per_pixel", "sc:Integer"),
        ("focal_length_mm", "sc:Float"),
        ("aperture_radius_m", "sc:Float"),
        ("inverse_focus_distance_per_m", "sc:Float"),
        ("glass_distance_m", "sc:Float"),
        ("glass_thickness_m", "sc:Float"),
        ("glass_ior", "sc:Float"),
        ("glass_pitch_deg", "sc:Float"),
        ("glass_yaw_deg", "sc:Float"),
        ("front", "sc:Text"),
        ("back", "sc:Text"),
    ];
    let field = |(name, data_type)| {
        field("tuples", name, data_type, "metadata-files", &json!({ "column": name }))
    };
    columns.into_iter().map(field).collect()
}

/// Returns Croissant's own context, word for word and in the same order; mlcroissant warns of any other context.
fn context() -> Value {
    const KEYS: &str = "@language @vocab citeAs column conformsTo cr rai data dataType equivalentProperty \
        dct examples extract field fileProperty fileObject fileSet format includes \
        isLiveDataset jsonPath key md5 parentField path recordSet references regex \
        repeated replace samplingRate sc separator source subField transform";
    let value = |key: &str| match key {
        "@language" => json!("en"),
        "@vocab" | "sc" => json!("https://schema.org/"),
        "cr" => json!("http://mlcommons.org/croissant/"),
        "rai" => json!("http://mlcommons.org/croissant/RAI/"),
        "dct" => json!("http://purl.org/dc/terms/"),
        "conformsTo" => json!("dct:conformsTo"),
        "data" | "examples" => json!({ "@id": format!("cr:{key}"), "@type": "@json" }),
        "dataType" => json!({ "@id": "cr:dataType", "@type": "@vocab" }),
        _ => json!(format!("cr:{key}")),
    };
    KEYS.split(' ').map(|key| (key.to_owned(), value(key))).collect()
}
