//! Checks the launch files of `workers/` with the program and with installed tools.

mod flags;
mod kubernetes;
mod nats;
mod scripts;
mod services;
mod yaml;

use std::path::{Path, PathBuf};

pub(crate) fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Returns a launch file's path.
pub(crate) fn launch(name: &str) -> PathBuf {
    repository().join("workers").join(name)
}

/// Returns all launch files with one of these endings, sorted.
pub(crate) fn launch_files(endings: &[&str]) -> Vec<PathBuf> {
    let mut folders = vec![repository().join("workers")];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let has = |ending: &&str| path.to_string_lossy().ends_with(*ending);
            if path.is_dir() {
                folders.push(path);
            } else if endings.iter().any(has) {
                found.push(path);
            }
        }
    }
    found.sort();
    assert!(!found.is_empty(), "no launch file ends with {endings:?}");
    found
}
