//! Tests names, bytes and values of exported data sets, from tuples in any store.

use crate::support::outputs::{exr_channels, files, manifest, read_json, tuple_record};
use crate::support::program::{Ended, command, run, text};
use crate::support::s3_server::{BUCKET, S3Server};
use exr::prelude::{ReadChannels, ReadLayers};
use glasshouse_line::color::linear_to_srgb16;
use glasshouse_line::layer::Layer;
use render::formats::decode_exr_channels;
use render::merge::{TupleRecord, decode_tuple_exr};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// A recipe of seven tiny scenes.
pub(crate) const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "smoke"
seed = 7
[film]
width = 24
height = 16
spp = 16
[glass]
distance_m = 0.3
thickness_m = { choice = [0.010, 0.040] }
ior = { uniform = [1.4, 1.7] }
tilt_deg = [0, { choice = [0, 20] }]
[sources.sample]
layout = "sample"
count = 8
width = 64
height = 48
[[split]]
name = "train"
pairs = { sample = 5 }
[[split]]
name = "test"
pairs = { sample = 2 }
"#;

/// Number of scenes of [`RECIPE`].
const SCENES: usize = 7;

/// Makes a finished run `runs/smoke` in a new folder.
pub(crate) fn finished(recipe: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("smoke.toml");
    std::fs::write(&path, recipe).unwrap();
    let made = folder.path().join("runs/smoke");
    run(&["run", text(&path), "--out", text(&made), "-q"]).expect(0);
    (folder, made)
}

/// Returns the command line of an export.
pub(crate) fn arguments<'a>(run: &'a Path, out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec!["export", text(run), "--out", text(out)];
    all.extend(more);
    all
}

/// Reads every file of an export.
pub(crate) fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let read = |path: PathBuf| {
        let bytes = std::fs::read(folder.join(&path)).unwrap();
        (path, bytes)
    };
    files(folder).into_iter().map(read).collect()
}

#[track_caller]
pub(crate) fn assert_equal(found: &Path, expected: &Path) {
    let (found, expected) = (content(found), content(expected));
    let names = |of: &BTreeMap<PathBuf, Vec<u8>>| of.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found), names(&expected));
    for (path, bytes) in &expected {
        assert!(found[path] == *bytes, "{} differs", path.display());
    }
}

/// Returns the sorted ids of a split.
pub(crate) fn ids(run: &Path, split: &str) -> Vec<String> {
    let lines = manifest(run);
    let of_split = lines.iter().filter(|line| line["split"] == split);
    let mut ids: Vec<String> =
        of_split.map(|line| line["id"].as_str().unwrap().to_owned()).collect();
    ids.sort();
    ids
}

const FORMATS: [(&str, &str); 12] = [
    ("webdataset", "srgb8"),
    ("webdataset", "srgb16"),
    ("webdataset", "linear"),
    ("imagefolder", "srgb8"),
    ("imagefolder", "srgb16"),
    ("pairs", "srgb8"),
    ("pairs", "srgb16"),
    ("pairs", "linear"),
    ("exr", "linear"),
    ("exr", ""),
    ("safetensors", "linear"),
    ("safetensors", ""),
];

#[test]
fn equal_runs_export_equal_bytes_with_correct_sums() {
    let (folder, made) = finished(RECIPE);
    let (_other, elsewhere) = finished(RECIPE);
    for (format, encoding) in FORMATS {
        let outs = ["a", "b"].map(|n| folder.path().join(format!("{format}-{encoding}-{n}")));
        for (out, (run_folder, threads)) in outs.iter().zip([(&made, "1"), (&elsewhere, "3")]) {
            let mut more = vec!["--format", format, "-j", threads];
            if !encoding.is_empty() {
                more.extend(["--encoding", encoding]);
            }
            let ended = run(&arguments(run_folder, out, &more)).expect(0);
            assert!(ended.stdout.contains("exported 7 tuples"), "{ended:?}");
        }
        assert_equal(&outs[1], &outs[0]);
        let there: BTreeSet<PathBuf> = files(&outs[0]).into_iter().collect();
        let sums = std::fs::read_to_string(outs[0].join("SHA256SUMS")).unwrap();
        let mut summed: BTreeSet<PathBuf> =
            sums.lines().map(|line| line.split_once("  ").unwrap().1.into()).collect();
        assert_eq!(summed.len(), sums.lines().count());
        summed.insert("SHA256SUMS".into());
        assert_eq!(there, summed);
        let checked = Command::new("sha256sum")
            .args(["-c", "--strict", "--quiet", "SHA256SUMS"])
            .current_dir(&outs[0])
            .output()
            .unwrap();
        assert!(checked.status.success(), "{checked:?}");
        // No file contains the path of the folder.
        for (path, bytes) in content(&outs[0]) {
            let place = text(folder.path()).as_bytes();
            let told = bytes.windows(place.len()).any(|part| part == place);
            assert!(!told, "{} names {}", path.display(), folder.path().display());
        }
    }
}

