//! What can go wrong while something is measured.

use procedural::SampleError;
use render::atomic_file::WriteError;
use render::formats::SceneError;
use render::merge::MergeError;
use render::scene::{AssembleError, LoadError};
use std::path::PathBuf;

/// Why a benchmark could not be done.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A built-in photograph could not be coded.
    #[error(transparent)]
    Sample(#[from] SampleError),
    /// A scene's files cannot be used.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// A scene cannot be traced.
    #[error(transparent)]
    Assemble(#[from] AssembleError),
    /// A rendering is not whole or not finite.
    #[error(transparent)]
    Merge(#[from] MergeError),
    /// A result cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// An EXR cannot be coded.
    #[error("cannot encode {name}.exr: {reason}")]
    Encode { name: &'static str, reason: String },
    /// A reference image is missing.
    #[error("no reference for {layer} in {}: give a folder with {layer}.exr or ref_{layer}.npy", dir.display())]
    NoReference { layer: &'static str, dir: PathBuf },
    /// A reference image cannot be read.
    #[error("cannot read {}: {source}; check the folder given to --reference", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// A reference image cannot be used.
    #[error(transparent)]
    Image(#[from] SceneError),
    /// A reference image has another size than the film.
    #[error("{} has {found_width} x {found_height} px, the scene's film {width} x {height}: give references of that size", path.display())]
    Size {
        path: PathBuf,
        /// Its pixels across.
        found_width: usize,
        /// Its pixels down.
        found_height: usize,
        /// The film's pixels across.
        width: u32,
        /// The film's pixels down.
        height: u32,
    },
}
