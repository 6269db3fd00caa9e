//! Training examples composed in linear light: a F_i + b R~_j of any two tuples i and j.
//!
//! Light adds, so the front through one pane, F_i = I_i - R~_i, and the reflection of another, R~_j, make a photograph
//! that could have been taken. N tuples make N^2 scenes. For i = j the sum is exact; otherwise only the focus of R~_j is
//! that of another front.
//!
//! ```text
//! settings -> draw (all numbers of an example)
//! layers (tuples as halves) -> cut, resample -> texture -> example (factors, sum) -> exposure -> camera (blur, noise, curve, jpeg)
//!                                              mixture ^ `-> code (nothing drawn: the tuple's bits)
//! ```
//!
//! Examples are functions of the settings, the tuples and two streams of random numbers; no result depends on the
//! machine. All loops have a fixed order, and curves come from tables that `libm` computes.

mod camera;
mod code;
mod cover;
mod cut;
mod draw;
mod example;
mod exposure;
mod layers;
mod mixture;
mod noise;
mod power;
mod sensor;
mod settings;
mod stored;
mod texture;

pub(crate) use code::prepare as prepare_codes;
pub use code::srgb_code;
pub use cut::Cut;
pub use draw::{Draw, DrawnCamera, DrawnExposure, DrawnSensor, DrawnStrength};
pub use example::{ComposedExample, Layering, LinearExample, Side};
pub(crate) use exposure::brightest;
pub use layers::{LUMINANCE, Layer, LinearTuple, TupleLayers};
pub use mixture::DrawnZhang;
pub(crate) use power::prepare as prepare_powers;
pub use settings::{
    Camera, Composition, CompositionError, Exposure, LogNormal, Mixtures, PercentileExposure,
    Strength, TargetLight,
};
pub use stored::{SharedBytes, StoredLayer};
pub use texture::DrawnTexture;
pub(crate) use texture::prepare as prepare_textures;

#[cfg(test)]
mod tests;
