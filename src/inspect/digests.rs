//! Compares files with their digests in the records beside them.

use super::facts::{Inspection, Problem};
use super::input::Input;
use crate::develop::{PHOTOGRAPH_RECORD, PhotographsRecord};
use render::shard::{Spec, manifest_digest};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;

/// A record with digests of files beside it.
pub(super) trait Digested: DeserializeOwned {
    /// Name of the record in its folder.
    const NAME: &'static str;
    /// Remedy for a wrong digest or a missing file.
    const TO_DO: &'static str;
    /// True if a missing file is damage.
    const NEEDS_FILES: bool;

    /// Lists the files with a digest in the record.
    fn files(&self) -> Vec<&str>;

    /// Compares the bytes of a file with its digest.
    fn compare(&self, name: &str, bytes: &[u8]) -> Result<(), String>;
}

/// Compares a file with the record beside it.
pub(super) fn hold_file<D: Digested>(found: &mut Inspection, input: &Input) {
    let record = (input.beside)(D::NAME).and_then(|bytes| serde_json::from_slice::<D>(&bytes).ok());
    let record = record.filter(|record| record.files().contains(&input.name));
    let Some(record) = record else {
        found.may_be_whole(format!(
            "the whole file can be read, but no {} beside it contains its digest",
            D::NAME
        ));
        return;
    };
    match record.compare(input.name, input.bytes) {
        Ok(()) => found.is_whole(format!("its digest matches the one in {}", D::NAME)),
        Err(reason) => found.wrong(Problem::new(reason, D::TO_DO)),
    }
}

/// Compares the files beside a record with the record.
pub(super) fn hold_record<D: Digested>(found: &mut Inspection, input: &Input, record: &D) {
    let mut compared = Vec::new();
    for name in record.files() {
        let Some(bytes) = (input.beside)(name) else {
            if D::NEEDS_FILES {
                let what = format!("its file {name} is missing");
                found.wrong(Problem::new(what, D::TO_DO));
            }
            continue;
        };
        match record.compare(name, &bytes) {
            Ok(()) => compared.push(name),
            Err(reason) => {
                found.wrong(Problem::new(format!("{name}: {reason}"), D::TO_DO));
            }
        }
    }
    found.may_be_whole(match compared.as_slice() {
        [] => format!("{} is missing, so no digest can be compared", record.files().join(", ")),
        fitting => {
            format!("the digests of {} match; this record has no digest", fitting.join(" and "))
        }
    });
}

fn same(digest: &str, expected: &str, record: &str) -> Result<(), String> {
    if digest == expected {
        Ok(())
    } else {
        Err(format!("it was changed: its digest differs from the one in {record}"))
    }
}

impl Digested for Spec {
    const NAME: &'static str = "spec.json";
    const TO_DO: &'static str =
        "plan again into a new folder, from the recipe or from this manifest";
    const NEEDS_FILES: bool = false;

    fn files(&self) -> Vec<&str> {
        vec!["manifest.jsonl"]
    }

    fn compare(&self, _: &str, bytes: &[u8]) -> Result<(), String> {
        let digest = manifest_digest(&String::from_utf8_lossy(bytes));
        same(&digest, &self.manifest_blake3, Self::NAME)
    }
}

impl Digested for PhotographsRecord {
    const NAME: &'static str = PHOTOGRAPH_RECORD;
    const TO_DO: &'static str = "delete this scene's folder: `glasshouse develop` makes it again";
    const NEEDS_FILES: bool = true;

    fn files(&self) -> Vec<&str> {
        self.files.keys().map(String::as_str).collect()
    }

    fn compare(&self, name: &str, bytes: &[u8]) -> Result<(), String> {
        let expected = self.files.get(name).map_or("", String::as_str);
        same(&blake3::hash(bytes).to_hex(), expected, Self::NAME)
    }
}

/// The digests in a checkpoint's `state.json`; the trainer defines the other fields of that file.
#[derive(Deserialize)]
pub(super) struct CheckpointDigests {
    files: BTreeMap<String, String>,
}

impl Digested for CheckpointDigests {
    const NAME: &'static str = "state.json";
    const TO_DO: &'static str =
        "delete the checkpoint's folder: `glasshouse train` resumes from the previous checkpoint";
    const NEEDS_FILES: bool = true;

    fn files(&self) -> Vec<&str> {
        self.files.keys().map(String::as_str).collect()
    }

    fn compare(&self, name: &str, bytes: &[u8]) -> Result<(), String> {
        let digest = blake3::hash(bytes).to_hex();
        let expected = self.files.get(name).map_or("", String::as_str);
        same(&digest, expected, Self::NAME)
    }
}
