//! Tuples of an export in the format of safetensors, whose shards are mapped into memory.

use super::source::{Base, ExampleError};
use compose::{Layer, LinearTuple, StoredLayer, TupleLayers};
use glasshouse_line::label::Label;
use glasshouse_line::layer;
use glasshouse_line::{SceneLine, Split};
use memmap2::Mmap;
use render::merge::TupleRecord;
use safetensors::{Dtype, SafeTensors};
use std::collections::HashMap;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Schema of a shard's metadata.
const SCHEMA: &str = "glasshouse.tuples/1";

/// The exported tuples of a split, in the order of its shards.
pub struct ShardSource {
    pub lines: Vec<SceneLine>,
    shards: Vec<Shard>,
    /// Shard of each scene, by id.
    places: HashMap<String, usize>,
}

/// A file of tensors.
struct Shard {
    path: PathBuf,
    map: Arc<Mmap>,
    tensors: HashMap<String, Tensor>,
}

struct Tensor {
    value_bytes: usize,
    range: Range<usize>,
}

impl ShardSource {
    /// Opens the shards of a split in the folder of a finished export.
    ///
    /// # Errors
    ///
    /// Fails if a file is missing or has another format.
    pub fn open(folder: &Path, split: Split) -> Result<Self, ExampleError> {
        let list = folder.join(format!("{split}.jsonl"));
        let text = render::input_file::read_to_string(&list).map_err(|e| damaged(&list, &e))?;
        let record =
            |line: &str| TupleRecord::parse(line.as_bytes()).map_err(|e| damaged(&list, &e));
        let records: Vec<TupleRecord> = text.lines().map(record).collect::<Result<_, _>>()?;
        let mut source = Self {
            lines: records.into_iter().map(|record| record.scene).collect(),
            shards: Vec::new(),
            places: HashMap::new(),
        };
        while source.places.len() < source.lines.len() {
            let number = source.shards.len();
            let shard = Shard::open(folder.join(format!("{split}-{number:06}.safetensors")))?;
            for line in &source.lines {
                if shard.tensors.contains_key(&format!("{}.input", line.id)) {
                    source.places.insert(line.id.to_string(), number);
                }
            }
            source.shards.push(shard);
        }
        Ok(source)
    }

    /// Returns the linear layers of a scene's tuple. Pixels are read when an example needs them.
    pub fn read_linear(&self, index: usize) -> Result<Base, ExampleError> {
        let line = &self.lines[index];
        let shard = &self.shards[self.places[line.id.as_str()]];
        let layer = |name: &str| shard.layer(&format!("{}.{name}", line.id));
        let colour = |kind: layer::Layer| layer(kind.name());
        let [input, transmission, glass_reflection, clean_reflection] =
            layer::Layer::ALL.map(colour);
        let (Some(input), Some(transmission), Some(glass_reflection)) =
            (input, transmission, glass_reflection)
        else {
            return Err(ExampleError::Unusable {
                name: line.id.to_string(),
                reason: "the export has no input, transmission or glass_reflection of it, which composed examples need"
                    .to_owned(),
            });
        };
        let coverage = layer(Label::Coverage.name());
        let layers =
            TupleLayers { input, transmission, glass_reflection, clean_reflection, coverage };
        LinearTuple::new(line.film.height as usize, line.film.width as usize, layers)
            .map(Base::Linear)
            .ok_or_else(|| {
                damaged(&shard.path, &format!("the size of {} is not the film's", line.id))
            })
    }
}

impl Shard {
    fn open(path: PathBuf) -> Result<Self, ExampleError> {
        let file = File::open(&path).map_err(|e| damaged(&path, &e))?;
        let map = map(&file).map_err(|e| damaged(&path, &e))?;
        let (header, metadata) =
            SafeTensors::read_metadata(&map).map_err(|e| damaged(&path, &e))?;
        let schema = metadata.metadata().as_ref().and_then(|texts| texts.get("schema"));
        if schema.is_none_or(|schema| schema != SCHEMA) {
            return Err(damaged(&path, &format!("its metadata do not have the schema {SCHEMA}")));
        }
        // The length of the header precedes it.
        let data = 8 + header;
        let mut tensors = HashMap::new();
        for (name, info) in metadata.tensors() {
            let value_bytes = match info.dtype {
                Dtype::F16 => 2,
                Dtype::F32 => 4,
                // Padding.
                _ => continue,
            };
            let (begin, end) = info.data_offsets;
            tensors.insert(name, Tensor { value_bytes, range: data + begin..data + end });
        }
        Ok(Self { path, map: Arc::new(map), tensors })
    }

    fn layer(&self, name: &str) -> Option<Layer> {
        let tensor = self.tensors.get(name)?;
        let bytes = Arc::clone(&self.map);
        StoredLayer::new(bytes, tensor.range.clone(), tensor.value_bytes).map(Layer::Stored)
    }
}

/// Maps a file into memory.
#[allow(unsafe_code, reason = "files are mapped by an unsafe function")]
fn map(file: &File) -> std::io::Result<Mmap> {
    // SAFETY: an export is finished and its files are never written again. A user that truncates one meanwhile gets a bus
    // error; other changes only change pixels, since all bytes are valid floats.
    unsafe { Mmap::map(file) }
}

fn damaged(path: &Path, reason: &dyn std::fmt::Display) -> ExampleError {
    ExampleError::Export { path: path.to_owned(), reason: reason.to_string() }
}
