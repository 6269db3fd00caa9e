//! Stage 8: tuples become networks that take reflections away (begun: what networks are made of; no command uses it yet).
//!
//! ```text
//! ops/               what candle computes slowly or with wrong gradients, made right
//! vgg.rs             frozen features of images         loss.rs     what is minimised
//! generator.rs       what SP-net and BT-net share       adam.rs     the optimiser, its state in reach
//! discriminator.rs   who tells real from made           random.rs   random numbers by seed and name
//! ```

pub mod ops;

mod adam;
mod discriminator;
mod generator;
mod loss;
mod random;
mod vgg;

pub use adam::{Adam, AdamOptions, Moments};
pub use discriminator::Discriminator;
pub use generator::{DILATIONS, Generator, GeneratorOptions, Start};
pub use loss::{FEATURE_DIVISORS, believed, feature_loss, l1, told_apart};
pub use random::Stream;
pub use vgg::{VGG_PLACES, VGG_WIDTHS, Vgg, VggError};
