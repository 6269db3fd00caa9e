//! A scene whose shards are all there: its files are encoded one by one, by any thread that is free.

use super::active_task::ActiveTask;
use crate::farm::FarmError;
use crate::farm::tuples::encode_noise;
use crate::run::AccessError;
use render::color::SrgbEncoder;
use render::merge::{Tuple, encode_tuple_file, tuple_files};
use std::sync::{Arc, Mutex};

/// A tuple in memory and those of its files that are encoded.
pub(super) struct FinishedScene<'a> {
    pub(super) task: Arc<ActiveTask<'a>>,
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
    pub(super) fn new(task: Arc<ActiveTask<'a>>, tuple: Tuple) -> Self {
        let names = tuple_files(task.job.line);
        Self {
            task,
            encoded: Mutex::new(vec![None; names.len() + usize::from(!tuple.noise.is_empty())]),
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

    /// Encodes a file; returns all of them after the last one.
    pub(super) fn encode(
        &self,
        file: usize,
        encoder: &SrgbEncoder,
    ) -> Result<Option<Encoded>, FarmError> {
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
