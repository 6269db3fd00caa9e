//! A scene line: everything that determines one scene, resolved, checked, and written as one line of JSON.
//!
//! ```text
//! scene_line -> side -> photograph, panorama -> image, highlights, depth_range   the line's types
//! layers       which images are made          side_json, jsonl   sides and manifests as text
//! roots        where a line's paths lead      validate, limits   which lines are sound by themselves
//! ```

mod depth_range;
mod error;
mod highlights;
mod image;
mod jsonl;
mod layers;
pub mod limits;
mod panorama;
mod photograph;
#[cfg(test)]
mod published;
mod roots;
mod scene_line;
mod side;
mod side_json;
mod validate;

pub use depth_range::DepthRange;
pub use error::LineError;
pub use highlights::Highlights;
pub use image::{Apex, DepthKind, Fill, Intrinsics, Transfer, one};
pub use jsonl::{ManifestError, parse_jsonl, parse_scene, to_jsonl};
pub use layers::LayerSet;
pub use panorama::{DepthMap, PanoramaDepth, PanoramaFile};
pub use photograph::Photograph;
pub use roots::{RootError, Roots, is_root_name, is_url};
pub use scene_line::*;
pub use side::{MeshFile, MeshPose, Side};
pub use validate::side as validate_side;

#[cfg(test)]
pub(crate) use published::published;
