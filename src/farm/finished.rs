//! A scene whose shards are all there: its files are encoded one by one, by whoever is free.

use super::error::FarmError;
use super::open_span::OpenSpan;
use crate::run::AccessError;
use crate::run::keys;
use render::merge::{SrgbEncoder, Tuple, encode_tuple_file, tuple_files};
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

/// All that is written of a scene.
pub(super) struct Encoded {
    pub(super) files: Files,
    /// The map of its noise, if it has one.
    pub(super) noise: Option<Vec<u8>>,
}

impl<'a> FinishedScene<'a> {
    pub(super) fn new(span: Arc<OpenSpan<'a>>, tuple: Tuple) -> Self {
        let names = tuple_files(span.job.line);
        Self {
            span,
            encoded: Mutex::new(vec![
                None;
                names.len() + usize::from(!tuple.noise.is_empty())
            ]),
            names,
            tuple,
        }
    }

    /// Files to encode: the tuple's, and its noise map.
    pub(super) fn len(&self) -> usize {
        self.names.len() + usize::from(!self.tuple.noise.is_empty())
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
    ) -> Result<Option<Encoded>, FarmError> {
        // Of a scene that has failed meanwhile nothing is written.
        if self.span.job.has_failed() {
            return Ok(None);
        }
        let bytes = match self.names.get(file) {
            Some(name) => encode_tuple_file(&self.tuple, encoder, name)
                .map_err(|e| AccessError::Tuple(e.to_string()))?,
            None => encode_noise(&self.tuple)?,
        };
        let mut encoded = self.encoded.lock().expect("no holder of this lock panics");
        encoded[file] = Some(bytes);
        if encoded.iter().any(Option::is_none) {
            return Ok(None);
        }
        let mut bytes = encoded.iter_mut().filter_map(Option::take);
        let files = self.names.iter().cloned().zip(bytes.by_ref()).collect();
        let noise = bytes.next();
        Ok(Some(Encoded { files, noise }))
    }
}

/// The bytes of a tuple's noise map.
pub(super) fn encode_noise(tuple: &Tuple) -> Result<Vec<u8>, FarmError> {
    let encoded = tuple.noise.encode();
    encoded.map_err(|e| {
        let key = keys::noise(&tuple.record.scene.id);
        FarmError::from(AccessError::Tuple(format!("cannot encode {key}: {e}")))
    })
}
