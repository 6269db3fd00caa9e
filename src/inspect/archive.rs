//! Inspects tar archives in the WebDataset convention: members with equal names up to the first dot form a sample.

use super::facts::{Inspection, Problem, first_of};
use super::kind::Kind;
use crate::text::many;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read};

/// Remedy for a damaged archive.
const EXPORT: &str = "`glasshouse export RUN --format webdataset` makes it again";
/// Maximum number of bytes that are read from a sample's record.
const MAX_RECORD_BYTES: u64 = 1 << 24;
const SHOWN: usize = 3;

/// Inspects an archive of `length` bytes, in one pass over its headers and records.
pub(super) fn read(bytes: impl Read, length: u64) -> Inspection {
    let mut found = Inspection::new(Kind::Archive);
    found.bytes = Some(length);
    let mut samples = Samples::default();
    if let Err(error) = members(bytes, &mut samples) {
        let what = format!("it is truncated, or the rest is no tar archive: {error}");
        let place = format!("after {}", many(samples.members, "member"));
        found.wrong(Problem::new(what, EXPORT).at(place));
    }
    samples.say(&mut found);
    found.may_be_whole("`sha256sum -c SHA256SUMS` compares its bytes");
    found
}

fn members(stream: impl Read, samples: &mut Samples) -> io::Result<()> {
    let mut archive = tar::Archive::new(stream);
    for entry in archive.entries()? {
        let mut entry = entry?;
        let path = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        if !entry.header().entry_type().is_file() {
            continue;
        }
        let mut record = Vec::new();
        if path.rsplit('.').next() == Some("json") {
            (&mut entry).take(MAX_RECORD_BYTES).read_to_end(&mut record)?;
        }
        samples.add(&path, &record);
    }
    Ok(())
}

#[derive(Default)]
struct Samples {
    members: u64,
    samples: BTreeMap<String, Sample>,
}

#[derive(Default)]
struct Sample {
    endings: BTreeSet<String>,
    /// Layers in the sample's record, if it can be read.
    layers: Option<Vec<String>>,
}

impl Samples {
    fn add(&mut self, path: &str, record: &[u8]) {
        self.members += 1;
        let name = path.rfind('/').map_or(0, |slash| slash + 1);
        let dot = path[name..].find('.').map_or(path.len(), |dot| name + dot);
        let sample = self.samples.entry(path[..dot].to_owned()).or_default();
        let ending = path[dot..].trim_start_matches('.');
        sample.endings.insert(ending.to_owned());
        if ending == "json" {
            let record = serde_json::from_slice::<Value>(record).unwrap_or_default();
            let layers = record["layers"].as_object();
            sample.layers = layers.map(|layers| layers.keys().cloned().collect());
        }
    }

    fn say(&self, found: &mut Inspection) {
        let all: BTreeSet<&String> = self.samples.values().flat_map(|s| &s.endings).collect();
        let mut complete = 0;
        for (key, sample) in &self.samples {
            let missing = sample.missing(&all);
            if missing.is_empty() {
                complete += 1;
            } else {
                let problem = Problem::new(format!("it lacks {}", missing.join(", ")), EXPORT);
                found.wrong(problem.at(format!("sample {key}")));
            }
        }
        let (facts, count) = (&mut found.facts, self.samples.len());
        facts.fact("members", many(self.members, "file"), self.members);
        let text = format!("{}, {complete} of them complete", many(count as u64, "sample"));
        facts.fact("samples", text, count);
        facts.put("complete", complete);
        let keys: Vec<&String> = self.samples.keys().collect();
        facts.fact("keys", first_of(&keys, SHOWN), json!(keys[..count.min(SHOWN)]));
        facts.value("each_has", json!(all));
    }
}

impl Sample {
    /// Lists the layers of the record that have no picture; without a record, the endings that only other samples have.
    fn missing<'a>(&'a self, all: &BTreeSet<&'a String>) -> Vec<&'a str> {
        let has = |layer: &str| self.endings.iter().any(|e| e.starts_with(&format!("{layer}.")));
        if let Some(layers) = &self.layers {
            return layers.iter().filter(|l| !has(l)).map(String::as_str).collect();
        }
        let missing = all.iter().filter(|e| !self.endings.contains(**e));
        missing.map(|e| e.as_str()).collect()
    }
}
