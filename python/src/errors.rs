//! Exceptions of the module.

use glasshouse_line::ids::SceneId;
use pyo3::prelude::*;
use pyo3::{create_exception, exceptions::PyException};
use std::fmt::Display;

create_exception!(
    glasshouse,
    GlasshouseError,
    PyException,
    "An input that cannot be used. The text names the file, the reason and the remedy."
);
create_exception!(
    glasshouse,
    SceneError,
    GlasshouseError,
    "A scene that cannot be rendered. `scene` is its id."
);

/// Makes a [`GlasshouseError`].
pub(crate) fn error(text: impl Display) -> PyErr {
    GlasshouseError::new_err(text.to_string())
}

/// A scene that cannot be rendered.
#[derive(Clone, Debug)]
pub(crate) struct BadScene {
    pub(crate) id: SceneId,
    pub(crate) reason: String,
}

impl BadScene {
    pub(crate) fn to_error(&self, py: Python<'_>) -> PyErr {
        let error = SceneError::new_err(format!("scene {}: {}", self.id, self.reason));
        match error.value(py).setattr("scene", self.id.to_string()) {
            Ok(()) => error,
            Err(other) => other,
        }
    }
}
