//! The request, `export.json`. It is written first and identifies the folder.

use super::error::ExportError;
use super::plan::LeftOut;
use glasshouse_line::Split;
use glasshouse_line::layer::Layer;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Schema name of `export.json`; its version is raised whenever the bytes of an export change.
pub const EXPORT_REQUEST_SCHEMA: &str = "glasshouse.export_request/1";

/// Name of the request's file in the exported folder.
pub(super) const REQUEST_FILE: &str = "export.json";

/// Layout of the exported folder and format of its files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExportFormat {
    /// Tars of the WebDataset library: `SPLIT-000000.tar` with `ID.LAYER.png` (or `.exr`) and `ID.json`.
    Webdataset,
    /// Hugging Face's imagefolder: `SPLIT/metadata.jsonl` and `SPLIT/LAYER/ID.png`.
    Imagefolder,
    /// Folders of published sets: `SPLIT/blended/ID.png` (or `.exr`), ...
    Pairs,
    /// A multi-part OpenEXR file for each tuple: `SPLIT/ID.exr`.
    Exr,
    /// Shards of tensors in the format of safetensors: `SPLIT-000000.safetensors` with `ID.LAYER`, and `SPLIT.jsonl`.
    Safetensors,
}

impl ExportFormat {
    /// Returns the ending of the names of shards, with the dot; `None` for a format with files for each tuple.
    pub(super) fn shard_ending(self) -> Option<&'static str> {
        match self {
            Self::Webdataset => Some(".tar"),
            Self::Safetensors => Some(".safetensors"),
            Self::Imagefolder | Self::Pairs | Self::Exr => None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PixelEncoding {
    /// The tuple's own PNGs, byte for byte: 8-bit sRGB codes, clipped at 1.
    Srgb8,
    /// PNGs of 16-bit sRGB codes, clipped at 1.
    Srgb16,
    /// OpenEXR or tensors, linear, not clipped; half or float as in the tuple.
    Linear,
    /// The tuple's photographs: PNGs of I behind the camera, decoded from its JPEG, and of T and R~ without noise.
    Photograph,
}

impl PixelEncoding {
    /// True if the pixels come from `tuple.exr`.
    pub(super) fn is_of_exr(self) -> bool {
        matches!(self, Self::Srgb16 | Self::Linear)
    }

    /// True if the encoding has a layer (index in [`Layer::ALL`]). No camera sees R.
    pub(super) fn has(self, layer: usize) -> bool {
        self != Self::Photograph || Layer::ALL[layer] != Layer::CleanReflection
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExportRequest {
    /// Always [`EXPORT_REQUEST_SCHEMA`].
    pub schema: String,
    /// Name of the recipe.
    pub name: String,
    /// BLAKE3 of the run's manifest.
    pub manifest_blake3: String,
    pub tracer_version: u32,
    pub format: ExportFormat,
    pub encoding: PixelEncoding,
    /// Exported splits, in the order of [`Split`].
    pub splits: Vec<Split>,
    /// Maximum size of a shard, megabytes (1e6 bytes); a shard with a single tuple may be larger.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shard_mb: Option<u32>,
    /// Scenes that the export leaves out, although they are in its splits.
    pub left_out: Vec<LeftOut>,
}

impl ExportRequest {
    pub(super) fn to_json(&self) -> String {
        let mut json = serde_json::to_string_pretty(self).expect("strings and numbers are JSON");
        json.push('\n');
        json
    }

    /// Describes the differences between `self` (in the folder) and `new`. Ignores scenes that are left out.
    pub(super) fn diff(&self, new: &Self) -> Vec<String> {
        let mut rows = Vec::new();
        let mut row = |what: &str, old: &dyn fmt::Display, new: &dyn fmt::Display| {
            let (old, new) = (old.to_string(), new.to_string());
            if old != new {
                rows.push(format!("{what} {old} there and {new} here"));
            }
        };
        row("schema", &self.schema, &new.schema);
        row("recipe", &self.name, &new.name);
        row("manifest", &short(&self.manifest_blake3), &short(&new.manifest_blake3));
        row("tracer_version", &self.tracer_version, &new.tracer_version);
        row("--format", &self.format, &new.format);
        row("--encoding", &self.encoding, &new.encoding);
        row("--split", &names(&self.splits), &names(&new.splits));
        let mb = |mb: Option<u32>| mb.map_or_else(|| "none".to_owned(), |mb| mb.to_string());
        row("--shard-mb", &mb(self.shard_mb), &mb(new.shard_mb));
        rows
    }
}

/// Refuses invalid combinations of format and encoding.
pub(super) fn check(format: ExportFormat, encoding: PixelEncoding) -> Result<(), ExportError> {
    let reason = match (format, encoding) {
        (ExportFormat::Imagefolder, PixelEncoding::Linear) => {
            "imagefolder has no linear encoding, because `datasets` reads no OpenEXR: use --format webdataset, pairs or exr"
        }
        (
            ExportFormat::Exr,
            PixelEncoding::Srgb8 | PixelEncoding::Srgb16 | PixelEncoding::Photograph,
        ) => {
            "OpenEXR files hold linear light: leave --encoding out, or use --format webdataset, imagefolder or pairs"
        }
        (
            ExportFormat::Safetensors,
            PixelEncoding::Srgb8 | PixelEncoding::Srgb16 | PixelEncoding::Photograph,
        ) => {
            "safetensors hold linear light: leave --encoding out, or use --format webdataset, imagefolder or pairs"
        }
        _ => return Ok(()),
    };
    Err(ExportError::Request(reason.to_owned()))
}

fn short(digest: &str) -> &str {
    digest.get(..16).unwrap_or(digest)
}

fn names(splits: &[Split]) -> String {
    let names: Vec<String> = splits.iter().map(ToString::to_string).collect();
    names.join(" and ")
}

impl fmt::Display for ExportFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Webdataset => "webdataset",
            Self::Imagefolder => "imagefolder",
            Self::Pairs => "pairs",
            Self::Exr => "exr",
            Self::Safetensors => "safetensors",
        })
    }
}

impl fmt::Display for PixelEncoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Srgb8 => "srgb8",
            Self::Srgb16 => "srgb16",
            Self::Linear => "linear",
            Self::Photograph => "photograph",
        })
    }
}
