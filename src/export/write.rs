//! Writes an export: reads and encodes tuples in batches on all threads, and adds them to parts in order.

use super::digest::FileRecord;
use super::error::ExportError;
use super::finish::finish;
use super::folder::{ExportFolder, FolderState, SUMS_FILE, look};
use super::part::{PartRecord, Parts, Prepared, TUPLES_A_PART, record_name, recorded};
use super::plan::ExportPlan;
use super::request::REQUEST_FILE;
use super::sample::{layer_folders, sample};
use super::stale::Stale;
use crate::made::{Digests, Files, Remade};
use crate::run::{Run, keys};
use crate::store::Store;
use glasshouse_line::{SceneLine, Split};
use rayon::prelude::*;
use render::atomic_file;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Maximum number of tuples per thread in a batch.
const BATCH: usize = 8;
/// Maximum number of pixels in a batch, because memory holds two batches. A larger tuple has a batch of its own.
const BATCH_PIXELS: u64 = 1 << 23;
/// Maximum number of tuples that are encoded to estimate the size of an export.
const TRIALS: usize = 8;

/// Result of an export, with the keys of `glasshouse.export/1`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Exported {
    /// Number of tuples by split, including those of earlier calls.
    pub tuples: BTreeMap<Split, u64>,
    /// Number of tuples that earlier calls wrote; 0 if the export was already complete.
    #[serde(rename = "tuples_resumed")]
    pub resumed: u64,
    /// Number of files, without `SHA256SUMS`; 0 unless this call completed the export. The same applies to `bytes`.
    pub files: u64,
    pub bytes: u64,
    pub already_complete: bool,
    /// Tuples of earlier calls that were written again.
    #[serde(skip_serializing_if = "Remade::is_none")]
    pub remade: Remade,
    /// True if the stop flag ended the export early; the same command resumes it.
    #[serde(skip)]
    pub stopped: bool,
}

/// Threads, stop flag and callback of an export. They do not change the bytes of a complete export.
pub struct ExportWork<'a> {
    pub threads: usize,
    /// Flag that ends the export after the current batch.
    pub stop: &'a AtomicBool,
    /// True to read all files of earlier calls and their tuples, also where nothing seems to have changed.
    pub verify: bool,
    /// Callback with a number of finished tuples, and true if an earlier call wrote them.
    pub on_tuples: &'a (dyn Fn(u64, bool) + Sync),
}

/// Exports a run into `out`, or resumes an earlier call. A resumed export has the scenes of the earlier call; the
/// returned plan lists them. Parts whose tuples or files changed since are made again.
pub fn export(
    run: &Run,
    store: &Store,
    plan: ExportPlan,
    out: &Path,
    work: &ExportWork,
) -> Result<(ExportPlan, Exported), ExportError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(work.threads)
        .build()
        .map_err(|e| ExportError::Request(format!("{} threads: {e}", work.threads)))?;
    let tuples = Files::objects(store, keys::TUPLES)?;
    let digests = Digests::open(out, work.verify);
    // Checks the folder before the first write.
    let was_complete = look(out, &plan.request)? == FolderState::Complete;
    if was_complete && pool.install(|| stale(&plan, &tuples, out, &digests))?.is_none() {
        // Removes what a killed process left. The folder may be read-only, and the memory of digests only saves time.
        if let Ok(_folder) = ExportFolder::claim(out) {
            let _ = digests.write(out);
        }
        return Ok(nothing_to_do(run, plan));
    }
    let folder = ExportFolder::claim(out)?;
    let state = look(out, &plan.request)?;
    let plan = match state {
        FolderState::Empty => {
            let json = plan.request.to_json();
            atomic_file::write(&folder.path(REQUEST_FILE), json.as_bytes())?;
            plan
        }
        FolderState::Begun(request) => ExportPlan::of(run, *request),
        FolderState::Complete => plan,
    };
    let stale = pool.install(|| stale(&plan, &tuples, out, &digests))?;
    stale.remove(&folder)?;
    let mut exported = Exported { remade: stale.remade, ..Exported::default() };
    let mut written_by_all = 0;
    for &split in &plan.request.splits {
        let of_split = |&scene: &usize| run.lines[scene].split == split;
        let lines: Vec<&SceneLine> = plan
            .scenes
            .iter()
            .filter(|scene| of_split(scene))
            .map(|&scene| &run.lines[scene])
            .collect();
        let writer = SplitWriter {
            store,
            plan: &plan,
            folder: &folder,
            tuples: &tuples,
            digests: &digests,
            work,
            pool: &pool,
        };
        let (resumed, written) = writer.write(split, &lines)?;
        exported.resumed += resumed;
        written_by_all += written;
        if resumed + written > 0 {
            exported.tuples.insert(split, resumed + written);
        }
        if work.stop.load(Ordering::Relaxed) && resumed + written < lines.len() as u64 {
            exported.stopped = true;
            digests.write(out)?;
            return Ok((plan, exported));
        }
    }
    if was_complete {
        exported.remade.count = written_by_all;
    }
    let total = finish(run, &plan, &folder)?;
    folder.sweep();
    digests.write(out)?;
    exported.files = total.files;
    exported.bytes = total.bytes;
    Ok((plan, exported))
}