#[test]
fn names_are_as_documented_and_pngs_are_copies() {
    let (folder, made) = finished(RECIPE);
    let png = |id: &str, layer: &str| {
        std::fs::read(made.join("tuples").join(id).join(format!("{layer}.png"))).unwrap()
    };
    let out = folder.path().join("w");
    run(&arguments(&made, &out, &["--format", "webdataset"])).expect(0);
    for split in ["train", "test"] {
        let bytes = std::fs::read(out.join(format!("{split}-000000.tar"))).unwrap();
        let mut archive = tar::Archive::new(&bytes[..]);
        let mut members = Vec::new();
        for entry in archive.entries().unwrap() {
            let mut entry = entry.unwrap();
            let name = entry.path().unwrap().to_str().unwrap().to_owned();
            let mut content = Vec::new();
            std::io::Read::read_to_end(&mut entry, &mut content).unwrap();
            assert_eq!(entry.header().mtime().unwrap(), 0);
            let (id, rest) = name.split_once('.').unwrap();
            match rest {
                "json" => {
                    let record = made.join("tuples").join(id).join("tuple.json");
                    assert_eq!(content, std::fs::read(record).unwrap());
                }
                _ => assert!(content == png(id, rest.strip_suffix(".png").unwrap())),
            }
            members.push(name);
        }
        let mut expected: Vec<String> = ids(&made, split)
            .iter()
            .flat_map(|id| {
                let pictures = Layer::NAMES.map(|layer| format!("{id}.{layer}.png"));
                pictures.into_iter().chain([format!("{id}.json")])
            })
            .collect();
        expected.sort();
        assert_eq!(members, expected);
    }

    let out = folder.path().join("i");
    run(&arguments(&made, &out, &["--format", "imagefolder"])).expect(0);
    for split in ["train", "test"] {
        let metadata = std::fs::read_to_string(out.join(split).join("metadata.jsonl")).unwrap();
        let rows: Vec<Value> =
            metadata.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let found: Vec<&str> = rows.iter().map(|row| row["id"].as_str().unwrap()).collect();
        assert_eq!(found, ids(&made, split));
        for row in &rows {
            for layer in Layer::NAMES {
                let file = row[format!("{layer}_file_name")].as_str().unwrap();
                let bytes = std::fs::read(out.join(split).join(file)).unwrap();
                assert!(bytes == png(row["id"].as_str().unwrap(), layer));
            }
            let record = tuple_record(&made, row["id"].as_str().unwrap());
            assert_eq!(row["glass_thickness_m"], record["scene"]["glass"]["thickness_m"]);
            assert_eq!(row["glass_yaw_deg"], record["scene"]["glass"]["tilt_deg"][1]);
            assert_eq!(row["input_error_rms"], record["layers"]["input"]["error_rms"]);
        }
    }
    let croissant = read_json(out.join("croissant.json"));
    assert_eq!(croissant["conformsTo"], "http://mlcommons.org/croissant/1.0");

    let out = folder.path().join("p");
    run(&arguments(&made, &out, &["--format", "pairs", "--split", "test"])).expect(0);
    let folders = ["blended", "transmission_layer", "reflection_layer", "clean_reflection_layer"];
    for (folder, layer) in folders.iter().zip(Layer::NAMES) {
        for id in ids(&made, "test") {
            let bytes = std::fs::read(out.join(format!("test/{folder}/{id}.png"))).unwrap();
            assert!(bytes == png(&id, layer));
        }
    }
    assert!(!out.join("train").exists() && !out.join("croissant.json").exists());
}

