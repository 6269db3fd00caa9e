//! Runs of the first version, stored in `kept_run/`, continue with equal bits and without repeating completed work.
//!
//! `kept_run.sh` made the runs: `half` was killed while it traced, and `trained` stopped after two of four steps of the
//! separation stage. `expected.txt` has the digests of the same plan's files from an uninterrupted run.

use crate::support::outputs::files;
use crate::support::program::{run, text};
use render::merge::{TUPLE_SCHEMA, TUPLE_SCHEMA_1, TupleRecord, encode_tuple_record_1};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// The instruction set of the machine that trained the kept run. Training gives equal bits only on one type of CPU.
const CODE_PATH: &str = "avx512f";

fn unpacked() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let tar = std::fs::File::open(kept("kept_run.tar")).unwrap();
    tar::Archive::new(tar).unpack(folder.path()).unwrap();
    folder
}

fn kept(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/farm/kept_run").join(name)
}

/// Continues the run `name` to its end.
fn continued(folder: &Path, name: &str) -> Value {
    let (recipe, out) = (kept("kept_run.toml"), folder.join(name));
    let root = format!("photographs={}", folder.join("photographs").display());
    let tile = ["--tile", "16", "--root", &root, "--json"];
    run(&[&["run", text(&recipe), "--out", text(&out)][..], &tile].concat()).expect(0).json()
}

/// Compares the files below `prefix` with the first version's; returns their number.
fn compare(folder: &Path, run: &str, prefix: &str) -> usize {
    let expected = std::fs::read_to_string(folder.join("expected.txt")).unwrap();
    let rows = expected.lines().map(|line| line.split_once("  ").unwrap());
    let rows: Vec<_> = rows.filter(|(_, path)| path.starts_with(prefix)).collect();
    for (digest, path) in &rows {
        let mut bytes = std::fs::read(folder.join(run).join(path)).unwrap();
        if path.ends_with("tuple.json") {
            // The first version's records have no digests of the files; the rest is equal.
            let record: TupleRecord = serde_json::from_slice(&bytes).unwrap();
            bytes = encode_tuple_record_1(&record).unwrap();
        }
        let expected =
            (0..64).step_by(2).map(|k| u8::from_str_radix(&digest[k..k + 2], 16).unwrap());
        assert!(Sha256::digest(bytes).iter().copied().eq(expected), "{run}/{path}");
    }
    rows.len()
}

#[test]
fn a_half_traced_run_of_the_first_version_continues_with_equal_bits() {
    let folder = unpacked();
    let ended = continued(folder.path(), "half");
    assert_eq!(
        ["already_merged", "merged", "shards_resumed", "shards_traced"].map(|key| &ended[key]),
        [1, 3, 3, 69]
    );
    assert_eq!(compare(folder.path(), "half", "tuples/"), 20);
    let half = folder.path().join("half");
    let mut schemas: Vec<String> = files(&half.join("tuples"))
        .into_iter()
        .filter(|path| path.ends_with("tuple.json"))
        .map(|path| {
            let record = std::fs::read(half.join("tuples").join(path)).unwrap();
            serde_json::from_slice::<TupleRecord>(&record).unwrap().schema
        })
        .collect();
    schemas.sort();
    assert_eq!(schemas, [TUPLE_SCHEMA_1, TUPLE_SCHEMA, TUPLE_SCHEMA, TUPLE_SCHEMA]);
    let root = format!("photographs={}", folder.path().join("photographs").display());
    run(&["audit", text(&half), "--share", "1", "--root", &root]).expect(0);
}

/// Readers accept the first version's tuples, and `inspect` states that nothing proves their PNGs.
#[test]
fn a_tuple_of_the_first_version_is_called_unchecked() {
    let folder = unpacked();
    let trained = folder.path().join("trained");
    let tuple = std::fs::read_dir(trained.join("tuples")).unwrap().next().unwrap().unwrap().path();
    let found = run(&["inspect", text(&tuple)]).expect(0);
    assert!(found.stdout.contains("PNGs not checked"), "{found:#?}");
    let out = folder.path().join("out");
    run(&["export", text(&trained), "--format", "pairs", "--out", text(&out)]).expect(0);
    run(&["report", text(&trained)]).expect(0);
}

#[cfg(feature = "train")]
#[test]
fn a_half_trained_run_of_the_first_version_continues_with_equal_bits() {
    let folder = unpacked();
    let ended = continued(folder.path(), "trained");
    assert_eq!(["already_merged", "merged"].map(|key| &ended[key]), [4, 0]);
    let separation = &ended["train"]["separation"];
    assert_eq!(["from_step", "step", "steps_taken"].map(|key| &separation[key]), [2, 4, 2]);
    assert_eq!(ended["train"]["backtrack"]["steps_taken"], 0);
    assert_eq!(compare(folder.path(), "trained", "train/backtrack/"), 2);
    if separation["code_path"] == CODE_PATH {
        assert_eq!(compare(folder.path(), "trained", "train/separation/"), 2);
    } else {
        eprintln!("the kept networks were trained with {CODE_PATH}: their bits are not compared");
    }
}
