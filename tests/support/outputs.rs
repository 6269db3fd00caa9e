//! Decodes and compares the results of runs.

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// Content of a file: pixels of an EXR by channel (type and bits), or the bytes of any other file.
#[derive(PartialEq, Clone)]
pub(crate) enum Content {
    Pixels(BTreeMap<String, (&'static str, Vec<u32>)>),
    Bytes(Vec<u8>),
}

/// Files of a run's tuples, by path below `tuples/`.
pub(crate) type Tuples = BTreeMap<PathBuf, Content>;

impl fmt::Debug for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pixels(channels) => write!(f, "{} channels", channels.len()),
            Self::Bytes(bytes) => write!(f, "{}", String::from_utf8_lossy(bytes)),
        }
    }
}

/// Decodes an EXR to the bits of its channels.
pub(crate) fn exr_channels(path: &Path) -> BTreeMap<String, (&'static str, Vec<u32>)> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let channels = image.layer_data.channel_data.list;
    let bits = channels.iter().map(|channel| {
        let bits = match &channel.sample_data {
            FlatSamples::F16(v) => ("half", v.iter().map(|v| v.to_bits().into()).collect()),
            FlatSamples::F32(v) => ("float", v.iter().map(|v| v.to_bits()).collect()),
            FlatSamples::U32(v) => ("uint", v.clone()),
        };
        (channel.name.to_string(), bits)
    });
    bits.collect()
}

/// Returns the paths of all files below `folder`, relative to it, except for what commands remember for their next call.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = all_files(folder);
    let is_memory = |path: &PathBuf| {
        path.ends_with(".glasshouse-written.jsonl")
            || path.ends_with(".glasshouse-digests.json")
            || path.starts_with(".export")
    };
    found.retain(|path| !is_memory(path));
    found
}

/// Returns the paths of all files below `folder`, relative to it.
fn all_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        // A running process may remove a folder during the walk.
        for entry in std::fs::read_dir(&next).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else {
                found.push(path.strip_prefix(folder).unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

/// Copies all files below a folder to another folder, and creates missing folders.
pub(crate) fn copy_folder(from: &Path, to: &Path) {
    for file in all_files(from) {
        let copy = to.join(&file);
        std::fs::create_dir_all(copy.parent().unwrap()).unwrap();
        std::fs::copy(from.join(&file), copy).unwrap();
    }
}

/// Reads a JSON file.
#[track_caller]
pub(crate) fn read_json(path: impl AsRef<Path>) -> Value {
    let path = path.as_ref();
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_slice(&bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Reads the `tuple.json` of a scene.
#[track_caller]
pub(crate) fn tuple_record(run: &Path, scene: &str) -> Value {
    read_json(run.join("tuples").join(scene).join("tuple.json"))
}

/// Returns the reason of a scene's quarantine.
#[track_caller]
pub(crate) fn quarantine_reason(run: &Path, scene: &str) -> String {
    let record = read_json(run.join(format!("quarantine/{scene}.json")));
    record["reason"].as_str().unwrap().to_owned()
}

/// Reads the lines of a run's manifest.
pub(crate) fn manifest(run: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(run.join("manifest.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Reads and decodes the tuples of a run.
pub(crate) fn tuples(run: &Path) -> Tuples {
    let folder = run.join("tuples");
    let decode = |path: PathBuf| {
        let full = folder.join(&path);
        let content = if path.extension().is_some_and(|e| e == "exr") {
            Content::Pixels(exr_channels(&full))
        } else {
            Content::Bytes(std::fs::read(&full).unwrap())
        };
        (path, content)
    };
    files(&folder).into_iter().map(decode).collect()
}

/// Asserts that two sets of tuples are equal and not empty; names the first file with other content.
#[track_caller]
pub(crate) fn assert_same(found: &Tuples, expected: &Tuples) {
    assert!(!expected.is_empty());
    let names = |of: &Tuples| of.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(found), names(expected));
    for (path, content) in expected {
        let same = found[path] == *content;
        assert!(same, "{} differs: {:?} instead of {content:?}", path.display(), found[path]);
    }
}

/// Asserts that a finished run has no temporary files and no partials.
#[track_caller]
pub(crate) fn assert_tidy(run: &Path) {
    for path in files(run) {
        let is_temporary =
            path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(".tmp-"));
        let is_leftover = is_temporary || path.starts_with("partials");
        assert!(!is_leftover, "{} is left", path.display());
    }
}
