//! Writes a shard of tensors in the format of safetensors: a header with types, shapes and places, then the data.
//!
//! The header precedes the data, and its length depends on all tensors. So the data go to a scratch file first, and memory
//! holds the header alone. The writer of the crate `safetensors` would hold all data in memory, sort tensors by type and
//! name, and order the metadata like a hash map.

use super::digest::{Digesting, FileRecord};
use super::error::ExportError;
use super::folder::{ExportFolder, STATE_FOLDER};
use super::tensors::Tensor;
use glasshouse_line::ExrPrecision;
use glasshouse_line::ids::SceneId;
use render::atomic_file::{PendingFile, WriteError};
use serde_json::json;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::PathBuf;

/// Schema name in the metadata of a shard.
pub const TUPLES_SCHEMA: &str = "glasshouse.tuples/1";
/// Multiple of the places of all tensors in the file, bytes: a mapped file then has aligned floats.
const ALIGNMENT: usize = 8;
/// Maximum number of tuples in a shard. It bounds the header, and the lines that a part's record holds in memory.
const MOST_TUPLES: usize = 4096;
/// Length of the number before the header, bytes.
const LENGTH_BYTES: usize = 8;

pub(super) struct TensorShard {
    /// Data of all tensors; removed with this value.
    scratch: PendingFile,
    scratch_path: PathBuf,
    listed: Listed,
    tuples: usize,
    path: PathBuf,
    name: String,
}

/// Contents of a header.
#[derive(Clone, Debug, Default)]
struct Listed {
    /// Elements of the list of ids, inside a JSON string.
    scenes: String,
    /// Members of the header after the metadata, each with a comma before it.
    tensors: String,
    data_bytes: usize,
}

impl TensorShard {
    pub(super) fn begin(folder: &ExportFolder, name: String) -> Result<Self, ExportError> {
        let scratch_path = folder.path(STATE_FOLDER).join("data");
        Ok(Self {
            scratch: PendingFile::begin(&scratch_path)?,
            scratch_path,
            listed: Listed::default(),
            tuples: 0,
            path: folder.path(&name),
            name,
        })
    }

    pub(super) fn has_room(&self, scene: &SceneId, tensors: &[Tensor], limit_bytes: u64) -> bool {
        let lengths = |listed: &Listed| (listed.scenes.len(), listed.tensors.len());
        let more = Listed::of(scene, tensors, self.listed.data_bytes);
        let (there, added) = (lengths(&self.listed), lengths(&more));
        // A comma separates the ids.
        let header = header_bytes(there.0 + added.0 + 1, there.1 + added.1);
        let bytes = LENGTH_BYTES + header + more.data_bytes;
        self.tuples < MOST_TUPLES && bytes as u64 <= limit_bytes
    }

    /// Adds the tensors of a tuple, each followed by zeros up to the next multiple of [`ALIGNMENT`].
    pub(super) fn add(&mut self, scene: &SceneId, tensors: &[Tensor]) -> Result<(), ExportError> {
        let more = Listed::of(scene, tensors, self.listed.data_bytes);
        for tensor in tensors {
            let zeros = &[0; ALIGNMENT][..padding(tensor.bytes.len())];
            let written = self.scratch.write_all(&tensor.bytes);
            let written = written.and_then(|()| self.scratch.write_all(zeros));
            written.map_err(|source| WriteError { path: self.scratch_path.clone(), source })?;
        }
        let Listed { scenes, tensors, data_bytes } = &mut self.listed;
        if !scenes.is_empty() {
            scenes.push(',');
        }
        *scenes += &more.scenes;
        *tensors += &more.tensors;
        *data_bytes = more.data_bytes;
        self.tuples += 1;
        Ok(())
    }

    /// Ends the shard; on return it is durable.
    pub(super) fn finish(mut self) -> Result<FileRecord, ExportError> {
        let mut file = Digesting::new(PendingFile::begin(&self.path)?);
        let header = self.listed.header();
        let mut write = || -> io::Result<()> {
            file.write_all(&(header.len() as u64).to_le_bytes())?;
            file.write_all(header.as_bytes())?;
            self.scratch.copy_to(&mut file)
        };
        write().map_err(|source| WriteError { path: self.path.clone(), source })?;
        let (file, record) = file.finish(&self.name);
        file.finish()?;
        debug_assert_eq!(
            record.bytes,
            (LENGTH_BYTES + header.len() + self.listed.data_bytes) as u64,
            "the scratch file has all data"
        );
        Ok(record)
    }
}

