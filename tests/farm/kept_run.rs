//! Runs of the first version, stored in `kept_run/`, continue with equal bits and without repeating completed work.
//!
//! `kept_run.sh` made the runs: `half` was killed while it traced, and `trained` stopped after two of four steps of the
//! separation stage. `expected.txt` has the digests of the same plan's files from an uninterrupted run.

use crate::support::outputs::files;
use crate::support::program::{run, text};
use render::merge::{TupleRecord, encode_tuple_record_1};
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

/// The tracer's version is higher than the first version's, although it changes no pixel of these scenes.
#[test]
fn a_run_of_an_older_tracer_is_read_but_not_continued() {
    let folder = unpacked();
    let half = folder.path().join("half");
    let before = files(&half);
    for command in ["work", "merge", "audit"] {
        run(&[command, text(&half)]).expect(5).says(&["tracer_version is 3 in the run"]);
    }
    for command in ["status", "inspect"] {
        run(&[command, text(&half)]).expect(0);
    }
    assert_eq!(files(&half), before);
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
    let trained = folder.path().join("trained");
    let train = ["train", text(&trained), "--stage", "separation", "--steps", "4", "--json"];
    let ended = run(&train).expect(0).json();
    assert_eq!(["from_step", "step", "steps_taken"].map(|key| &ended[key]), [2, 4, 2]);
    assert_eq!(compare(folder.path(), "trained", "train/backtrack/"), 2);
    if ended["code_path"] == CODE_PATH {
        assert_eq!(compare(folder.path(), "trained", "train/separation/"), 2);
    } else {
        eprintln!("the kept networks were trained with {CODE_PATH}: their bits are not compared");
    }
}
