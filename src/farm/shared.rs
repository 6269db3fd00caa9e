//! What the threads of a worker share, and how what they have made gets into the store.

use super::error::FarmError;
use super::finished::FinishedScene;
use super::hand::Band;
use super::held::{Costs, HeldSpans};
use super::intake::Loaded;
use super::open_span::OpenSpan;
use super::queue::Queue;
use super::work::{Outcome, SharedQueue, WorkOptions};
use super::writer::{Order, What, remove_partials, write_noise};
use crate::run::Stop;
use crate::run::control::ControlFlag;
use crate::run::done::is_done;
use crate::run::events::{Event, StageSeconds, Stopwatch};
use crate::run::keys;
use crate::run::made_by::MadeBy;
use crate::run::quarantine::QuarantineRecord;
use crate::run::receipt::Receipt;
use crate::run::run_dir::Run;
use crate::run::work_log::SceneSeconds;
use crate::store::Store;
use crossbeam::channel::Receiver;
use crossbeam::deque::{Injector, Stealer};
use render::ids::SceneId;
use render::line::SceneLine;
use render::merge::SrgbEncoder;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Instant;

pub(super) struct Shared<'a> {
    pub(super) run: &'a Run,
    pub(super) store: &'a Store,
    pub(super) queue: &'a dyn Queue,
    /// Other workers are there.
    pub(super) beside: Option<&'a SharedQueue<'a>>,
    pub(super) options: &'a WorkOptions<'a>,
    pub(super) on_event: &'a (dyn Fn(Event) + Sync),
    pub(super) files: Receiver<Loaded<'a>>,
    pub(super) stealers: Vec<Stealer<Band<'a>>>,
    /// Before all else: what is traced is to become durable soon, and its memory free.
    pub(super) to_encode: Injector<(Arc<FinishedScene<'a>>, usize)>,
    /// Scenes whose last shards others have traced.
    pub(super) to_complete: Injector<Arc<OpenSpan<'a>>>,
    /// Spans whose partials are to be written.
    pub(super) to_checkpoint: Injector<Arc<OpenSpan<'a>>>,
    pub(super) encoder: SrgbEncoder,
    pub(super) held: HeldSpans<'a>,
    /// Spans that are loaded, or being loaded, and have not ended.
    pub(super) open: AtomicUsize,
    pub(super) merged: AtomicU64,
    pub(super) found_merged: AtomicU64,
    pub(super) traced: AtomicU64,
    pub(super) resumed: AtomicU64,
    pub(super) given: AtomicU64,
    pub(super) loads: AtomicU64,
    /// Those of children, which did not cost this process anything.
    pub(super) isolated_loads: AtomicU64,
    pub(super) timed_out: AtomicBool,
    pub(super) drained: AtomicBool,
    /// There is nothing to do here, and nothing in the queue.
    pub(super) hungry: AtomicBool,
    /// Somebody has published something because this worker asked.
    pub(super) promised: AtomicBool,
    /// In which time other workers load a scene; 0 if none has told.
    pub(super) others_load_us: AtomicU64,
    /// Scenes that failed since the last one that did not.
    pub(super) failing: Mutex<BTreeSet<SceneId>>,
    /// What the run has been told.
    pub(super) control: ControlFlag,
    pub(super) quarantined: Mutex<Vec<(SceneId, String)>>,
    pub(super) failure: Mutex<Option<FarmError>>,
    pub(super) broken: AtomicBool,
    /// The threads that compute have gone home.
    pub(super) over: AtomicBool,
    pub(super) seconds: StageSeconds,
    /// What tracing cost here, by scene.
    pub(super) scene_seconds: SceneSeconds,
}

