//! Previews a drawn scene at up to 64 px and 16 samples per pixel, to set exposures and white balance or to reject it.
//!
//! ```text
//! auto_expose.rs   sets exposures and white balance of the scene line
//! images.rs        the preview and its measures       rules.rs   the `[reject]` bounds of a recipe
//! ```
//!
//! The module is pure: a scene gets equal numbers on all machines.

mod auto_expose;
mod images;
mod rules;

pub(crate) use auto_expose::{ExposureError, auto_expose};
