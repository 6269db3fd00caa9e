//! Tests shards of tensors: their values, order and types, and the lines of records beside them.

use crate::export::{RECIPE, arguments, content, finished, ids};
use crate::support::program::{run, text};
use exr::prelude::f16;
use glasshouse_line::layer::Layer;
use render::formats::{ExrChannels, decode_exr_channels};
use safetensors::{Dtype, SafeTensors};
use serde_json::{Value, json};
use std::path::Path;

const FORMAT: [&str; 2] = ["--format", "safetensors"];

fn export(made: &Path, out: &Path) {
    run(&arguments(made, out, &FORMAT)).expect(0);
}

fn channels(made: &Path, id: &str) -> ExrChannels {
    let path = made.join("tuples").join(id).join("tuple.exr");
    decode_exr_channels(&std::fs::read(path).unwrap()).unwrap()
}

/// Returns the planes of some channels, one after the other.
fn planes(channels: &ExrChannels, names: &[String]) -> Vec<f32> {
    let plane = |name: &String| {
        let (_, values) = channels.list.iter().find(|(n, _)| n == name).unwrap();
        values.clone()
    };
    names.iter().flat_map(plane).collect()
}

fn floats(kind: Dtype, data: &[u8]) -> Vec<f32> {
    match kind {
        Dtype::F16 => {
            data.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect()
        }
        Dtype::F32 => {
            data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
        }
        other => panic!("{other:?}"),
    }
}

/// Asserts that a tensor of a shard has exactly the values of the tuple's channels.
#[track_caller]
fn assert_values(
    read: &SafeTensors,
    exr: &ExrChannels,
    [id, name]: [&str; 2],
    of_channels: &[&str],
    kind: Dtype,
) {
    let tensor = read.tensor(&format!("{id}.{name}")).unwrap();
    let names: Vec<String> = of_channels.iter().map(|c| format!("{name}.{c}")).collect();
    let size = [16, 24];
    let expected = if of_channels.len() == 1 { size.to_vec() } else { vec![3, 16, 24] };
    assert_eq!((tensor.dtype(), tensor.shape()), (kind, &expected[..]), "{name}");
    assert_eq!(floats(kind, tensor.data()), planes(exr, &names), "{name}");
}

#[test]
fn tensors_have_the_values_of_the_exr() {
    for (exr, kind) in [("half", Dtype::F16), ("float", Dtype::F32)] {
        let recipe = RECIPE.replace("spp = 16", &format!("spp = 16\nexr = \"{exr}\""));
        let (folder, made) = finished(&recipe);
        let out = folder.path().join("out");
        export(&made, &out);
        for split in ["train", "test"] {
            let bytes = std::fs::read(out.join(format!("{split}-000000.safetensors"))).unwrap();
            let read = SafeTensors::deserialize(&bytes).unwrap();
            let ids = ids(&made, split);
            for id in &ids {
                let exr = channels(&made, id);
                for layer in Layer::NAMES {
                    assert_values(&read, &exr, [id, layer], &["R", "G", "B"], kind);
                }
            }
            let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
            // The tensors of a tuple follow each other.
            let names = ids.iter().flat_map(|id| Layer::NAMES.map(|layer| format!("{id}.{layer}")));
            assert_eq!(header.offset_keys(), names.collect::<Vec<_>>());
            let metadata = header.metadata().as_ref().unwrap();
            assert_eq!(metadata["schema"], "glasshouse.tuples/1");
            assert_eq!(metadata["scenes"], serde_json::to_string(&ids).unwrap());
            let lines = std::fs::read_to_string(out.join(format!("{split}.jsonl"))).unwrap();
            let lines: Vec<Value> =
                lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
            let record = |id: &String| -> Value {
                let path = made.join("tuples").join(id).join("tuple.json");
                serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
            };
            assert_eq!(lines, ids.iter().map(record).collect::<Vec<_>>());
        }
        let card = std::fs::read_to_string(out.join("README.md")).unwrap();
        assert!(card.contains("tensors of 3 x height x width"), "{card}");
        assert!(!out.join("croissant.json").exists());
    }
}