/// Finds what a call must make again.
fn stale(
    plan: &ExportPlan,
    tuples: &Files,
    out: &Path,
    digests: &Digests,
) -> Result<Stale, ExportError> {
    let mut stale = Stale::find(plan, tuples, out, digests)?;
    if out.join(SUMS_FILE).exists() {
        stale.look_at_finish(out, digests)?;
    }
    Ok(stale)
}

/// Lists what a call would make again of a complete export. Writes nothing.
pub fn look_again(
    store: &Store,
    plan: &ExportPlan,
    out: &Path,
    verify: bool,
) -> Result<Remade, ExportError> {
    let tuples = Files::objects(store, keys::TUPLES)?;
    Ok(stale(plan, &tuples, out, &Digests::open(out, verify))?.remade)
}

/// Returns the result for an export that is already complete.
fn nothing_to_do(run: &Run, plan: ExportPlan) -> (ExportPlan, Exported) {
    let mut exported = Exported { already_complete: true, ..Exported::default() };
    for &scene in &plan.scenes {
        *exported.tuples.entry(run.lines[scene].split).or_insert(0) += 1;
    }
    (plan, exported)
}

/// Estimates the size of an export in bytes from some encoded tuples.
pub fn estimate_bytes(run: &Run, store: &Store, plan: &ExportPlan) -> Result<u64, ExportError> {
    let count = plan.scenes.len();
    let trials = count.min(TRIALS);
    let mut bytes = 0;
    for trial in 0..trials {
        let line = &run.lines[plan.scenes[trial * count / trials]];
        let sample = sample(store, line, (plan.request.format, plan.request.encoding), None)?;
        bytes += sample.files.iter().map(|(_, b)| b.len()).sum::<usize>();
        bytes += sample.tensors.iter().map(|tensor| tensor.bytes.len()).sum::<usize>();
    }
    Ok((bytes as f64 / trials.max(1) as f64 * count as f64) as u64)
}

struct SplitWriter<'a> {
    store: &'a Store,
    plan: &'a ExportPlan,
    folder: &'a ExportFolder,
    /// The tuples' files in the store.
    tuples: &'a Files<'a>,
    digests: &'a Digests,
    work: &'a ExportWork<'a>,
    pool: &'a rayon::ThreadPool,
}

