//! The tuples to learn from, wherever a run keeps them.

use crate::ids::SceneId;
use bytes::Bytes;
use std::error::Error;

/// Why the place that holds the tuples gave no answer.
pub type TupleFilesError = Box<dyn Error + Send + Sync>;

/// The files of a run's tuples.
pub trait TupleFiles: Send + Sync {
    /// A file of a scene's tuple; `None` if there is no such file (yet).
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Bytes>, TupleFilesError>;

    /// The scene gets no tuple until it is retried.
    fn is_quarantined(&self, scene: &SceneId) -> Result<bool, TupleFilesError>;

    /// How many of these scenes have a tuple.
    fn count(&self, scenes: &[SceneId]) -> Result<usize, TupleFilesError>;
}
