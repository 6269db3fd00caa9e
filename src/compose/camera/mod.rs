//! The camera: from linear layers to the photographs that it would save.
//!
//! ```text
//! layers --meter--> factor --blur--> photosites (inverse matrix, balance, mosaic) --expose--> numbers (noise, well, bits)
//!   numbers --demosaic--> planes --balance, matrix--> linear sRGB --tone--> codes --scale, sharpen--> 8 bits --> JPEG, PNG
//! ```
//!
//! The transmission and the reflection of a mixture pass the same camera with the decisions that it took for the mixture, but
//! without noise, converter and JPEG: they are what the photograph would show without the other layer and with all light of
//! many equal exposures.
//!
//! Noise is a function of the seed, row and column of a photosite; no result depends on the machine.

mod demosaic;
mod developing;
mod dng;
mod exposing;
mod matrix;
mod philox;
mod photons;
mod shot;

pub use dng::encode_dng;
pub use matrix::{inverse as matrix_inverse, product as matrix_product};
pub(crate) use photons::prepare as prepare_photons;
pub use shot::Shot;

#[cfg(test)]
mod tests;