/// Decodes a tuple's layers with the library.
fn layers(run: &Path, id: &str) -> [Vec<[f32; 3]>; 4] {
    let folder = run.join("tuples").join(id);
    let record = std::fs::read(folder.join("tuple.json")).unwrap();
    let record: TupleRecord = serde_json::from_slice(&record).unwrap();
    let bytes = std::fs::read(folder.join("tuple.exr")).unwrap();
    decode_tuple_exr(&bytes, &record).unwrap().0
}

#[test]
fn other_encodings_hold_the_values_of_the_exr() {
    for exr in ["half", "float"] {
        let recipe = RECIPE.replace("spp = 16", &format!("spp = 16\nexr = \"{exr}\""));
        let (folder, made) = finished(&recipe);
        let [wide, linear] = ["srgb16", "linear"].map(|encoding| {
            let out = folder.path().join(encoding);
            let more = ["--format", "pairs", "--encoding", encoding];
            run(&arguments(&made, &out, &more)).expect(0);
            out
        });
        for id in ids(&made, "train") {
            let [input, ..] = layers(&made, &id);
            let png = image::open(wide.join(format!("train/blended/{id}.png"))).unwrap();
            let image::DynamicImage::ImageRgb16(png) = png else {
                panic!("not 16 bit: {png:?}");
            };
            let expected: Vec<u16> =
                input.as_flattened().iter().map(|&v| linear_to_srgb16(v)).collect();
            assert_eq!(png.as_raw(), &expected);
            let path = linear.join(format!("train/blended/{id}.exr"));
            let channels = decode_exr_channels(&std::fs::read(&path).unwrap()).unwrap();
            for (c, name) in ["R", "G", "B"].iter().enumerate() {
                let (_, values) = channels.list.iter().find(|(n, _)| n == name).unwrap();
                assert!(values.iter().zip(&input).all(|(v, p)| *v == p[c]), "{id} {name}");
            }
            let kinds: BTreeSet<&str> =
                exr_channels(&path).values().map(|(kind, _)| *kind).collect();
            assert_eq!(kinds, [exr].into());
        }
    }
}

/// Returns a member of a tar.
fn member(tar: &[u8], name: &str) -> Vec<u8> {
    let mut archive = tar::Archive::new(tar);
    let mut entries = archive.entries().unwrap().map(Result::unwrap);
    let mut entry = entries.find(|e| e.path().unwrap().to_str() == Some(name)).unwrap();
    let mut content = Vec::new();
    std::io::Read::read_to_end(&mut entry, &mut content).unwrap();
    content
}

