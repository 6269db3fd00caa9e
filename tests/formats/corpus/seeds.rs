//! Seeds of the fuzzers: small files, at least one of them valid for each reader.

use super::pictures::{images, png};
use glasshouse::farm::queue::{Message, write_message};
use glasshouse::run::Task;
use glasshouse_line::ids::SceneId;
use glasshouse_line::{SceneLine, Side, parse_scene, to_jsonl};
use image::ExtendedColorType as Png;
use render::formats::{NamedBytes, PhotographFiles};
use render::merge::combine;
use render::partial::{PARTIAL_SCHEMA, Partial, PartialHeader};
use render::scene::{InputDigests, assemble, decode_photograph};
use render::shard::{Golden, SPEC_SCHEMA, ShardLayout, Spec, scene_digest};
use render::trace::{Isa, TRACER_VERSION, trace_tile};
use std::fmt::Write;

/// Name of the reader, name of the file, content.
type Seed = (&'static str, String, Vec<u8>);

const LINE: &str = r#"{"schema":"glasshouse.scene/1","id":"a","split":"test","seed":7,"film":{"width":3,"height":2,"spp":4,"filter":"gaussian","order_tolerance":0.001},"camera":{"focal_length_mm":55.0,"aperture_radius_m":0.009,"focus":{"at":"front_center"}},"glass":{"distance_m":0.3,"thickness_m":0.01,"ior":1.6,"absorption_per_m":[0.1,0,5e-1],"tilt_deg":[1.5,-2]},"front":{"color":"a.png","depth":"NAME:a.npy","mask":"m.npy","transfer":"linear","depth_unit_m":0.001,"depth_kind":"distance","intrinsics":{"fx":9,"fy":9.5,"cx":1.5,"cy":1,"size":[3,2]},"exposure":2,"fill":"far"},"back":{"color":"b.png","depth":"b.npy","intrinsics":{"fx":9,"fy":9,"cx":1.5,"cy":1},"apex":"camera"}}"#;

/// A line with all keys of windows that combine.
const WINDOW: &str = r#"{"schema":"glasshouse.scene/1","id":"w","split":"train","seed":7,"film":{"width":3,"height":2,"spp":4,"layers":["input","glass_reflection","coverage","ghosts"]},"camera":{"focal_length_mm":55,"aperture_radius_m":0.009,"focus":{"at":"infinity"}},"glass":{"distance_m":0.3,"tilt_deg":[0,20],"glazing":"double-low-e","layers":[{"glass_m":0.004,"ior":1.52,"absorption_per_m":[6,2,4]},{"gap_m":0.016,"wedge_deg":[0.1,-0.2]},{"glass_m":0.004,"ior":1.52}],"coatings":[{"face":1,"angles_deg":[0,60,90],"reflectance":[[0.1,0.1,0.1],[0.2,0.2,0.2],[1,1,1]],"reflectance_back":[0.05,0.06,0.07],"transmittance":[[0.8,0.8,0.8],[0.7,0.7,0.7],[0,0,0]]}],"wave":{"amplitude_m":0.0001,"length_m":0.3,"direction_deg":30},"roughness":[0.002,0,0,0.01],"smudges":{"map":"cover:s.png","center_m":[0,0.1],"width_m":0.5,"roughness":0.05,"haze":0.5,"transmittance":0.9},"outline":{"x_m":[-0.1,0.2],"y_m":[-0.3,0.3],"frame_m":0.04,"frame_radiance":[0.2,0.2,0.2]}},"front":{"panorama":"p.exr","cards":[{"color":"cover:train/blind-0001.png","distance_m":0.6,"center_m":[0,-0.1],"width_m":0.4,"exposure":0.5}]},"back":{"color":"b.png","depth":"b.npy","intrinsics":{"fx":9,"fy":9,"cx":1.5,"cy":1},"cards":[{"color":"c.png","distance_m":0.2,"center_m":[0,0.3],"width_m":1}]}}"#;

fn plain_line() -> SceneLine {
    let mut line = parse_scene(LINE).unwrap();
    line.glass.tilt_deg = [0.0; 2];
    if let Side::Photograph(front) = &mut line.front {
        front.depth_unit_m = 1.0;
        front.mask = None;
    }
    line
}

/// Traces and merges a scene of a few pixels; returns its line, its partials and its tuple's record.
fn traced() -> (SceneLine, Vec<Partial>, Vec<u8>) {
    let line = plain_line();
    let named = |bytes: &[u8]| NamedBytes { path: "a".into(), bytes: bytes.to_vec() };
    let files = PhotographFiles {
        color: named(b"P5 3 2 255 abcdef"),
        depth: named(b"P5 3 2 255 \x02\x03\x02\x04\x03\x02"),
        mask: None,
    };
    let sheet = || decode_photograph(line.front.photograph().unwrap(), &files).unwrap();
    let (scene, facts) = assemble(&line, sheet(), sheet()).unwrap();
    let layout = ShardLayout::of(&line, 16);
    let partials: Vec<Partial> = layout
        .shards()
        .map(|shard| {
            let result = trace_tile(&scene, shard.tile, shard.samples.clone(), Isa::Baseline);
            let header = PartialHeader {
                schema: PARTIAL_SCHEMA.to_owned(),
                tracer_version: TRACER_VERSION,
                scene: line.id.clone(),
                line_blake3: scene_digest(&line),
                inputs: InputDigests::default(),
                shard: shard.index,
                film: [line.film.width, line.film.height],
                tile: shard.tile,
                samples: [shard.samples.start, shard.samples.end],
                layer_samples: result.samples,
                sample_sums: result.sample_sums,
                paths: result.paths,
                misses: result.misses,
                facts: facts.clone(),
                blake3: String::new(),
            };
            Partial::new(header, result.pixels, result.labels)
        })
        .collect();
    let tuple = combine(&line, 16, &partials).unwrap();
    let record = serde_json::to_vec_pretty(&tuple.record).unwrap();
    (line, partials, record)
}

/// Lines of a list of photographs: two photographs, a panorama and a mesh.
const LIST: [&str; 4] = [
    r#"{"schema":"glasshouse.photograph/1","place":"indoors","color":"a.png","depth":"a.npy","intrinsics":{"fx":9,"fy":9,"cx":4,"cy":3}}"#,
    r#"{"schema":"glasshouse.photograph/1","place":"indoors","scan":"s","color":"b.png","depth":"b.npy","intrinsics":{"fx":9,"fy":9,"cx":4,"cy":3},"values":{"glass.ior":1.5}}"#,
    r#"{"schema":"glasshouse.photograph/1","place":"outdoor","panorama":"c.hdr","transfer":"linear","yaw_deg":40}"#,
    r#"{"schema":"glasshouse.photograph/1","place":"outdoor","mesh":"d.ply","unit_m":0.5,"exposure":2}"#,
];

const RECIPES: [&str; 3] = [
    r#"schema = "glasshouse.recipe/1"
name = "places"
seed = 2020
[film]
width = 256
height = 256
spp = 256
[camera]
focal_length_mm = 55.0
aperture_radius_m = 0.00893
focus = "front_center"
[glass]
distance_m = 0.30
thickness_m = { choice = [0.010, 0.040] }
ior = 1.6
absorption_per_m = [0, 0, 0]
tilt_deg = [0, { choice = [0, 30] }]
[sources.diode]
layout = "diode"
[sources.sample]
layout = "sample"
count = 16
width = 256
height = 192
[[split]]
name = "train"
pairs = { diode = 6, sample = 2 }
[[split]]
name = "test"
pairs = { sample = 2 }
"#,
    r#"schema = "glasshouse.recipe/1"
name = "small"
seed = 7
[film]
width = 96
height = 64
spp = 256
filter = "gaussian"
[camera]
focal_length_mm = { uniform = [35.0, 85.0] }
aperture_radius_m = { log_uniform = [0.001, 0.01] }
[glass]
thickness_m = { normal = { mean = 0.01, sd = 0.002, min = 0.001, max = 0.02 } }
ior = { choice = [1.5, 1.6] }
[sources.sample]
layout = "sample"
count = 6
[[split]]
name = "train"
pairs = { sample = 3 }
"#,
    r#"schema = "glasshouse.recipe/1"
name = "windows"
[film]
layers = ["input", "transmission", "coverage"]
[glass]
glazing = { choice = ["double-4-16-4", "single-4"], weights = [3, 2] }
roughness = { choice = [0, 0.002], weights = [4, 1] }
smudges = { coverage = { choice = [0, 0.2] } }
[cover]
photographer = 0.3
frame = { share = 0.2, frame_m = 0.05 }
[cover.blind]
share = 0.1
gap_m = { uniform = [0.02, 0.1] }
[sources.sample]
layout = "sample"
count = 6
[[split]]
name = "train"
pairs = { sample = 3 }
"#,
];

/// Returns a quadrilateral and a triangle in each PLY format.
fn meshes() -> Vec<(&'static str, Vec<u8>)> {
    let header = |coding: &str, vertex: &str| {
        format!(
            "ply\nformat {coding} 1.0\ncomment a seed\nelement vertex 5\n{vertex}element face 2\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    };
    let float = "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
                 property uchar blue\n";
    let points =
        [[0.0f32, 0.0, 2.0], [1.0, 0.0, 2.0], [1.0, 1.0, 2.5], [0.0, 1.0, 2.0], [2.0, 1.0, 3.0]];
    let faces = [&[0i32, 1, 2, 3][..], &[1, 4, 2]];
    let mut text = header("ascii", float);
    let (mut little, mut big) = (
        header("binary_little_endian", float).into_bytes(),
        header("binary_big_endian", float).into_bytes(),
    );
    for (k, [x, y, z]) in points.into_iter().enumerate() {
        let grey = 50 * k as u8;
        let _ = writeln!(text, "{x} {y} {z} {grey} 128 255");
        for value in [x, y, z] {
            little.extend(value.to_le_bytes());
            big.extend(value.to_be_bytes());
        }
        little.extend([grey, 128, 255]);
        big.extend([grey, 128, 255]);
    }
    for face in faces {
        let _ = write!(text, "{}", face.len());
        little.push(face.len() as u8);
        big.push(face.len() as u8);
        for corner in face {
            let _ = write!(text, " {corner}");
            little.extend(corner.to_le_bytes());
            big.extend(corner.to_be_bytes());
        }
        text.push('\n');
    }
    vec![("text.ply", text.into_bytes()), ("little.ply", little), ("big.ply", big)]
}

/// Returns seeds of `inspect`: files of an export and of a training run.
fn of_an_export_and_a_training() -> Vec<(&'static str, Vec<u8>)> {
    let mut shard = tar::Builder::new(vec![]);
    let picture = png(&[7; 12], 2, 2, Png::Rgb8);
    for (name, bytes) in [("a.input.png", &picture[..]), ("a.json", b"{\"layers\":{\"input\":{}}}")]
    {
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        header.set_cksum();
        shard.append_data(&mut header, name, bytes).unwrap();
    }
    let tensors = |header: &str| {
        let length = (header.len() as u64).to_le_bytes();
        [&length[..], header.as_bytes(), &[0; 8]].concat()
    };
    let weights = tensors(r#"{"separation.a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}"#);
    let tuples = tensors(
        r#"{"__metadata__":{"schema":"glasshouse.tuples/1","scenes":"[\"a\"]"},"a.input":{"dtype":"F16","shape":[3,1,1],"data_offsets":[0,6]},"a.input.padding":{"dtype":"U8","shape":[2],"data_offsets":[6,8]}}"#,
    );
    vec![
        ("shard.tar", shard.into_inner().unwrap()),
        ("model.safetensors", weights),
        ("tuples.safetensors", tuples),
        ("metrics.csv", b"step,total,wall_s\n1,0.5,0.1\n2,0.25,0.1\n".to_vec()),
    ]
}

/// Returns the seeds of all readers.
pub(crate) fn all() -> Vec<Seed> {
    let mut seeds: Vec<Seed> = vec![];
    for (name, bytes) in images() {
        for reader in ["color", "depth", "mask"] {
            seeds.push((reader, name.clone(), bytes.clone()));
        }
    }
    for (name, bytes) in meshes() {
        seeds.push(("ply", name.to_owned(), bytes));
    }
    for (name, bytes) in of_an_export_and_a_training() {
        seeds.push(("inspect", name.to_owned(), bytes));
    }
    let (line, partials, record) = traced();
    let lines = to_jsonl(&[line.clone(), {
        let mut other = line.clone();
        other.id = SceneId::new("b").unwrap();
        other
    }]);
    seeds.push(("scene_line", "full.json".to_owned(), LINE.as_bytes().to_vec()));
    seeds.push(("scene_line", "window.json".to_owned(), WINDOW.as_bytes().to_vec()));
    let written = to_jsonl(std::slice::from_ref(&line)).trim().as_bytes().to_vec();
    seeds.push(("scene_line", "written.json".to_owned(), written));
    seeds.push(("manifest", "two.jsonl".to_owned(), lines.clone().into_bytes()));
    seeds.push(("manifest", "one.jsonl".to_owned(), format!("\n{LINE}\n\n").into_bytes()));
    for (k, text) in RECIPES.iter().enumerate() {
        seeds.push(("recipe", format!("{k}.toml"), text.as_bytes().to_vec()));
    }
    seeds.push(("list", "four.jsonl".to_owned(), LIST.join("\n").into_bytes()));
    seeds.push(("list", "short.jsonl".to_owned(), LIST[0].as_bytes().to_vec()));
    let partial = render::partial::encode(&partials[0]).unwrap();
    seeds.push(("partial", "pixels.exr".to_owned(), partial));
    seeds.push(("partial", "foreign.exr".to_owned(), images().pop().unwrap().1));
    let spec = Spec {
        schema: SPEC_SCHEMA.to_owned(),
        name: "a".to_owned(),
        scenes: 2,
        manifest_blake3: "00".to_owned(),
        tile_px: 64,
        tracer_version: 1,
        golden: Golden { scene: "builtin/5".to_owned(), blake3: "ff".to_owned() },
        roots: [("data".to_owned(), "data".into())].into(),
        left_out: Vec::new(),
    };
    seeds.push(("spec", "a.json".to_owned(), serde_json::to_vec_pretty(&spec).unwrap()));
    let tiny = serde_json::to_vec(&Spec { tile_px: 0, ..spec }).unwrap();
    seeds.push(("spec", "tile_px_0.json".to_owned(), tiny));
    seeds.push(("spec", "short.json".to_owned(), b"{\"schema\":\"glasshouse.spec/1\"}".to_vec()));
    seeds.push(("tuple", "a.json".to_owned(), record));
    seeds.push(("tuple", "short.json".to_owned(), b"{\"schema\":\"glasshouse.tuple/1\"}".to_vec()));
    seeds.extend(farm());
    seeds
}

/// Returns messages of a queue and small records in a run's store.
fn farm() -> Vec<(&'static str, String, Vec<u8>)> {
    let waiting = Message { task: Task { scene: 7, shards: 16..32 }, hops: 1 };
    let records = [
        (
            "attempt.json",
            r#"{"schema":"glasshouse.attempt/1","scene":"a","shards":[0,4],"n":1,"worker":"w","started_us":0,"host":"h","found":0,"ended":null}"#,
        ),
        (
            "ended.json",
            r#"{"schema":"glasshouse.attempt/1","scene":"a","shards":[0,4],"n":1,"worker":"w","started_us":0,"host":"h","found":2,"ended":{"kind":"crashed","reason":"signal 6","log_tail":"out of memory"}}"#,
        ),
        ("control.json", r#"{"schema":"glasshouse.control/1","state":"paused","reason":"backup"}"#),
        (
            "receipt.json",
            r#"{"schema":"glasshouse.receipt/1","scene":"a","worker":"w","version":"0.1.0","with":["v"]}"#,
        ),
        (
            "quarantine.json",
            r#"{"schema":"glasshouse.quarantine/1","scene":"a","reason":"no depth"}"#,
        ),
    ];
    let message = |run| write_message(run, &waiting);
    let mut seeds = vec![
        ("message", "mine.bin".to_owned(), message(*b"8 bytes!")),
        ("message", "foreign.bin".to_owned(), message([0; 8])),
    ];
    seeds.extend(records.map(|(name, json)| ("record", name.to_owned(), json.as_bytes().to_vec())));
    seeds
}
