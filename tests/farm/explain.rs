//! Runs `explain` on scenes and shards in several states.

use crate::support::program::{run, text};
use crate::support::scenes::{SHARDS, partials, place, put_partials};
use serde_json::{Value, json};
use std::path::Path;

fn explain(run_folder: &Path, shard: &str) -> (Value, String) {
    let arguments = ["explain", text(run_folder), shard];
    let object = run(&[&arguments[..], &["--json"]].concat()).expect(0).json();
    (object, run(&arguments).expect(0).stdout)
}

#[test]
fn waiting_begun_and_done_scenes_are_explained() {
    let place = place();
    place.plan();
    let (object, words) = explain(&place.run, "train-sample-000001");
    assert_eq!((&object["state"], &object["index"]), (&"waiting".into(), &1.into()));
    assert_eq!(object["missing"], json!([[0, SHARDS]]));
    assert!(words.contains("96 x 64 px") && words.contains("glasshouse work"), "{words}");

    let (id, mut made) = partials(&place.run, 1);
    made.remove(5);
    let paths = put_partials(&place.run, &id, &made);
    let (object, _) = explain(&place.run, "train-sample-000001:5");
    assert_eq!(object["state"], "begun");
    assert_eq!(object["there"], json!([[0, 5], [6, SHARDS]]));
    assert_eq!(object["missing"], json!([[5, 6]]));
    // The film has 96 x 64 px, so a row has six tiles of 16 px.
    let tile = json!({"x": 80, "y": 0, "width": 16, "height": 16});
    assert_eq!(object["shard"]["tile"], tile);
    assert_eq!(object["shard"]["samples"], json!([0, 256]));
    assert_eq!(object["shard"]["result"], "missing");
    let (object, _) = explain(&place.run, "train-sample-000001:6");
    assert!(object["shard"]["result"].as_str().unwrap().contains("intact"));
    let mut bytes = std::fs::read(&paths[5]).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&paths[5], bytes).unwrap();
    let (_, words) = explain(&place.run, "train-sample-000001:6");
    assert!(words.contains("traced again"), "{words}");

    run(&["pause", text(&place.run), "--reason", "backup"]).expect(0);
    let (_, words) = explain(&place.run, "train-sample-000001");
    assert!(words.contains("paused (backup)") && words.contains("glasshouse resume"), "{words}");
    run(&["resume", text(&place.run)]).expect(0);
    run(&["work", text(&place.run)]).expect(0);
    let (object, words) = explain(&place.run, "train-sample-000001:6");
    assert_eq!(object["state"], "done");
    assert_eq!(object["shard"]["result"], "in the tuple");
    assert!(words.contains("glasshouse audit"), "{words}");
}

#[test]
fn attempts_and_quarantine_are_shown_with_their_logs() {
    let place = place();
    place.plan();
    let folder = place.run.join("attempts/train-sample-000000");
    std::fs::create_dir_all(&folder).unwrap();
    let attempt = |n: u32, worker: &str, ended: Value| {
        let record = json!({"schema": "glasshouse.attempt/1", "scene": "train-sample-000000", "shards": [0, 12], "n": n,
            "worker": worker, "started_us": 0, "host": "h", "found": 0, "ended": ended});
        std::fs::write(folder.join(format!("0-12.{n}.json")), record.to_string()).unwrap();
    };
    let crash = json!({"kind": "crashed", "reason": "signal 6", "log_tail": "assertion failed\nlast words"});
    attempt(1, "alpha-1", crash);
    attempt(2, "beta-2", Value::Null);
    let (object, words) = explain(&place.run, "train-sample-000000:3");
    assert_eq!(object["state"], "begun");
    assert_eq!(object["attempts"].as_array().unwrap().len(), 2);
    for part in [
        "alpha-1",
        "crashed: signal 6",
        "| last words",
        "attempt 2, beta-2",
        "beta-2 holds the shard",
    ] {
        assert!(words.contains(part), "no {part:?} in {words}");
    }
    let status = run(&["status", text(&place.run), "--json"]).expect(0).json();
    assert_eq!(status["attempts"][1]["worker"], "beta-2");

    let record = json!({"schema": "glasshouse.quarantine/1", "scene": "train-sample-000000", "reason": "it kills workers"});
    std::fs::create_dir(place.run.join("quarantine")).unwrap();
    std::fs::write(place.run.join("quarantine/train-sample-000000.json"), record.to_string())
        .unwrap();
    let (object, words) = explain(&place.run, "train-sample-000000");
    assert_eq!(object["state"], "quarantined");
    assert_eq!(object["quarantine"]["reason"], "it kills workers");
    assert!(
        words.contains(&format!("glasshouse retry {} train-sample-000000", text(&place.run))),
        "{words}"
    );
}

#[test]
fn an_unknown_scene_or_shard_is_an_error() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    run(&["explain", folder, "train-9"]).expect(2).says(&["is not a scene", "manifest.jsonl"]);
    run(&["explain", folder, "train-sample-000000:24"])
        .expect(2)
        .says(&["no shard 24", "24 shards"]);
    run(&["explain", folder, "train-sample-000000:x"]).expect(2).says(&["SCENE:NUMBER"]);
}
