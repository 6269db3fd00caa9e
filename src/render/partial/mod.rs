//! Partials: results of shards, and their files.
//!
//! A partial is an uncompressed OpenEXR file. Its data window is the shard's tile, its display window is the film, and
//! 36 float channels hold each layer's mean and the means of the first half and the first quarter of its samples (for
//! the error estimate, see [`crate::trace::square_error`]); labels have channels of their own (`coverage.Y`). The header attribute `glasshouse` holds the rest as JSON.
//! Readers reject a partial that does not match its digest or that no tracer can have made; its shard is then traced again.
//!
//! A second attribute, `glasshouse_maker`, names the [`Maker`]. It stands beside the digest and not in it, so partials of
//! the same shard by two workers are equal in digest and pixels, and differ only in this attribute.
//!
//! ```
//! let torn = render::partial::decode("partials/a/0007.exr".as_ref(), b"v/1");
//! let error = torn.unwrap_err().to_string();
//! assert!(error.starts_with("partial partials/a/0007.exr is not usable"));
//! ```

mod exr_file;
mod header;
mod maker;
mod sense;

pub use exr_file::{PartialError, decode, encode};
pub use header::{PARTIAL_SCHEMA, PartialHeader};
pub use maker::Maker;

use crate::trace::PixelMeans;
use glasshouse_line::label::LabelImages;

#[derive(Clone, Debug, PartialEq)]
pub struct Partial {
    pub header: PartialHeader,
    /// Pixels of the tile, row by row.
    pub pixels: Vec<PixelMeans>,
    /// Labels of the tile.
    pub labels: LabelImages,
    /// The worker that traced the shard; `None` if it is unknown, as in files of earlier versions. The digest does not
    /// cover it.
    pub maker: Option<Maker>,
}

impl Partial {
    /// Makes a partial without a maker and computes its digest.
    pub fn new(mut header: PartialHeader, pixels: Vec<PixelMeans>, labels: LabelImages) -> Self {
        header.blake3 = digest(&header, &pixels, &labels);
        Self { header, pixels, labels, maker: None }
    }

    /// Encodes the partial with a freshly computed digest.
    pub fn seal(&self) -> Result<Vec<u8>, exr::error::Error> {
        let blake3 = digest(&self.header, &self.pixels, &self.labels);
        let header = PartialHeader { blake3, ..self.header.clone() };
        exr_file::encode_as(&header, self)
    }

    /// True if the digest matches the content.
    pub fn is_intact(&self) -> bool {
        self.header.blake3 == digest(&self.header, &self.pixels, &self.labels)
    }
}

/// Number of pixels that are hashed at once.
const HASHED_PIXELS: usize = 512;

/// Computes the BLAKE3 digest (hex) of a header without its digest, of the pixels' bits and of the labels' bits.
fn digest(header: &PartialHeader, pixels: &[PixelMeans], labels: &LabelImages) -> String {
    let bare = PartialHeader { blake3: String::new(), ..header.clone() };
    let mut hasher = blake3::Hasher::new();
    hasher.update(bare.to_json().as_bytes());
    // A block is small enough for the cache and large enough for the parallelism of BLAKE3.
    let mut bytes = Vec::with_capacity(HASHED_PIXELS * size_of::<PixelMeans>());
    for block in pixels.chunks(HASHED_PIXELS) {
        bytes.clear();
        for pixel in block {
            for part in [&pixel.mean, &pixel.half, &pixel.quarter] {
                for value in part.as_flattened() {
                    bytes.extend_from_slice(&value.to_le_bytes());
                }
            }
        }
        hasher.update(&bytes);
    }
    for (label, values) in labels {
        hasher.update(label.name().as_bytes());
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        hasher.update(&bytes);
    }
    hasher.finalize().to_hex().to_string()
}
