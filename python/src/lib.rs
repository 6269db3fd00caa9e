//! The extension module `glasshouse._native`. `python/glasshouse` wraps its functions; see the stubs in `_native.pyi`.
//!
//! ```text
//! planning.rs    recipe, manifest or run -> scene lines      scenes.rs     scene lines -> layers, by engine.rs
//! stored.rs      files of a tuple -> layers                  sampler.rs    tuples of a run -> examples of a trainer
//! process.rs     state of a process; calls that signals interrupt        arrays.rs    vectors as arrays
//! weights.rs     weights of new networks, with the Cargo feature `train`
//! ```
//!
//! Python's lock is free during all work. Threads are those of this module, made at the first call in a process.

#![expect(clippy::needless_pass_by_value, reason = "Python's arguments become owned values")]

mod arrays;
mod engine;
mod errors;
mod planning;
mod process;
mod sampler;
mod scenes;
mod stored;
#[cfg(feature = "train")]
mod weights;

use pyo3::prelude::*;

#[pymodule]
mod _native {
    use super::Bound;
    use super::{PyModule, PyResult};
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::errors::{GlasshouseError, SceneError};
    #[pymodule_export]
    use super::planning::{plan_lines, run_lines};
    #[pymodule_export]
    use super::sampler::{Sampler, train_settings};
    #[pymodule_export]
    use super::scenes::Scenes;
    #[pymodule_export]
    use super::stored::{blake3, read_tuple};
    #[cfg(feature = "train")]
    #[pymodule_export]
    use super::weights::initial_weights;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("TRACER_VERSION", render::trace::TRACER_VERSION)
    }
}
