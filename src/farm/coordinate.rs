//! The coordinator: sees to it that everything that is not done is in the queue, and that the run ends.
//!
//! It has no state of its own. Starting, resuming and taking over from another coordinator are the same loop: look at
//! the queue, then at the store, publish what is in neither. Any number may run at once, for publishing twice does
//! nothing and merging twice makes the same bytes.

use super::error::FarmError;
use super::queue::{QueueError, QueueKeeper, QueueState, Waiting};
use super::share::share_run;
use super::sweep::sweep_staged;
use super::tuples::remove_partials;
use super::worker::whole;
use crate::run::AccessError;
use crate::run::control::{Control, ControlState};
use crate::run::done::Progress;
use crate::run::events::Event;
use crate::run::keys;
use crate::run::run_dir::Run;
use crate::run::seen::{Watch, see_attempts, see_tuples};
use crate::store::Store;
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How to coordinate.
pub struct CoordinateOptions<'a> {
    /// Set from outside to end.
    pub stop: &'a AtomicBool,
    /// Shortest time between two looks.
    pub every: Duration,
    /// Somebody may want to see who works on what.
    pub watched: bool,
}

/// How coordinating ended.
#[derive(Debug)]
pub struct Coordinated {
    /// What was known at the end.
    pub watch: Watch,
    /// Spans published.
    pub published: u64,
    /// Ended by `stop`.
    pub stopped: bool,
    /// Ended because the run is cancelled.
    pub cancelled: bool,
}

/// A look must not cost more than a twentieth of the time.
const LOOK_SHARE: u32 = 20;
/// Between two looks at everything, if nothing makes one due before.
const EVERYTHING: Duration = Duration::from_mins(10);
/// Between two complaints about a queue that is away.
const COMPLAIN: Duration = Duration::from_secs(30);

/// What one look at the queue found.
struct Looked {
    state: QueueState,
    /// It is another queue than at the last look.
    other: bool,
    /// Scenes in it, if it was a look at everything.
    scenes: BTreeSet<u32>,
}

fn look(queue: &dyn QueueKeeper, everything: bool) -> Result<Looked, QueueError> {
    let other = queue.ensure()?;
    let state = queue.look()?;
    let scenes = if everything {
        queue.scenes()?
    } else {
        BTreeSet::new()
    };
    Ok(Looked {
        state,
        other,
        scenes,
    })
}

/// Looks and publishes until every scene is done or in quarantine. `watch` is kept up to date.
///
/// Most looks are at what changes: how much is in the queue, and receipts. Everything is looked at, and what is missing
/// published, at the start, when nothing is in the queue, when it is another one, when something done or set aside was
/// taken back, before the end, and now and then.
pub fn coordinate(
    run: &Run,
    store: &Store,
    queue: &dyn QueueKeeper,
    options: &CoordinateOptions,
    watch: &Mutex<Watch>,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<Coordinated, FarmError> {
    share_run(run, store)?;
    let mut progress = Progress::new(run.lines.len());
    let mut told = vec![false; run.lines.len()];
    let (mut published, mut complained) = (0, None::<Instant>);
    let mut store_complained = None;
    // Quiet at the last look, too: a message on its way from one to the other is in neither count for a moment.
    let mut was_quiet = false;
    let (mut due, mut looked_at_all) = (true, Instant::now());
    let mut took_before = Duration::ZERO;
    let mut first = true;
    let mut control = Control::default();
    on_event(Event::Started {
        shards: run.lines.len() as u64,
        scenes: run.lines.len() as u64,
    });
    loop {
        let start = Instant::now();
        let everything = due || looked_at_all.elapsed() > EVERYTHING;
        // First the queue, then the store: a scene that leaves the queue in between has its tuple by then.
        let looked = look(queue, everything);
        let updated = if everything {
            progress.look(run, store).map(|()| false)
        } else {
            progress.look_for_news(run, store)
        };
        let updated = updated
            .and_then(|taken_back| Ok((taken_back, Control::get(store)?)))
            .map_err(FarmError::from);
        let (taken_back, told_to) = match updated {
            Ok(found) => found,
            Err(error) => {
                wait_for_store(error, options, &mut store_complained, on_event)?;
                if options.stop.load(Ordering::Relaxed) {
                    return Ok(ended(watch, published, true));
                }
                continue;
            }
        };
        store_complained = None;
        due |= taken_back;
        let new: Vec<usize> = (0..run.lines.len())
            .filter(|&scene| progress.done[scene] && !std::mem::replace(&mut told[scene], true))
            .collect();
        see_tuples(run, store, &new, first, watch);
        if options.watched {
            see_attempts(store, watch);
        }
        for &scene in &new {
            on_event(Event::ShardDone { resumed: first });
            on_event(Event::SceneMerged {
                scene: run.lines[scene].id.clone(),
                miss_share: 0.0,
            });
        }
        first = false;
        let finished = progress.is_finished();
        if finished && !everything {
            due = true;
            continue;
        }
        {
            let mut watch = watch.lock().expect("no holder of this lock panics");
            let count = |n: usize| n as u64;
            watch.scenes = count(run.lines.len());
            watch.done = count(progress.done.iter().filter(|d| **d).count());
            watch.quarantined = count(progress.quarantined.iter().flatten().count());
            watch.finished = finished;
            watch.control = told_to.clone();
            let reasons = progress.quarantined.iter().enumerate();
            watch.reasons = reasons.filter_map(|(s, r)| Some((s, r.clone()?))).collect();
            match &looked {
                Ok(Looked { state, .. }) => {
                    (watch.waiting, watch.held) = (state.waiting, state.held);
                    watch.queue_lost = None;
                }
                Err(error) => watch.queue_lost = Some(error.to_string()),
            }
        }
        if std::mem::replace(&mut control, told_to.clone()) != told_to {
            on_event(Event::Controlled {
                state: told_to.state,
                reason: told_to.reason.clone(),
            });
        }
        if finished {
            break;
        }
        if options.stop.load(Ordering::Relaxed) {
            return Ok(ended(watch, published, true));
        }
        if told_to.state == ControlState::Cancelled {
            // One that cannot be removed does no harm: nobody takes from it.
            let _ = queue.remove();
            return Ok(ended(watch, published, false));
        }
        match looked {
            Ok(_) if told_to.state == ControlState::Paused => (complained, due) = (None, true),
            Ok(looked) => {
                complained = None;
                let quiet = looked.state.is_quiet();
                if everything {
                    // Nobody will get what is left in a quiet queue: leftovers of a server that was killed.
                    let dead = quiet && was_quiet && !looked.scenes.is_empty();
                    let missing: Vec<Waiting> = progress
                        .missing()
                        .filter(|&scene| dead || !looked.scenes.contains(&(scene as u32)))
                        .map(|scene| whole(run, scene))
                        .collect();
                    let told = if dead { queue.purge() } else { Ok(()) };
                    match told.and_then(|()| queue.publish(&missing)) {
                        Ok(()) => {
                            published += missing.len() as u64;
                            (due, looked_at_all) = (false, Instant::now());
                        }
                        Err(error) => complain(&mut complained, error.to_string(), on_event),
                    }
                } else {
                    due |= looked.other;
                }
                due |= quiet;
                was_quiet = quiet;
            }
            Err(error) => {
                due = true;
                complain(&mut complained, error.to_string(), on_event);
            }
        }
        // One look that waited for a server must not cost twenty times that: what the shorter of the last two took counts.
        let took = start.elapsed();
        let pause = options.every.max(took.min(took_before) * LOOK_SHARE);
        took_before = took;
        let until = Instant::now() + pause;
        while Instant::now() < until && !options.stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20).min(pause));
        }
    }
    while let Err(error) = finish(run, store, queue, &progress) {
        wait_for_store(error, options, &mut store_complained, on_event)?;
        if options.stop.load(Ordering::Relaxed) {
            return Ok(ended(watch, published, true));
        }
    }
    Ok(ended(watch, published, false))
}

