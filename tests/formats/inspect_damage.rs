//! Checks that `inspect` on a damaged file names the damage, its location and a remedy. `inspect` never reports the
//! file as whole and never panics.

use crate::every_file::files;
use crate::inspect::one;
use crate::support::program::text;
use crate::support::workplace::run_in;
use serde_json::Value;
use std::path::Path;

/// Returns the output of `inspect` for a changed file; restores the file.
fn inspect(
    folder: &Path,
    path: &Path,
    damage: impl FnOnce(&mut Vec<u8>),
) -> (Option<i32>, Value, String) {
    let whole = std::fs::read(folder.join(path)).unwrap();
    let mut bytes = whole.clone();
    damage(&mut bytes);
    std::fs::write(folder.join(path), &bytes).unwrap();
    let ended = run_in(folder, &["inspect", text(path), "--json"]);
    let page = run_in(folder, &["inspect", text(path)]);
    assert_eq!(ended.code, page.code);
    assert!(!ended.stderr.contains("panicked") && !page.stderr.contains("panicked"), "{page:?}");
    std::fs::write(folder.join(path), whole).unwrap();
    (ended.code, one(&ended), page.stdout)
}

/// Asserts that the output explains the damage and that every problem has a remedy.
fn explained(path: &Path, (code, file, page): &(Option<i32>, Value, String)) {
    let path = path.display();
    assert_eq!(*code, Some(4), "{path}: {file:#}");
    assert_eq!(file["whole"], false, "{path}: {file:#}");
    let problems = file["problems"].as_array().unwrap();
    assert!(!problems.is_empty(), "{path}");
    for problem in problems {
        assert!(
            !problem["what"].as_str().unwrap().is_empty()
                && !problem["to_do"].as_str().unwrap().is_empty()
        );
    }
    assert!(page.contains("  wrong ") && page.contains("  to do "), "{path}: {page}");
}

#[test]
fn cut_and_changed_files_are_explained() {
    let files = files();
    let folder = files.folder.path();
    for known in files.plain() {
        let path = &known.path;
        if known.kind == "lock" {
            continue;
        }
        for part in [2, 3] {
            let cut = inspect(folder, path, |bytes| {
                bytes.truncate(bytes.len() * (part - 1) / part);
            });
            // The start of a TOML file, table or list may be valid. `inspect` does not check TensorBoard's files.
            let is_text = ["recipe", "depth_ranges", "evaluation_table", "listing", "events"]
                .contains(&known.kind);
            // The start of a manifest may be valid, too, if no spec has its digest.
            let is_free = is_text || (known.kind == "manifest" && known.whole.is_none());
            if !is_free || cut.0 == Some(4) {
                explained(path, &cut);
            }
            assert_ne!(cut.1["whole"], true, "{}: {:#}", path.display(), cut.1);
        }
        let empty = inspect(folder, path, Vec::clear);
        explained(path, &empty);
        assert!(empty.2.contains("empty"), "{}", empty.2);
        // Changes the middle of the file: pixels, weights, records or lines.
        let changed = inspect(folder, path, |bytes| {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 0x01;
        });
        if known.whole == Some(true) {
            explained(path, &changed);
        } else {
            assert_ne!(changed.1["whole"], true, "{}: {:#}", path.display(), changed.1);
        }
        // Overwrites the first bytes with bytes that no known format has.
        let foreign = inspect(folder, path, |bytes| {
            let length = bytes.len().min(300);
            bytes[..length].fill(0xfe);
        });
        explained(path, &foreign);
    }
}

#[test]
fn problems_name_their_location() {
    let files = files();
    let folder = files.folder.path();
    let path = Path::new("runs/smoke/manifest.jsonl");
    let (_, file, page) = inspect(folder, path, |bytes| {
        let second = bytes.iter().position(|byte| *byte == b'\n').unwrap() + 1;
        bytes[second] = b'x';
    });
    assert_eq!(file["facts"]["good_lines"], 1, "{file:#}");
    assert_eq!(file["problems"][0]["where"], "line 2", "{page}");
    let (_, file, _) = inspect(folder, Path::new("runs/smoke/spec.json"), |bytes| {
        bytes.truncate(bytes.len() / 2);
    });
    assert!(file["problems"][0]["where"].as_str().unwrap().starts_with("line "), "{file:#}");
    // Changes the version of the schema.
    let (_, file, _) = inspect(folder, Path::new("runs/smoke/spec.json"), |bytes| {
        let text = String::from_utf8(bytes.clone())
            .unwrap()
            .replace("glasshouse.spec/1", "glasshouse.spec/9");
        *bytes = text.into_bytes();
    });
    assert_eq!(file["kind"], "spec");
    assert!(file["problems"][0]["what"].as_str().unwrap().contains("spec/9"), "{file:#}");
}

