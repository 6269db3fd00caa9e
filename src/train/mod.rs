//! Stage 8: tuples become networks that take reflections away (begun: what networks are made of; no command uses it yet).
//!
//! ```text
//! ops/        what candle computes slowly or with wrong gradients, made right
//! vgg.rs         frozen features of images       adam.rs     the optimiser, its state in reach
//! generator.rs   what SP-net and BT-net share     random.rs   random numbers by seed and name
//! mixture.rs     pairs mixed as images, to compare rendered tuples with
//! ```

pub mod ops;

mod adam;
mod generator;
mod mixture;
mod random;
mod vgg;

pub use adam::{Adam, AdamOptions, Moments};
pub use generator::{DILATIONS, Generator, GeneratorOptions, Start};
pub use mixture::{
    CeilnetDraw, Mixture, MixtureError, MixtureRecipe, Planes, ZhangDraw, ceilnet, zhang,
};
pub use random::Stream;
pub use vgg::{VGG_PLACES, VGG_WIDTHS, Vgg, VggError};
