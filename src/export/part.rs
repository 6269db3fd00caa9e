//! Parts of an export: a part is a shard, or the files of some tuples. A record marks a complete part.

use super::card_numbers::Numbers;
use super::digest::FileRecord;
use super::error::{ExportError, unreadable};
use super::folder::{ExportFolder, STATE_FOLDER, names};
use super::metadata::listing_line;
use super::plan::ExportPlan;
use super::request::ExportFormat;
use super::sample::Sample;
use super::shard::Shard;
use super::tensor_shard::TensorShard;
use crate::made::{Digests, Files, Made};
use glasshouse_line::Split;
use render::atomic_file;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum number of tuples in a part without a shard.
pub(super) const TUPLES_A_PART: usize = 256;

/// Schema of [`PartRecord`].
const PART_SCHEMA: &str = "glasshouse.export_part/1";

/// Record of a complete part.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PartRecord {
    /// [`PART_SCHEMA`]; empty in records of older versions.
    #[serde(default)]
    schema: String,
    pub(super) numbers: Numbers,
    pub(super) files: Vec<FileRecord>,
    /// Lines of the split's list of tuples; empty for formats without this file.
    pub(super) lines: Vec<String>,
    /// BLAKE3 of the tuples' files, by key in the store. A record of an older version has none.
    #[serde(default)]
    pub(super) of: BTreeMap<String, String>,
}

/// Returns the name of the record of part `number`.
pub(super) fn record_name(split: Split, number: usize) -> String {
    format!("{STATE_FOLDER}/{split}-{number:06}.json")
}

/// Lists the numbers of the parts of a split that have a record, ascending.
pub(super) fn recorded(out: &Path, split: Split) -> Result<Vec<usize>, ExportError> {
    let number = |name: String| {
        let number = name.strip_prefix(&format!("{split}-"))?.strip_suffix(".json")?;
        number.parse().ok()
    };
    Ok(names(&out.join(STATE_FOLDER))?.into_iter().filter_map(number).collect())
}

impl PartRecord {
    /// Makes the record of a part with these files and no tuples.
    pub(super) fn of_files(files: Vec<FileRecord>) -> Self {
        Self {
            schema: PART_SCHEMA.to_owned(),
            numbers: Numbers::default(),
            files,
            lines: Vec::new(),
            of: BTreeMap::new(),
        }
    }

    /// Reads a record below the folder of the export; `None` if there is none, or a damaged one.
    pub(super) fn read(out: &Path, name: &str) -> Result<Option<Self>, ExportError> {
        let path = out.join(name);
        let bytes = render::input_file::read_if_there(&path).map_err(unreadable(&path))?;
        Ok(bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok()))
    }

    /// Returns the digests of the part's inputs and files.
    pub(super) fn made(&self) -> Made {
        let files = self.files.iter().map(|file| (file.path.clone(), file.blake3.clone()));
        Made { of: self.of.clone(), files: files.collect() }
    }

    /// Writes the record durably.
    pub(super) fn write(&self, folder: &ExportFolder, name: &str) -> Result<(), ExportError> {
        let json = serde_json::to_vec(self).expect("strings and numbers are JSON");
        atomic_file::write(&folder.path(name), &json)?;
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
    Tar(Box<Shard>),
    Tensors(Box<TensorShard>),
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
            ExportFormat::Safetensors => Self::Tensors(Box::new(TensorShard::begin(folder, name)?)),
            _ => Self::Tar(Box::new(Shard::begin(folder.root(), name)?)),
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
    digests: &'a Digests,
    split: Split,
    number: usize,
    open: Option<(PartRecord, Option<OpenShard>)>,
}

impl<'a> Parts<'a> {
    /// Starts at part `number`.
    pub(super) fn new(
        plan: &'a ExportPlan,
        folder: &'a ExportFolder,
        digests: &'a Digests,
        (split, number): (Split, usize),
    ) -> Self {
        Self { plan, folder, digests, split, number, open: None }
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
            let record = PartRecord::of_files(Vec::new());
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
        record.of.extend(prepared.sample.of);
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
            Some(shard) => {
                let file = shard.finish()?;
                let results = Files::results(self.folder.root());
                let stamp = results.stamp(&file.path)?;
                self.digests.remember(&results, &file.path, stamp, &file.blake3);
                record.files.push(file);
            }
            None => atomic_file::settle(self.folder.root())?,
        }
        record.write(self.folder, &record_name(self.split, self.number))?;
        self.number += 1;
        Ok(())
    }
}
