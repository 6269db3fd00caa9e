//! `[sources.NAME]` of a recipe: where photographs come from.

use render::line::DepthRange;
use render::line::Highlights;
use render::line::{DepthKind, Fill, Intrinsics, Transfer, one};
use schemars::JsonSchema;
use serde::Deserialize;
use std::fmt;

/// How a source's files are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// A DIODE folder.
    Diode,
    /// Procedural photographs in DIODE's layout, made on the fly.
    Sample,
    /// A PLACES365 folder with estimated depth.
    Places,
    /// Photographs that a list names, one JSON object a line.
    List,
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Diode => "diode",
            Self::Sample => "sample",
            Self::Places => "places",
            Self::List => "list",
        })
    }
}

/// `[sources.NAME]`
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// How the files are laid out.
    pub layout: Layout,
    /// Folder relative to the recipe, unless `--root NAME=DIR` says where. Default: the source's name.
    /// Not for `sample`.
    pub root: Option<String>,
    /// `sample` alone: photographs to make.
    pub count: Option<u32>,
    /// `sample` alone: seed of the photographs. Default: the recipe's seed.
    pub seed: Option<u64>,
    /// `sample` alone: pixels across. Default 1024.
    pub width: Option<u32>,
    /// `sample` alone: pixels down. Default 768.
    pub height: Option<u32>,
    /// `places` alone: table of mean depths by category.
    pub depth_ranges: Option<String>,
    /// `list` alone: the list, relative to the recipe; `photographs.jsonl` in the root if missing. Its lines say what
    /// the keys below say of all photographs of other sources.
    pub list: Option<String>,
    /// Capture camera. Default: DIODE's, for images of the same field of view.
    #[serde(default = "Intrinsics::diode")]
    pub intrinsics: Intrinsics,
    /// Coding of the colour images. Default srgb.
    #[serde(default)]
    pub transfer: Transfer,
    /// Metres per unit of the depth files. Default 1.
    #[serde(default = "one")]
    pub depth_unit_m: f64,
    /// What the depth files measure. Default z.
    #[serde(default)]
    pub depth_kind: DepthKind,
    /// Metres for relative depths; of `places` the table of categories has them.
    pub depth_range: Option<DepthRange>,
    /// `places`: folder of the depth maps, relative to the recipe; `NAME-depth` if missing.
    pub depth_root: Option<String>,
    /// Light for clipped sRGB values. Default none.
    pub highlights: Option<Highlights>,
    /// How holes are filled. Default smooth.
    #[serde(default)]
    pub fill: Fill,
}

impl Source {
    /// Size of a `sample` source's photographs, px.
    pub fn sample_size(&self) -> [u32; 2] {
        [self.width.unwrap_or(1024), self.height.unwrap_or(768)]
    }
}
