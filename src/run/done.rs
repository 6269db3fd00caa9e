//! Checks whether a scene's tuple is complete.

use super::keys;
use super::open::Run;
use crate::store::{Store, StoreError};
use glasshouse_line::SceneLine;
use render::merge::{is_record_of, tuple_files};

/// True if the store has all files of the scene's tuple, and the run's version of the tracer made them from this line.
pub(crate) fn is_done(run: &Run, store: &Store, line: &SceneLine) -> Result<bool, StoreError> {
    let Some(record) = store.get(&keys::tuple_record(&line.id))? else {
        return Ok(false);
    };
    Ok(is_record_of(&record, line, run.spec.tracer_version)
        && store.has_files(&keys::tuple_folder(&line.id), &tuple_files(line))?)
}
