//! Exported data sets: names, bytes, what is refused, and what a killed export leaves.

use crate::outputs::files;
use crate::program::{Ended, command, run, send, text, wait_until};
use crate::s3_server::{BUCKET, S3Server};
use glasshouse::merge::{TupleRecord, decode_exr_channels, decode_tuple_exr, linear_to_srgb16};
use glasshouse::trace::LAYERS;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// Seven scenes, tiny.
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

/// Scenes of [`RECIPE`].
const SCENES: usize = 7;

/// A finished run `runs/smoke` in a folder of its own.
pub(crate) fn finished(recipe: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("smoke.toml");
    std::fs::write(&path, recipe).unwrap();
    let made = folder.path().join("runs/smoke");
    run(&["run", text(&path), "--out", text(&made), "-q"]).expect(0);
    (folder, made)
}

/// The command line of an export.
fn arguments<'a>(run: &'a Path, out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec!["export", text(run), "--out", text(out)];
    all.extend(more);
    all
}

/// Every file of an export.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let read = |path: PathBuf| {
        let bytes = std::fs::read(folder.join(&path)).unwrap();
        (path, bytes)
    };
    files(folder).into_iter().map(read).collect()
}

#[track_caller]
fn assert_equal(found: &Path, expected: &Path) {
    let (found, expected) = (content(found), content(expected));
    let names = |of: &BTreeMap<PathBuf, Vec<u8>>| of.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found), names(&expected));
    for (path, bytes) in &expected {
        assert!(found[path] == *bytes, "{} differs", path.display());
    }
}

/// The tuples of a run: ids, by split.
fn ids(run: &Path, split: &str) -> Vec<String> {
    let manifest = std::fs::read_to_string(run.join("manifest.jsonl")).unwrap();
    let lines = manifest.lines().map(|l| serde_json::from_str(l).unwrap());
    let of_split = lines.filter(|line: &Value| line["split"] == split);
    let mut ids: Vec<String> = of_split
        .map(|line| line["id"].as_str().unwrap().to_owned())
        .collect();
    ids.sort();
    ids
}

const FORMATS: [(&str, &str); 10] = [
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
];

#[test]
fn equal_runs_make_equal_bytes_and_sums_fit() {
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
        let mut summed: BTreeSet<PathBuf> = sums
            .lines()
            .map(|line| line.split_once("  ").unwrap().1.into())
            .collect();
        assert_eq!(summed.len(), sums.lines().count());
        summed.insert("SHA256SUMS".into());
        assert_eq!(there, summed);
        let checked = Command::new("sha256sum")
            .args(["-c", "--strict", "--quiet", "SHA256SUMS"])
            .current_dir(&outs[0])
            .output()
            .unwrap();
        assert!(checked.status.success(), "{checked:?}");
        // Nothing tells where or when it was made.
        for (path, bytes) in content(&outs[0]) {
            let place = text(folder.path()).as_bytes();
            let told = bytes.windows(place.len()).any(|part| part == place);
            assert!(
                !told,
                "{} names {}",
                path.display(),
                folder.path().display()
            );
        }
    }
}

#[test]
fn names_are_as_promised_and_pngs_are_copies() {
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
                let pictures = LAYERS.map(|layer| format!("{id}.{layer}.png"));
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
        let rows: Vec<Value> = metadata
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        let found: Vec<&str> = rows.iter().map(|row| row["id"].as_str().unwrap()).collect();
        assert_eq!(found, ids(&made, split));
        for row in &rows {
            for layer in LAYERS {
                let file = row[format!("{layer}_file_name")].as_str().unwrap();
                let bytes = std::fs::read(out.join(split).join(file)).unwrap();
                assert!(bytes == png(row["id"].as_str().unwrap(), layer));
            }
            let record = made.join("tuples").join(row["id"].as_str().unwrap());
            let record: Value =
                serde_json::from_slice(&std::fs::read(record.join("tuple.json")).unwrap()).unwrap();
            assert_eq!(
                row["glass_thickness_m"],
                record["scene"]["glass"]["thickness_m"]
            );
            assert_eq!(
                row["glass_yaw_deg"],
                record["scene"]["glass"]["tilt_deg"][1]
            );
            assert_eq!(
                row["input_error_rms"],
                record["layers"]["input"]["error_rms"]
            );
        }
    }
    let croissant = std::fs::read(out.join("croissant.json")).unwrap();
    let croissant: Value = serde_json::from_slice(&croissant).unwrap();
    assert_eq!(
        croissant["conformsTo"],
        "http://mlcommons.org/croissant/1.0"
    );

    let out = folder.path().join("p");
    run(&arguments(
        &made,
        &out,
        &["--format", "pairs", "--split", "test"],
    ))
    .expect(0);
    let folders = [
        "blended",
        "transmission_layer",
        "reflection_layer",
        "clean_reflection_layer",
    ];
    for (folder, layer) in folders.iter().zip(LAYERS) {
        for id in ids(&made, "test") {
            let bytes = std::fs::read(out.join(format!("test/{folder}/{id}.png"))).unwrap();
            assert!(bytes == png(&id, layer));
        }
    }
    assert!(!out.join("train").exists() && !out.join("croissant.json").exists());
}