/// Labels follow the layers; the depth keeps its floats among halves.
#[test]
fn labels_are_tensors() {
    let film = "spp = 16\nlayers = [\"input\", \"glass_reflection\", \"coverage\", \"front_depth\", \"ghosts\"]";
    let pane = "outline = { x_m = [-0.05, 0.02], y_m = [-0.2, 0.2] }\ndistance_m = 0.3";
    let recipe = RECIPE.replace("spp = 16", film).replace("distance_m = 0.3", pane);
    let (folder, made) = finished(&recipe);
    let out = folder.path().join("out");
    export(&made, &out);
    let bytes = std::fs::read(out.join("train-000000.safetensors")).unwrap();
    let read = SafeTensors::deserialize(&bytes).unwrap();
    let id = &ids(&made, "train")[0];
    let exr = channels(&made, id);
    for (name, channels, kind) in [
        ("input", &["R", "G", "B"][..], Dtype::F16),
        ("glass_reflection", &["R", "G", "B"], Dtype::F16),
        ("coverage", &["Y"], Dtype::F16),
        ("front_depth", &["Z"], Dtype::F32),
        ("ghosts", &["R", "G", "B"], Dtype::F16),
    ] {
        assert_values(&read, &exr, [id, name], channels, kind);
    }
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let names = ["input", "glass_reflection", "coverage", "front_depth", "ghosts"];
    assert_eq!(header.offset_keys()[..5], names.map(|name| format!("{id}.{name}")));
}

/// Tensors with an odd number of halves leave the next ones aligned.
#[test]
fn odd_films_have_aligned_tensors() {
    let film = "spp = 16\nlayers = [\"input\", \"coverage\", \"front_depth\"]";
    let recipe = RECIPE
        .replace("width = 24", "width = 25")
        .replace("height = 16", "height = 17")
        .replace("spp = 16", film);
    let (folder, made) = finished(&recipe);
    let out = folder.path().join("out");
    export(&made, &out);
    let bytes = std::fs::read(out.join("train-000000.safetensors")).unwrap();
    let read = SafeTensors::deserialize(&bytes).unwrap();
    for (name, tensor) in read.iter() {
        let place = tensor.data().as_ptr() as usize - bytes.as_ptr() as usize;
        assert!(name.ends_with(".padding") || place.is_multiple_of(8), "{name} {place}");
    }
    let id = &ids(&made, "train")[0];
    assert_eq!(read.tensor(&format!("{id}.input")).unwrap().data().len(), 3 * 25 * 17 * 2);
    assert_eq!(read.tensor(&format!("{id}.input.padding")).unwrap().data(), [0, 0]);
}

#[test]
fn shards_have_at_most_the_requested_size_and_all_tuples() {
    let recipe = RECIPE
        .replace("width = 24", "width = 128")
        .replace("height = 16", "height = 96")
        .replace("spp = 16", "spp = 1")
        .replace("sample = 5", "sample = 9");
    let (folder, made) = finished(&recipe);
    let out = folder.path().join("out");
    let more = [&FORMAT[..], &["--shard-mb", "1", "--json"]].concat();
    let json = run(&arguments(&made, &out, &more)).expect(0).json();
    assert_eq!(json["encoding"], "linear");
    assert_eq!(json["tuples"], json!({ "train": 9, "test": 2 }));
    let mut there = Vec::new();
    let mut shards = 0;
    for (path, bytes) in content(&out) {
        let name = text(&path);
        if !name.starts_with("train-") {
            continue;
        }
        assert!(bytes.len() <= 1_000_000, "{name}");
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let metadata = header.metadata().as_ref().unwrap();
        there.extend(serde_json::from_str::<Vec<String>>(&metadata["scenes"]).unwrap());
        shards += 1;
    }
    // A tuple has 294,912 bytes of tensors.
    assert_eq!((shards, there), (3, ids(&made, "train")));
    // Another size is another export.
    let other = [&FORMAT[..], &["--shard-mb", "2"]].concat();
    run(&arguments(&made, &out, &other)).expect(5).says(&["--shard-mb 1 there and 2 here"]);
}
