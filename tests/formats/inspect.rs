//! Tests `inspect` on every kind of file that rendering, training and export write.

use crate::every_file::files;
use crate::support::program::{Ended, text};
use crate::support::workplace::{run_in, workplace};
use serde_json::{Value, json};

/// Returns the only file in the output of `inspect --json`.
pub(crate) fn one(ended: &Ended) -> Value {
    let object = ended.json();
    assert_eq!(object["schema"], "glasshouse.inspect/1");
    let [file] = object["files"].as_array().unwrap().as_slice() else {
        panic!("{object:#}");
    };
    file.clone()
}

#[test]
fn every_kind_of_file_is_described() {
    let files = files();
    let mut missing = Vec::new();
    for known in &files.list {
        let path = text(&known.path);
        let ended = run_in(files.folder.path(), &["inspect", path, "--json"]).expect(0);
        let file = one(&ended);
        assert_eq!(file["kind"], known.kind, "{path}: {file:#}");
        assert_eq!(file["whole"].as_bool(), known.whole, "{path}: {file:#}");
        assert!(
            file["how"].is_string() && file["problems"].as_array().unwrap().is_empty(),
            "{file:#}"
        );
        let page = run_in(files.folder.path(), &["inspect", path]).expect(0);
        assert!(page.stderr.is_empty(), "{page:?}");
        for word in known.words {
            let flat = page.stdout.split_whitespace().collect::<Vec<_>>().join(" ");
            if !flat.contains(word) {
                missing.push(format!("{path}: no {word:?} in\n{}", page.stdout));
            }
        }
        // Lines fit a terminal, except for long names without a space.
        let is_long = |line: &&str| {
            let word = line.split_whitespace().map(str::len).max().unwrap_or(0);
            line.chars().count() > 80 && word < 40
        };
        assert_eq!(page.stdout.lines().find(is_long), None, "{path}");
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

#[test]
fn files_are_recognised_by_their_content() {
    let files = files();
    let folder = files.folder.path();
    for known in files.plain() {
        // `inspect` recognises most of these kinds only by their names.
        if ["lock", "best", "train_recipe", "finished"].contains(&known.kind) {
            continue;
        }
        std::fs::create_dir_all(folder.join("elsewhere")).unwrap();
        std::fs::copy(folder.join(&known.path), folder.join("elsewhere/file.dat")).unwrap();
        let ended = run_in(folder, &["inspect", "elsewhere/file.dat", "--json"]);
        let kind = one(&ended)["kind"].clone();
        let path = known.path.display();
        // For these kinds, `inspect` may need the name (a list of one line) or the files beside the file (digests).
        if known.kind == "sums"
            || known.kind == "manifest"
            || known.kind == "checkpoint_state"
            || known.kind == "rejected"
            || known.kind == "listing"
        {
            continue;
        }
        assert_eq!(kind, known.kind, "{path}");
    }
}

#[test]
fn several_files_are_inspected_and_missing_ones_reported() {
    let place = workplace();
    let arguments = ["inspect", "scene.json", "nowhere.exr", "words.txt", ".", "--json"];
    std::fs::write(place.path().join("words.txt"), "only words\n").unwrap();
    let object = run_in(place.path(), &arguments).expect(4).json();
    assert_eq!((&object["sound"], &object["unsound"]), (&json!(1), &json!(3)));
    let problem =
        |index: usize| object["files"][index]["problems"][0]["what"].as_str().unwrap().to_owned();
    assert!(problem(1).contains("No such file"), "{object:#}");
    assert!(problem(2).contains("only words"), "{object:#}");
    assert!(problem(3).contains("neither a run"), "{object:#}");
    run_in(place.path(), &["inspect"]).expect(2);
    // A device may have no end.
    let device = run_in(place.path(), &["inspect", "/dev/zero"]).expect(4);
    assert!(device.stdout.contains("a device, not a file"), "{device:?}");
}
