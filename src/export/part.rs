//! Parts of an export: a part is a shard, or the files of some tuples. A record marks a complete part.

use super::card_numbers::Numbers;
use super::digest::FileRecord;
use super::error::{ExportError, unreadable};
use super::folder::{ExportFolder, STATE_FOLDER};
use super::metadata::listing_line;
use super::plan::ExportPlan;
use super::request::ExportFormat;
use super::sample::Sample;
use super::shard::Shard;
use super::tensor_shard::TensorShard;
use render::atomic_file;
use render::line::Split;
use serde::{Deserialize, Serialize};

/// Maximum number of tuples in a part without a shard.
const TUPLES_A_PART: usize = 256;

/// Record of a complete part.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PartRecord {
    pub(super) numbers: Numbers,
    pub(super) files: Vec<FileRecord>,
    /// Lines of the split's list of tuples; empty for formats without this file.
    pub(super) lines: Vec<String>,
}

fn record_name(split: Split, number: usize) -> String {
    format!("{STATE_FOLDER}/{split}-{number:06}.json")
}

impl PartRecord {
    /// Reads the record of part `number`, if the part is complete. Fails if a file is missing or has another length.
    pub(super) fn read(
        folder: &ExportFolder,
        split: Split,
        number: usize,
    ) -> Result<Option<Self>, ExportError> {
        let name = record_name(split, number);
        let path = folder.path(&name);
        let bytes = match render::input_file::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(unreadable(&path)(e)),
        };
        let foreign = |reason| ExportError::Foreign { out: folder.root().to_owned(), reason };
        let record: Self = serde_json::from_slice(&bytes)
            .map_err(|e| foreign(format!("has a damaged {name}: {e}")))?;
        for file in &record.files {
            let there = std::fs::metadata(folder.path(&file.path)).map(|meta| meta.len());
            match there {
                Ok(bytes) if bytes == file.bytes => {}
                Ok(bytes) => {
                    return Err(foreign(format!(
                        "was changed: {} has {bytes} bytes, not {}",
                        file.path, file.bytes
                    )));
                }
                Err(e) => return Err(foreign(format!("was changed: {}: {e}", file.path))),
            }
        }
        Ok(Some(record))
    }

    fn write(&self, folder: &ExportFolder, split: Split, number: usize) -> Result<(), ExportError> {
        let json = serde_json::to_vec(self).expect("strings and numbers are JSON");
        atomic_file::write(&folder.path(&record_name(split, number)), &json)?;
        Ok(())
    }
}

/// A sample with files that are already written, unless they go into a shard.
pub(super) struct Prepared {
    pub(super) sample: Sample,
    /// Records of the written files.
    pub(super) written: Vec<FileRecord>,
}

/// A shard that is not complete.
enum OpenShard {
    Tar(Shard),
    Tensors(TensorShard),
}

impl OpenShard {
    /// Begins the shard of a part, if the format has shards.
    fn begin(
        format: ExportFormat,
        folder: &ExportFolder,
        split: Split,
        number: usize,
    ) -> Result<Option<Self>, ExportError> {
        let Some(ending) = format.shard_ending() else { return Ok(None) };
        let name = format!("{split}-{number:06}{ending}");
        Ok(Some(match format {
            ExportFormat::Safetensors => Self::Tensors(TensorShard::begin(folder, name)?),
            _ => Self::Tar(Shard::begin(folder.root(), name)?),
        }))
    }

    fn has_room(&self, sample: &Sample, limit_bytes: u64) -> bool {
        match self {
            Self::Tar(shard) => shard.has_room(&sample.files, limit_bytes),
            Self::Tensors(shard) => {
                shard.has_room(&sample.record.scene.id, &sample.tensors, limit_bytes)
            }
        }
    }

    fn add(&mut self, sample: &Sample) -> Result<(), ExportError> {
        match self {
            Self::Tar(shard) => shard.add(&sample.files),
            Self::Tensors(shard) => shard.add(&sample.record.scene.id, &sample.tensors),
        }
    }

    fn finish(self) -> Result<FileRecord, ExportError> {
        match self {
            Self::Tar(shard) => shard.finish(),
            Self::Tensors(shard) => shard.finish(),
        }
    }
}

/// Writer of a split's parts, one after the other.
pub(super) struct Parts<'a> {
    plan: &'a ExportPlan,
    folder: &'a ExportFolder,
    split: Split,
    number: usize,
    open: Option<(PartRecord, Option<OpenShard>)>,
}

impl<'a> Parts<'a> {
    /// Starts at part `number`.
    pub(super) fn new(
        plan: &'a ExportPlan,
        folder: &'a ExportFolder,
        split: Split,
        number: usize,
    ) -> Self {
        Self { plan, folder, split, number, open: None }
    }

    /// Adds a tuple; starts another part if the open one is full.
    pub(super) fn add(&mut self, prepared: Prepared) -> Result<(), ExportError> {
        let request = &self.plan.request;
        let limit_bytes = u64::from(request.shard_mb.unwrap_or(0)) * 1_000_000;
        let is_full = self.open.as_ref().is_some_and(|(record, shard)| match shard {
            Some(shard) => !shard.has_room(&prepared.sample, limit_bytes),
            None => record.numbers.tuples >= TUPLES_A_PART as u64,
        });
        if is_full {
            self.close()?;
        }
        if self.open.is_none() {
            let record =
                PartRecord { numbers: Numbers::default(), files: Vec::new(), lines: Vec::new() };
            let shard = OpenShard::begin(request.format, self.folder, self.split, self.number)?;
            self.open = Some((record, shard));
        }
        let Some((record, shard)) = &mut self.open else {
            return Ok(());
        };
        if let Some(shard) = shard {
            shard.add(&prepared.sample)?;
        }
        record.files.extend(prepared.written);
        record.numbers.add(&Numbers::of(&prepared.sample.record));
        record.lines.extend(listing_line(self.plan, &prepared.sample.record));
        Ok(())
    }

    /// Ends the open part, if any; on return the part is durable.
    pub(super) fn close(&mut self) -> Result<(), ExportError> {
        let Some((mut record, shard)) = self.open.take() else {
            return Ok(());
        };
        match shard {
            Some(shard) => record.files.push(shard.finish()?),
            None => atomic_file::settle(self.folder.root())?,
        }
        record.write(self.folder, self.split, self.number)?;
        self.number += 1;
        Ok(())
    }
}
