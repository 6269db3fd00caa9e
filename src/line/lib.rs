//! A scene line: all parameters of one scene, resolved, checked, and written as one line of JSON.
//!
//! ```text
//! scene_line -> side -> photograph, panorama -> image, highlights, depth_range   the line's types
//! glass, coating, roughness, wave, smudges, outline   the pane, its layers, faces and edges
//! card         flat pictures on a side
//! sensor       camera of the photographs
//! layers       images to render               side_json, jsonl   sides and manifests as text
//! roots        resolution of paths            validate     rules between keys
//! keys, limits, param   what a declared key gives: ranges, a recipe's distributions, draws, rows of tables
//! glazing, focus        words of recipes for several keys      schema, table   for editors and readers
//! ```
//!
//! ```
//! use glasshouse_line::{Focus, parse_scene};
//!
//! let side = r#"{"panorama": "room.exr", "transfer": "linear", "depth_m": 4}"#;
//! let line = parse_scene(&format!(r#"{{
//!     "schema": "glasshouse.scene/1", "id": "000412", "seed": 412,
//!     "film": {{"width": 256, "height": 256, "spp": 256}},
//!     "camera": {{"focal_length_mm": 55, "aperture_radius_m": 0.009, "focus": {{"distance_m": 7}}}},
//!     "glass": {{"distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6}},
//!     "front": {side}, "back": {side}}}"#))?;
//! assert_eq!(line.camera.focus, Focus::Distance { distance_m: 7.0 });
//! assert_eq!(line.front.name(), "room.exr");
//! # Ok::<(), glasshouse_line::ManifestError>(())
//! ```

mod card;
mod coating;
pub mod color;
pub mod curve;
mod depth_range;
mod error;
mod focus;
mod glass;
mod glazing;
pub mod hash;
mod highlights;
pub mod ids;
mod image;
mod jsonl;
pub mod keys;
pub mod label;
pub mod layer;
mod layers;
pub mod limits;
#[cfg(test)]
mod limits_tests;
mod outline;
mod panorama;
pub mod param;
mod photograph;
mod published;
mod roots;
mod roughness;
mod scene_line;
pub mod schema;
mod sensor;
mod side;
mod side_json;
mod sketch;
mod smudges;
pub mod table;
mod validate;
mod wave;

pub use card::Card;
pub use coating::{FaceCoating, Shares};
pub use depth_range::DepthRange;
pub use error::LineError;
pub use focus::{Focus, FocusAt, FocusRecipe};
pub use glass::{Glass, GlassLayer, GlassRecipe};
pub use glazing::{Glazing, GlazingName, Glazings, KnownGlazing, glazings};
pub use highlights::Highlights;
pub use image::{Apex, DepthKind, Fill, Intrinsics, Orientation, Transfer, one};
pub use jsonl::{ManifestError, parse_jsonl, parse_scene, to_jsonl};
pub use layers::LayerSet;
pub use outline::{Outline, OutlineRecipe};
pub use panorama::{DepthMap, PanoramaDepth, PanoramaFile};
pub use photograph::Photograph;
pub use published::published;
pub use roots::{RootError, Roots, is_root_name, is_url};
pub use roughness::Roughness;
pub use scene_line::*;
pub use sensor::{Mosaic, SENSOR_VERSION, Sensor, SensorExposure, Subsampling, Tone};
pub use side::{MeshFile, MeshPose, Side, card_key};
pub use sketch::{CAMERA_HEIGHT_M, HORIZON, Sketch};
pub use smudges::{SmudgePattern, SmudgeRecipe, Smudges};
pub use validate::side as validate_side;
pub use wave::{MAX_WAVE_SLOPE, Wave, WaveRecipe};