impl SplitWriter<'_> {
    /// Writes the tuples of a split until the stop flag is set. Returns the numbers of earlier and new tuples.
    fn write(&self, split: Split, lines: &[&SceneLine]) -> Result<(u64, u64), ExportError> {
        let numbers = recorded(self.folder.root(), split)?;
        let (mut resumed, mut written) = (0, 0);
        let (mut number, mut next) = (0, 0);
        for there in numbers.into_iter().map(Some).chain([None]) {
            // Missing parts before one that is there have the largest number of tuples: parts of shards have no gaps.
            let end = match there {
                Some(there) => next + (there - number) * TUPLES_A_PART,
                None => lines.len(),
            };
            let rest = lines.get(next..end).unwrap_or_default();
            let of_rest = self.write_parts((split, number), rest)?;
            written += of_rest;
            if of_rest < rest.len() as u64 {
                break;
            }
            let Some(there) = there else { break };
            let Some(record) = PartRecord::read(self.folder.root(), &record_name(split, there))?
            else {
                break;
            };
            (number, next) = (there + 1, end + record.numbers.tuples as usize);
            resumed += record.numbers.tuples;
            (self.work.on_tuples)(record.numbers.tuples, true);
        }
        Ok((resumed, written))
    }

    /// Writes parts from `number` on until the stop flag is set. Returns the number of tuples.
    fn write_parts(
        &self,
        (split, number): (Split, usize),
        rest: &[&SceneLine],
    ) -> Result<u64, ExportError> {
        if rest.is_empty() {
            return Ok(0);
        }
        for name in layer_folders(self.plan, split) {
            atomic_file::create_dir(&self.folder.path(&name))?;
        }
        let mut parts = Parts::new(self.plan, self.folder, self.digests, (split, number));
        let mut written = 0;
        let mut batches = batches(rest, self.work.threads * BATCH);
        let mut ready: Vec<Prepared> = Vec::new();
        // One task writes a batch while the other prepares the next batch.
        loop {
            let is_stopped = self.work.stop.load(Ordering::Relaxed);
            let batch = if is_stopped { None } else { batches.next() };
            if ready.is_empty() && batch.is_none() {
                break;
            }
            let (taken, next) = self.pool.join(
                || -> Result<u64, ExportError> {
                    let mut taken = 0;
                    for prepared in ready.drain(..) {
                        parts.add(prepared)?;
                        taken += 1;
                        (self.work.on_tuples)(1, false);
                    }
                    Ok(taken)
                },
                || -> Result<Vec<Prepared>, ExportError> {
                    let batch = batch.unwrap_or_default().par_iter();
                    batch.map(|line| self.prepare(line)).collect()
                },
            );
            written += taken?;
            ready = next?;
        }
        if written == rest.len() as u64 {
            parts.close()?;
        }
        Ok(written)
    }

    fn prepare(&self, line: &SceneLine) -> Result<Prepared, ExportError> {
        let request = &self.plan.request;
        let remember = Some((self.digests, self.tuples));
        let mut sample = sample(self.store, line, (request.format, request.encoding), remember)?;
        let mut written = Vec::new();
        let results = Files::results(self.folder.root());
        if request.format.shard_ending().is_none() {
            for (name, bytes) in sample.files.drain(..) {
                // A relaxed write suffices, because the export syncs files once per part.
                atomic_file::write_relaxed(&self.folder.path(&name), &bytes)?;
                let stamp = results.stamp(&name)?;
                let record = FileRecord::new(&name, &bytes);
                self.digests.remember(&results, &name, stamp, &record.blake3);
                written.push(record);
            }
        }
        Ok(Prepared { sample, written })
    }
}

/// Splits lines into batches of at most `most` scenes that fit into memory.
fn batches<'a, 'b>(
    lines: &'a [&'b SceneLine],
    most: usize,
) -> impl Iterator<Item = &'a [&'b SceneLine]> {
    let mut rest = lines;
    std::iter::from_fn(move || {
        let mut pixels = 0;
        let fits = |line: &&&SceneLine| {
            pixels += u64::from(line.film.width) * u64::from(line.film.height);
            pixels <= BATCH_PIXELS
        };
        let count = rest.iter().take(most).take_while(fits).count();
        let (batch, later) = rest.split_at(count.max(1).min(rest.len()));
        rest = later;
        (!batch.is_empty()).then_some(batch)
    })
}
