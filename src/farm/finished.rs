//! A scene whose shards are all there: its files are encoded one by one, by whoever is free.

use super::error::FarmError;
use super::open_span::OpenSpan;
use crate::merge::{SrgbEncoder, Tuple, encode_tuple_file, tuple_files};
use std::sync::{Arc, Mutex};

/// A tuple in memory and those of its files that are encoded.
pub(super) struct FinishedScene<'a> {
    pub(super) span: Arc<OpenSpan<'a>>,
    tuple: Tuple,
    names: Vec<String>,
    encoded: Mutex<Vec<Option<Vec<u8>>>>,
}

/// A tuple's files, in the order in which they are written.
pub(super) type Files = Vec<(String, Vec<u8>)>;

impl<'a> FinishedScene<'a> {
    pub(super) fn new(span: Arc<OpenSpan<'a>>, tuple: Tuple) -> Self {
        let names = tuple_files(span.job.line);
        Self {
            span,
            tuple,
            encoded: Mutex::new(vec![None; names.len()]),
            names,
        }
    }

    /// Files to encode.
    pub(super) fn len(&self) -> usize {
        self.names.len()
    }

    /// Of its layers, the largest share of paths that ended beyond a photograph's border.
    pub(super) fn miss_share(&self) -> f64 {
        let layers = self.tuple.record.layers.values();
        layers.map(|layer| layer.miss_share).fold(0.0, f64::max)
    }

    /// Encodes a file; all of them for whoever encodes the last one.
    pub(super) fn encode(
        &self,
        file: usize,
        encoder: &SrgbEncoder,
    ) -> Result<Option<Files>, FarmError> {
        // Of a scene that has failed meanwhile nothing is written.
        if self.span.job.has_failed() {
            return Ok(None);
        }
        let bytes = encode_tuple_file(&self.tuple, encoder, &self.names[file])
            .map_err(|e| FarmError::Tuple(e.to_string()))?;
        let mut encoded = self.encoded.lock().expect("no holder of this lock panics");
        encoded[file] = Some(bytes);
        if encoded.iter().any(Option::is_none) {
            return Ok(None);
        }
        let bytes = encoded.iter_mut().filter_map(Option::take);
        Ok(Some(self.names.iter().cloned().zip(bytes).collect()))
    }
}
