//! `croissant.json`: the export as ML Commons' Croissant 1.0 describes data sets.
//!
//! A record set a layer, joined by `id`: mlcroissant joins two sources at most.

use super::finish::Summary;
use super::plan::ExportPlan;
use super::request::{ExportFormat, PixelEncoding};
use render::layer::Layer;
use serde_json::{Value, json};

const CITATION: &str = "S. Kim, Y. Huo, S.-E. Yoon. Single Image Reflection Removal with Physically-Based Training Images. \
                        CVPR 2020.";

pub(super) fn croissant(plan: &ExportPlan, summary: &Summary) -> String {
    let is_tars = plan.request.format == ExportFormat::Webdataset;
    let mut distribution = Vec::new();
    let mut record_sets = Vec::new();
    if is_tars {
        for shard in &summary.shards {
            distribution.push(json!({
                "@type": "cr:FileObject", "@id": shard.path, "name": shard.path, "contentUrl": shard.path,
                "contentSize": format!("{} B", shard.bytes), "encodingFormat": "application/x-tar",
                "sha256": shard.sha256,
            }));
        }
    }
    let tars: Vec<Value> = summary.shards.iter().map(|s| json!({ "@id": s.path })).collect();
    let mut file_set = |name: &str, format: &str, includes: String| {
        let mut set = json!({ "@type": "cr:FileSet", "@id": name, "name": name });
        if is_tars {
            set["containedIn"] = json!(tars);
        }
        set["encodingFormat"] = json!(format);
        set["includes"] = json!(includes);
        distribution.push(set);
    };
    if is_tars {
        file_set("tuple-files", "application/json", "*.json".to_owned());
        record_sets.push(record_set(
            "tuples",
            "Each tuple's record, tuple.json, as text.",
            &[
                id_field("tuples", "tuple-files", r"^(?:.*/)?([^/.]+)\.json$"),
                field(
                    "tuples",
                    "json",
                    "sc:Text",
                    "tuple-files",
                    &json!({ "fileProperty": "content" }),
                ),
            ],
        ));
    } else {
        file_set("metadata-files", "application/jsonlines", "*/metadata.jsonl".to_owned());
        record_sets.push(record_set(
            "tuples",
            "Each tuple's parameters, a line of metadata.jsonl.",
            &columns(),
        ));
    }
    let is_png = plan.request.encoding != PixelEncoding::Linear;
    for (_, layer) in Layer::NAMES.iter().enumerate().filter(|(l, _)| plan.layers[*l]) {
        let files = format!("{layer}-files");
        let (includes, id) = match (is_tars, is_png) {
            (true, true) => (format!("*.{layer}.png"), r"^(?:.*/)?([^/.]+)\.[^/]*$"),
            (true, false) => (format!("*.{layer}.exr"), r"^(?:.*/)?([^/.]+)\.[^/]*$"),
            (false, _) => (format!("*/{layer}/*.png"), r"^(?:.*/)?([^/.]+)\.[^/]*$"),
        };
        file_set(&files, if is_png { "image/png" } else { "image/x-exr" }, includes);
        if is_png {
            let content = json!({ "fileProperty": "content" });
            record_sets.push(record_set(
                layer,
                "The layer's pictures; id is that of tuples.",
                &[
                    id_field(layer, &files, id),
                    field(layer, "image", "sc:ImageObject", &files, &content),
                ],
            ));
        }
    }
    let description = format!(
        "{} tuples of pictures behind glass and their exact parts, for single-image reflection removal. README.md says how they \
         were made and whose terms apply.",
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

/// The scene's id, out of the file's name.
fn id_field(set: &str, files: &str, regex: &str) -> Value {
    let mut id = field(set, "id", "sc:Text", files, &json!({ "fileProperty": "filename" }));
    id["source"]["transform"] = json!({ "regex": regex });
    id
}

/// Columns of `metadata.jsonl` that every tuple has.
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

/// Croissant's own context, word by word: mlcroissant warns of any other.
fn context() -> Value {
    json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "citeAs": "cr:citeAs",
        "column": "cr:column",
        "conformsTo": "dct:conformsTo",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "data": { "@id": "cr:data", "@type": "@json" },
        "dataType": { "@id": "cr:dataType", "@type": "@vocab" },
        "equivalentProperty": "cr:equivalentProperty",
        "dct": "http://purl.org/dc/terms/",
        "examples": { "@id": "cr:examples", "@type": "@json" },
        "extract": "cr:extract",
        "field": "cr:field",
        "fileProperty": "cr:fileProperty",
        "fileObject": "cr:fileObject",
        "fileSet": "cr:fileSet",
        "format": "cr:format",
        "includes": "cr:includes",
        "isLiveDataset": "cr:isLiveDataset",
        "jsonPath": "cr:jsonPath",
        "key": "cr:key",
        "md5": "cr:md5",
        "parentField": "cr:parentField",
        "path": "cr:path",
        "recordSet": "cr:recordSet",
        "references": "cr:references",
        "regex": "cr:regex",
        "repeated": "cr:repeated",
        "replace": "cr:replace",
        "samplingRate": "cr:samplingRate",
        "sc": "https://schema.org/",
        "separator": "cr:separator",
        "source": "cr:source",
        "subField": "cr:subField",
        "transform": "cr:transform",
    })
}
