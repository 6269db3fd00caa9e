//! `explain`: describes the state of a scene or shard in a run's store, and the next steps.

use super::attempts::{MOST_LOST, attempts_with_times};
use super::control::{Control, ControlState};
use super::done::is_done;
use super::error::AccessError;
use super::keys;
use super::open::Run;
use super::provenance::Provenance;
use super::snapshot::{SceneState, StandingAttempt};
use crate::store::{Store, StoreError};
use glasshouse_line::SceneLine;
use glasshouse_line::ids::SceneId;
use render::partial;
use render::trace::Tile;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::SystemTime;

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Explanation {
    pub(crate) scene: SceneId,
    /// Index in the manifest.
    pub(crate) index: usize,
    pub(crate) state: SceneState,
    pub(crate) line: SceneLine,
    pub(crate) shards: u32,
    /// Side of a tile, px.
    pub(crate) tile_px: u32,
    /// Number of sample ranges per tile.
    pub(crate) ranges: u32,
    /// Shards with partials, or all shards if the tuple exists, as half-open ranges.
    pub(crate) there: Vec<[u32; 2]>,
    /// The other shards, as half-open ranges.
    pub(crate) missing: Vec<[u32; 2]>,
    /// The requested shard, if any.
    pub(crate) shard: Option<ShardFacts>,
    /// Running and failed attempts at the scene.
    pub(crate) attempts: Vec<StandingAttempt>,
    pub(crate) quarantine: Option<serde_json::Value>,
    /// Provenance of the tuple, if a farm made it.
    pub(crate) receipt: Option<Provenance>,
    /// State of the run: running, paused or cancelled.
    pub(crate) run: ControlState,
    /// Sentences about the next steps of the workers and the user.
    pub(crate) next: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct ShardFacts {
    /// Index of the shard in the scene.
    pub(crate) index: u32,
    pub(crate) tile: Tile,
    /// Range of sample indices of each pixel, half open.
    pub(crate) samples: [u32; 2],
    /// Location of the shard's result, or a note that the result is missing or unusable.
    pub(crate) result: String,
}

/// Reason why a scene cannot be explained.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ExplainError {
    /// The store cannot be used.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The run has no such scene, or the scene has no such shard.
    #[error("{0}")]
    Unknown(String),
}

impl From<StoreError> for ExplainError {
    fn from(error: StoreError) -> Self {
        Self::Access(error.into())
    }
}

/// Explains a scene and, if `shard` is given, that shard.
pub(crate) fn explain(
    run: &Run,
    store: &Store,
    scene: &SceneId,
    shard: Option<u32>,
) -> Result<Explanation, ExplainError> {
    let place = run.lines.iter().position(|line| line.id == *scene);
    let index = place.ok_or_else(|| {
        let text =
            format!("{scene} is not a scene of this run; {} lists the scenes", keys::MANIFEST);
        ExplainError::Unknown(text)
    })?;
    let line = &run.lines[index];
    let layout = run.layout(line);
    if let Some(shard) = shard.filter(|&shard| shard >= layout.len()) {
        return Err(ExplainError::Unknown(format!(
            "{scene} has no shard {shard}: its {} shards are numbered from 0",
            layout.len()
        )));
    }
    let age_s = |put: SystemTime| put.elapsed().unwrap_or_default().as_secs_f64();
    let attempts = attempts_with_times(store, scene)?.into_iter();
    let attempts: Vec<StandingAttempt> =
        attempts.map(|a| StandingAttempt { age_s: age_s(a.last()), note: a.record }).collect();
    let partials: BTreeSet<u32> = store
        .list(&keys::partials(scene))?
        .iter()
        .filter_map(|key| keys::shard_of(key))
        .filter(|&shard| shard < layout.len())
        .collect();
    let quarantine = store.get(&keys::quarantine(scene))?.map(|bytes| {
        serde_json::from_slice(&bytes).unwrap_or_else(
            |e| serde_json::json!({ "reason": format!("the record is damaged: {e}") }),
        )
    });
    let state = if is_done(run, store, line)? {
        SceneState::Done
    } else {
        SceneState::of_unfinished(
            quarantine.is_some(),
            partials.len() as u32,
            layout.len(),
            !attempts.is_empty(),
        )
    };
    let control = Control::get(store)?;
    let facts = shard.map(|shard| {
        let cut = layout.shard(shard);
        Ok::<_, StoreError>(ShardFacts {
            index: shard,
            tile: cut.tile,
            samples: [cut.samples.start, cut.samples.end],
            result: result_of(store, scene, shard, state, &attempts)?,
        })
    });
    let missing = (0..layout.len()).filter(|shard| !partials.contains(shard));
    let mut explanation = Explanation {
        scene: scene.clone(),
        index,
        state,
        line: line.clone(),
        shards: layout.len(),
        tile_px: run.spec.tile_px,
        ranges: layout.ranges(),
        missing: rows(missing),
        there: rows(partials.iter().copied()),
        shard: facts.transpose()?,
        attempts,
        quarantine,
        receipt: Provenance::get(store, scene)?,
        run: control.state,
        next: Vec::new(),
    };
    if state == SceneState::Done {
        // The tuple contains the results of all shards.
        (explanation.there, explanation.missing) = (vec![[0, layout.len()]], Vec::new());
    }
    explanation.next = next(&explanation, &control);
    Ok(explanation)
}

