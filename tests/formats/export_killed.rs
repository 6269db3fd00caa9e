//! Killed and stopped exports resume where they ended.

use crate::export::{RECIPE, arguments, assert_equal, finished};
use crate::support::program::{Ended, command, run, send, wait_until};
use std::path::PathBuf;
use tempfile::TempDir;

/// Options for shards of 1 MB.
const SHARDS: [&str; 6] = ["--format", "webdataset", "--encoding", "linear", "--shard-mb", "1"];

/// Makes a run with tuples for several shards of 1 MB.
fn many() -> (TempDir, PathBuf) {
    let recipe = RECIPE
        .replace("width = 24", "width = 96")
        .replace("height = 16", "height = 64")
        .replace("spp = 16", "spp = 1\nexr = \"float\"")
        .replace("sample = 5", "sample = 60");
    finished(&recipe)
}

#[test]
fn a_killed_export_resumes_and_ends_with_the_same_bytes() {
    let (folder, made) = many();
    for (name, more, sign) in [
        ("shards", &SHARDS[..], ".export/train-000001.json"),
        ("pairs", &["--format", "pairs"], "train/blended"),
        ("exr", &["--format", "exr"], "train"),
        ("tensors", &["--format", "safetensors", "--shard-mb", "1"], ".export/train-000001.json"),
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
            let ending = if name == "shards" { "tar" } else { "safetensors" };
            let first = out.join(format!("train-000000.{ending}"));
            let before = first.metadata().ok().map(|meta| meta.modified().unwrap());
            line.push("--json");
            let json = run(&line).expect(0).json();
            if sign.starts_with(".export/") {
                assert!(json["tuples_resumed"].as_u64().unwrap() > 0, "{json}");
                assert_eq!(before, Some(first.metadata().unwrap().modified().unwrap()));
            }
            assert_equal(&out, &whole);
            break;
        }
        assert!(killed > 0, "{name}: every export ended before the test killed it");
        // A repeated export is already complete.
        let json = run(&arguments(&made, &whole, &[more, &["--json"]].concat())).expect(0).json();
        assert_eq!(json["already_complete"], true);
    }
}

#[test]
fn an_export_stopped_by_a_signal_can_be_resumed() {
    let (folder, made) = many();
    let whole = folder.path().join("whole");
    run(&arguments(&made, &whole, &SHARDS)).expect(0);
    for attempt in 0..20 {
        let out = folder.path().join(format!("out-{attempt}"));
        let mut line = arguments(&made, &out, &SHARDS);
        line.extend(["-j", "1"]);
        let mut child = command(&line).spawn().unwrap();
        if wait_until(&mut child, || out.join(".export/train-000000.json").exists()) {
            send(&child, "TERM");
        }
        let ended: Ended = child.wait_with_output().unwrap().into();
        if ended.code == Some(0) {
            continue;
        }
        ended.expect(143).says(&["run the same command to resume"]);
        run(&line).expect(0);
        assert_equal(&out, &whole);
        return;
    }
    panic!("every export ended before its signal");
}
