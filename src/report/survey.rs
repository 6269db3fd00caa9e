//! Reads the run's status, the records of its tuples and the workers' logs from the store.

use crate::run::{Run, Scope, Snapshot, Status, WorkLog, keys, read_logs};
use crate::store::{Store, StoreError};
use glasshouse_line::SceneLine;
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::Layer;
use render::merge::{TupleRecord, tuple_files};
use render::trace::TRACER_VERSION;
use std::collections::BTreeSet;

pub(super) struct Survey {
    pub(super) status: Status,
    /// Scenes with a usable tuple, in the order of the manifest.
    pub(super) done: Vec<DoneScene>,
    /// Scenes with unusable tuples, and the reasons.
    pub(super) damaged: Vec<(SceneId, String)>,
    /// Scenes with a noise map.
    pub(super) noise: BTreeSet<SceneId>,
    /// Logs that workers left, oldest first.
    pub(super) logs: Vec<WorkLog>,
    /// Names of logs that cannot be read.
    pub(super) damaged_logs: Vec<String>,
}

/// A scene with a usable tuple.
pub(super) struct DoneScene {
    /// Index in the manifest.
    pub(super) index: usize,
    /// Facts of I, T, R~, R; `None` if a layer was not made.
    pub(super) layers: [Option<LayerFacts>; 4],
}

/// Entries of a layer in `tuple.json`, kept in memory for all scenes.
pub(super) struct LayerFacts {
    /// Samples per pixel; for an adaptive scene, their mean.
    pub(super) samples: f64,
    /// Stated RMS error, linear; `None` for one sample.
    pub(super) error_rms: Option<f64>,
}

impl Survey {
    /// Reads every record, but no picture.
    pub(super) fn of(run: &Run, store: &Store) -> Result<Self, StoreError> {
        let snapshot = Snapshot::take(run, store, Scope::STATUS)?;
        let listed: BTreeSet<String> = store.list(keys::TUPLES)?.into_iter().collect();
        let mut survey = Self {
            status: snapshot.status(),
            done: Vec::new(),
            damaged: Vec::new(),
            noise: BTreeSet::new(),
            logs: Vec::new(),
            damaged_logs: Vec::new(),
        };
        let lines = run.lines.iter().enumerate();
        let (indices, records): (Vec<usize>, Vec<String>) = lines
            .map(|(index, line)| (index, keys::tuple_record(&line.id)))
            .filter(|(_, key)| listed.contains(key))
            .unzip();
        store.for_each(&records, |at, bytes| {
            let index = indices[at];
            let line = &run.lines[index];
            match bytes.map(|bytes| facts(line, &bytes, &listed)) {
                // The record was removed after the listing.
                None => {}
                Some(Ok(layers)) => survey.done.push(DoneScene { index, layers }),
                Some(Err(reason)) => survey.damaged.push((line.id.clone(), reason)),
            }
        })?;
        let maps: BTreeSet<String> = store.list(keys::NOISE)?.into_iter().collect();
        let ids = run.lines.iter().map(|line| &line.id);
        let with_map = ids.filter(|id| maps.contains(&keys::noise(id)));
        survey.noise = with_map.cloned().collect();
        (survey.logs, survey.damaged_logs) = read_logs(store)?;
        Ok(survey)
    }
}

/// Returns the layers of a scene's `tuple.json`; the error is the damage to the tuple.
fn facts(
    line: &SceneLine,
    bytes: &[u8],
    listed: &BTreeSet<String>,
) -> Result<[Option<LayerFacts>; 4], String> {
    let record = parse(line, bytes)?;
    if let Some(file) =
        tuple_files(line).into_iter().find(|file| !listed.contains(&keys::tuple(&line.id, file)))
    {
        return Err(format!("{file} is missing"));
    }
    Ok(Layer::NAMES.map(|name| {
        let layer = record.layers.get(name)?;
        Some(LayerFacts {
            samples: layer.mean_samples.unwrap_or(f64::from(layer.samples)),
            error_rms: layer.error_rms,
        })
    }))
}

/// Parses `tuple.json` and checks that it belongs to the line and to this or an older version of the tracer.
pub(super) fn parse(line: &SceneLine, bytes: &[u8]) -> Result<TupleRecord, String> {
    let record: TupleRecord =
        serde_json::from_slice(bytes).map_err(|e| format!("tuple.json cannot be read: {e}"))?;
    if record.scene != *line {
        return Err("tuple.json belongs to another plan".to_owned());
    }
    if record.tracer_version > TRACER_VERSION {
        return Err(format!(
            "tuple.json has tracer version {}, but this program has {TRACER_VERSION}",
            record.tracer_version
        ));
    }
    Ok(record)
}
