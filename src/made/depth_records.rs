//! Digests of pictures and their depth maps: `made.jsonl` in the folder of `depth`.

use super::{Made, MadeError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the list. The last line of a picture counts.
pub(crate) const DEPTH_RECORDS: &str = "made.jsonl";
/// Schema of each line of [`DEPTH_RECORDS`].
pub(crate) const DEPTH_RECORD_SCHEMA: &str = "glasshouse.depth_map/1";

/// Digests of a picture, its link and its depth map: a line of [`DEPTH_RECORDS`].
#[derive(Serialize, Deserialize)]
pub(crate) struct DepthRecord {
    pub(crate) schema: String,
    /// Path relative to the folder of pictures.
    pub(crate) picture: String,
    #[serde(flatten)]
    pub(crate) made: Made,
}

/// Reads the digests of a folder of depth maps, by picture. Leaves out lines that a killed process left unfinished.
pub(crate) fn depth_records(out: &Path) -> Result<BTreeMap<String, Made>, MadeError> {
    let path = out.join(DEPTH_RECORDS);
    let text = render::input_file::read_if_there(&path)
        .map_err(|source| MadeError::Read { path, source })?
        .unwrap_or_default();
    let lines = text.split(|byte| *byte == b'\n');
    let records = lines.filter_map(|line| serde_json::from_slice::<DepthRecord>(line).ok());
    let of_schema = records.filter(|record| record.schema == DEPTH_RECORD_SCHEMA);
    Ok(of_schema.map(|record| (record.picture, record.made)).collect())
}