#[test]
fn a_partial_under_another_name_is_detected() {
    let files = files();
    let folder = files.folder.path();
    let partials = folder.join("runs/smoke/partials/train-sample-000000");
    std::fs::rename(partials.join("000000.exr"), partials.join("000007.exr")).unwrap();
    let ended = run_in(&partials, &["inspect", "000007.exr", "--json"]).expect(4);
    assert!(one(&ended)["problems"][0]["what"].as_str().unwrap().contains("another shard"));
}

#[test]
fn an_incomplete_tuple_and_an_incomplete_sample_are_detected() {
    let files = files();
    let folder = files.folder.path();
    let tuple = folder.join("runs/smoke/tuples/train-sample-000000");
    std::fs::remove_file(tuple.join("input.png")).unwrap();
    let ended = run_in(folder, &["inspect", text(&tuple), "--json"]).expect(4);
    assert!(
        one(&ended)["problems"][0]["what"].as_str().unwrap().contains("input.png"),
        "{ended:?}"
    );
    let mut shard = tar::Builder::new(Vec::new());
    shard.append_path_with_name(tuple.join("transmission.png"), "a.transmission.png").unwrap();
    shard.append_path_with_name(tuple.join("tuple.json"), "a.json").unwrap();
    std::fs::write(folder.join("lacks.tar"), shard.into_inner().unwrap()).unwrap();
    let file = one(&run_in(folder, &["inspect", "lacks.tar", "--json"]).expect(4));
    assert_eq!(file["facts"]["complete"], 0);
    assert_eq!(file["problems"][0]["where"], "sample a");
}

#[cfg(feature = "train")]
type Change = fn(&mut Value);

#[test]
fn a_record_without_the_digest_of_a_file_is_damaged() {
    let files = files();
    let tuple = Path::new("runs/smoke/tuples/train-sample-000000/tuple.json");
    let changes: [(&str, Change); 5] = [
        ("digest of", |record| drop(record.as_object_mut().unwrap().remove("files"))),
        ("digest of input.png", |record| {
            drop(record["files"].as_object_mut().unwrap().remove("input.png"));
        }),
        ("layer transmission", |record| {
            drop(record["layers"].as_object_mut().unwrap().remove("transmission"));
        }),
        ("has no `files`", |record| record["schema"] = "glasshouse.tuple/1".into()),
        ("not the name of a file beside it", |record| record["files"]["../x"] = "0".into()),
    ];
    for (words, change) in changes {
        let found = inspect(files.folder.path(), tuple, |bytes| {
            let mut record: Value = serde_json::from_slice(bytes).unwrap();
            change(&mut record);
            *bytes = serde_json::to_vec(&record).unwrap();
        });
        explained(tuple, &found);
        assert!(
            found.2.replace("\n                           ", " ").contains(words),
            "{words}: {}",
            found.2
        );
    }
}

#[test]
fn a_checkpoint_is_compared_with_its_state() {
    let files = files();
    let folder = files.folder.path();
    let step = folder.join("runs/smoke/train/separation/step-0000002");
    let mut model = std::fs::read(step.join("model.safetensors")).unwrap();
    let last = model.len() - 5;
    model[last] ^= 1;
    std::fs::write(step.join("model.safetensors"), model).unwrap();
    for path in [&step, &step.join("state.json"), &step.parent().unwrap().to_owned()] {
        let ended = run_in(folder, &["inspect", text(path)]).expect(4);
        let flat = ended.stdout.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(flat.contains("model.safetensors: it was changed"), "{ended:?}");
        assert!(flat.contains("resumes from the previous checkpoint"), "{ended:?}");
    }
}
