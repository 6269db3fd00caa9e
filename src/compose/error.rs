//! Errors of the evaluation.

use render::formats::SceneError;
use std::io;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    #[error("cannot read {}: {source}; check the path and its permissions", path.display())]
    Read { path: PathBuf, source: io::Error },
    /// A picture that is damaged, too large, or of colours that cannot be converted.
    #[error(transparent)]
    Picture(#[from] SceneError),
    #[error(
        "{} has transparent pixels; flatten it onto a background and save it without an alpha channel",
        path.display()
    )]
    Transparent { path: PathBuf },
    #[error(
        "a picture of {} x {} px cannot be compared with one of {} x {} px; crop or scale one of them to the other's size",
        a[0], a[1], b[0], b[1]
    )]
    SizesDiffer { a: [u32; 2], b: [u32; 2] },
    #[error("a picture without pixels cannot be compared; give one with at least 1 x 1 px")]
    Empty,
    #[error(transparent)]
    Subject(Box<dyn std::error::Error + Send + Sync>),
    #[error(transparent)]
    Method(Box<dyn std::error::Error + Send + Sync>),
    #[error(
        "{} has no picture with ground truth ({left_out_count} files or folders left out); give a folder with blended/ and transmission_layer/, with NAME-input.png and NAME-label1.png, or with SIR2's m.jpg and g.jpg",
        path.display()
    )]
    NoPairs { path: PathBuf, left_out_count: usize },
    #[error("{image} was readable at first, but not again: {reason}; run the command again")]
    Changed { image: String, reason: String },
    #[error("cannot use the index {}: {reason}", path.display())]
    Index { path: PathBuf, reason: String },
}
