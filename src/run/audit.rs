//! Traces scenes again, in memory, and compares the results with the run's, bit for bit.
//!
//! The golden shard reveals machines that always compute other bits. An audit finds machines that sometimes do so, and
//! objects that were damaged later; it names the workers that made differing scenes.

use super::compare::{FileDifference, compare};
use super::error::AccessError;
use super::keys;
use super::open::Run;
use super::provenance::Provenance;
use crate::store::{Store, StoreError};
use bytes::Bytes;
use compose::encode_tuple;
use glasshouse_line::SceneLine;
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::ids::SceneId;
use render::job::{SceneJob, render_partials};
use render::merge::{TUPLE_SCHEMA_1, TupleRecord, combine, encode_tuple_record_1};
use render::partial::{self, Partial};
use render::scene::{InputDigests, load, read_files_by};
use render::shard::golden_of;
use render::trace::Isa;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;

pub(crate) struct AuditOptions<'a> {
    pub(crate) threads: usize,
    /// Instruction set of the tracer.
    pub(crate) isa: Isa,
    /// Flag that ends the audit when another thread sets it.
    pub(crate) stop: &'a AtomicBool,
}

/// Result of a scene's audit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// Every file is equal, bit for bit.
    Same,
    Differs,
    /// The scene could not be compared.
    NotCompared,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct SceneAudit {
    pub(crate) scene: SceneId,
    pub(crate) verdict: Verdict,
    /// Provenance of the scene's tuple, if the store has it.
    pub(crate) receipt: Option<Provenance>,
    pub(crate) files: u64,
    pub(crate) differences: Vec<FileDifference>,
    /// Reason why the scene could not be compared.
    pub(crate) reason: Option<String>,
}

impl SceneAudit {
    fn not_compared(self, reason: String) -> Self {
        Self { reason: Some(reason), ..self }
    }
}

/// Checks that this machine computes the golden shard's bits; otherwise its verdicts would mean nothing.
pub(crate) fn check_auditor(run: &Run, options: &AuditOptions) -> Result<(), AccessError> {
    let found = golden_of(&run.spec.golden.scene, options.isa, options.threads.max(1));
    if found == run.spec.golden {
        return Ok(());
    }
    Err(AccessError::Golden {
        scene: run.spec.golden.scene.clone(),
        found: found.blake3,
        expected: run.spec.golden.blake3.clone(),
    })
}

/// Draws a share (0 to 1) of the scenes with a tuple, but at least one of them. Returns their indices in the manifest,
/// ascending. The choice depends only on `share`, `seed` and the ids; a larger share only adds scenes.
pub(crate) fn draw_scenes(
    run: &Run,
    store: &Store,
    share: f64,
    seed: u64,
) -> Result<Vec<usize>, StoreError> {
    let listed: BTreeSet<String> = store.list(keys::TUPLES)?.into_iter().collect();
    let is_there = |line: &SceneLine| keys::tuple_keys(line).all(|key| listed.contains(&key));
    let lines = run.lines.iter().enumerate();
    let done = lines.filter(|(_, line)| is_there(line));
    Ok(draw(done.map(|(index, line)| (index, &line.id)), share, seed))
}

fn draw<'a>(
    scenes: impl Iterator<Item = (usize, &'a SceneId)>,
    share: f64,
    seed: u64,
) -> Vec<usize> {
    let mut drawn: Vec<([u8; 32], usize)> = scenes
        .map(|(index, id)| {
            let mut hasher = blake3::Hasher::new();
            hasher.update(b"audit");
            hasher.update(&seed.to_le_bytes());
            hasher.update(id.as_str().as_bytes());
            (*hasher.finalize().as_bytes(), index)
        })
        .collect();
    drawn.sort_unstable();
    let count = (share * drawn.len() as f64).ceil() as usize;
    drawn.truncate(count.max(1));
    let mut places: Vec<usize> = drawn.into_iter().map(|(_, index)| index).collect();
    places.sort_unstable();
    places
}

/// Traces a scene again and compares all of its files in the store: its tuple's files and its partials. Calls
/// `on_shard` after each shard. Returns `None` if `options.stop` ended the audit.
pub(crate) fn audit_scene(
    run: &Run,
    store: &Store,
    index: usize,
    options: &AuditOptions,
    on_shard: &(dyn Fn() + Sync),
) -> Result<Option<SceneAudit>, AccessError> {
    let line = &run.lines[index];
    let mut audit = SceneAudit {
        scene: line.id.clone(),
        verdict: Verdict::NotCompared,
        receipt: Provenance::get(store, &line.id)?,
        files: 0,
        differences: Vec::new(),
        reason: None,
    };
    let mut there = store.list(&keys::tuple_folder(&line.id))?;
    let partials = store.list(&keys::partials(&line.id))?;
    there.extend(partials.into_iter().filter(|key| keys::shard_of(key).is_some()));
    there.sort();
    if there.is_empty() {
        return Ok(Some(audit.not_compared("the run has no files of the scene yet".to_owned())));
    }
    let open = |path: &Path| run.inputs.read(path);
    let files = read_files_by(line, &run.roots, run.root(), &open);
    let loaded = match files.and_then(|files| load(line, &files)) {
        Ok(loaded) => loaded,
        Err(error) => {
            return Ok(Some(
                audit.not_compared(format!("this machine cannot load the scene: {error}")),
            ));
        }
    };
    let record = stored_record(store, line)?;
    if let Some(files) = record.as_ref().and_then(|r| other_inputs(r, &loaded.inputs)) {
        return Ok(Some(audit.not_compared(format!(
            "this machine's input files differ from the tuple's ({files}): some are damaged or of another version"
        ))));
    }
    let job = SceneJob::new(line, run.layout(line), loaded);
    let Some(partials) =
        render_partials(&job, options.threads, options.isa, options.stop, on_shard)
    else {
        return Ok(None);
    };
    let is_older = record.is_some_and(|record| record.schema == TUPLE_SCHEMA_1);
    let made = Made::new(run, line, &partials, is_older)?;
    for (key, stored) in there.iter().zip(store.get_all(&there)?) {
        // A file without content was removed meanwhile.
        let Some(stored) = stored else { continue };
        let Some(made) = made.file(key)? else { continue };
        audit.files += 1;
        let (stored, maker) = without_maker(key, stored);
        let Some(mut difference) = compare(key, &made, &stored) else { continue };
        difference.made_by = if key.starts_with(keys::PARTIALS) {
            maker.into_iter().collect()
        } else {
            audit.receipt.iter().flat_map(Provenance::workers).cloned().collect()
        };
        audit.differences.push(difference);
    }
    audit.verdict = if audit.differences.is_empty() { Verdict::Same } else { Verdict::Differs };
    Ok(Some(audit))
}

