//! Tar archives, as WebDataset reads them: members whose names share what stands before the first dot are a sample.

use super::facts::{Inspection, Problem, first_of, many};
use super::kind::Kind;
use super::sums;
use serde_json::json;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read};

/// What to do about a damaged shard.
const EXPORT: &str = "`glasshouse export RUN --format webdataset` makes it again";
/// Longest member that is looked into; longer ones are only counted.
const MAX_MEMBER_BYTES: u64 = 1 << 28;
/// An archive ends with two blocks of zeros.
const END_ZEROS: u64 = 1024;
/// Keys that are shown.
const SHOWN: usize = 3;

/// A stream that is digested while it is read.
struct Digested<R> {
    inner: R,
    digest: Sha256,
    bytes: u64,
    /// Zeros in a row at the end of what was read.
    zeros: u64,
}

impl<R: Read> Read for Digested<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.digest.update(&buffer[..count]);
        self.bytes += count as u64;
        let zeros = buffer[..count]
            .iter()
            .rev()
            .take_while(|byte| **byte == 0)
            .count();
        self.zeros = if zeros == count {
            self.zeros + zeros as u64
        } else {
            zeros as u64
        };
        Ok(count)
    }
}

/// Explains an archive of `length` bytes, in one pass.
pub(super) fn read(
    bytes: impl Read,
    length: u64,
    name: &str,
    beside: &dyn Fn(&str) -> Option<Vec<u8>>,
) -> Inspection {
    let mut found = Inspection::new(Kind::Archive);
    found.bytes = Some(length);
    let mut stream = Digested {
        inner: bytes,
        digest: Sha256::new(),
        bytes: 0,
        zeros: 0,
    };
    let mut samples = Samples::default();
    if let Err(error) = members(&mut stream, &mut samples, &mut found) {
        let problem = Problem::new(
            format!("it is cut, or no tar archive from there on: {error}"),
            EXPORT,
        );
        found.wrong(problem.at(format!("byte {}", stream.bytes)));
    }
    if let Err(error) = io::copy(&mut stream, &mut io::sink()) {
        found.wrong(Problem::new(
            format!("it cannot be read to its end: {error}"),
            EXPORT,
        ));
    }
    if stream.zeros < END_ZEROS && found.is_sound() {
        let what = "it is cut between two members: it does not end with zeros, as archives do";
        found.wrong(Problem::new(what, EXPORT));
    }
    let digest = sums::hex(&stream.digest.finalize());
    samples.say(&mut found);
    found.facts.fact("sha256", digest.as_str(), digest.as_str());
    let listed = beside("SHA256SUMS").map(|sums| String::from_utf8_lossy(&sums).into_owned());
    let expected = listed.as_deref().and_then(|text| {
        let mut lines = text.lines().filter_map(sums::line);
        lines.find(|(_, of)| *of == name).map(|(digest, _)| digest)
    });
    match expected {
        Some(expected) if expected.eq_ignore_ascii_case(&digest) => {
            found.is_whole("its digest is that of SHA256SUMS");
        }
        Some(_) => found.wrong(Problem::new(
            "its digest is not that of SHA256SUMS beside it",
            EXPORT,
        )),
        None => found.may_be_whole(
            "every member and picture can be read; no SHA256SUMS beside it holds its digest",
        ),
    }
    found
}

fn members(
    stream: &mut impl Read,
    samples: &mut Samples,
    found: &mut Inspection,
) -> io::Result<()> {
    let mut archive = tar::Archive::new(stream);
    for entry in archive.entries()? {
        let mut entry = entry?;
        let path = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        if !entry.header().entry_type().is_file() {
            continue;
        }
        let size = entry.size();
        if size > MAX_MEMBER_BYTES {
            let read = io::copy(&mut entry, &mut io::sink())?;
            if read < size {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            samples.add(&path, &[]);
            continue;
        }
        // As long as what is there, not as what the header claims.
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < size {
            return Err(io::Error::new(
                io::ErrorKind::UnexpectedEof,
                format!("member {path} is cut"),
            ));
        }
        if let Some(reason) = wrong_with(&path, &bytes) {
            found.wrong(Problem::new(reason, EXPORT).at(format!("member {path}")));
        }
        samples.add(&path, &bytes);
    }
    Ok(())
}

/// What is wrong with a member's bytes.
fn wrong_with(path: &str, bytes: &[u8]) -> Option<String> {
    let ending = path.rsplit('.').next();
    if ending == Some("png") {
        let image =
            image::ImageReader::with_format(io::Cursor::new(bytes), image::ImageFormat::Png);
        return image
            .decode()
            .err()
            .map(|error| format!("its PNG cannot be read: {error}"));
    }
    if ending == Some("json") {
        let read = serde_json::from_slice::<serde::de::IgnoredAny>(bytes);
        return read
            .err()
            .map(|error| format!("its JSON cannot be read: {error}"));
    }
    None
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
