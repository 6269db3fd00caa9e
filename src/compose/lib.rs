//! Composes examples for networks, and evaluates networks.
//!
//! [`Composition`] has the distributions of examples that are composed of tuples in linear light.
//!
//! Evaluation finds, reads, scores and tabulates pictures with ground truth:
//!
//! ```text
//! folders, index -> pairs (pictures and their truths) -> picture (8-bit RGB) -> lanczos -> methods -> score -> summary -> table
//!                                                                                `-> align (shift between picture and truth)
//! training examples -> fit (factor, veil rule) -> methods
//! ```
//!
//! [`run`] scores all pictures of a [`Subject`] (a folder of pairs, an index, or the scenes of a run) for every
//! [`Method`]: the unchanged input, the [`Rules`] that a network must beat, oracles that know the truth, networks, and
//! folders of outputs.
//!
//! Papers use different protocols, and their scores are not comparable; `score` computes scores by two protocols. The
//! two photographs of a real pair are not simultaneous, so some pairs are misaligned: `align` finds these pairs, and
//! tables have means with and without them.
//!
//! Only `index`, `outputs`, `pairs` and `picture` access files.

mod align;
mod blur;
mod bootstrap;
mod camera;
mod code_sums;
mod composition;
mod curve;
mod error;
mod factor;
mod fit;
mod index;
mod jpeg;
mod lanczos;
mod layout;
mod markdown;
mod method;
mod outputs;
mod pairs;
mod per_image;
mod picture;
mod quantiles;
mod random;
mod resample;
mod run;
mod score;
mod seeds;
mod ssim;
mod subject;
mod summary;
mod table;
mod tuple_files;
mod veil;

pub use align::{MAX_ALIGNED_SHIFT_PX, Shift, shift_px};
pub use bootstrap::Interval;
pub use camera::{Shot, encode_dng, matrix_inverse, matrix_product};
pub use composition::{
    Camera, ComposedExample, Composition, CompositionError, Cut, Draw, DrawnCamera, DrawnExposure,
    DrawnSensor, DrawnStrength, DrawnTexture, DrawnZhang, Exposure, LUMINANCE, Layer, Layering,
    LinearExample, LinearTuple, LogNormal, Mixtures, PercentileExposure, SharedBytes, Side,
    StoredLayer, Strength, TargetLight, TupleLayers, srgb_code,
};
pub use error::EvaluateError;
pub use factor::{Factor, own_best_factor};
pub use fit::{Baselines, Rules, fit_baselines};
pub use index::{IndexedPairs, read_index};
pub use lanczos::{resize, shrink_to, shrunk_size_px};
pub use layout::picture_stem;
pub use markdown::markdown_table;
pub use method::{GROUP_FACTOR, Given, Method, OWN_FACTOR, Unmade, row_names};
pub use outputs::OutputFolder;
pub use pairs::{Found, Pair, find_pairs};
pub use per_image::{Row, per_image_csv};
pub use picture::{decode_picture, read_photo, read_picture};
pub use quantiles::tukey_deviation;
pub use random::Stream;
pub use run::{Scored, Setting, run};
pub use score::{Scores, psnr_colour_db, score};
pub use seeds::{SeedGroup, Spread};
pub use ssim::ssim_grey;
pub use subject::{LeftOut, Subject, Unread, WithTruth, read_sized};
pub use summary::{ALL, INPUT, MethodSummary, Summary, groups, summaries};
pub use table::{Protocol, means_tables};
pub use tuple_files::{encode_photograph, encode_tuple, encode_tuple_image, write_tuple};
pub use veil::VeilRule;

/// Makes the tables of composition and camera that would otherwise be made at their first use. A process calls this before
/// it starts threads if it may fork later: a child that is forked while a thread makes a table would wait for ever.
pub fn prepare() {
    curve::prepare();
    composition::prepare_codes();
    composition::prepare_powers();
    composition::prepare_textures();
    camera::prepare_photons();
}

#[cfg(test)]
mod tests;
