//! What can be typed after `export`.

use super::farm_args::StoreArgs;
use super::split_name::SplitName;
use crate::export::{ExportFormat, PixelEncoding};
use clap::{Args as ClapArgs, ValueEnum};
use std::path::PathBuf;

/// `--format`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FormatName {
    /// Tars for the WebDataset library.
    Webdataset,
    /// Hugging Face's imagefolder.
    Imagefolder,
    /// Folders of pictures as published sets of pairs have them.
    Pairs,
    /// A multi-part OpenEXR file a tuple.
    Exr,
}

impl From<FormatName> for ExportFormat {
    fn from(name: FormatName) -> Self {
        match name {
            FormatName::Webdataset => Self::Webdataset,
            FormatName::Imagefolder => Self::Imagefolder,
            FormatName::Pairs => Self::Pairs,
            FormatName::Exr => Self::Exr,
        }
    }
}

/// `--encoding`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EncodingName {
    /// The tuples' own PNGs, byte by byte.
    Srgb8,
    /// PNGs of 16-bit sRGB codes, from the tuples' EXRs.
    Srgb16,
    /// OpenEXR files, linear and not clipped.
    Linear,
}

impl From<EncodingName> for PixelEncoding {
    fn from(name: EncodingName) -> Self {
        match name {
            EncodingName::Srgb8 => Self::Srgb8,
            EncodingName::Srgb16 => Self::Srgb16,
            EncodingName::Linear => Self::Linear,
        }
    }
}

/// `export`
#[derive(Debug, ClapArgs)]
pub struct ExportArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// What is to read it
    #[arg(long, value_enum)]
    pub format: FormatName,
    /// Folder of the export: a new one, or one in which this export was begun
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How pixels are stored [default: srgb8; of exr: linear]
    #[arg(long, value_enum)]
    pub encoding: Option<EncodingName>,
    /// Which scenes
    #[arg(long, value_enum, default_value = "all")]
    pub split: SplitName,
    /// Largest WebDataset shard, MB (1e6 bytes); a larger tuple has one for itself
    #[arg(long, value_name = "MB", default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub shard_mb: u32,
    /// Export what is merged of a run that is not finished
    #[arg(long)]
    pub partial: bool,
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
}

impl ExportArgs {
    /// As typed, or what the format has.
    pub(super) fn encoding(&self) -> PixelEncoding {
        match (self.encoding, self.format) {
            (Some(encoding), _) => encoding.into(),
            (None, FormatName::Exr) => PixelEncoding::Linear,
            (None, _) => PixelEncoding::Srgb8,
        }
    }
}
