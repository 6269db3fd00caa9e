//! A cheap look at a scene before it is farmed: 64 px and 16 samples tell how bright it is and whether it is worth farming.
//!
//! ```text
//! meter.rs    how bright a photograph is            settle.rs   exposures and white balance, as numbers of the scene line
//! look.rs     the four small pictures, measured     judge.rs    whether a scene keeps to a recipe's bounds
//! ssim.rs     structural similarity
//! ```
//!
//! Pure: the same scene, the same numbers, on any machine.

mod judge;
mod look;
mod meter;
mod settle;
mod ssim;

pub use judge::{Bound, Measure, reject};
pub use look::{Look, PREVIEW_PX, PREVIEW_SPP};
pub use meter::mean_luminance;
pub use settle::{SettleError, Settled, settle};
pub use ssim::ssim_grey;
