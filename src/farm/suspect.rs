//! What happens to a span between the queue and the hands: is it still to do, was it lost before, can its files be read.

use super::error::FarmError;
use super::queue::{Delivery, Waiting};
use super::shared::Shared;
use crate::run::Span;
use crate::run::attempts::{
    AttemptRecord, EndKind, Ending, Verdict, attempts, is_unreadable, mark_lost, verdict,
};
use crate::run::done::is_done;
use crate::run::events::Event;
use crate::run::keys;
use crate::run::quarantine::QuarantineRecord;
use render::ids::SceneId;
use render::line::SceneLine;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Traces spans in another process, since they may kill it.
pub trait Isolate: Sync {
    /// Traces a span of a scene and writes what comes of it to the run's store. `on_sign` is called while there is
    /// progress; when `must_stop` says so the process is ended.
    fn trace(
        &self,
        scene: &SceneId,
        span: &Span,
        on_sign: &dyn Fn(),
        must_stop: &dyn Fn() -> bool,
    ) -> IsolatedEnd;
}

/// How it went.
#[derive(Clone, Debug)]
pub enum IsolatedEnd {
    /// All of it is durable, or its scene is in quarantine.
    Done {
        /// Tuples written: one or none.
        merged: u64,
        /// Shards traced.
        traced: u64,
        /// Shards found.
        resumed: u64,
        /// Scenes loaded: one, if it got so far.
        loaded: u64,
        /// Why the scene is in quarantine, if it is.
        quarantined: Option<String>,
    },
    /// It was told to end before its end.
    Stopped,
    /// It died, or made no progress.
    Lost(Ending),
    /// It could not work, which is not the scene's fault.
    Failed(String),
}

/// What is to be done with a span.
pub(super) enum Examined {
    /// Nothing: its scene is done or set aside, or another worker has it now.
    Over,
    /// Trace it.
    Fresh,
    /// Trace it in a process of its own.
    Suspect,
}

/// So many scenes in a row that fail on one worker are its own fault.
const FAILURES_IN_A_ROW: usize = 3;
/// A machine waits so long before it reads files again that it could not read, times how often it tried.
const READ_AGAIN: Duration = Duration::from_secs(1);

