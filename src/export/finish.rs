//! Finishes an export: writes metadata, card, Croissant description, and the digests of all files.

use super::card::card;
use super::card_numbers::Numbers;
use super::croissant::croissant;
use super::digest::{Digesting, FileRecord};
use super::error::ExportError;
use super::folder::{CARD_FILE, CROISSANT_FILE, ExportFolder, SUMS_FILE};
use super::metadata::listing_file;
use super::part::{PartRecord, record_name};
use super::plan::ExportPlan;
use super::request::{ExportFormat, REQUEST_FILE};
use crate::run::Run;
use glasshouse_line::Split;
use render::atomic_file::{self, PendingFile, WriteError};
use std::collections::BTreeMap;
use std::io::Write;

pub(super) struct Summary {
    pub(super) splits: BTreeMap<Split, u64>,
    pub(super) numbers: Numbers,
    pub(super) shards: Vec<FileRecord>,
}

#[derive(Default)]
pub(super) struct Total {
    pub(super) files: u64,
    pub(super) bytes: u64,
}

/// Record of the files that belong to no part.
pub(super) const FINISH_RECORD: &str = ".export/finish.json";

/// Writes metadata, card, Croissant and `SHA256SUMS`, and records them. All parts must be complete.
pub(super) fn finish(
    run: &Run,
    plan: &ExportPlan,
    folder: &ExportFolder,
) -> Result<Total, ExportError> {
    let format = plan.request.format;
    let mut summary =
        Summary { splits: BTreeMap::new(), numbers: Numbers::default(), shards: Vec::new() };
    let mut named = Vec::new();
    for &split in &plan.request.splits {
        let mut listing = None;
        each_part(folder, split, |part| {
            *summary.splits.entry(split).or_insert(0) += part.numbers.tuples;
            summary.numbers.add(&part.numbers);
            if format == ExportFormat::Webdataset {
                summary.shards.extend(part.files);
            }
            if let Some(name) = listing_file(format, split) {
                let file = match &mut listing {
                    Some(file) => file,
                    none => none.insert(Summed::begin(folder, &name)?),
                };
                for line in &part.lines {
                    file.put(line)?;
                }
            }
            Ok(())
        })?;
        if let Some(listing) = listing {
            named.push(listing.finish()?);
        }
    }
    let request = plan.request.to_json();
    let mut texts = vec![(CARD_FILE, card(run, plan, &summary))];
    if matches!(format, ExportFormat::Webdataset | ExportFormat::Imagefolder) {
        texts.push((CROISSANT_FILE, croissant(plan, &summary)));
    }
    for (name, text) in &texts {
        atomic_file::write(&folder.path(name), text.as_bytes())?;
    }
    texts.push((REQUEST_FILE, request));
    for (name, text) in &texts {
        named.push(FileRecord::new(name, text.as_bytes()));
    }
    named.sort_by(|a, b| a.path.cmp(&b.path));

    let mut total = Total::default();
    let mut sums = Summed::begin(folder, SUMS_FILE)?;
    let mut put = |file: &FileRecord| {
        total.files += 1;
        total.bytes += file.bytes;
        sums.put(&file.sum_line())
    };
    for file in &named {
        put(file)?;
    }
    for &split in &plan.request.splits {
        each_part(folder, split, |part| part.files.iter().try_for_each(&mut put))?;
    }
    let (sums, record) = sums.file.finish(SUMS_FILE);
    named.push(record);
    PartRecord::of_files(named).write(folder, FINISH_RECORD)?;
    // Its presence means that all other files are there.
    sums.finish()?;
    Ok(total)
}

fn each_part(
    folder: &ExportFolder,
    split: Split,
    mut take: impl FnMut(PartRecord) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let mut number = 0;
    while let Some(part) = PartRecord::read(folder.root(), &record_name(split, number))? {
        take(part)?;
        number += 1;
    }
    Ok(())
}

/// A text file written line by line, with its digest.
struct Summed {
    file: Digesting<PendingFile>,
    name: String,
    path: std::path::PathBuf,
}

impl Summed {
    fn begin(folder: &ExportFolder, name: &str) -> Result<Self, ExportError> {
        let path = folder.path(name);
        Ok(Self { file: Digesting::new(PendingFile::begin(&path)?), name: name.to_owned(), path })
    }

    fn put(&mut self, line: &str) -> Result<(), ExportError> {
        let written = self.file.write_all(line.as_bytes());
        Ok(written.map_err(|source| WriteError { path: self.path.clone(), source })?)
    }

    fn finish(self) -> Result<FileRecord, ExportError> {
        let (file, record) = self.file.finish(&self.name);
        file.finish()?;
        Ok(record)
    }
}
