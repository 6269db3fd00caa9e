//! Whether a result belongs to its present input.
//!
//! Commands that resume record the BLAKE3 digests of the files that a result was made of, and of its own files ([`Made`]). A later
//! call compares them with the present files ([`Digests::differences`]). It reads a file again only if its size, times or inode are
//! not those for which [`DIGESTS_FILE`] has a digest. This file is a memory: without it, all bytes are read.

mod depth_records;
mod files;

pub(crate) use depth_records::{DEPTH_RECORD_SCHEMA, DEPTH_RECORDS, DepthRecord, depth_records};
pub(crate) use files::MadeError;
pub(crate) use files::{Files, Stamp};

use render::atomic_file;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::sync::{Mutex, MutexGuard};

/// Digests of files, in the folder of the results.
pub(crate) const DIGESTS_FILE: &str = ".glasshouse-digests.json";
/// Schema of [`DIGESTS_FILE`].
pub(crate) const DIGESTS_SCHEMA: &str = "glasshouse.digests/1";
/// Largest number of files in a message.
const SHOWN: usize = 3;

/// Digests (BLAKE3, hex) of the files that a result was made of, and of its own files, by name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Made {
    pub(crate) of: BTreeMap<String, String>,
    pub(crate) files: BTreeMap<String, String>,
}

/// A file that is not the one of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Difference {
    /// An input changed.
    Input(String),
    /// An input is missing.
    InputGone(String),
    /// A file of the result was changed or damaged.
    File(String),
    /// A file of the result is missing.
    FileGone(String),
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(name) => write!(f, "{name} changed since"),
            Self::File(name) => write!(f, "{name} is damaged or of another program"),
            Self::InputGone(name) | Self::FileGone(name) => write!(f, "{name} is missing"),
        }
    }
}

/// Results of earlier calls that a call makes again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Remade {
    /// Number of results.
    pub count: u64,
    /// Why, in the order of the results.
    pub because: Vec<String>,
}

impl Remade {
    pub(crate) fn is_none(&self) -> bool {
        self.because.is_empty()
    }

    /// Counts results that are made again, and adds the reasons.
    pub(crate) fn add(&mut self, count: u64, differences: &[Difference]) {
        self.count += count;
        self.because.extend(differences.iter().map(Difference::to_string));
    }
}

impl fmt::Display for Remade {
    /// Names the first three files.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = self.because.len().min(SHOWN);
        match self.count {
            0 => f.write_str("the lists were made again")?,
            count => write!(f, "{count} made again")?,
        }
        write!(f, ", because {}", self.because[..shown].join(", "))?;
        match self.because.len() - shown {
            0 => Ok(()),
            more => write!(f, ", and {more} more"),
        }
    }
}

/// Digests of files, remembered for as long as their stamps stay.
pub(crate) struct Digests {
    known: Mutex<Known>,
    /// True to read every file.
    is_verifying: bool,
}

/// Content of [`DIGESTS_FILE`].
#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Known {
    schema: String,
    /// Stamp and BLAKE3 of files, by folder and name.
    files: BTreeMap<String, (Stamp, String)>,
    /// True if the file lacks one of these.
    #[serde(skip)]
    is_new: bool,
}

impl Digests {
    /// Reads the memory of a folder of results. A damaged one is forgotten.
    pub(crate) fn open(folder: &Path, is_verifying: bool) -> Self {
        let json = render::input_file::read(&folder.join(DIGESTS_FILE)).unwrap_or_default();
        let known = serde_json::from_slice::<Known>(&json).ok();
        let known = known.filter(|known| known.schema == DIGESTS_SCHEMA).unwrap_or_default();
        Self { known: Mutex::new(known), is_verifying }
    }

    /// Writes the memory. A file that changed a moment ago is left out: within a tick of its disk's clock, it may change again and
    /// keep its stamp.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), atomic_file::WriteError> {
        let mut known = self.known();
        if !known.is_new {
            return Ok(());
        }
        DIGESTS_SCHEMA.clone_into(&mut known.schema);
        known.files.retain(|_, (stamp, _)| stamp.is_settled());
        let json = serde_json::to_vec(&*known).expect("texts and numbers are JSON");
        known.is_new = false;
        atomic_file::write(&folder.join(DIGESTS_FILE), &json)
    }

    /// Returns the BLAKE3 (hex) of a file; `None` if it does not exist.
    pub(crate) fn of(&self, files: &Files, name: &str) -> Result<Option<String>, MadeError> {
        let Some(stamp) = files.stamp(name)? else { return Ok(None) };
        let key = files.key(name);
        if !self.is_verifying
            && let Some((known, digest)) = self.known().files.get(&key)
            && *known == stamp
        {
            return Ok(Some(digest.clone()));
        }
        let Some(digest) = files.digest(name)? else { return Ok(None) };
        self.remember(files, name, Some(stamp), &digest);
        Ok(Some(digest))
    }

    /// Remembers the BLAKE3 (hex) of a file that had this stamp before it was read, or right after it was written.
    pub(crate) fn remember(&self, files: &Files, name: &str, stamp: Option<Stamp>, digest: &str) {
        let Some(stamp) = stamp else { return };
        let mut known = self.known();
        known.is_new = true;
        known.files.insert(files.key(name), (stamp, digest.to_owned()));
    }

    /// Compares a result's record with its present inputs `of` and its present `files`. Returns each file that differs; none if the result
    /// still belongs to its inputs.
    pub(crate) fn differences(
        &self,
        made: &Made,
        of: &Files,
        files: &Files,
    ) -> Result<Vec<Difference>, MadeError> {
        let mut found = Vec::new();
        for (name, digest) in &made.of {
            match self.of(of, name)? {
                None => found.push(Difference::InputGone(name.clone())),
                Some(present) if present != *digest => found.push(Difference::Input(name.clone())),
                Some(_) => {}
            }
        }
        for (name, digest) in &made.files {
            match self.of(files, name)? {
                None => found.push(Difference::FileGone(name.clone())),
                Some(present) if present != *digest => found.push(Difference::File(name.clone())),
                Some(_) => {}
            }
        }
        Ok(found)
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().expect("no holder of this lock panics")
    }
}

/// Returns a digest as in [`Made`].
pub(crate) fn digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

#[cfg(test)]
mod tests;