/// A tuple's layers by the library.
fn layers(run: &Path, id: &str) -> [Vec<[f32; 3]>; 4] {
    let folder = run.join("tuples").join(id);
    let record = std::fs::read(folder.join("tuple.json")).unwrap();
    let record: TupleRecord = serde_json::from_slice(&record).unwrap();
    decode_tuple_exr(&std::fs::read(folder.join("tuple.exr")).unwrap(), &record).unwrap()
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
            let expected: Vec<u16> = input
                .as_flattened()
                .iter()
                .map(|&v| linear_to_srgb16(v))
                .collect();
            assert_eq!(png.as_raw(), &expected);
            let path = linear.join(format!("train/blended/{id}.exr"));
            let channels = decode_exr_channels(&std::fs::read(&path).unwrap()).unwrap();
            for (c, name) in ["R", "G", "B"].iter().enumerate() {
                let (_, values) = channels.list.iter().find(|(n, _)| n == name).unwrap();
                assert!(
                    values.iter().zip(&input).all(|(v, p)| *v == p[c]),
                    "{id} {name}"
                );
            }
            let kinds: BTreeSet<&str> = crate::outputs::exr_channels(&path)
                .values()
                .map(|(kind, _)| *kind)
                .collect();
            assert_eq!(kinds, [exr].into());
        }
    }
}

/// Many tuples, several shards of 1 MB.
fn many() -> (TempDir, PathBuf) {
    let recipe = RECIPE
        .replace("width = 24", "width = 96")
        .replace("height = 16", "height = 64")
        .replace("spp = 16", "spp = 1\nexr = \"float\"")
        .replace("sample = 5", "sample = 60");
    finished(&recipe)
}

#[test]
fn a_killed_export_goes_on_and_ends_with_the_same_bytes() {
    let (folder, made) = many();
    let shards = [
        "--format",
        "webdataset",
        "--encoding",
        "linear",
        "--shard-mb",
        "1",
    ];
    for (name, more, sign) in [
        ("shards", &shards[..], ".export/train-000001.json"),
        ("pairs", &["--format", "pairs"], "train/blended"),
        ("exr", &["--format", "exr"], "train"),
    ] {
        let whole = folder.path().join(format!("{name}-whole"));
        run(&arguments(&made, &whole, more)).expect(0);
        let mut killed = 0;
        for attempt in 0..20 {
            let out = folder.path().join(format!("{name}-{attempt}"));
            let mut line = arguments(&made, &out, more);
            line.extend(["-j", "1"]);
            let mut child = command(&line).spawn().unwrap();
            let is_under_way = wait_until(&mut child, || out.join(sign).exists());
            let _ = child.kill();
            child.wait().unwrap();
            if !is_under_way || out.join("SHA256SUMS").exists() {
                continue;
            }
            killed += 1;
            let first = out.join("train-000000.tar");
            let before = first.metadata().ok().map(|meta| meta.modified().unwrap());
            line.push("--json");
            let json = run(&line).expect(0).json();
            if name == "shards" {
                assert!(json["tuples_resumed"].as_u64().unwrap() > 0, "{json}");
                assert_eq!(before, Some(first.metadata().unwrap().modified().unwrap()));
            }
            assert_equal(&out, &whole);
            break;
        }
        assert!(killed > 0, "{name}: never caught at work");
        // Once more: nothing to do.
        let json = run(&arguments(&made, &whole, &[more, &["--json"]].concat()))
            .expect(0)
            .json();
        assert_eq!(json["already_complete"], true);
    }
}

#[test]
fn a_signal_stops_it_and_it_can_be_gone_on_with() {
    let (folder, made) = many();
    let shards = [
        "--format",
        "webdataset",
        "--encoding",
        "linear",
        "--shard-mb",
        "1",
    ];
    let whole = folder.path().join("whole");
    run(&arguments(&made, &whole, &shards)).expect(0);
    for attempt in 0..20 {
        let out = folder.path().join(format!("out-{attempt}"));
        let mut line = arguments(&made, &out, &shards);
        line.extend(["-j", "1"]);
        let mut child = command(&line).spawn().unwrap();
        if wait_until(&mut child, || {
            out.join(".export/train-000000.json").exists()
        }) {
            send(&child, "TERM");
        }
        let ended: Ended = child.wait_with_output().unwrap().into();
        if ended.code == Some(0) {
            continue;
        }
        ended.expect(143).says(&["the same command goes on"]);
        run(&line).expect(0);
        assert_equal(&out, &whole);
        return;
    }
    panic!("never caught at work");
}

