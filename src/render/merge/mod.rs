//! Merges the partials of a scene into a tuple: four images and their record.
//!
//! ```
//! use render::merge::{MergeError, combine};
//! use render::partial::Partial;
//! # let side = r#"{"panorama": "room.exr", "transfer": "linear", "depth_m": 4}"#;
//! # let line = glasshouse_line::parse_scene(&format!(r#"{{
//! #     "schema": "glasshouse.scene/1", "id": "a", "seed": 1,
//! #     "film": {{"width": 100, "height": 50, "spp": 1024}},
//! #     "camera": {{"focal_length_mm": 55, "aperture_radius_m": 0, "focus": {{"at": "infinity"}}}},
//! #     "glass": {{"distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6}},
//! #     "front": {side}, "back": {side}}}"#))?;
//!
//! // A film of two tiles and four sample ranges has eight shards; none of them is traced.
//! let error = combine::<Partial>(&line, 64, &[]).unwrap_err();
//! assert!(matches!(error, MergeError::Gaps { total: 8, .. }));
//! # Ok::<(), glasshouse_line::ManifestError>(())
//! ```

mod combine;
mod moves;
mod noise;
mod photographs;
mod read;
mod tuple;
mod write;

pub use combine::{MergeError, combine};
pub use noise::NoiseMap;
pub use photographs::{
    PHOTO, PhotographRecord, RAW, metered_factor, percentile, photographed_layer, photographs,
};
pub use read::{check_png, decode_tuple_exr, decode_tuple_labels};
pub use tuple::{
    LabelRecord, LayerRecord, TUPLE_SCHEMA, TUPLE_SCHEMA_1, Tuple, TupleRecord, light_notes,
};
pub use write::{
    TupleWriteError, encode_layer_image, encode_png, encode_png16, encode_rgb8_png,
    encode_tuple_exr, encode_tuple_record, encode_tuple_record_1, is_readable_record_of,
    is_record_of, is_written, tuple_files, tuple_images,
};
