//! Tests that `--out` overwrites no file of the user, no tuple and no part of a run.

use crate::support::outputs::copy_folder;
use crate::support::scenes::{photographs, scene};
use crate::support::workplace::{run_in, workplace};
use std::path::{Path, PathBuf};

/// Runs the program in `folder`, and asserts that it refuses with these words and changes no file.
#[track_caller]
fn refused(folder: &Path, line: &str, words: &[&str]) {
    let before = tree(folder);
    let arguments: Vec<&str> = line.split(' ').collect();
    run_in(folder, &arguments).expect(2).says(words).says(&["--out"]);
    let dry = [&arguments[..], &["-n"]].concat();
    run_in(folder, &dry).expect(2).says(words);
    assert_eq!(tree(folder), before, "{line}");
}

/// Reads every file below a folder.
fn tree(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                files.push((path, bytes));
            }
        }
    }
    files.sort();
    files
}

#[test]
fn a_photograph_and_a_tuple_are_not_rendered_over() {
    let place = workplace();
    let folder = place.path();
    let own = folder.join("own");
    std::fs::create_dir(&own).unwrap();
    let mut line = scene("one");
    line["front"]["color"] = "input.png".into();
    photographs(&own);
    std::fs::rename(own.join("a.png"), own.join("input.png")).unwrap();
    std::fs::write(own.join("scene.json"), line.to_string()).unwrap();
    refused(
        folder,
        "render own/scene.json --out own",
        &["own/input.png is an input", "overwritten"],
    );

    let tuple =
        std::fs::read_dir(folder.join("runs/smoke/tuples")).unwrap().next().unwrap().unwrap();
    let tuple = format!("runs/smoke/tuples/{}", tuple.file_name().to_str().unwrap());
    let line = format!("render {tuple}/tuple.json --out {tuple} --spp 1");
    refused(folder, &line, &["tuples/ of the run", "only the run's own commands write"]);
    refused(folder, "render scene.json --out runs/smoke/tuples/new", &["of the run"]);
    // A copied tuple is outside the run.
    copy_folder(&folder.join(&tuple), &folder.join("copy"));
    refused(folder, "render scene.json --out copy", &["copy/input.png exists", "is a tuple"]);

    // The command's own files are overwritten, but not by another command.
    run_in(folder, &["render", "scene.json", "--out", "out"]).expect(0);
    std::fs::write(folder.join("out/evaluation.md"), "notes").unwrap();
    refused(
        folder,
        "evaluate pairs --out out",
        &["out/evaluation.md exists", "`glasshouse evaluate`"],
    );
    refused(folder, "render scene.json --out scene.json", &["scene.json is a file"]);
}

#[test]
fn no_command_overwrites_a_file_that_another_program_wrote() {
    let place = workplace();
    let folder = place.path();
    let mine = folder.join("mine");
    std::fs::create_dir_all(mine.join("inputs")).unwrap();
    for name in [
        "photo.transmission.png",
        "glasshouse-render.1",
        "error.json",
        "report.html",
        "manifest.jsonl",
    ] {
        std::fs::write(mine.join(name), "mine").unwrap();
    }
    run_in(folder, &["sample", "sampled", "--count", "1", "--width", "32", "--height", "24"])
        .expect(0);
    std::fs::remove_file(folder.join("sampled/.glasshouse-written.jsonl")).unwrap();
    refused(folder, "man --out mine", &["mine/glasshouse-render.1 exists"]);
    refused(
        folder,
        "bench error --out mine --spp 1 --reference-spp 4",
        &["mine/error.json exists"],
    );
    refused(folder, "report runs/smoke --out mine/report.html", &["mine/report.html exists"]);
    refused(folder, "report runs/smoke --out runs/smoke/logs/report.html", &["logs/ of the run"]);
    refused(
        folder,
        "export runs/smoke --format pairs --out runs/smoke/noise/x",
        &["noise/ of the run"],
    );
    refused(
        folder,
        "plan my.toml --root diode=. --out runs/smoke/tuples/x",
        &["tuples/ of the run"],
    );
    refused(folder, "plan manifests/smoke.toml --out mine", &["mine/manifest.jsonl exists"]);
    std::fs::remove_file(mine.join("manifest.jsonl")).unwrap();
    refused(folder, "plan manifests/smoke.toml --out mine", &["mine/inputs exists"]);
    if cfg!(feature = "train") {
        refused(
            folder,
            "separate photo.jpg --network runs/smoke --out mine",
            &["mine/photo.transmission.png exists", "`glasshouse separate`"],
        );
    }
    let sample = ["sample", "sampled", "--count", "1", "--width", "32", "--height", "24"];
    run_in(folder, &sample).expect(2).says(&["exists, and no `glasshouse sample` wrote it"]);
    run_in(folder, &["report", "runs/smoke", "--out", "page.html"]).expect(0);
    run_in(folder, &["report", "runs/smoke", "--out", "page.html"]).expect(0);
}

#[test]
fn a_manifest_is_not_planned_over_itself() {
    let place = workplace();
    let folder = place.path();
    let list = folder.join("list");
    std::fs::create_dir(&list).unwrap();
    let line = scene("one").to_string().replace("\"a.", "\"../a.").replace("\"b.", "\"../b.");
    std::fs::write(list.join("manifest.jsonl"), line + "\n").unwrap();
    refused(folder, "plan list/manifest.jsonl --out list", &["list/manifest.jsonl exists"]);
    // A planning that was killed leaves its lock; its manifest is still not the source of another planning.
    std::fs::write(list.join("work.lock"), "").unwrap();
    refused(folder, "plan list/manifest.jsonl --out list", &["list/manifest.jsonl exists"]);
}
