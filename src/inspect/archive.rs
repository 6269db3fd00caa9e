//! Tar archives, as WebDataset reads them: members whose names agree up to the first dot are a sample.

use super::facts::{Inspection, Problem, first_of, many};
use super::kind::Kind;
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read};

/// What to do about a damaged shard.
const EXPORT: &str = "`glasshouse export RUN --format webdataset` makes it again";
/// Longest record of a sample that is read.
const MAX_RECORD_BYTES: u64 = 1 << 24;
/// Keys that are shown.
const SHOWN: usize = 3;

/// Explains an archive of `length` bytes, in one pass over its headers and records.
pub(super) fn read(bytes: impl Read, length: u64) -> Inspection {
    let mut found = Inspection::new(Kind::Archive);
    found.bytes = Some(length);
    let mut samples = Samples::default();
    if let Err(error) = members(bytes, &mut samples) {
        let what = format!("it is cut, or no tar archive from there on: {error}");
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
            (&mut entry)
                .take(MAX_RECORD_BYTES)
                .read_to_end(&mut record)?;
        }
        samples.add(&path, &record);
    }
    Ok(())
}

/// Members by sample, in the archive's order.
#[derive(Default)]
struct Samples {
    members: u64,
    keys: Vec<String>,
    /// Endings by key.
    endings: BTreeMap<String, BTreeSet<String>>,
    /// Layers that a sample's record says were made, by key.
    layers: BTreeMap<String, Vec<String>>,
}

impl Samples {
    fn add(&mut self, path: &str, bytes: &[u8]) {
        self.members += 1;
        let start = path.rfind('/').map_or(0, |slash| slash + 1);
        let dot = path[start..]
            .find('.')
            .map_or(path.len(), |dot| start + dot);
        let (key, ending) = (&path[..dot], path[dot..].trim_start_matches('.'));
        let endings = self.endings.entry(key.to_owned()).or_default();
        if endings.is_empty() {
            self.keys.push(key.to_owned());
        }
        endings.insert(ending.to_owned());
        if ending == "json"
            && let Ok(record) = serde_json::from_slice::<serde_json::Value>(bytes)
            && let Some(layers) = record["layers"].as_object()
        {
            self.layers
                .insert(key.to_owned(), layers.keys().cloned().collect());
        }
    }

    /// What a sample lacks: pictures of layers that its record names, else what other samples have.
    fn lacks(&self, key: &str, all: &BTreeSet<&String>) -> Vec<String> {
        let endings = &self.endings[key];
        match self.layers.get(key) {
            Some(layers) => {
                let is_there =
                    |layer: &&String| endings.iter().any(|e| e.starts_with(&format!("{layer}.")));
                layers
                    .iter()
                    .filter(|layer| !is_there(layer))
                    .cloned()
                    .collect()
            }
            None => all
                .iter()
                .filter(|e| !endings.contains(**e))
                .map(|e| (*e).clone())
                .collect(),
        }
    }

    fn say(&self, found: &mut Inspection) {
        found
            .facts
            .fact("members", many(self.members, "file"), self.members);
        let all: BTreeSet<&String> = self.endings.values().flatten().collect();
        let whole = self
            .keys
            .iter()
            .filter(|key| self.lacks(key, &all).is_empty())
            .count();
        let text = format!(
            "{}, {whole} of them complete",
            many(self.keys.len() as u64, "sample")
        );
        found.facts.fact("samples", text, self.keys.len());
        found.facts.put("complete", whole);
        found.facts.fact(
            "keys",
            first_of(&self.keys, SHOWN),
            json!(self.keys.iter().take(SHOWN).collect::<Vec<_>>()),
        );
        let names: Vec<&String> = all.iter().copied().collect();
        found
            .facts
            .fact("each_has", first_of(&names, 8), json!(names));
        for key in &self.keys {
            let lacks = self.lacks(key, &all);
            if !lacks.is_empty() {
                let problem = Problem::new(format!("it lacks {}", lacks.join(", ")), EXPORT);
                found.wrong(problem.at(format!("sample {key}")));
            }
        }
    }
}