/// Takes the maker's name out of a partial, because every worker may make it. Returns other files, and partials that
/// cannot be read, as they are.
fn without_maker(key: &str, stored: Bytes) -> (Bytes, Option<String>) {
    if !key.starts_with(keys::PARTIALS) {
        return (stored, None);
    }
    let Ok(mut found) = partial::decode(Path::new(key), &stored) else {
        return (stored, None);
    };
    let maker = found.maker.take().map(|maker| maker.worker);
    (partial::encode(&found).map_or(stored, Bytes::from), maker)
}

/// Reads the record of a scene's tuple. Ignores a damaged record, because `audit_scene` compares the record like any
/// other file.
fn stored_record(store: &Store, line: &SceneLine) -> Result<Option<TupleRecord>, StoreError> {
    let bytes = store.get(&keys::tuple_record(&line.id))?;
    Ok(bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok()))
}

/// Names input files with different digests in the tuple's record and on this machine.
fn other_inputs(record: &TupleRecord, here: &InputDigests) -> Option<String> {
    let here = &here.0;
    let differ = |(name, digest): &(&String, &String)| here.get(*name) != Some(*digest);
    let names = record.inputs.0.iter().filter(differ);
    let names: Vec<&str> = names.map(|(name, _)| name.as_str()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// A scene that was traced again.
struct Made<'p> {
    partials: &'p [Partial],
    /// Names and bytes of the tuple's files.
    tuple: Vec<(String, Vec<u8>)>,
}

impl<'p> Made<'p> {
    /// `is_older` is true if the stored record has no digests of the files ([`TUPLE_SCHEMA_1`]).
    fn new(
        run: &Run,
        line: &SceneLine,
        partials: &'p [Partial],
        is_older: bool,
    ) -> Result<Self, AccessError> {
        let cannot = |e: &dyn std::fmt::Display| AccessError::Tuple(e.to_string());
        let tuple = combine(line, run.spec.tile_px, partials).map_err(|e| cannot(&e))?;
        let mut files = encode_tuple(&tuple, &SrgbEncoder::new()).map_err(|e| cannot(&e))?;
        if let Some((_, record)) = files.last_mut().filter(|_| is_older) {
            *record = encode_tuple_record_1(&tuple.record).map_err(|e| cannot(&e))?;
        }
        Ok(Self { partials, tuple: files })
    }

    /// Returns the file under `key`, or `None` if the scene has no such file. A partial names no maker.
    fn file(&self, key: &str) -> Result<Option<Vec<u8>>, AccessError> {
        if key.starts_with(keys::PARTIALS) {
            let shard = keys::shard_of(key);
            let found = shard.and_then(|s| self.partials.iter().find(|p| p.header.shard == s));
            let bytes = found.map(partial::encode).transpose();
            return bytes.map_err(|e| AccessError::Tuple(format!("cannot encode {key}: {e}")));
        }
        let name = key.rsplit('/').next().unwrap_or(key);
        let found = self.tuple.iter().find(|(file, _)| file == name);
        Ok(found.map(|(_, bytes)| bytes.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_choice_of_scenes_depends_only_on_seed_and_ids() {
        let ids: Vec<SceneId> =
            (0..200).map(|n| SceneId::new(format!("train-{n}")).unwrap()).collect();
        let of = |share, seed| draw(ids.iter().enumerate(), share, seed);
        assert_eq!(of(0.0, 1).len(), 1);
        assert_eq!(of(0.005, 1).len(), 1);
        assert_eq!(of(0.1, 1).len(), 20);
        assert_eq!(of(1.0, 1), (0..200).collect::<Vec<_>>());
        assert_eq!(of(0.1, 1), of(0.1, 1));
        assert_ne!(of(0.1, 1), of(0.1, 2));
        let (few, many) = (of(0.1, 1), of(0.3, 1));
        assert!(few.iter().all(|index| many.contains(index)));
        assert!(draw(std::iter::empty(), 0.5, 1).is_empty());
    }
}
