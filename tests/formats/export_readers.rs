//! Reads exports back with common Python packages and with the examples of docs/datasets.md.
//!
//! Runs `GLASSHOUSE_PYTHON`, or `python3`. If a package is missing, its checks are skipped with a message.

use crate::export::{RECIPE, finished};
use crate::support::program::{Ended, command, run, text};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Exit code of `read_back.py` when a package is missing.
const ABSENT: i32 = 77;

fn python() -> Command {
    let python = std::env::var_os("GLASSHOUSE_PYTHON");
    Command::new(python.unwrap_or_else(|| "python3".into()))
}

/// Reads `out` back, or prints that Python or a package is missing.
fn read_back(what: &str, run: &Path, out: &Path) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/read_back.py");
    let output = python().arg(script).arg(what).args([run, out]).output();
    let Ok(output) = output else {
        eprintln!("skipped: {what}: Python is not installed");
        return;
    };
    let ended: Ended = output.into();
    match ended.code {
        Some(0) => eprintln!("read back: {}", ended.stdout.trim()),
        Some(ABSENT) => eprintln!("{}", ended.stdout.trim()),
        _ => panic!("{what}: {ended:#?}"),
    }
}

fn export(run_folder: &Path, out: &Path, more: &str) -> PathBuf {
    let mut arguments = vec!["export", text(run_folder), "--out", text(out)];
    arguments.extend(more.split(' '));
    run(&arguments).expect(0);
    out.to_owned()
}

#[test]
fn loaders_return_the_pixels_of_the_tuples() {
    let (folder, made) = finished(RECIPE);
    for (name, more, readers) in [
        ("w", "--format webdataset", &["webdataset", "loader", "hub_webdataset", "croissant"][..]),
        ("w16", "--format webdataset --encoding srgb16", &["webdataset_srgb16"]),
        ("wl", "--format webdataset --encoding linear", &["webdataset_linear"]),
        ("i", "--format imagefolder", &["imagefolder", "croissant"]),
        ("p", "--format pairs", &["pairs"]),
        ("pl", "--format pairs --encoding linear", &["pairs_linear"]),
        ("e", "--format exr", &["exr"]),
        ("s", "--format safetensors", &["safetensors", "safetensors_torch"]),
    ] {
        let out = export(&made, &folder.path().join(name), more);
        for what in readers {
            read_back(what, &made, &out);
        }
    }
}

#[test]
fn several_shards_are_read_as_one_set() {
    let recipe = RECIPE
        .replace("width = 24", "width = 256")
        .replace("height = 16", "height = 256")
        .replace("spp = 16", "spp = 1");
    let (folder, made) = finished(&recipe);
    let out = export(&made, &folder.path().join("w"), "--format webdataset --shard-mb 1");
    assert!(out.join("train-000001.tar").exists());
    for shard in std::fs::read_dir(&out).unwrap() {
        let shard = shard.unwrap();
        assert!(shard.metadata().unwrap().len() <= 1_000_000, "{shard:?}");
    }
    for what in ["webdataset", "loader", "croissant"] {
        read_back(what, &made, &out);
    }
}

#[test]
fn films_with_floats_or_fewer_layers_are_read() {
    let film = "spp = 16\nexr = \"float\"\nlayers = [\"input\", \"transmission\"]";
    let (folder, made) = finished(&RECIPE.replace("spp = 16", film));
    for (name, more, what) in [
        ("w", "--format webdataset", "webdataset"),
        ("i", "--format imagefolder", "imagefolder"),
        ("p", "--format pairs", "pairs"),
        ("pl", "--format pairs --encoding linear", "pairs_linear"),
        ("e", "--format exr", "exr"),
        ("s", "--format safetensors", "safetensors"),
    ] {
        let out = export(&made, &folder.path().join(name), more);
        read_back(what, &made, &out);
    }
    let (folder, made) = finished(&RECIPE.replace("spp = 16", "spp = 16\nlayers = [\"input\"]"));
    let out = export(&made, &folder.path().join("e"), "--format exr");
    read_back("exr", &made, &out);
}

#[test]
fn examples_in_datasets_md_work() {
    let document = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/datasets.md");
    let document = std::fs::read_to_string(document).unwrap();
    let (folder, _) = finished(RECIPE);
    let exports = document.lines().filter_map(|line| line.strip_prefix("    glasshouse export "));
    let mut formats = 0;
    for line in exports {
        let words: Vec<&str> = std::iter::once("export").chain(line.split_whitespace()).collect();
        let output = command(&words).current_dir(folder.path()).output();
        Ended::from(output.unwrap()).expect(0);
        formats += 1;
    }
    assert_eq!(formats, 5, "the document has an example of every format");
    let blocks: Vec<&str> = document
        .split("```python\n")
        .skip(1)
        .map(|rest| rest.split_once("```").unwrap().0)
        .collect();
    assert_eq!(blocks.len(), 6, "a block for each way to read");
    let cache = tempfile::tempdir().unwrap();
    for block in blocks {
        let mut python = python();
        python.args(["-c", block]).current_dir(folder.path());
        for name in ["HOME", "HF_HOME", "XDG_CACHE_HOME", "CROISSANT_CACHE"] {
            python.env(name, cache.path());
        }
        python.env("HF_HUB_OFFLINE", "1");
        let Ok(output) = python.output() else {
            eprintln!("skipped: Python is not installed");
            return;
        };
        let ended: Ended = output.into();
        if ended.code == Some(0) {
            continue;
        }
        let last = ended.stderr.lines().last().unwrap_or_default();
        assert!(last.starts_with("ModuleNotFoundError"), "{block}\n{ended:#?}");
        eprintln!("skipped: {last}");
    }
}
