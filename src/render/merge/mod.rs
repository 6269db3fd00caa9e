//! Stage 6: a scene's partials become a tuple.

mod combine;
mod moves;
mod noise;
mod read;
mod tuple;
mod write;

pub use combine::{MergeError, combine};
pub use noise::NoiseMap;
pub use read::{check_png, decode_tuple_exr};
pub use tuple::{LayerRecord, TUPLE_SCHEMA, Tuple, TupleRecord};
pub use write::{
    TupleWriteError, encode_png, encode_png16, encode_tuple_exr, encode_tuple_file, is_record_of,
    is_written, tuple_files, write_tuple,
};
