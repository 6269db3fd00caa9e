//! Previews a scene at 64 px and 16 samples, before it is traced in full: for exposures, white balance and rejection.
//!
//! ```text
//! auto_expose.rs   sets exposures and white balance of the scene line
//! images.rs        the preview and its measures       rules.rs   the `[reject]` bounds of a recipe
//! ```
//!
//! Pure: a scene's numbers are equal on all machines.

mod auto_expose;
mod images;
mod rules;

pub(crate) use auto_expose::{ExposureError, auto_expose};
