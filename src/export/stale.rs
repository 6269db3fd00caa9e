//! Finds the parts of an earlier call that are not those of the present run, or whose files were damaged.

use super::error::ExportError;
use super::finish::FINISH_RECORD;
use super::folder::{ExportFolder, SUMS_FILE};
use super::part::{PartRecord, record_name, recorded};
use super::plan::ExportPlan;
use crate::made::{Difference, Digests, Files, Remade};
use crate::run::keys;
use glasshouse_line::Split;
use rayon::prelude::*;
use std::path::Path;

/// What a call must make again.
#[derive(Default)]
pub(super) struct Stale {
    /// Parts with their records, and `None` for a damaged record.
    parts: Vec<(Split, usize, Option<PartRecord>)>,
    /// True if `SHA256SUMS` or another file that belongs to no part was changed or is missing.
    finish: bool,
    pub(super) remade: Remade,
}

impl Stale {
    /// Compares an export with its records and with the tuples in the store.
    pub(super) fn find(
        plan: &ExportPlan,
        tuples: &Files,
        out: &Path,
        digests: &Digests,
    ) -> Result<Self, ExportError> {
        let results = Files::results(out);
        let mut found = Self::default();
        // The size of a shard decides where the next one begins.
        let follows = plan.request.format.shard_ending().is_some();
        for &split in &plan.request.splits {
            let numbers = recorded(out, split)?;
            let look = |&number: &usize| -> Result<_, ExportError> {
                let record = PartRecord::read(out, &record_name(split, number))?;
                let differences = match &record {
                    Some(record) if record.of.is_empty() => vec![unknown(split, number)],
                    Some(record) => {
                        of_scenes(digests.differences(&record.made(), tuples, &results)?)
                    }
                    None => vec![unknown(split, number)],
                };
                Ok((number, record, differences))
            };
            let parts: Vec<_> = numbers.par_iter().map(look).collect::<Result<_, _>>()?;
            let mut is_later = false;
            for (place, (number, record, differences)) in parts.into_iter().enumerate() {
                is_later |= follows && number != place;
                if differences.is_empty() && !is_later {
                    continue;
                }
                is_later |= follows;
                let tuples = record.as_ref().map_or(0, |record| record.numbers.tuples);
                found.remade.add(tuples, &differences);
                found.parts.push((split, number, record));
            }
        }
        Ok(found)
    }

    /// Compares the files that belong to no part of a complete export.
    pub(super) fn look_at_finish(
        &mut self,
        out: &Path,
        digests: &Digests,
    ) -> Result<(), ExportError> {
        let differences = match PartRecord::read(out, FINISH_RECORD)? {
            None => vec![Difference::FileGone(FINISH_RECORD.to_owned())],
            Some(record) => {
                let results = Files::results(out);
                digests.differences(&record.made(), &results, &results)?
            }
        };
        self.finish = !differences.is_empty();
        self.remade.add(0, &differences);
        Ok(())
    }

    pub(super) fn is_none(&self) -> bool {
        self.parts.is_empty() && !self.finish
    }

    /// Removes the parts, so that the export goes on without them. The records go last: a part without its files is stale.
    pub(super) fn remove(&self, folder: &ExportFolder) -> Result<(), ExportError> {
        if self.is_none() {
            return Ok(());
        }
        folder.remove(SUMS_FILE)?;
        for (split, number, record) in &self.parts {
            for file in record.iter().flat_map(|record| &record.files) {
                folder.remove(&file.path)?;
            }
            folder.remove(&record_name(*split, *number))?;
        }
        Ok(())
    }
}

/// Names the folders of tuples in place of their files.
fn of_scenes(differences: Vec<Difference>) -> Vec<Difference> {
    let folder = |key: String| match keys::scene_of(&key) {
        Some(scene) => format!("{}/{scene}", keys::TUPLES),
        None => key,
    };
    let mut found: Vec<Difference> = Vec::new();
    for difference in differences {
        let difference = match difference {
            Difference::Input(key) => Difference::Input(folder(key)),
            Difference::InputGone(key) => Difference::InputGone(folder(key)),
            of_file => of_file,
        };
        if !found.contains(&difference) {
            found.push(difference);
        }
    }
    found
}

/// Returns the reason to make a part again whose record is missing or damaged.
fn unknown(split: Split, number: usize) -> Difference {
    Difference::FileGone(format!("a readable {}", record_name(split, number)))
}
