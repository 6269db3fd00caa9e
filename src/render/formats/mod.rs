//! Readers of image, array and mesh files, and writers of OpenEXR and of NumPy arrays.
//!
//! Hostile bytes in a scene's files cause a [`SceneError`], never a panic. Sizes are checked ([`limits`]) before memory
//! of that size is allocated.

pub(crate) mod color_space;
pub(crate) mod error;
pub(crate) mod exr_labels;
pub(crate) mod exr_raster;
pub(crate) mod exr_read;
pub(crate) mod exr_write;
mod exr_zip;
pub(crate) mod files;
mod hdr;
pub(crate) mod icc;
pub(crate) mod jpeg;
pub mod limits;
mod linear_picture;
mod meaning;
pub(crate) mod npy;
pub(crate) mod npy_header;
mod npy_write;
pub(crate) mod npz;
mod other_formats;
pub(crate) mod pfm;
mod photo;
pub(crate) mod ply;
pub(crate) mod ply_header;
pub(crate) mod png_chunks;
pub(crate) mod raster;
mod srgb_picture;
pub(crate) mod tiff_depth;
pub(crate) mod upright;

pub use error::SceneError;
pub use exr_labels::label_precision;
pub use exr_read::{ExrChannels, decode_exr_channels};
pub use exr_write::{encode_parts_exr, encode_rgb_exr};
pub use files::{NamedBytes, PanoramaFiles, PhotographFiles};
pub use icc::ColorError;
pub use linear_picture::{LinearPicture, decode_linear_exr};
pub use npy_header::npy_facts;
pub use npy_write::{encode_npy, extend_floats};
pub use photo::Photo;
pub use ply::ply_counts;
pub use srgb_picture::{SrgbPicture, decode_srgb_picture};
pub use upright::PictureSize;
