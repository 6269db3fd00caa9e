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
mod batch;
mod discriminator;
mod example;
mod generator;
mod learner;
mod loss;
mod random;
mod settings;
mod vgg;

pub use adam::{Adam, AdamOptions, Moments};
pub use batch::Batch;
pub use discriminator::Discriminator;
pub use example::{Cut, Example, Planes};
pub use generator::{DILATIONS, Generator, GeneratorOptions, SLOPE, Start};
pub use learner::{Lap, Learner, StepLosses, Term};
pub use loss::{FEATURE_DIVISORS, believed, feature_difference, l1, told_apart};
pub use random::Stream;
pub use settings::{ExampleKind, FeatureSource, PixelSource, SettingError, Stage, TrainSettings};
pub use vgg::{VGG_PLACES, VGG_WIDTHS, Vgg, VggError};

#[cfg(test)]
mod step_tests;
