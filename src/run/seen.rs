//! What a coordinator has seen of its run, for who watches.

use super::attempts::AttemptRecord;
use super::control::Control;
use super::keys;
use super::receipt::Receipt;
use super::run_dir::Run;
use crate::store::Store;
use render::ids::SceneId;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// What a coordinator knows, for who watches. It is told anew at every look.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    /// Scenes with a tuple.
    pub done: u64,
    /// Scenes in quarantine.
    pub quarantined: u64,
    /// Scenes of the run.
    pub scenes: u64,
    /// Spans that wait in the queue.
    pub waiting: u64,
    /// Spans that workers hold.
    pub held: u64,
    /// Why the queue is away, if it is.
    pub queue_lost: Option<String>,
    /// Nothing is left to do.
    pub finished: bool,
    /// What the run has been told.
    pub control: Control,
    /// Scenes with a tuple, in the order in which they were seen.
    pub tuples: Vec<SeenTuple>,
    /// Scenes in quarantine (place in the manifest) with their reasons.
    pub reasons: Vec<(usize, String)>,
    /// Work in hand, by the names of its attempts.
    pub attempts: BTreeMap<String, SeenAttempt>,
}

/// A tuple that the coordinator saw.
#[derive(Clone, Debug)]
pub struct SeenTuple {
    /// Its scene's place in the manifest.
    pub scene: usize,
    /// When it was seen first; not known of those that were there at the start.
    pub at: Option<Instant>,
    /// Who made it.
    pub receipt: Receipt,
}

/// Work in hand that the coordinator saw.
#[derive(Clone, Debug)]
pub struct SeenAttempt {
    /// What is known of it.
    pub record: AttemptRecord,
    /// When it was seen first.
    pub at: Instant,
}

/// Over so long a time the rate is taken.
const RATE_OVER: Duration = Duration::from_mins(5);

impl Watch {
    /// Scenes a second over the last minutes, if any were seen.
    pub fn rate_scenes_per_s(&self) -> Option<f64> {
        let ages: Vec<f64> = self
            .tuples
            .iter()
            .rev()
            .map_while(|tuple| tuple.at.map(|at| at.elapsed()))
            .take_while(|age| *age < RATE_OVER)
            .map(|age| age.as_secs_f64())
            .collect();
        let oldest = ages.last().copied().filter(|age| *age > 0.0)?;
        Some(ages.len() as f64 / oldest)
    }
}

/// Adds tuples to what is shown. What their receipts say is only shown: without them it is not known.
pub(crate) fn see_tuples(
    run: &Run,
    store: &Store,
    scenes: &[usize],
    first: bool,
    watch: &Mutex<Watch>,
) {
    let name = |&scene: &usize| keys::receipt(&run.lines[scene].id);
    let names: Vec<String> = scenes.iter().map(name).collect();
    let receipts = store.get_all(&names).unwrap_or_default();
    let mut receipts = receipts.into_iter().map(|bytes| {
        let receipt = bytes.map(|bytes| Receipt::parse(&bytes));
        receipt.unwrap_or_default()
    });
    let at = (!first).then(Instant::now);
    let mut watch = watch.lock().expect("no holder of this lock panics");
    for &scene in scenes {
        watch.tuples.push(SeenTuple {
            scene,
            at,
            receipt: receipts.next().unwrap_or_default(),
        });
    }
}

/// Looks who works on what. A store that does not answer changes nothing.
pub(crate) fn see_attempts(store: &Store, watch: &Mutex<Watch>) {
    let Ok(listed) = store.list(keys::ATTEMPTS) else {
        return;
    };
    let listed: BTreeSet<String> = listed.into_iter().collect();
    let new: Vec<String> = {
        let mut watch = watch.lock().expect("no holder of this lock panics");
        watch.attempts.retain(|key, _| listed.contains(key));
        let is_new = |key: &String| !watch.attempts.contains_key(key);
        listed.into_iter().filter(is_new).collect()
    };
    let Ok(found) = store.get_all(&new) else {
        return;
    };
    let at = Instant::now();
    let mut watch = watch.lock().expect("no holder of this lock panics");
    for (key, bytes) in new.into_iter().zip(found) {
        let scene = key.split('/').nth(1).and_then(|id| SceneId::new(id).ok());
        let record = scene.and_then(|scene| AttemptRecord::parse(&scene, &key, &bytes?));
        if let Some(record) = record {
            watch.attempts.insert(key, SeenAttempt { record, at });
        }
    }
}