impl<'a> Shared<'a> {
    pub(super) fn outcome(self) -> Result<Outcome, FarmError> {
        let failure = self.failure.into_inner();
        if let Some(error) = failure.expect("no holder of this lock panics") {
            return Err(error);
        }
        let stopped = if self.drained.into_inner() {
            Some(Stop::Drained)
        } else if self.options.stop.load(Ordering::Relaxed) {
            Some(Stop::Asked)
        } else if self.control.is_cancelled() {
            Some(Stop::Cancelled)
        } else {
            let timed_out = self.timed_out.load(Ordering::Relaxed);
            timed_out.then_some(Stop::TimeLimit)
        };
        let quarantined = self.quarantined.into_inner();
        let mut quarantined = quarantined.expect("no holder of this lock panics");
        quarantined.sort();
        Ok(Outcome {
            merged: self.merged.into_inner(),
            already_merged: self.found_merged.into_inner(),
            traced: self.traced.into_inner(),
            resumed: self.resumed.into_inner(),
            loaded: self.loads.into_inner() + self.isolated_loads.into_inner(),
            given: self.given.into_inner(),
            quarantined,
            stopped,
            seconds: self.seconds,
        })
    }

    /// No further shard may be begun.
    pub(super) fn must_stop(&self) -> bool {
        if self
            .options
            .deadline
            .is_some_and(|deadline| Instant::now() >= deadline)
        {
            self.timed_out.store(true, Ordering::Relaxed);
        }
        self.options.stop.load(Ordering::Relaxed)
            || self.timed_out.load(Ordering::Relaxed)
            || self.drained.load(Ordering::Relaxed)
            || self.broken.load(Ordering::Relaxed)
            || self.control.is_cancelled()
    }

    /// Spans to have read before they are needed. Beside other workers nothing is hoarded.
    pub(super) fn ahead(&self) -> usize {
        self.options.threads.div_ceil(4)
    }

    /// What a shard and a scene cost this worker so far.
    pub(super) fn costs(&self) -> Costs {
        let seconds = self.seconds.all();
        let of = |stage: &str| {
            let found = seconds.iter().find(|(name, _)| *name == stage);
            found.map_or(0.0, |(_, s)| *s)
        };
        let mean = |sum: f64, count: &AtomicU64, guess: f64| match count.load(Ordering::Relaxed) {
            0 => guess,
            n => sum / n as f64,
        };
        Costs {
            shard_s: mean(of("trace"), &self.traced, 0.4),
            threads: self.options.threads.max(1) as f64,
            load_s: mean(of("read") + of("decode"), &self.loads, 0.1),
            load_is_known: self.loads.load(Ordering::Relaxed) > 0,
        }
    }

    /// Writes all that is ordered, also after a stop; once the farm is broken only takes it, so that nobody waits.
    pub(super) fn write(&self, orders: &Receiver<Order<'a>>) {
        for Order { span, what } in orders {
            if self.broken.load(Ordering::Relaxed) {
                continue;
            }
            let line = span.job.line;
            let start = Stopwatch::start();
            self.step(&span, || match what {
                What::Partial { .. } if span.is_merged() => Ok(()),
                What::Partial { shard, bytes } => {
                    let put = self.put_partial(&span, shard, &bytes.into());
                    if put.is_err() && self.is_done_elsewhere(&span)? {
                        // Its folder went while this was being written.
                        return Ok(());
                    }
                    if !put? {
                        return Ok(());
                    }
                    self.seconds.add_checkpoint(start.spent());
                    if span.stored() {
                        self.end_in_part(&span)?;
                    }
                    Ok(())
                }
                What::Tuple {
                    encoded,
                    miss_share,
                } => {
                    // Made before the tuple is there: from then on others may take away the notes that it is made from.
                    let receipt = self.receipt(&span);
                    if let Some(noise) = encoded.noise {
                        write_noise(self.store, line, &noise);
                    }
                    if !self.put_tuple(&span, encoded.files)? {
                        return Ok(());
                    }
                    span.merged();
                    if let Some(receipt) = receipt {
                        // Nothing depends on it.
                        let _ = receipt.put(self.store, &line.id);
                    }
                    remove_partials(self.store, line);
                    self.seconds.add_write(start.spent());
                    self.merged.fetch_add(1, Ordering::Relaxed);
                    self.went_well();
                    (self.on_event)(Event::SceneMerged {
                        scene: line.id.clone(),
                        miss_share,
                    });
                    self.close(span.delivery.ticket);
                    Ok(())
                }
            });
        }
    }

