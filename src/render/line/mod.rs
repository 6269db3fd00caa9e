//! A scene line: everything that determines one scene, resolved, checked, and written as one line of JSON.
//!
//! ```text
//! scene_line, side, side_json, panorama, highlights, depth_range   the line's types      layers    which images are made
//! jsonl                                                            manifests as text     roots     where a line's paths lead
//! validate, limits, refuse                                         which lines are sound, which panes cannot be looked through
//! ```

mod depth_range;
mod highlights;
mod jsonl;
mod layers;
pub mod limits;
mod panorama;
mod refuse;
mod roots;
mod scene_line;
mod side;
mod side_json;
mod validate;

pub use depth_range::DepthRange;
pub use highlights::Highlights;
pub use jsonl::{ManifestError, parse_jsonl, parse_scene, to_jsonl};
pub use layers::{LAYER_NAMES, LayerSet};
pub use panorama::{DepthMap, PanoramaDepth, PanoramaFile};
pub use refuse::{MAX_INCIDENCE_DEG, refuse};
pub use roots::{RootError, Roots, is_root_name, is_url};
pub use scene_line::*;
pub use side::{MeshFile, MeshPose, Side};
pub use validate::{LineError, side as validate_side};