/// Says that the store is away, and waits a little; any other error stays one.
fn wait_for_store(
    error: FarmError,
    options: &CoordinateOptions,
    complained: &mut Option<Instant>,
    on_event: &(dyn Fn(Event) + Sync),
) -> Result<(), FarmError> {
    let FarmError::Access(AccessError::Store(error)) = error else {
        return Err(error);
    };
    if !error.is_passing() {
        return Err(error.into());
    }
    if complained.is_none_or(|at| at.elapsed() > COMPLAIN) {
        *complained = Some(Instant::now());
        let reason = error.to_string();
        on_event(Event::StoreLost { reason });
    }
    std::thread::sleep(options.every);
    Ok(())
}

fn ended(watch: &Mutex<Watch>, published: u64, stopped: bool) -> Coordinated {
    let watch = watch.lock().expect("no holder of this lock panics");
    Coordinated {
        watch: watch.clone(),
        published,
        stopped,
        cancelled: !watch.finished && watch.control.state == ControlState::Cancelled,
    }
}

fn complain(last: &mut Option<Instant>, reason: String, on_event: &(dyn Fn(Event) + Sync)) {
    if last.is_none_or(|at| at.elapsed() > COMPLAIN) {
        *last = Some(Instant::now());
        on_event(Event::QueueLost { reason });
    }
}

/// Removes what is left of scenes that are done. What cannot be removed does no harm.
fn clear_away(run: &Run, store: &Store, progress: &Progress) {
    let done = || (0..run.lines.len()).filter(|&scene| progress.done[scene]);
    if store.local_root().is_some() {
        done().for_each(|scene| remove_partials(store, &run.lines[scene]));
        return;
    }
    let done: BTreeSet<&str> = done().map(|scene| run.lines[scene].id.as_str()).collect();
    for folder in [keys::PARTIALS, keys::ATTEMPTS] {
        let mut left = store.list(folder).unwrap_or_default();
        left.retain(|key| key.split('/').nth(1).is_some_and(|id| done.contains(id)));
        let _ = store.delete(&left);
    }
}

/// Says that the run is over, and clears away what nobody needs any more.
fn finish(
    run: &Run,
    store: &Store,
    queue: &dyn QueueKeeper,
    progress: &Progress,
) -> Result<(), FarmError> {
    clear_away(run, store, progress);
    sweep_staged(run, store);
    let quarantined = progress.quarantined.iter().flatten().count();
    let note = serde_json::json!({
        "schema": "glasshouse.finished/1",
        "scenes": run.lines.len(),
        "quarantined": quarantined,
    });
    store.replace(keys::FINISHED, format!("{note}\n").as_bytes())?;
    // A queue that cannot be removed does no harm: its messages are of a run that is over.
    let _ = queue.remove();
    Ok(())
}