impl Shared<'_> {
    /// Looks at what is known of a span that was taken, and records the attempt if it is to be traced.
    pub(super) fn examine(
        &self,
        line: &SceneLine,
        delivery: &Delivery,
    ) -> Result<Examined, FarmError> {
        let (store, span) = (self.store, &delivery.waiting.span);
        if self.beside.is_some()
            && (is_done(store, line)? || QuarantineRecord::get(store, &line.id)?.is_some())
        {
            return Ok(Examined::Over);
        }
        if self.beside.is_some_and(|shared| shared.is_child) {
            return Ok(Examined::Fresh);
        }
        let mut records = attempts(store, &line.id)?;
        if delivery.suspect {
            records = mark_lost(store, records, span)?;
        }
        let found = if self.run.layout(line).len() > 1 {
            let there = store.list(&keys::partials(&line.id))?;
            let shards = there.iter().filter_map(|key| keys::shard_of(key));
            shards.filter(|shard| span.shards.contains(shard)).count() as u32
        } else {
            0
        };
        let verdict = verdict(&records, span, found);
        if let Verdict::SetAside(reason) = verdict {
            self.quarantine(line, &reason);
            return Ok(Examined::Over);
        }
        // What has failed before is not handed to and fro.
        if !records.is_empty() && !self.held.keep(delivery.ticket) {
            return Ok(Examined::Over);
        }
        let tried_here = records.iter().filter(|r| r.could_not_read(self.host()));
        self.pause(READ_AGAIN * tried_here.count() as u32);
        let mut record = AttemptRecord::new(&line.id, span, &self.options.who, found);
        record.begin(store, &records)?;
        if !self.held.note(delivery.ticket, record.clone()) {
            record.forget(store);
            return Ok(Examined::Over);
        }
        Ok(match verdict {
            Verdict::Suspect if self.options.isolate.is_some() => Examined::Suspect,
            _ => Examined::Fresh,
        })
    }

    fn host(&self) -> &str {
        &self.options.who.host
    }

    fn pause(&self, time: Duration) {
        let start = Instant::now();
        while start.elapsed() < time && !self.must_stop() {
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Traces a suspect in a process of its own.
    pub(super) fn isolate(&self, line: &SceneLine, delivery: &Delivery) -> Result<(), FarmError> {
        let (ticket, span) = (delivery.ticket, &delivery.waiting.span);
        let Some(isolate) = self.options.isolate else {
            return Ok(());
        };
        // From now on it is not given away.
        if !self.held.may_open(ticket) {
            return Ok(());
        }
        (self.on_event)(Event::Isolated {
            scene: line.id.clone(),
        });
        let end = isolate.trace(&line.id, span, &|| self.held.touch(ticket), &|| {
            self.must_stop()
        });
        match end {
            IsolatedEnd::Done {
                merged,
                traced,
                resumed,
                loaded,
                quarantined,
            } => {
                self.isolated_loads.fetch_add(loaded, Ordering::Relaxed);
                self.count(line, [merged, traced, resumed], quarantined);
                self.let_go(ticket);
                Ok(())
            }
            IsolatedEnd::Stopped => {
                self.pass_to_others(delivery);
                Ok(())
            }
            IsolatedEnd::Lost(ending) => self.lost(line, delivery, ending),
            IsolatedEnd::Failed(reason) => {
                self.let_go(ticket);
                Err(FarmError::Isolated(reason))
            }
        }
    }

    /// Adds what a child did to what this process did.
    fn count(&self, line: &SceneLine, counts: [u64; 3], quarantined: Option<String>) {
        let [merged, traced, resumed] = counts;
        self.merged.fetch_add(merged, Ordering::Relaxed);
        self.traced.fetch_add(traced, Ordering::Relaxed);
        self.resumed.fetch_add(resumed, Ordering::Relaxed);
        for shard in 0..traced + resumed {
            (self.on_event)(Event::ShardDone {
                resumed: shard >= traced,
            });
        }
        if merged > 0 {
            (self.on_event)(Event::SceneMerged {
                scene: line.id.clone(),
                miss_share: 0.0,
            });
        }
        match quarantined {
            Some(reason) => self.tell_quarantine(line, &reason),
            None => self.went_well(),
        }
    }

    /// A child was lost with a span: others try, unless that happened too often.
    fn lost(&self, line: &SceneLine, delivery: &Delivery, ending: Ending) -> Result<(), FarmError> {
        let span = &delivery.waiting.span;
        (self.on_event)(Event::ChildLost {
            scene: line.id.clone(),
            reason: ending.reason.clone(),
        });
        let mut found = 0;
        if let Some(record) = self.held.attempt(delivery.ticket) {
            found = record.found;
            record.end(self.store, ending)?;
        }
        match verdict(&attempts(self.store, &line.id)?, span, found) {
            Verdict::SetAside(reason) => {
                self.quarantine(line, &reason);
                self.give_up(delivery.ticket);
            }
            Verdict::Fresh | Verdict::Suspect => self.publish_again(delivery),
        }
        self.went_wrong(line);
        Ok(())
    }

    /// A scene's files cannot be read on this machine: on others perhaps.
    pub(super) fn could_not_read(
        &self,
        line: &SceneLine,
        delivery: &Delivery,
        reason: &str,
    ) -> Result<(), FarmError> {
        if !self.held.keep(delivery.ticket) {
            // Another worker has it: let it see for itself.
            return Ok(());
        }
        if let Some(record) = self.held.attempt(delivery.ticket) {
            let ending = Ending {
                kind: EndKind::Unreadable,
                reason: reason.to_owned(),
                log_tail: String::new(),
            };
            record.end(self.store, ending)?;
        }
        if is_unreadable(&attempts(self.store, &line.id)?) {
            self.quarantine(line, reason);
            self.give_up(delivery.ticket);
        } else {
            self.publish_again(delivery);
        }
        self.went_wrong(line);
        Ok(())
    }

    /// Publishes a span again, as it was, and gives it up. Its record stays.
    fn publish_again(&self, delivery: &Delivery) {
        if self.tell_others(delivery) {
            self.give_up(delivery.ticket);
        } else {
            self.held.remove(delivery.ticket);
        }
    }

    /// Publishes a span again. False if the queue cannot be told: it is away or has lost everything. That is no fault of the
    /// worker's; the lease ends, or the coordinator notices what is missing.
    fn tell_others(&self, delivery: &Delivery) -> bool {
        let again = Waiting {
            span: delivery.waiting.span.clone(),
            handed_on: delivery.waiting.handed_on + 1,
        };
        self.queue.publish(&[again]).is_ok()
    }

    /// A held span is no longer this worker's. The record of the attempt stays.
    fn give_up(&self, ticket: u64) {
        self.held.remove(ticket);
        self.queue.finish(ticket);
    }

    /// The same for a span with which nothing is wrong.
    fn pass_to_others(&self, delivery: &Delivery) {
        if self.tell_others(delivery) {
            self.let_go(delivery.ticket);
        } else if let Some(record) = self.held.remove(delivery.ticket) {
            record.forget(self.store);
        }
    }

    /// A held span has ended in order.
    pub(super) fn let_go(&self, ticket: u64) {
        if let Some(record) = self.held.remove(ticket) {
            record.forget(self.store);
        }
        self.queue.finish(ticket);
    }

    /// A scene, or a part of it, was done here.
    pub(super) fn went_well(&self) {
        self.failing().clear();
    }

    /// A scene failed here in a way that may be this machine's fault.
    pub(super) fn went_wrong(&self, line: &SceneLine) {
        let mut failing = self.failing();
        failing.insert(line.id.clone());
        if self.beside.is_some() && failing.len() >= FAILURES_IN_A_ROW {
            let scenes: Vec<String> = failing.iter().map(ToString::to_string).collect();
            drop(failing);
            if !self.drained.swap(true, Ordering::AcqRel) {
                (self.on_event)(Event::Drained {
                    reason: format!(
                        "{} scenes in a row failed here ({}): this worker leaves the rest to others; check this machine's \
                         inputs (--root) and memory, then start it again",
                        scenes.len(),
                        scenes.join(", ")
                    ),
                });
            }
        }
    }
}