#[test]
fn changed_and_foreign_folders_are_refused() {
    let (folder, made) = finished(RECIPE);
    let out = folder.path().join("out");
    let pairs = ["--format", "pairs"];
    run(&arguments(&made, &out, &pairs)).expect(0);
    for (more, words) in [
        (
            &["--format", "webdataset"][..],
            "--format pairs there and webdataset here",
        ),
        (
            &["--format", "pairs", "--split", "test"],
            "--split train and test there and test here",
        ),
        (
            &["--format", "pairs", "--encoding", "srgb16"],
            "--encoding srgb8 there",
        ),
    ] {
        run(&arguments(&made, &out, more)).expect(5).says(&[words]);
    }
    let (_other, other) = finished(&RECIPE.replace("seed = 7", "seed = 8"));
    run(&arguments(&other, &out, &pairs))
        .expect(5)
        .says(&["manifest"]);
    let lost = out.join(format!("test/blended/{}.png", ids(&made, "test")[0]));
    std::fs::remove_file(&lost).unwrap();
    run(&arguments(&made, &out, &pairs))
        .expect(5)
        .says(&["has lost test/blended/"]);
    std::fs::write(out.join("export.json"), "{}").unwrap();
    run(&arguments(&made, &out, &pairs))
        .expect(5)
        .says(&["export.json that is damaged"]);

    let foreign = folder.path().join("foreign");
    std::fs::create_dir(&foreign).unwrap();
    run(&arguments(&made, &foreign, &[&pairs[..], &["-n"]].concat())).expect(0);
    std::fs::write(foreign.join("thesis.tex"), "x").unwrap();
    run(&arguments(&made, &foreign, &pairs))
        .expect(5)
        .says(&["it holds thesis.tex"]);
    run(&arguments(&made, &foreign.join("thesis.tex"), &pairs))
        .expect(5)
        .says(&["is a file"]);
    assert_eq!(files(&foreign), [PathBuf::from("thesis.tex")]);
}

#[test]
fn an_export_that_was_begun_is_looked_at() {
    let (folder, made) = finished(RECIPE);
    let out = folder.path().join("out");
    let shards = ["--format", "webdataset"];
    // As a process leaves it that is killed after the first split.
    run(&arguments(&made, &out, &shards)).expect(0);
    let whole = content(&out);
    let tar = out.join("train-000000.tar");
    let bytes = &whole[Path::new("train-000000.tar")];
    for name in [
        "SHA256SUMS",
        "test-000000.tar",
        "README.md",
        "croissant.json",
    ] {
        std::fs::remove_file(out.join(name)).unwrap();
    }
    std::fs::write(out.join(".tmp-abc"), "half").unwrap();
    std::fs::write(out.join("notes.txt"), "mine").unwrap();
    run(&arguments(&made, &out, &shards))
        .expect(5)
        .says(&["notes.txt"]);
    std::fs::remove_file(out.join("notes.txt")).unwrap();
    std::fs::create_dir_all(out.join(".export")).unwrap();
    let record = out.join(".export/train-000000.json");
    let sum = String::from_utf8(whole[Path::new("SHA256SUMS")].clone()).unwrap();
    let sum = sum
        .lines()
        .find(|l| l.ends_with("train-000000.tar"))
        .unwrap();
    let numbers = json!({ "tuples": 5, "ranges": [], "layers": {}, "roots": {} });
    let file = json!({ "path": "train-000000.tar", "bytes": bytes.len(), "sha256": sum[..64] });
    let state = json!({ "numbers": numbers, "files": [file], "lines": [] });
    std::fs::write(&record, state.to_string()).unwrap();
    std::fs::write(&tar, &bytes[..bytes.len() / 2]).unwrap();
    run(&arguments(&made, &out, &shards))
        .expect(5)
        .says(&["was changed: train-000000.tar has"]);
    std::fs::write(&record, "{").unwrap();
    run(&arguments(&made, &out, &shards))
        .expect(5)
        .says(&["damaged .export/train-000000.json"]);
    // Without the record the shard is made again.
    std::fs::remove_file(&record).unwrap();
    run(&arguments(&made, &out, &shards)).expect(0);
    assert!(content(&out) == whole);
}