/// Every format has the labels of the tuples, next to layers of any encoding.
#[test]
fn labels_are_exported() {
    let film = "spp = 16\nlayers = [\"input\", \"glass_reflection\", \"coverage\", \"front_depth\", \"ghosts\"]";
    let pane = "outline = { x_m = [-0.05, 0.02], y_m = [-0.2, 0.2] }\ndistance_m = 0.3";
    let recipe = RECIPE.replace("spp = 16", film).replace("distance_m = 0.3", pane);
    let (folder, made) = finished(&recipe);
    let out = |more: &str| {
        let out = folder.path().join(more.replace(' ', ""));
        let more: Vec<&str> = more.split(' ').collect();
        run(&arguments(&made, &out, &more)).expect(0);
        out
    };
    let id = &ids(&made, "train")[0];
    let channels = decode_exr_channels(
        &std::fs::read(made.join("tuples").join(id).join("tuple.exr")).unwrap(),
    )
    .unwrap();
    let values = |name: &str| {
        let (_, values) = channels.list.iter().find(|(n, _)| n == name).unwrap();
        values.clone()
    };
    let coverage = values("coverage.Y");
    assert!(coverage.contains(&0.0) && coverage.contains(&1.0));
    // Headers have 128 bytes; coverage and ghosts are halves, depths are floats.
    let check = |read: &dyn Fn(&str) -> Vec<u8>| {
        let halves = |bytes: &[u8]| -> Vec<f32> {
            let of = |b: &[u8]| exr::prelude::f16::from_le_bytes([b[0], b[1]]).to_f32();
            bytes[128..].chunks(2).map(of).collect()
        };
        assert_eq!(halves(&read("coverage")), coverage);
        let depth = read("front_depth");
        let depth = npyz::NpyFile::new(&depth[..]).unwrap();
        assert_eq!(depth.shape(), [16, 24]);
        assert_eq!(depth.into_vec::<f32>().unwrap(), values("front_depth.Z"));
        let ghosts = read("ghosts");
        assert_eq!(npyz::NpyFile::new(&ghosts[..]).unwrap().shape(), [16, 24, 3]);
        let green: Vec<f32> = halves(&ghosts).into_iter().skip(1).step_by(3).collect();
        assert_eq!(green, values("ghosts.G"));
    };
    for encoding in ["srgb8", "linear"] {
        let tars = out(&format!("--format webdataset --encoding {encoding}"));
        let tar = std::fs::read(tars.join("train-000000.tar")).unwrap();
        check(&|label| member(&tar, &format!("{id}.{label}.npy")));
    }
    for more in ["--format imagefolder", "--format pairs --encoding srgb16"] {
        let root = out(more);
        check(&|label| std::fs::read(root.join(format!("train/{label}/{id}.npy"))).unwrap());
        if let Ok(metadata) = std::fs::read_to_string(root.join("train/metadata.jsonl")) {
            let row: Value = serde_json::from_str(metadata.lines().next().unwrap()).unwrap();
            assert_eq!(row["coverage_npy"], format!("coverage/{id}.npy"));
        }
        let card = std::fs::read_to_string(root.join("README.md")).unwrap();
        assert!(card.contains("| `coverage` | share of the pixel's camera rays that meet glass"));
    }
    let parts = std::fs::read(out("--format exr").join(format!("train/{id}.exr"))).unwrap();
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(std::io::Cursor::new(parts))
        .unwrap();
    let names: Vec<String> = image
        .layer_data
        .iter()
        .map(|part| part.attributes.layer_name.as_ref().unwrap().to_string())
        .collect();
    assert_eq!(names, ["input", "glass_reflection", "coverage", "front_depth", "ghosts"]);
    let depth = &image.layer_data[3].channel_data.list[0];
    assert_eq!(depth.name.to_string(), "Z");
    let depth: Vec<f32> = depth.sample_data.values_as_f32().collect();
    assert_eq!(depth, values("front_depth.Z"));
}

#[test]
fn a_dry_run_writes_nothing() {
    let (folder, made) = finished(RECIPE);
    let out = folder.path().join("out");
    let line = arguments(&made, &out, &["--format", "pairs", "-n", "--json"]);
    let json = run(&line).expect(0).json();
    assert_eq!(json["tuples"], json!({ "train": 5, "test": 2 }));
    let foretold = json["bytes"].as_f64().unwrap();
    assert!(!out.exists());
    let made = run(&arguments(&made, &out, &["--format", "pairs", "--json"])).expect(0).json();
    let bytes = made["bytes"].as_f64().unwrap();
    assert!((foretold / bytes - 1.0).abs() < 0.5, "{foretold} {bytes}");
    assert_eq!(made["files"].as_u64().unwrap() as usize, SCENES * 4 + 2);
}

#[test]
fn tuples_come_from_any_store() {
    let (folder, made) = finished(RECIPE);
    let pairs = ["--format", "webdataset"];
    let expected = folder.path().join("expected");
    run(&arguments(&made, &expected, &pairs)).expect(0);

    // The export fetches the run from another folder.
    let out = folder.path().join("of-folder");
    let fetched = folder.path().join("fetched");
    let store = ["--store", text(&made)];
    run(&arguments(&fetched, &out, &[&pairs[..], &store].concat())).expect(0);
    assert_equal(&out, &expected);

    let server = S3Server::start(5);
    let bucket = server.store("runs/smoke");
    for path in files(&made) {
        let bytes = std::fs::read(made.join(&path)).unwrap();
        if !path.ends_with("work.lock") {
            bucket.create(text(&path), &bytes).unwrap();
        }
    }
    server.faults.set(100);
    let out = folder.path().join("of-bucket");
    let fetched = folder.path().join("fetched-too");
    let address = format!("s3://{BUCKET}/runs/smoke");
    let mut command =
        command(&arguments(&fetched, &out, &[&pairs[..], &["--store", &address]].concat()));
    server.tell(&mut command);
    let ended: Ended = command.output().unwrap().into();
    ended.expect(0);
    assert_equal(&out, &expected);
}
