//! The one place where a scene's files are read; decoding them is pure.

use super::{
    AssembleError, NamedBytes, PhotographFiles, SceneError, SceneFacts, Sheet, assemble,
    decode_photograph,
};
use crate::manifest::{Photograph, RootError, Roots, SceneLine};
use crate::trace::Scene;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Why a scene cannot be made from its files: a reason for quarantine.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A path leads nowhere.
    #[error(transparent)]
    Root(#[from] RootError),
    /// A file cannot be read.
    #[error("cannot read {}: {source}; check the path and the roots (--root NAME=DIR)", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file's content cannot be used.
    #[error(transparent)]
    Decode(#[from] SceneError),
    /// The parts do not make a scene.
    #[error(transparent)]
    Assemble(#[from] AssembleError),
}

/// The bytes of a scene's files.
pub struct SceneFiles {
    /// Of the front photograph.
    pub front: PhotographFiles,
    /// Of the back photograph.
    pub back: PhotographFiles,
}

/// A scene's photographs, decoded, and the digests of their files.
#[derive(Clone)]
pub struct DecodedScene {
    /// Seen through the pane.
    pub front: Sheet,
    /// Seen reflected in it.
    pub back: Sheet,
    /// Of the files.
    pub inputs: InputDigests,
}

/// Digests (BLAKE3, hex) of a scene's input files, by the manifest line's field (`front.color`, ...).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct InputDigests(pub BTreeMap<String, String>);

/// A scene that can be traced, and what is known about it.
pub struct LoadedScene {
    /// For the tracer.
    pub scene: Scene,
    /// For the record.
    pub facts: SceneFacts,
    /// Of the files it was made from.
    pub inputs: InputDigests,
}

/// Reads all of a scene's files. Paths are relative to `base` or under a named root.
pub fn read_files(line: &SceneLine, roots: &Roots, base: &Path) -> Result<SceneFiles, LoadError> {
    let read = |text: &str| -> Result<NamedBytes, LoadError> {
        let path = roots.resolve(base, text)?;
        match std::fs::read(&path) {
            Ok(bytes) => Ok(NamedBytes { path, bytes }),
            Err(source) => Err(LoadError::Read { path, source }),
        }
    };
    let photograph = |p: &Photograph| -> Result<PhotographFiles, LoadError> {
        Ok(PhotographFiles {
            color: read(&p.color)?,
            depth: read(&p.depth)?,
            mask: p.mask.as_deref().map(read).transpose()?,
        })
    };
    Ok(SceneFiles {
        front: photograph(&line.front)?,
        back: photograph(&line.back)?,
    })
}

/// Decodes the files and assembles the scene. Pure.
pub fn load(line: &SceneLine, files: &SceneFiles) -> Result<LoadedScene, LoadError> {
    let decoded = decode(line, files)?;
    let (scene, facts) = assemble(line, decoded.front, decoded.back)?;
    Ok(LoadedScene {
        scene,
        facts,
        inputs: decoded.inputs,
    })
}

/// The first half of [`load`], for who assembles several scenes from the same photographs.
pub fn decode(line: &SceneLine, files: &SceneFiles) -> Result<DecodedScene, LoadError> {
    Ok(DecodedScene {
        front: decode_photograph(&line.front, &files.front)?,
        back: decode_photograph(&line.back, &files.back)?,
        inputs: digests(files),
    })
}

fn digests(files: &SceneFiles) -> InputDigests {
    let mut digests = BTreeMap::new();
    for (side, photograph) in [("front", &files.front), ("back", &files.back)] {
        let parts = [
            ("color", Some(&photograph.color)),
            ("depth", Some(&photograph.depth)),
            ("mask", photograph.mask.as_ref()),
        ];
        for (part, file) in parts {
            if let Some(file) = file {
                let digest = blake3::hash(&file.bytes).to_hex().to_string();
                digests.insert(format!("{side}.{part}"), digest);
            }
        }
    }
    InputDigests(digests)
}
