//! Errors of the benchmarks.

use procedural::SampleError;
use render::atomic_file::WriteError;
use render::formats::SceneError;
use render::merge::MergeError;
use render::scene::{AssembleError, LoadError};
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    #[error(transparent)]
    Sample(#[from] SampleError),
    #[error(transparent)]
    Load(#[from] LoadError),
    #[error(transparent)]
    Assemble(#[from] AssembleError),
    #[error(transparent)]
    Merge(#[from] MergeError),
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error("cannot encode {name}.exr: {reason}")]
    Encode { name: &'static str, reason: String },
    #[error("no reference for {layer} in {}: give a folder with {layer}.exr or ref_{layer}.npy", dir.display())]
    NoReference { layer: &'static str, dir: PathBuf },
    #[error("cannot read {}: {source}; check the folder given to --reference", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Image(#[from] SceneError),
    #[error("{} has {found_width} x {found_height} px, but the scene's film has {width} x {height}: give references of that size", path.display())]
    Size { path: PathBuf, found_width: usize, found_height: usize, width: u32, height: u32 },
}
