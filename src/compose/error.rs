//! Why pictures cannot be evaluated.

use render::formats::limits::{MAX_PIXELS, MAX_SIDE};
use std::io;
use std::path::PathBuf;

/// Why a picture cannot be read, or two not be compared.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// A file or folder that cannot be read.
    #[error("cannot read {}: {source}; check the path and its permissions", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Bytes that are no picture.
    #[error("cannot read {} as a PNG or JPEG picture: {reason}; fetch or export it again", path.display())]
    Picture {
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// Larger than the limits, or without pixels.
    #[error(
        "{} has {width} x {height} px; pictures have 1 to {MAX_SIDE} px a side and at most {MAX_PIXELS} in all",
        path.display()
    )]
    Size { path: PathBuf, width: u32, height: u32 },
    /// What shows through it is not in the file.
    #[error(
        "{} is transparent in places; flatten it onto a background and save it without an alpha channel",
        path.display()
    )]
    Transparent { path: PathBuf },
    /// Two pictures that do not fit onto each other.
    #[error(
        "a picture of {} x {} px cannot be compared with one of {} x {} px; crop or scale one of them to the other's size",
        a[0], a[1], b[0], b[1]
    )]
    SizesDiffer {
        /// Columns and rows of the first.
        a: [u32; 2],
        /// Columns and rows of the second.
        b: [u32; 2],
    },
    #[error("a picture without pixels cannot be compared; give one with at least 1 x 1 px")]
    Empty,
    /// Pictures cannot be read any more.
    #[error(transparent)]
    Subject(Box<dyn std::error::Error + Send + Sync>),
    /// A method made no picture.
    #[error(transparent)]
    Method(Box<dyn std::error::Error + Send + Sync>),
    /// No folder layout that is known.
    #[error(
        "{} holds no picture with its truth ({left_out_count} pictures without a partner); give a folder with blended/ and transmission_layer/, with NAME-input.png and NAME-label1.png, or with SIR2's m.jpg and g.jpg",
        path.display()
    )]
    NoPairs {
        path: PathBuf,
        /// Pictures that were found and not understood.
        left_out_count: usize,
    },
}
