//! Reasons to stop a worker: a signal, its time limit, a cancelled run, failures of its machine, or an error.

use crate::farm::FarmError;
use crate::run::{ControlFlag, Stop};
use glasshouse_line::ids::SceneId;
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Number of failed scenes in a row after which the machine counts as faulty.
const FAILURES_IN_A_ROW: usize = 3;

/// Reasons to stop; flags are never cleared.
#[derive(Default)]
pub(super) struct StopSigns {
    timed_out: AtomicBool,
    drained: AtomicBool,
    cancelled: AtomicBool,
    broken: AtomicBool,
    failure: Mutex<Option<FarmError>>,
    /// Scenes that failed since the last success.
    failing: Mutex<BTreeSet<SceneId>>,
    pub(super) control: ControlFlag,
    pub(super) over: AtomicBool,
}

impl StopSigns {
    pub(super) fn any(&self, asked: &AtomicBool, deadline: Option<Instant>) -> bool {
        if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            self.timed_out.store(true, Ordering::Relaxed);
        }
        if self.control.is_cancelled() {
            self.cancelled.store(true, Ordering::Relaxed);
        }
        let signs = [asked, &self.timed_out, &self.drained, &self.broken, &self.cancelled];
        signs.iter().any(|sign| sign.load(Ordering::Relaxed))
    }

    /// Stops the worker after an error. Only the first error is reported.
    pub(super) fn break_down(&self, error: FarmError) {
        self.broken.store(true, Ordering::Relaxed);
        let mut failure = self.failure.lock().expect("no holder of this lock panics");
        failure.get_or_insert(error);
    }

    /// Stops the worker after the end of another thread; joining that thread reports the reason.
    pub(super) fn break_down_silently(&self) {
        self.broken.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_broken(&self) -> bool {
        self.broken.load(Ordering::Relaxed)
    }

    pub(super) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Resets the row of failures after a scene, or a part of one, succeeded.
    pub(super) fn went_well(&self) {
        self.failing.lock().expect("no holder of this lock panics").clear();
    }

    /// Counts a failure that may be this machine's fault. Returns the scenes that failed in a row if they are too many.
    pub(super) fn went_wrong(&self, scene: &SceneId) -> Option<Vec<String>> {
        let mut failing = self.failing.lock().expect("no holder of this lock panics");
        failing.insert(scene.clone());
        let scenes = || failing.iter().map(ToString::to_string).collect();
        (failing.len() >= FAILURES_IN_A_ROW).then(scenes)
    }

    /// Leaves the remaining tasks to other workers. Returns false if the worker was draining already.
    pub(super) fn drain(&self) -> bool {
        !self.drained.swap(true, Ordering::AcqRel)
    }

    pub(super) fn take_failure(&self) -> Option<FarmError> {
        self.failure.lock().expect("no holder of this lock panics").take()
    }

    pub(super) fn reason(&self, asked: &AtomicBool) -> Option<Stop> {
        let reasons = [
            (&self.drained, Stop::Drained),
            (asked, Stop::Asked),
            (&self.cancelled, Stop::Cancelled),
            (&self.timed_out, Stop::TimeLimit),
        ];
        let is_set = |(sign, _): &&(&AtomicBool, Stop)| sign.load(Ordering::Relaxed);
        reasons.iter().find(is_set).map(|(_, stop)| *stop)
    }
}