/// Describes the location of a shard's result; reads and checks its partial.
fn result_of(
    store: &Store,
    scene: &SceneId,
    shard: u32,
    state: SceneState,
    attempts: &[StandingAttempt],
) -> Result<String, StoreError> {
    if state == SceneState::Done {
        return Ok("in the tuple".to_owned());
    }
    let key = keys::partial(scene, shard);
    let Some(bytes) = store.get(&key)? else {
        let holds = |a: &&StandingAttempt| (a.note.shards[0]..a.note.shards[1]).contains(&shard);
        let holder = attempts.iter().rfind(|a| holds(a) && a.note.ended.is_none());
        return Ok(match holder {
            Some(a) => format!("missing; {} holds the shard, or was lost with it", a.note.worker),
            None => "missing".to_owned(),
        });
    };
    let path = PathBuf::from(store.name()).join(&key);
    Ok(match partial::decode(&path, &bytes) {
        Ok(_) => format!("{key}, {} bytes, intact", bytes.len()),
        Err(error) => format!("unusable, so the shard will be traced again: {error}"),
    })
}

/// Groups ascending numbers into half-open ranges.
fn rows(numbers: impl Iterator<Item = u32>) -> Vec<[u32; 2]> {
    let mut rows: Vec<[u32; 2]> = Vec::new();
    for number in numbers {
        match rows.last_mut() {
            Some(row) if row[1] == number => row[1] += 1,
            _ => rows.push([number, number + 1]),
        }
    }
    rows
}

fn next(known: &Explanation, control: &Control) -> Vec<String> {
    let scene = &known.scene;
    let mut next = Vec::new();
    let left: u32 = known.missing.iter().map(|[start, end]| end - start).sum();
    match known.state {
        SceneState::Done => {
            next.push("Nothing is left to do.".to_owned());
            next.push(format!(
                "`glasshouse audit RUN --scene {scene}` traces the scene again and compares every file."
            ));
            return next;
        }
        SceneState::Quarantined => {
            next.push("The scene is left out; the run ends without it, with exit code 3.".to_owned());
            next.push(format!(
                "Repair the cause that the reason names, run `glasshouse retry RUN {scene}`, and start `work` (in a farm \
                 also `coordinate`) again if it has ended."
            ));
            return next;
        }
        SceneState::Complete => next.push(
            "All shards are traced: the next worker that opens the scene writes the tuple, or `glasshouse merge RUN` does."
                .to_owned(),
        ),
        SceneState::Begun if known.attempts.iter().any(|a| a.note.ended.is_none()) => next.push(format!(
            "{left} shards are missing. If the worker that holds them is alive, it continues; otherwise the queue delivers them \
             again after a lease, and a child process traces them. After {MOST_LOST} losses without a new partial, the scene \
             goes into quarantine."
        )),
        SceneState::Begun | SceneState::Waiting => next.push(format!(
            "The next worker that takes the scene traces the {left} missing shards."
        )),
    }
    match control.state {
        ControlState::Running => next.push(
            "If no worker is running, start `glasshouse work RUN`; in a farm, `glasshouse coordinate` publishes the missing shards."
                .to_owned(),
        ),
        ControlState::Paused => next.push(format!(
            "The run is paused{}: no worker takes the scene before `glasshouse resume RUN`.",
            control.because()
        )),
        ControlState::Cancelled => next.push(format!(
            "The run is cancelled{}: no worker takes the scene before `glasshouse resume RUN` and `glasshouse work RUN`.",
            control.because()
        )),
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn consecutive_numbers_are_one_range() {
        assert_eq!(rows([].into_iter()), Vec::<[u32; 2]>::new());
        assert_eq!(rows([0, 1, 2, 5, 7, 8].into_iter()), [[0, 3], [5, 6], [7, 9]]);
    }
}
