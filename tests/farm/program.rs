//! Starting the program, and reading what it leaves.

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The program, without colours and progress.
pub(crate) fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_glasshouse"));
    command.args(["-q", "--color", "never"]);
    command
}

/// Runs it and returns exit code, stdout, stderr.
pub(crate) fn run(arguments: &[&str]) -> (i32, String, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = program().args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code().unwrap_or(-1), text(stdout), text(stderr))
}

/// Runs it with --json and returns exit code and the one object on stdout.
pub(crate) fn run_json(arguments: &[&str]) -> (i32, Value) {
    let (code, stdout, stderr) = run(&[arguments, &["--json"]].concat());
    assert_eq!(
        stdout.trim_end().lines().count(),
        1,
        "not one object: {stdout} {stderr}"
    );
    let object: Value = serde_json::from_str(&stdout).unwrap();
    assert!(
        object["schema"]
            .as_str()
            .unwrap()
            .starts_with("glasshouse."),
        "{object}"
    );
    (code, object)
}

/// A recipe of `scenes` scenes whose film no tile divides, from small procedural photographs.
pub(crate) fn recipe(folder: &Path, scenes: u32, spp: u32) -> PathBuf {
    let path = folder.join("small.toml");
    let text = format!(
        "schema = \"glasshouse.recipe/1\"\nname = \"small\"\nseed = 7\n\
         [film]\nwidth = 90\nheight = 70\nspp = {spp}\n\
         [glass]\nthickness_m = 0.010\nior = {{ uniform = [1.4, 1.7] }}\n\
         [sources.sample]\nlayout = \"sample\"\ncount = 8\nwidth = 256\nheight = 192\n\
         [[split]]\nname = \"train\"\npairs = {{ sample = {scenes} }}\n"
    );
    write(&path, text.as_bytes());
    path
}

/// `std::fs::write`, which the program itself must not use.
#[allow(
    clippy::disallowed_methods,
    reason = "test input needs no atomic write"
)]
pub(crate) fn write(path: &Path, bytes: &[u8]) {
    std::fs::write(path, bytes).unwrap();
}

/// Channels of an OpenEXR file by name, as the bits of 32-bit floats.
pub(crate) fn exr_bits(path: &Path) -> BTreeMap<String, Vec<u32>> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap();
    let bits =
        |samples: &FlatSamples| -> Vec<u32> { samples.values_as_f32().map(f32::to_bits).collect() };
    let channels = image.layer_data.channel_data.list;
    channels
        .iter()
        .map(|c| (c.name.to_string(), bits(&c.sample_data)))
        .collect()
}

/// All that a run's tuples hold: decoded pixels of the EXRs, bytes of the rest.
#[derive(Debug, PartialEq)]
pub(crate) struct Tuples {
    pixels: BTreeMap<PathBuf, BTreeMap<String, Vec<u32>>>,
    bytes: BTreeMap<PathBuf, Vec<u8>>,
}

pub(crate) fn tuples(run: &Path) -> Tuples {
    let mut all = Tuples {
        pixels: BTreeMap::new(),
        bytes: BTreeMap::new(),
    };
    for path in files(&run.join("tuples")) {
        let name = path.strip_prefix(run).unwrap().to_owned();
        if path.extension().is_some_and(|e| e == "exr") {
            all.pixels.insert(name, exr_bits(&path));
        } else {
            all.bytes.insert(name, std::fs::read(&path).unwrap());
        }
    }
    assert!(!all.pixels.is_empty(), "no tuple in {}", run.display());
    all
}

/// All files below a folder, sorted; none if it is not there.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    if let Ok(entries) = std::fs::read_dir(folder) {
        for entry in entries {
            let path = entry.unwrap().path();
            if path.is_dir() {
                found.extend(files(&path));
            } else {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Whatever a killed process may have left behind: temporary files, and partials of merged scenes.
pub(crate) fn leftovers(run: &Path) -> Vec<PathBuf> {
    let temporary = |path: &PathBuf| {
        path.file_name()
            .is_some_and(|n| n.to_string_lossy().starts_with(".tmp"))
    };
    let mut found: Vec<PathBuf> = files(run).into_iter().filter(temporary).collect();
    found.extend(files(&run.join("partials")));
    found
}
