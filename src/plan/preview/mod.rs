//! A cheap look at a scene before it is farmed: 64 px and 16 samples tell how bright it is and whether it is worth farming.
//!
//! ```text
//! meter.rs    how bright a photograph is            settle.rs   exposures and white balance, as numbers of the scene line
//! look.rs     the four small pictures, measured     judge.rs    whether a scene keeps to a recipe's bounds
//! ```
//!
//! Pure: the same scene, the same numbers, on any machine.

mod rules;
mod images;
mod meter;
mod auto_expose;

pub(crate) use auto_expose::{SettleError, settle};