#[test]
fn what_cannot_be_is_refused() {
    let (folder, made) = finished(RECIPE);
    let out = folder.path().join("out");
    for (more, code, words) in [
        (
            &["--format", "exr", "--encoding", "srgb8"][..],
            2,
            "linear light",
        ),
        (
            &["--format", "imagefolder", "--encoding", "linear"],
            2,
            "reads no OpenEXR",
        ),
        (&["--format", "zip"], 2, "possible values"),
        (&["--format", "pairs", "--shard-mb", "0"], 2, "shard-mb"),
    ] {
        run(&arguments(&made, &out, more))
            .expect(code)
            .says(&[words]);
    }
    let url = Path::new("s3://bucket/out");
    run(&arguments(&made, url, &["--format", "pairs"]))
        .expect(2)
        .says(&["is no folder"]);
    let nowhere = folder.path().join("nowhere");
    run(&arguments(&nowhere, &out, &["--format", "pairs"])).expect(4);
    assert!(!out.exists());

    // Damage ends it.
    let id = &ids(&made, "train")[0];
    let png = made.join(format!("tuples/{id}/input.png"));
    let bytes = std::fs::read(&png).unwrap();
    std::fs::write(&png, &bytes[..bytes.len() - 20]).unwrap();
    run(&arguments(&made, &out, &["--format", "pairs"]))
        .expect(1)
        .says(&[&format!("tuples/{id}/input.png"), "glasshouse retry"]);
    let other = made.join(format!("tuples/{}/tuple.exr", ids(&made, "train")[1]));
    std::fs::copy(other, made.join(format!("tuples/{id}/tuple.exr"))).unwrap();
    run(&arguments(
        &made,
        &folder.path().join("exr"),
        &["--format", "exr"],
    ))
    .expect(1)
    .says(&[&format!("tuples/{id}/tuple.exr"), "digest"]);
    // Repaired, it goes on.
    std::fs::write(&png, bytes).unwrap();
    run(&arguments(&made, &out, &["--format", "pairs"])).expect(0);
}

#[test]
fn unfinished_runs_need_a_word() {
    let (folder, made) = finished(RECIPE);
    let id = ids(&made, "train")[1].clone();
    let tuple = made.join("tuples").join(&id);
    let aside = folder.path().join("aside");
    std::fs::rename(&tuple, &aside).unwrap();
    let out = folder.path().join("out");
    let line = arguments(&made, &out, &["--format", "webdataset", "--json"]);
    let refused = run(&line)
        .expect(75)
        .says(&["1 of 7 scenes are not merged yet", "--partial"]);
    assert_eq!(refused.json()["exit"], 75);
    assert!(!out.exists());
    let partial = [&line[..], &["--partial"]].concat();
    let json = run(&partial).expect(3).json();
    assert_eq!(
        [&json["missing"], &json["tuples"]["train"]],
        [&json!(1), &json!(4)]
    );
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    assert!(
        card.contains("1 scenes of the manifest were not rendered yet"),
        "{card}"
    );
    // One that was begun keeps to its scenes; one that is complete is not taken for another.
    std::fs::rename(&aside, &tuple).unwrap();
    run(&partial)
        .expect(5)
        .says(&["without 1 scenes of the run"]);
    let whole = content(&out);
    for name in ["SHA256SUMS", "test-000000.tar"] {
        std::fs::remove_file(out.join(name)).unwrap();
    }
    run(&line).expect(3);
    assert!(content(&out) == whole);
}

#[test]
fn quarantined_scenes_are_named() {
    let (folder, made) = finished(RECIPE);
    let id = &ids(&made, "test")[0];
    std::fs::remove_dir_all(made.join("tuples").join(id)).unwrap();
    let reason = format!("{}/inputs/sample/a.png has no | end", made.display());
    let record = json!({ "schema": "glasshouse.quarantine/1", "scene": id, "reason": reason });
    std::fs::create_dir_all(made.join("quarantine")).unwrap();
    std::fs::write(
        made.join(format!("quarantine/{id}.json")),
        record.to_string(),
    )
    .unwrap();
    let out = folder.path().join("out");
    let json = run(&arguments(
        &made,
        &out,
        &["--format", "imagefolder", "--json"],
    ))
    .expect(3)
    .json();
    assert_eq!(json["quarantined"][0]["scene"], *id);
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    let row = format!("| `{id}` | sample:a.png has no \\| end |");
    assert!(card.contains(&row), "{card}");
    assert!(card.starts_with("---\nlicense: other\n"));
    assert!(
        card.contains("- n<1K\n") && card.contains("glass: thickness, m | 0.01 | 0.04 |"),
        "{card}"
    );
    let export = std::fs::read_to_string(out.join("export.json")).unwrap();
    assert!(!export.contains(text(&made)), "{export}");
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
    let made = run(&arguments(&made, &out, &["--format", "pairs", "--json"]))
        .expect(0)
        .json();
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

    // Another folder; the run is fetched from it.
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
    let mut command = command(&arguments(
        &fetched,
        &out,
        &[&pairs[..], &["--store", &address]].concat(),
    ));
    server.tell(&mut command);
    let ended: Ended = command.output().unwrap().into();
    ended.expect(0);
    assert_equal(&out, &expected);
}
