//! Files that `export` and `train` write, and the expected output of `inspect` for each.

use crate::every_file::{Files, SCENE};
use crate::support::workplace::run_in;
use sha2::Digest;
use std::fmt::Write;

/// Makes an export of two samples, with the member names of `export`, and lists its files.
pub(crate) fn of_an_export(files: &mut Files) {
    let tuple = files.folder.path().join("runs/smoke/tuples").join(SCENE);
    let mut shard = tar::Builder::new(Vec::new());
    for id in ["a", "b"] {
        for layer in glasshouse_line::layer::Layer::NAMES {
            let name = format!("{id}.{layer}.png");
            shard.append_path_with_name(tuple.join(format!("{layer}.png")), name).unwrap();
        }
        shard.append_path_with_name(tuple.join("tuple.json"), format!("{id}.json")).unwrap();
    }
    let shard = shard.into_inner().unwrap();
    let digest = sha2::Sha256::digest(&shard).iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    });
    files.put("set/train-000000.tar", shard);
    files.put("set/SHA256SUMS", format!("{digest}  train-000000.tar\n"));
    files.put("set/metadata.jsonl", "{\"id\":\"a\",\"input_file_name\":\"a.png\"}\n{\"id\":\"b\",\"input_file_name\":\"b.png\"}\n");
    files.put(
        "set/croissant.json",
        r#"{"@context":{},"@type":"sc:Dataset","name":"smoke","distribution":[{}]}"#,
    );
    files.is(
        "set/train-000000.tar",
        "archive",
        None,
        &["10 files", "2 samples, 2 of them complete", "a, b", "sha256sum -c"],
    );
    files.is("set/SHA256SUMS", "sums", None, &["1 file", "sha256sum -c"]);
    files.is("set", "sums", None, &["1 file"]);
    files.is("set/metadata.jsonl", "listing", None, &["2 samples", "input_file_name"]);
    files.is("set/croissant.json", "croissant", None, &["smoke"]);
    files.put(
        "set/README.md",
        "---\nlicense: other\npretty_name: \"smoke\"\ntags:\n- reflection-removal\n- reflection-separation\n---\n",
    );
    files.is("set/README.md", "card", None, &["smoke", "sha256sum -c"]);
    let line = ["export", "runs/smoke", "--format", "safetensors", "--out", "tensors"];
    run_in(files.folder.path(), &line).expect(0);
    files.is(
        "tensors/train-000000.safetensors",
        "tuples",
        None,
        &["1: train-sample-000000", "input (F16)", "sha256sum -c"],
    );
    files.is("tensors/train.jsonl", "listing", None, &["1 sample", "tracer_version"]);
}

#[cfg(feature = "train")]
pub(crate) fn of_a_training(files: &mut Files) {
    let (whole, unknown) = (Some(true), None);
    files.is(
        "runs/smoke/train.json",
        "train_recipe",
        unknown,
        &["backtrack steps 2", "separation steps 2"],
    );
    files.is("runs/smoke/train/backtrack", "stage", whole, &["step-0000002", "total"]);
    let step = "runs/smoke/train/separation/step-0000002";
    files.is(step, "checkpoint", whole, &["stage separation", "state.json match"]);
    files.is(
        &format!("{step}/state.json"),
        "checkpoint_state",
        unknown,
        &["parameters", "learning rate"],
    );
    files.is(
        &format!("{step}/model.safetensors"),
        "tensors",
        whole,
        &["separation", "backtrack", "discriminator", "the one in state.json"],
    );
    files.is(&format!("{step}/optimizer.safetensors"), "tensors", whole, &["mean", "square"]);
    let stage = "runs/smoke/train/separation";
    files.is(
        &format!("{stage}/metrics.csv"),
        "metrics",
        unknown,
        &["2 rows", "columns step, total"],
    );
    files.is(
        &format!("{stage}/best.json"),
        "best",
        unknown,
        &["step", "validation psnr db", "chosen on"],
    );
    let events = std::fs::read_dir(files.folder.path().join(stage)).unwrap();
    let events = events.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let events = events.into_iter().find(|name| name.starts_with("events.")).unwrap();
    files.is(&format!("{stage}/{events}"), "events", unknown, &["TensorBoard"]);
    let scores = "runs/smoke/train/evaluation/evaluation";
    files.is(&format!("{scores}.csv"), "evaluation_rows", unknown, &["rows", "psnr_colour_db"]);
    files.is(&format!("{scores}.md"), "evaluation_table", unknown, &["PSNR"]);
    files.is(&format!("{scores}.json"), "output", unknown, &["glasshouse.evaluate/2"]);
}