impl Listed {
    /// Lists a tuple whose data begin at byte `place` of the data.
    fn of(scene: &SceneId, tensors: &[Tensor], place: usize) -> Self {
        let mut listed =
            Self { scenes: format!(r#"\"{scene}\""#), tensors: String::new(), data_bytes: place };
        for tensor in tensors {
            let kind = match tensor.precision {
                ExrPrecision::Half => "F16",
                ExrPrecision::Float => "F32",
            };
            let length = tensor.bytes.len();
            listed.add(&tensor.name, kind, &tensor.shape, length);
            // The format forbids gaps between tensors.
            if let zeros @ 1.. = padding(length) {
                listed.add(&format!("{}.padding", tensor.name), "U8", &[zeros], zeros);
            }
        }
        listed
    }

    fn add(&mut self, name: &str, kind: &str, shape: &[usize], length: usize) {
        let (start, end) = (self.data_bytes, self.data_bytes + length);
        let shape = json!(shape);
        let _ = write!(
            self.tensors,
            r#","{name}":{{"dtype":"{kind}","shape":{shape},"data_offsets":[{start},{end}]}}"#
        );
        self.data_bytes = end;
    }

    /// Returns the header, followed by spaces up to the next multiple of [`ALIGNMENT`].
    fn header(&self) -> String {
        let mut text = header_text(&self.scenes, &self.tensors);
        text.extend(std::iter::repeat_n(' ', padding(text.len())));
        text
    }
}

fn header_text(scenes: &str, tensors: &str) -> String {
    format!(r#"{{"__metadata__":{{"schema":"{TUPLES_SCHEMA}","scenes":"[{scenes}]"}}{tensors}}}"#)
}

/// Returns the length of the padded header, bytes, from the lengths of its parts.
fn header_bytes(scenes: usize, tensors: usize) -> usize {
    (header_text("", "").len() + scenes + tensors).next_multiple_of(ALIGNMENT)
}

/// Returns the number of bytes from `length` to the next multiple of [`ALIGNMENT`].
fn padding(length: usize) -> usize {
    length.next_multiple_of(ALIGNMENT) - length
}

#[cfg(test)]
mod tests {
    use super::*;
    use safetensors::{Dtype, SafeTensors};

    fn tuple(id: &str, pixels: usize) -> (SceneId, Vec<Tensor>) {
        let tensor = |name: &str, precision, bytes: usize| Tensor {
            name: format!("{id}.{name}"),
            precision,
            shape: vec![3, 1, pixels],
            bytes: (0..bytes * 3 * pixels).map(|k| k as u8).collect(),
        };
        let tensors = vec![
            tensor("input", ExrPrecision::Half, 2),
            tensor("front_depth", ExrPrecision::Float, 4),
        ];
        (SceneId::new(id).unwrap(), tensors)
    }

    /// An independent reader reads all tensors and the metadata; tensors are aligned, and the size is the predicted one.
    #[test]
    fn an_independent_reader_reads_the_tensors() {
        let out = tempfile::tempdir().unwrap();
        let folder = ExportFolder::claim(out.path()).unwrap();
        let tuples: Vec<_> =
            [("b", 1), ("a", 5), ("c-1", 4)].map(|(id, pixels)| tuple(id, pixels)).into();
        let mut shard = TensorShard::begin(&folder, "s.safetensors".to_owned()).unwrap();
        let mut foreseen = 0;
        for (scene, tensors) in &tuples {
            foreseen = (0..10_000).find(|limit| shard.has_room(scene, tensors, *limit)).unwrap();
            shard.add(scene, tensors).unwrap();
        }
        let record = shard.finish().unwrap();
        let bytes = std::fs::read(out.path().join("s.safetensors")).unwrap();
        assert_eq!(record, FileRecord::new("s.safetensors", &bytes));
        assert_eq!(foreseen, record.bytes);
        let read = SafeTensors::deserialize(&bytes).unwrap();
        for tensor in tuples.iter().flat_map(|(_, tensors)| tensors) {
            let view = read.tensor(&tensor.name).unwrap();
            let kind = if tensor.precision == ExrPrecision::Half { Dtype::F16 } else { Dtype::F32 };
            assert_eq!((view.dtype(), view.shape()), (kind, &tensor.shape[..]));
            assert_eq!(view.data(), tensor.bytes);
            let place = view.data().as_ptr() as usize - bytes.as_ptr() as usize;
            assert!(place.is_multiple_of(ALIGNMENT));
        }
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let metadata = header.metadata().as_ref().unwrap();
        assert_eq!(metadata["schema"], TUPLES_SCHEMA);
        let scenes: Vec<String> = serde_json::from_str(&metadata["scenes"]).unwrap();
        assert_eq!(scenes, ["b", "a", "c-1"]);
        // Odd numbers of halves are followed by zeros.
        assert_eq!(read.tensor("b.input.padding").unwrap().data(), [0, 0]);
        assert!(read.tensor("c-1.input.padding").is_err());
        assert_eq!(std::fs::read_dir(out.path().join(STATE_FOLDER)).unwrap().count(), 1);
    }
}
