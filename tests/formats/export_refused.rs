//! Tests refused exports, and messages about scenes that are left out.

use crate::export::{RECIPE, arguments, content, finished, ids};
use crate::support::outputs::files;
use crate::support::program::{run, text};
use serde_json::json;
use std::path::{Path, PathBuf};

#[test]
fn changed_and_foreign_folders_are_refused() {
    let (folder, made) = finished(RECIPE);
    let out = folder.path().join("out");
    let pairs = ["--format", "pairs"];
    run(&arguments(&made, &out, &pairs)).expect(0);
    for (more, words) in [
        (&["--format", "webdataset"][..], "--format pairs there and webdataset here"),
        (&["--format", "pairs", "--split", "test"], "--split train and test there and test here"),
        (&["--format", "pairs", "--encoding", "srgb16"], "--encoding srgb8 there"),
    ] {
        run(&arguments(&made, &out, more)).expect(5).says(&[words]);
    }
    let (_other, other) = finished(&RECIPE.replace("seed = 7", "seed = 8"));
    run(&arguments(&other, &out, &pairs)).expect(5).says(&["manifest"]);
    std::fs::write(out.join("export.json"), "{}").unwrap();
    run(&arguments(&made, &out, &pairs)).expect(5).says(&["a damaged export.json"]);

    let foreign = folder.path().join("foreign");
    std::fs::create_dir(&foreign).unwrap();
    run(&arguments(&made, &foreign, &[&pairs[..], &["-n"]].concat())).expect(0);
    std::fs::write(foreign.join("thesis.tex"), "x").unwrap();
    run(&arguments(&made, &foreign, &pairs)).expect(5).says(&["it holds thesis.tex"]);
    run(&arguments(&made, &foreign.join("thesis.tex"), &pairs)).expect(5).says(&["is a file"]);
    assert_eq!(files(&foreign), [PathBuf::from("thesis.tex")]);
}

#[test]
fn an_incomplete_export_is_checked() {
    let (folder, made) = finished(RECIPE);
    let out = folder.path().join("out");
    let shards = ["--format", "webdataset"];
    // The state that a process leaves if it is killed after the first split.
    run(&arguments(&made, &out, &shards)).expect(0);
    let whole = content(&out);
    for name in ["SHA256SUMS", "test-000000.tar", "README.md", "croissant.json"] {
        std::fs::remove_file(out.join(name)).unwrap();
    }
    std::fs::write(out.join(".tmp-abc"), "half").unwrap();
    std::fs::write(out.join("notes.txt"), "mine").unwrap();
    run(&arguments(&made, &out, &shards)).expect(5).says(&["notes.txt"]);
    std::fs::remove_file(out.join("notes.txt")).unwrap();
    // A record that does not fit, and a damaged one, count as none: the command makes the shard again.
    let record = out.join(".export/train-000000.json");
    let tar = out.join("train-000000.tar");
    let bytes = &whole[Path::new("train-000000.tar")];
    std::fs::write(&tar, &bytes[..bytes.len() / 2]).unwrap();
    run(&arguments(&made, &out, &shards)).expect(0).prints(&["train-000000.tar is damaged"]);
    assert!(content(&out) == whole);
    std::fs::remove_file(out.join("SHA256SUMS")).unwrap();
    std::fs::write(&record, "{").unwrap();
    run(&arguments(&made, &out, &shards)).expect(0).prints(&["a readable .export/train"]);
    assert!(content(&out) == whole);
    std::fs::remove_file(out.join("SHA256SUMS")).unwrap();
    std::fs::remove_file(&record).unwrap();
    run(&arguments(&made, &out, &shards)).expect(0);
    assert!(content(&out) == whole);
}

#[test]
fn impossible_exports_are_refused() {
    let (folder, made) = finished(RECIPE);
    let out = folder.path().join("out");
    for (more, code, words) in [
        (&["--format", "exr", "--encoding", "srgb8"][..], 2, "linear light"),
        (&["--format", "imagefolder", "--encoding", "linear"], 2, "reads no OpenEXR"),
        (&["--format", "safetensors", "--encoding", "srgb8"], 2, "safetensors hold linear light"),
        (&["--format", "safetensors", "--encoding", "srgb16"], 2, "leave --encoding out"),
        (&["--format", "safetensors", "--encoding", "photograph"], 2, "linear light"),
        (&["--format", "zip"], 2, "possible values"),
        (&["--format", "pairs", "--shard-mb", "0"], 2, "shard-mb"),
    ] {
        run(&arguments(&made, &out, more)).expect(code).says(&[words]);
    }
    let url = Path::new("s3://bucket/out");
    run(&arguments(&made, url, &["--format", "pairs"])).expect(2).says(&["is a URL"]);
    let nowhere = folder.path().join("nowhere");
    run(&arguments(&nowhere, &out, &["--format", "pairs"])).expect(4);
    assert!(!out.exists());

    // A damaged tuple ends the export.
    let id = &ids(&made, "train")[0];
    let png = made.join(format!("tuples/{id}/input.png"));
    let bytes = std::fs::read(&png).unwrap();
    std::fs::write(&png, &bytes[..bytes.len() - 20]).unwrap();
    run(&arguments(&made, &out, &["--format", "pairs"]))
        .expect(1)
        .says(&[&format!("tuples/{id}/input.png"), "glasshouse retry"]);
    let other = made.join(format!("tuples/{}/tuple.exr", ids(&made, "train")[1]));
    std::fs::copy(other, made.join(format!("tuples/{id}/tuple.exr"))).unwrap();
    run(&arguments(&made, &folder.path().join("exr"), &["--format", "exr"]))
        .expect(1)
        .says(&[&format!("tuples/{id}/tuple.exr"), "digest"]);
    // After a repair, the export resumes.
    std::fs::write(&png, bytes).unwrap();
    run(&arguments(&made, &out, &["--format", "pairs"])).expect(0);
}

#[test]
fn unfinished_runs_need_a_flag() {
    let (folder, made) = finished(RECIPE);
    let id = ids(&made, "train")[1].clone();
    let tuple = made.join("tuples").join(&id);
    let aside = folder.path().join("aside");
    std::fs::rename(&tuple, &aside).unwrap();
    let out = folder.path().join("out");
    let line = arguments(&made, &out, &["--format", "webdataset", "--json"]);
    let refused = run(&line).expect(75).says(&["1 of 7 scenes are not merged yet", "--partial"]);
    assert_eq!(refused.json()["exit"], 75);
    assert!(!out.exists());
    let partial = [&line[..], &["--partial"]].concat();
    let json = run(&partial).expect(3).json();
    assert_eq!([&json["missing"], &json["tuples"]["train"]], [&json!(1), &json!(4)]);
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.contains("not rendered yet when this set was exported: 1."), "{card}");
    // An incomplete export keeps its list of scenes, and a complete export with another list is refused.
    std::fs::rename(&aside, &tuple).unwrap();
    run(&partial).expect(5).says(&["without 1 of the run's scenes"]);
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
    std::fs::write(made.join(format!("quarantine/{id}.json")), record.to_string()).unwrap();
    let out = folder.path().join("out");
    let json =
        run(&arguments(&made, &out, &["--format", "imagefolder", "--json"])).expect(3).json();
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
