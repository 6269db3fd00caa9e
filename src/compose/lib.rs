//! Evaluates networks: finds, reads, scores and tabulates pictures with ground truth.
//!
//! ```text
//! folders -> layout, pairs (pictures and their truths) -> picture (8-bit RGB) -> a network -> gain, score -> table
//!                                                               `-> align (shift between picture and truth)
//! ```
//!
//! [`run`] scores all pictures of a [`Subject`] (a folder of pairs, or the scenes of a run) for every [`Method`].
//!
//! Papers use different protocols, and their scores are not comparable; `score` computes scores by two protocols. The
//! two photographs of a real pair are not simultaneous, so some pairs are misaligned: `align` finds these pairs, and
//! tables have means with and without them.
//!
//! Only `pairs` and `picture` access files.

mod align;
mod error;
mod fit_gain;
mod gain;
mod layout;
mod means;
mod pairs;
mod picture;
mod run;
mod score;
mod ssim;
mod subject;
mod table;

pub use align::{MAX_ALIGNED_SHIFT_PX, Shift, shift_px};
pub use error::EvaluateError;
pub use fit_gain::{Gain, fit_gain};
pub use gain::{apply_gain, best_gain};
pub use means::{Means, MethodMeans};
pub use pairs::{Found, Pair, find_pairs};
pub use picture::{decode_picture, read_picture};
pub use run::{Method, Scored, run};
pub use score::{Scores, psnr_colour_db, score};
pub use ssim::ssim_grey;
pub use subject::{LeftOut, Subject, Unread, WithTruth};
pub use table::{Protocol, Row, markdown_table, means_table, per_image_csv};

#[cfg(test)]
mod tests;
