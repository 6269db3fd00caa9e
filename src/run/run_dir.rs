//! A run directory: names of its files, and opening one.

use crate::store::Inputs;
use render::ids::SceneId;
use render::line::{ManifestError, RootError, Roots, SceneLine, is_url, parse_jsonl};
use render::shard::{SPEC_SCHEMA, ShardLayout, Spec, manifest_digest};
use render::trace::TRACER_VERSION;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// Where a run's files stand. The same names are the keys of an object store.
#[derive(Clone, Debug)]
pub struct RunDir {
    root: PathBuf,
}

impl RunDir {
    /// The run in `root`.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// Its folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// `spec.json`
    pub fn spec(&self) -> PathBuf {
        self.root.join("spec.json")
    }

    /// `manifest.jsonl`
    pub fn manifest(&self) -> PathBuf {
        self.root.join("manifest.jsonl")
    }

    /// `rejected.jsonl`: draws that were looked at and not kept.
    pub fn rejected(&self) -> PathBuf {
        self.root.join("rejected.jsonl")
    }

    /// Folder of a scene's partials.
    pub fn partials(&self, scene: &SceneId) -> PathBuf {
        self.root.join("partials").join(scene.as_str())
    }

    /// A shard's partial.
    pub fn partial(&self, scene: &SceneId, shard: u32) -> PathBuf {
        self.partials(scene).join(format!("{shard:06}.exr"))
    }

    /// Folder of a scene's tuple.
    pub fn tuple(&self, scene: &SceneId) -> PathBuf {
        self.root.join("tuples").join(scene.as_str())
    }

    /// Folder of the reasons for quarantine.
    pub fn quarantine_folder(&self) -> PathBuf {
        self.root.join("quarantine")
    }

    /// A scene's reason for quarantine.
    pub fn quarantine(&self, scene: &SceneId) -> PathBuf {
        self.quarantine_folder().join(format!("{scene}.json"))
    }

    /// Folder of procedural photographs made by `plan`, by source.
    pub fn inputs(&self, source: &str) -> PathBuf {
        self.root.join("inputs").join(source)
    }

    /// `report/`
    pub fn report(&self) -> PathBuf {
        self.root.join("report")
    }
}

/// A run that cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// No run there.
    #[error("{} is no run: it has no {missing}; make one with `glasshouse plan RECIPE --out {}`", root.display(), root.display())]
    Missing {
        /// The folder.
        root: PathBuf,
        /// Which file.
        missing: &'static str,
    },
    /// A file cannot be read.
    #[error("cannot read {}: {source}; check the folder and its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// `spec.json` is damaged, or a file beside it is no text.
    #[error("{} is damaged: {reason}; plan the run again into a new folder", path.display())]
    Spec {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// `manifest.jsonl` is damaged.
    #[error("{}: {source}", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ManifestError,
    },
    /// Made by, or for, another version.
    #[error("{} disagrees with this program: {reason}; finish it with the version that planned it, or plan again into a new folder", root.display())]
    Disagrees {
        /// The folder.
        root: PathBuf,
        /// How.
        reason: String,
    },
    /// A root of the spec is unusable.
    #[error(transparent)]
    Root(#[from] RootError),
    /// Another process is at work in it.
    #[error("another process is working on {}; wait for it, or stop it", root.display())]
    Busy {
        /// The folder.
        root: PathBuf,
    },
}

/// An open run.
#[derive(Debug)]
pub struct Run {
    /// Where.
    pub dir: RunDir,
    /// Its rules.
    pub spec: Spec,
    /// Its scenes.
    pub lines: Vec<SceneLine>,
    /// Named folders: the spec's, overridden by the user's.
    pub roots: Roots,
    /// Reads its scenes' files.
    pub inputs: Inputs,
}

impl Run {
    /// Opens a planned run. `given` roots override the spec's.
    pub fn open(root: &Path, given: &Roots) -> Result<Self, RunError> {
        let dir = RunDir::new(root);
        let read = |path: PathBuf, missing: &'static str| match std::fs::read_to_string(&path) {
            Ok(text) => Ok(text),
            Err(e) if e.kind() == io::ErrorKind::InvalidData => Err(RunError::Spec {
                path,
                reason: e.to_string(),
            }),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Err(RunError::Missing {
                root: root.to_owned(),
                missing,
            }),
            Err(source) => Err(RunError::Read { path, source }),
        };
        let spec_text = read(dir.spec(), "spec.json")?;
        let spec: Spec = serde_json::from_str(&spec_text).map_err(|e| RunError::Spec {
            path: dir.spec(),
            reason: e.to_string(),
        })?;
        let manifest = match read(dir.manifest(), "manifest.jsonl") {
            // Planning writes the spec last: without its manifest it is half of a run, not none.
            Err(RunError::Missing { .. }) => {
                return Err(RunError::Spec {
                    path: dir.spec(),
                    reason: "manifest.jsonl, which belongs to it, is gone".to_owned(),
                });
            }
            other => other?,
        };
        let disagrees = |reason: String| {
            Err(RunError::Disagrees {
                root: root.to_owned(),
                reason,
            })
        };
        if spec.schema != SPEC_SCHEMA {
            return disagrees(format!(
                "its spec has schema {:?}, not {SPEC_SCHEMA:?}",
                spec.schema
            ));
        }
        if spec.tracer_version != TRACER_VERSION {
            return disagrees(format!(
                "tracer_version is {} in the run and {TRACER_VERSION} in this program",
                spec.tracer_version
            ));
        }
        if spec.manifest_blake3 != manifest_digest(&manifest) {
            return disagrees(
                "manifest.jsonl is not the one that spec.json was made for".to_owned(),
            );
        }
        let lines = parse_jsonl(&manifest).map_err(|source| RunError::Manifest {
            path: dir.manifest(),
            source,
        })?;
        let mut roots = given.clone();
        for (name, folder) in &spec.roots {
            if roots.get(name).is_none() {
                // Relative folders are the run's own and move with it.
                let is_own = !is_url(folder);
                let folder = folder.clone();
                roots.insert(name, if is_own { root.join(folder) } else { folder })?;
            }
        }
        Ok(Self {
            dir,
            spec,
            lines,
            roots,
            inputs: Inputs::default(),
        })
    }

    /// Names the run among others: the first bytes of its spec's digest.
    pub fn id(&self) -> [u8; 8] {
        let spec = serde_json::to_vec(&self.spec).expect("a spec is JSON");
        let digest = blake3::hash(&spec);
        digest.as_bytes()[..8]
            .try_into()
            .expect("a digest has 32 bytes")
    }

    /// The cut of a scene.
    pub fn layout(&self, line: &SceneLine) -> ShardLayout {
        ShardLayout::of(line, self.spec.tile_px)
    }

    /// Claims the run for this process until the lock is dropped.
    pub fn lock(&self) -> Result<File, RunError> {
        let path = self.dir.root().join("work.lock");
        let file = File::options()
            .create(true)
            .append(true)
            .open(&path)
            .map_err(|source| RunError::Read {
                path: path.clone(),
                source,
            })?;
        match file.try_lock() {
            Ok(()) => Ok(file),
            Err(TryLockError::WouldBlock) => Err(RunError::Busy {
                root: self.dir.root().to_owned(),
            }),
            Err(TryLockError::Error(source)) => Err(RunError::Read { path, source }),
        }
    }
}
