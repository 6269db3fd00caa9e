//! `[sources.NAME]` of a recipe: a set of photographs.

use super::sketch::SketchRecipe;
use glasshouse_line::{
    DepthKind, DepthRange, Fill, Highlights, Intrinsics, Orientation, Transfer, one,
};
use procedural::Place;
use schemars::JsonSchema;
use serde::Deserialize;
use std::fmt;

/// Layout of a source's files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// A DIODE folder.
    Diode,
    /// Procedural photographs in DIODE's layout, rendered while planning.
    Sample,
    /// A PLACES365 folder with estimated depth.
    Places,
    /// A list of photographs, one JSON object per line.
    List,
    /// A tree of pictures without depth.
    Folder,
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Diode => "diode",
            Self::Sample => "sample",
            Self::Places => "places",
            Self::List => "list",
            Self::Folder => "folder",
        })
    }
}

/// `[sources.NAME]`: a set of photographs.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Layout of the folders and file names.
    pub layout: Layout,
    /// Folder relative to the recipe; `--root NAME=DIR` overrides it. Default: the source's name. Not for `sample`.
    pub root: Option<String>,
    /// `sample` only: number of photographs.
    pub count: Option<u32>,
    /// `sample` only: seed of the photographs. Default: the recipe's seed.
    pub seed: Option<u64>,
    /// `sample` only: width, px. Default 1024.
    pub width: Option<u32>,
    /// `sample` only: height, px. Default 768.
    pub height: Option<u32>,
    /// `places` only: path of the table of depth ranges by category, relative to the recipe.
    pub depth_ranges: Option<String>,
    /// `sample` only: surfaces have the texture of stone, bark, cloth or gravel. Default false: they are smooth.
    pub textured: Option<bool>,
    /// `list` only: path of the list, relative to the recipe. Default: `photographs.jsonl` in the root. The lines of
    /// the list have the keys below, except `depth_root`, for each photograph.
    pub list: Option<String>,
    /// `folder` only: the assumed shape of the pictures. Default `"sketch"`.
    pub depth: Option<SketchRecipe>,
    /// `folder` only: the place of all pictures, `"indoors"` or `"outdoor"`. Default: that which a folder's name tells.
    pub place: Option<Place>,
    /// `folder` only: field of view of the longer side, degrees. Default: from the EXIF focal length, or 65.
    pub field_of_view_deg: Option<f64>,
    /// Capture camera. Default: the camera of DIODE, which fits images of the same field of view.
    #[serde(default = "Intrinsics::diode")]
    pub intrinsics: Intrinsics,
    /// Order of the pixels: `upright` applies the EXIF orientation of the files, `stored` ignores it. Default upright.
    #[serde(default)]
    pub orientation: Orientation,
    /// Coding of the colour images. Default srgb.
    #[serde(default)]
    pub transfer: Transfer,
    /// Metres per unit of the depth files. Default 1.
    #[serde(default = "one")]
    pub depth_unit_m: f64,
    /// Value in the depth files that means "no depth", such as 65535. Default none.
    pub depth_none_code: Option<f64>,
    /// Quantity in the depth files. Default z.
    #[serde(default)]
    pub depth_kind: DepthKind,
    /// Metric range of relative depths. Not for `places` (ranges are in the table) or `list` (they are in its lines).
    pub depth_range: Option<DepthRange>,
    /// `places` only: folder of the depth maps, relative to the recipe. Default: `NAME-depth`.
    pub depth_root: Option<String>,
    /// Inverse tone curve for sRGB values near 1. Default none.
    pub highlights: Option<Highlights>,
    /// Method of filling holes. Default smooth.
    #[serde(default)]
    pub fill: Fill,
}

impl Source {
    /// Returns the width and height of a `sample` source's photographs, px.
    pub fn sample_size(&self) -> [u32; 2] {
        [self.width.unwrap_or(1024), self.height.unwrap_or(768)]
    }
}
