//! Stage 6: a scene's partials become a tuple.

mod combine;
mod moves;
mod noise;
mod read;
mod srgb;
mod tuple;
mod write;

pub use combine::{MergeError, combine};
pub use noise::NoiseMap;
pub use read::{ExrChannels, check_png, decode_exr_channels, decode_tuple_exr};
pub use srgb::{SrgbEncoder, linear_to_srgb, linear_to_srgb16, srgb_to_linear};
pub use tuple::{LayerRecord, TUPLE_SCHEMA, Tuple, TupleRecord};
pub use write::{
    TupleWriteError, encode_parts_exr, encode_png, encode_png16, encode_rgb_exr, encode_tuple_exr,
    encode_tuple_file, is_record_of, is_written, tuple_files, write_tuple,
};
