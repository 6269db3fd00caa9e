//! The exported folder: its state, its lock, and the removal of leftovers of killed processes.

use super::error::{ExportError, unreadable};
use super::metadata::LINES_ENDING;
use super::request::{ExportFormat, ExportRequest, REQUEST_FILE};
use crate::made::DIGESTS_FILE;
use render::atomic_file::{self, is_temporary};
use render::folder_lock::FolderLock;
use std::path::{Path, PathBuf};

/// Folder with the lock and the records of complete parts.
pub(super) const STATE_FOLDER: &str = ".export";
/// File with the digests of all exported files. It is written last, so its presence means that the export is complete.
pub(super) const SUMS_FILE: &str = "SHA256SUMS";
pub(super) const CARD_FILE: &str = "README.md";
pub(super) const CROISSANT_FILE: &str = "croissant.json";

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FolderState {
    Empty,
    /// An unfinished export, with the request of its first call.
    Begun(Box<ExportRequest>),
    Complete,
}

/// Finds the state of a folder without writing. Refuses a folder with other contents.
pub fn look(out: &Path, request: &ExportRequest) -> Result<FolderState, ExportError> {
    let foreign = |reason: String| ExportError::Foreign { out: out.to_owned(), reason };
    if out.exists() && !out.is_dir() {
        return Err(foreign("is a file".to_owned()));
    }
    let names = names(out)?;
    if !names.iter().any(|name| name == REQUEST_FILE) {
        // A process that was killed at its start leaves these files.
        let is_ours = |name: &String| name == STATE_FOLDER || is_temporary(Path::new(name));
        return match names.iter().find(|name| !is_ours(name)) {
            None => Ok(FolderState::Empty),
            Some(name) => Err(foreign(format!(
                "is neither empty nor an export: it holds {name} and no {REQUEST_FILE}"
            ))),
        };
    }
    let path = out.join(REQUEST_FILE);
    let text = render::input_file::read(&path).map_err(unreadable(&path))?;
    let there: ExportRequest = serde_json::from_slice(&text)
        .map_err(|e| foreign(format!("has a damaged {REQUEST_FILE}: {e}")))?;
    let diff = there.diff(request);
    if !diff.is_empty() {
        let diff = diff.join(", ");
        return Err(foreign(format!("holds another export: {diff}")));
    }
    if !names.iter().any(|name| name == SUMS_FILE) {
        if let Some(name) = names.iter().find(|name| !is_part(name, request)) {
            return Err(foreign(format!("holds {name}, which is no part of the started export")));
        }
        return Ok(FolderState::Begun(Box::new(there)));
    }
    if there.left_out != request.left_out {
        return Err(foreign(format!(
            "holds a complete export without {} of the run's scenes; this export would leave out {}",
            there.left_out.len(),
            request.left_out.len()
        )));
    }
    Ok(FolderState::Complete)
}

/// Lists the names in a folder, sorted; none if the folder does not exist.
pub(super) fn names(folder: &Path) -> Result<Vec<String>, ExportError> {
    let mut names = Vec::new();
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(names),
        Err(e) => return Err(unreadable(folder)(e)),
    };
    for entry in entries {
        let entry = entry.map_err(unreadable(folder))?;
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

/// True if a started export may contain the name.
fn is_part(name: &str, request: &ExportRequest) -> bool {
    let known = [STATE_FOLDER, REQUEST_FILE, CARD_FILE, CROISSANT_FILE, DIGESTS_FILE];
    known.contains(&name)
        || is_temporary(Path::new(name))
        || request.splits.iter().any(|split| {
            let split = split.to_string();
            let rest = name.strip_prefix(&split);
            rest.is_some_and(|rest| {
                rest.is_empty() || rest == LINES_ENDING || is_shard(rest, request.format)
            })
        })
}

/// True if `rest` has the form `-000000.tar`, with any digits and the ending of the format's shards.
fn is_shard(rest: &str, format: ExportFormat) -> bool {
    let ending = format.shard_ending().unwrap_or_default();
    let number = rest.strip_prefix('-').and_then(|r| r.strip_suffix(ending));
    number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

/// The exported folder, locked by this process.
pub(super) struct ExportFolder {
    root: PathBuf,
    lock: FolderLock,
}

impl ExportFolder {
    /// Locks the folder until the value is dropped, and removes leftovers of killed processes.
    pub(super) fn claim(root: &Path) -> Result<Self, ExportError> {
        let state = root.join(STATE_FOLDER);
        atomic_file::create_dir(&state)?;
        let path = state.join("export.lock");
        let lock = FolderLock::try_new(&path).map_err(unreadable(&path))?;
        let lock = lock.ok_or_else(|| ExportError::Busy { out: root.to_owned() })?;
        let folder = Self { root: root.to_owned(), lock };
        folder.sweep();
        Ok(folder)
    }

    /// Removes leftovers of killed processes and of failed removals.
    pub(super) fn sweep(&self) {
        // Two levels include SPLIT/LAYER/.
        atomic_file::sweep(&self.root, 2, &is_temporary);
    }

    /// Fails if the folder was deleted, moved or replaced since it was locked.
    fn check(&self) -> Result<(), ExportError> {
        if self.lock.is_in_place() {
            return Ok(());
        }
        Err(ExportError::Moved { out: self.root.clone() })
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Removes a file, if it exists.
    pub(super) fn remove(&self, name: &str) -> Result<(), ExportError> {
        self.check()?;
        let path = self.path(name);
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(unreadable(&path)(e)),
            _ => Ok(()),
        }
    }
}
