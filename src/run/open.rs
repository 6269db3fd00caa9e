//! Opens and locks a run.

use super::error::RunError;
use super::keys;
use crate::store::Inputs;
use glasshouse_line::{Roots, SceneLine, is_url, parse_jsonl};
use render::folder_lock::FolderLock;
use render::shard::{SPEC_SCHEMA, ShardLayout, Spec, manifest_digest};
use render::trace::TRACER_VERSION;
use std::io;
use std::path::{Path, PathBuf};

#[derive(Debug)]
pub struct Run {
    root: PathBuf,
    pub spec: Spec,
    pub lines: Vec<SceneLine>,
    /// Roots of the input files: the spec's, overridden by the user's.
    pub roots: Roots,
    /// Reader of the scenes' files.
    pub inputs: Inputs,
}

impl Run {
    /// Opens a planned run to make tuples. `given` roots override the spec's.
    pub fn open(root: &Path, given: &Roots) -> Result<Self, RunError> {
        let run = Self::open_to_read(root, given)?;
        if run.spec.tracer_version == TRACER_VERSION {
            return Ok(run);
        }
        Err(Self::other_version(root, run.spec.tracer_version))
    }

    fn other_version(root: &Path, version: u32) -> RunError {
        let reason =
            format!("tracer_version is {version} in the run and {TRACER_VERSION} in this program");
        RunError::Disagrees { root: root.to_owned(), reason }
    }

    /// Opens a planned run to read its tuples, which an older version of the tracer may have made.
    pub fn open_to_read(root: &Path, given: &Roots) -> Result<Self, RunError> {
        let damaged = |reason: String| RunError::Spec { path: root.join(keys::SPEC), reason };
        let text = read(root, keys::SPEC)?;
        let spec: Spec = serde_json::from_str(&text).map_err(|e| damaged(e.to_string()))?;
        let manifest = match read(root, keys::MANIFEST) {
            // Planning writes the spec last: a spec without its manifest is a damaged run.
            Err(RunError::Missing { .. }) => {
                return Err(damaged("its manifest.jsonl is missing".to_owned()));
            }
            other => other?,
        };
        let disagrees = |reason: String| Err(RunError::Disagrees { root: root.to_owned(), reason });
        if spec.schema != SPEC_SCHEMA {
            return disagrees(format!(
                "its spec has schema {:?}, not {SPEC_SCHEMA:?}",
                spec.schema
            ));
        }
        if spec.tracer_version > TRACER_VERSION {
            return Err(Self::other_version(root, spec.tracer_version));
        }
        if spec.manifest_blake3 != manifest_digest(&manifest) {
            return disagrees("manifest.jsonl does not have the digest in spec.json".to_owned());
        }
        let lines = parse_jsonl(&manifest)
            .map_err(|source| RunError::Manifest { path: root.join(keys::MANIFEST), source })?;
        if spec.scenes as usize != lines.len() {
            return disagrees(format!(
                "spec.json has {} scenes, and manifest.jsonl {}",
                spec.scenes,
                lines.len()
            ));
        }
        ShardLayout::check(&lines, spec.tile_px).map_err(|e| damaged(e.to_string()))?;
        let mut roots = given.clone();
        for (name, folder) in &spec.roots {
            if roots.get(name).is_none() {
                // Relative paths start at the run's folder and move with it.
                let folder = if is_url(folder) { folder.clone() } else { root.join(folder) };
                roots.insert(name, folder)?;
            }
        }
        Ok(Self { root: root.to_owned(), spec, lines, roots, inputs: Inputs::default() })
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the path of a key in the run's folder.
    pub fn path(&self, key: &str) -> PathBuf {
        self.root.join(key)
    }

    /// Returns the run's identity: the first eight bytes of its spec's digest.
    pub fn id(&self) -> [u8; 8] {
        let spec = serde_json::to_vec(&self.spec).expect("a spec is JSON");
        let digest = blake3::hash(&spec);
        digest.as_bytes()[..8].try_into().expect("a digest has 32 bytes")
    }

    /// Returns the division of a scene into shards.
    pub fn layout(&self, line: &SceneLine) -> ShardLayout {
        ShardLayout::of(line, self.spec.tile_px)
    }

    /// Returns the number of shards of each scene.
    pub fn shard_counts(&self) -> Vec<u32> {
        self.lines.iter().map(|line| self.layout(line).len()).collect()
    }

    /// Locks the run for this process until the returned lock is dropped.
    pub fn lock(&self) -> Result<FolderLock, RunError> {
        lock(&self.root)
    }

    /// Fails if another process may have locked the run, because the lock's file is not the one that was locked.
    pub(crate) fn check_lock(&self, lock: &FolderLock) -> Result<(), RunError> {
        if lock.is_in_place() {
            return Ok(());
        }
        Err(RunError::Changed { path: self.path(keys::LOCK) })
    }

    /// Fails if spec or manifest changed since the run was opened.
    pub(crate) fn check_unchanged(&self) -> Result<(), RunError> {
        let changed = |key: &str| RunError::Changed { path: self.path(key) };
        let text = |key| match read(&self.root, key) {
            // The disk fails; the file may be as it was.
            Err(error @ RunError::Read { .. }) => Err(error),
            text => Ok(text.ok()),
        };
        let spec = text(keys::SPEC)?.and_then(|text| serde_json::from_str::<Spec>(&text).ok());
        if spec.as_ref() != Some(&self.spec) {
            return Err(changed(keys::SPEC));
        }
        let manifest = text(keys::MANIFEST)?;
        if manifest.is_none_or(|text| manifest_digest(&text) != self.spec.manifest_blake3) {
            return Err(changed(keys::MANIFEST));
        }
        Ok(())
    }
}

/// Locks a run's folder for this process until the returned lock is dropped.
pub(super) fn lock(root: &Path) -> Result<FolderLock, RunError> {
    let path = root.join(keys::LOCK);
    match FolderLock::try_new(&path) {
        Ok(lock) => lock.ok_or_else(|| RunError::Busy { root: root.to_owned() }),
        Err(source) if source.kind() == io::ErrorKind::Unsupported => {
            Err(RunError::Disk { root: root.to_owned(), source })
        }
        Err(source) => Err(RunError::Read { path, source }),
    }
}

fn read(root: &Path, file: &'static str) -> Result<String, RunError> {
    let path = root.join(file);
    render::input_file::read_to_string(&path).map_err(|source| match source.kind() {
        io::ErrorKind::InvalidData => RunError::Spec { path, reason: source.to_string() },
        io::ErrorKind::NotFound => RunError::Missing { root: root.to_owned(), missing: file },
        _ => RunError::Read { path, source },
    })
}