    /// A span's own shards are durable: whoever finds all of the scene's shards there completes it.
    pub(super) fn end_in_part(&self, span: &Arc<OpenSpan<'a>>) -> Result<(), FarmError> {
        let line = span.job.line;
        let there = self.store.list(&keys::partials(&line.id))?;
        let shards = there.iter().filter_map(|key| keys::shard_of(key)).count();
        if shards >= span.job.layout.len() as usize {
            self.to_complete.push(Arc::clone(span));
        } else if !self.is_done_elsewhere(span)? {
            let (store, mine) = (self.store, &span.delivery.waiting.span);
            MadeBy::leave(store, &line.id, mine, &self.options.who);
            self.went_well();
            self.close(span.delivery.ticket);
        }
        Ok(())
    }

    /// Another worker has made the scene's tuple: this one slept, and what it still holds is of no use. True if so; the
    /// span is closed then.
    fn is_done_elsewhere(&self, span: &OpenSpan<'a>) -> Result<bool, FarmError> {
        let line = span.job.line;
        if self.beside.is_none() || !is_done(self.store, line)? {
            return Ok(false);
        }
        // Its partials that are still on their way to the writer would stay behind for good.
        span.merged();
        if !span.job.failed().swap(true, Ordering::AcqRel) {
            remove_partials(self.store, line);
            self.close(span.delivery.ticket);
        }
        Ok(true)
    }

    /// An open span has ended.
    pub(super) fn close(&self, ticket: u64) {
        self.let_go(ticket);
        self.open.fetch_sub(1, Ordering::AcqRel);
    }

    pub(super) fn failing(&self) -> MutexGuard<'_, BTreeSet<SceneId>> {
        self.failing.lock().expect("no holder of this lock panics")
    }

    /// Does a piece of a span's work; a panic in it costs its scene, not the farm.
    pub(super) fn step(&self, span: &OpenSpan<'a>, work: impl FnOnce() -> Result<(), FarmError>) {
        self.held.touch(span.delivery.ticket);
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => self.break_down(error),
            Err(panic) => self.fail(span, &panic_reason(&*panic)),
        }
        self.held.touch(span.delivery.ticket);
    }

    /// The scene of an open span cannot be done.
    pub(super) fn fail(&self, span: &OpenSpan<'a>, reason: &str) {
        if !span.job.failed().swap(true, Ordering::AcqRel) {
            self.quarantine(span.job.line, reason);
            self.close(span.delivery.ticket);
        }
    }

    pub(super) fn break_down(&self, error: FarmError) {
        self.broken.store(true, Ordering::Relaxed);
        self.failure
            .lock()
            .expect("no holder of this lock panics")
            .get_or_insert(error);
    }

    pub(super) fn quarantine(&self, line: &SceneLine, reason: &str) {
        if let Err(error) = QuarantineRecord::put(self.store, &line.id, reason) {
            self.break_down(error.into());
            return;
        }
        self.tell_quarantine(line, reason);
    }

    pub(super) fn tell_quarantine(&self, line: &SceneLine, reason: &str) {
        let entry = (line.id.clone(), reason.to_owned());
        self.quarantined
            .lock()
            .expect("no holder of this lock panics")
            .push(entry);
        (self.on_event)(Event::SceneQuarantined {
            scene: line.id.clone(),
            reason: reason.to_owned(),
            shards: u64::from(self.run.layout(line).len()),
        });
    }

    /// Beside other workers: who makes the tuple.
    fn receipt(&self, span: &OpenSpan) -> Option<Receipt> {
        self.beside?;
        let (scene, who) = (&span.job.line.id, &self.options.who);
        Some(Receipt::new(self.store, scene, who, span.is_alone()))
    }
}

pub(super) fn panic_reason(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned());
    format!(
        "the program failed on this scene ({text}); please report it with the scene's manifest line"
    )
}
