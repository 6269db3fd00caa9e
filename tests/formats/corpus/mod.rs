//! Runs every reader on the seeds of the fuzz targets and on truncated seeds: every call returns, and accepted values
//! are valid. CONTRIBUTING.md describes the fuzzers.

mod pictures;
#[path = "../../../fuzz/readers.rs"]
mod readers;
mod seeds;

use readers::READERS;
use std::path::{Path, PathBuf};

fn folder(reader: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(reader)
}

fn committed(reader: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder(reader))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.clone(), std::fs::read(path).unwrap()))
        .collect();
    files.sort();
    files
}

#[test]
fn every_reader_accepts_a_seed_and_survives_truncated_ones() {
    for (name, read) in READERS {
        let files = committed(name);
        assert!(files.len() >= 2, "{name} has {} seeds", files.len());
        // A changed format needs new seeds from `seeds_are_made` below.
        assert!(files.iter().any(|(_, bytes)| read(bytes)), "{name} accepts none of its seeds");
        for (_, bytes) in &files {
            read(bytes);
            // Truncates a short seed at every byte, and a long one at up to a hundred places.
            for length in (0..bytes.len()).step_by(bytes.len() / 100 + 1) {
                read(&bytes[..length]);
            }
        }
    }
}

/// A seed of one reader is hostile input for the others.
#[test]
fn every_reader_survives_the_seeds_of_the_others() {
    for (_, read) in READERS {
        for (other, _) in READERS {
            for (_, bytes) in committed(other) {
                read(&bytes);
            }
        }
    }
}

/// Writes the seeds: `cargo test --release --test formats seeds_are_made -- --ignored`.
#[test]
#[ignore = "writes fuzz/seeds"]
fn seeds_are_made() {
    for (reader, name, bytes) in seeds::all() {
        assert!(bytes.len() <= 8192, "{reader}/{name}: {} bytes", bytes.len());
        render::atomic_file::create_dir(&folder(reader)).unwrap();
        render::atomic_file::write(&folder(reader).join(name), &bytes).unwrap();
    }
}
