//! The values that a worker's threads pass to each other.

use super::tasks::TaskId;
use crate::farm::FarmError;
use crate::farm::tuples::encode_noise;
use crate::run::{AccessError, Makers, Task};
use compose::encode_tuple_image;
use glasshouse_line::SceneLine;
use glasshouse_line::color::SrgbEncoder;
use render::job::SceneJob;
use render::merge::{Tuple, encode_tuple_record, tuple_images};
use render::scene::{LoadError, SceneFiles};
use std::sync::{Arc, Mutex};

/// A task and its scene's files, passed from the prefetch thread to a compute thread.
pub(super) struct Loaded<'a> {
    pub(super) line: &'a SceneLine,
    pub(super) task: TaskId,
    pub(super) leased: Task,
    pub(super) files: Result<SceneFiles, LoadError>,
}

/// A task with a loaded scene.
pub(super) struct ActiveTask<'a> {
    pub(super) id: TaskId,
    pub(super) leased: Task,
    pub(super) job: SceneJob<'a>,
}

/// Work for any compute thread.
pub(super) enum Job<'a> {
    /// Encode a shard's partial for the writer.
    Seal(Arc<ActiveTask<'a>>, u32),
    /// Fetch the shards of other workers.
    Gather(Arc<ActiveTask<'a>>),
    Merge(Arc<ActiveTask<'a>>),
    /// Encode a file of a tuple for the writer.
    Encode(Arc<FinishedScene<'a>>, usize),
}

impl<'a> Job<'a> {
    pub(super) fn task(&self) -> Arc<ActiveTask<'a>> {
        match self {
            Self::Seal(task, _) | Self::Gather(task) | Self::Merge(task) => Arc::clone(task),
            Self::Encode(scene, _) => Arc::clone(&scene.task),
        }
    }
}

/// One band of a shard.
pub(super) struct Band<'a> {
    pub(super) task: Arc<ActiveTask<'a>>,
    pub(super) shard: u32,
    pub(super) index: u32,
}

/// Encoded objects, passed from a compute thread to the writer.
pub(super) struct Order<'a> {
    pub(super) task: Arc<ActiveTask<'a>>,
    pub(super) objects: Objects,
}

pub(super) enum Objects {
    Partial(u32, Vec<u8>),
    Tuple(EncodedTuple),
}

pub(super) struct EncodedTuple {
    /// Names and bytes, in the order of writing.
    pub(super) files: Vec<(String, Vec<u8>)>,
    pub(super) noise: Option<Vec<u8>>,
    /// The makers of the tuple's partials, for its receipt.
    pub(super) makers: Makers,
    /// The largest share, among the layers, of paths that ended beyond a photograph's border.
    pub(super) miss_share: f64,
    /// True if the intrinsics of a photograph are probably wrong.
    pub(super) has_odd_view: bool,
}

/// A scene with all shards in memory. Each of its images is encoded by a separate job, on any compute thread; the job
/// that ends last encodes the record, which has the digests of the images.
pub(super) struct FinishedScene<'a> {
    pub(super) task: Arc<ActiveTask<'a>>,
    tuple: Tuple,
    makers: Makers,
    names: Vec<String>,
    encoded: Mutex<Vec<Option<Vec<u8>>>>,
}

impl<'a> FinishedScene<'a> {
    pub(super) fn new(task: Arc<ActiveTask<'a>>, tuple: Tuple, makers: Makers) -> Self {
        let names = tuple_images(task.job.line);
        let count = names.len() + usize::from(!tuple.noise.is_empty());
        Self { task, encoded: Mutex::new(vec![None; count]), names, tuple, makers }
    }

    /// Returns the number of images: the tuple's, and the noise map if the tuple has one.
    pub(super) fn len(&self) -> usize {
        self.names.len() + usize::from(!self.tuple.noise.is_empty())
    }

    /// Encodes an image. Returns all files once every image is encoded, and `None` before.
    pub(super) fn encode(
        &self,
        file: usize,
        encoder: &SrgbEncoder,
    ) -> Result<Option<EncodedTuple>, FarmError> {
        let bytes = match self.names.get(file) {
            Some(name) => encode_tuple_image(&self.tuple, encoder, name)
                .map_err(|e| AccessError::Tuple(e.to_string()))?,
            None => encode_noise(&self.tuple)?,
        };
        let mut encoded = self.encoded.lock().expect("no holder of this lock panics");
        encoded[file] = Some(bytes);
        if encoded.iter().any(Option::is_none) {
            return Ok(None);
        }
        let mut bytes = encoded.iter_mut().filter_map(Option::take);
        let mut files: Vec<_> = self.names.iter().cloned().zip(bytes.by_ref()).collect();
        let record = encode_tuple_record(&self.tuple.record, &files);
        files.push(record.map_err(|e| AccessError::Tuple(e.to_string()))?);
        let layers = self.tuple.record.layers.values();
        let miss_share = layers.map(|layer| layer.miss_share).fold(0.0, f64::max);
        let makers = self.makers.clone();
        let has_odd_view = !self.tuple.record.facts.odd_view.is_empty();
        Ok(Some(EncodedTuple { files, noise: bytes.next(), makers, miss_share, has_odd_view }))
    }
}
