//! Whether a scene's tuple is done.

use super::keys;
use crate::store::{Store, StoreError};
use render::line::SceneLine;
use render::merge::{is_record_of, tuple_files};

/// Whether the store has all files of the scene's tuple, made from this line by this version of the tracer.
pub(crate) fn is_done(store: &Store, line: &SceneLine) -> Result<bool, StoreError> {
    let Some(record) = store.get(&keys::tuple_record(&line.id))? else {
        return Ok(false);
    };
    Ok(is_record_of(&record, line)
        && store.has_files(&keys::tuple_folder(&line.id), &tuple_files(line))?)
}
