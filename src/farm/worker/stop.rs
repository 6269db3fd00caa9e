//! Why a worker stops: it is told to, its time is over, its machine is at fault, or the farm broke.

use crate::farm::FarmError;
use crate::run::{ControlFlag, Stop};
use render::ids::SceneId;
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// So many scenes in a row that fail on one worker are its own fault.
const FAILURES_IN_A_ROW: usize = 3;

/// Each stays once it is set.
#[derive(Default)]
pub(super) struct StopSigns {
    timed_out: AtomicBool,
    drained: AtomicBool,
    cancelled: AtomicBool,
    broken: AtomicBool,
    failure: Mutex<Option<FarmError>>,
    /// Scenes that failed since the last one that did not.
    failing: Mutex<BTreeSet<SceneId>>,
    /// What the run has been told.
    pub(super) control: ControlFlag,
    /// The compute threads have ended.
    pub(super) over: AtomicBool,
}

impl StopSigns {
    /// No further shard starts; `asked` from outside, or after `deadline`.
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

    /// The first error is the one that is told.
    pub(super) fn break_down(&self, error: FarmError) {
        self.broken.store(true, Ordering::Relaxed);
        let mut failure = self.failure.lock().expect("no holder of this lock panics");
        failure.get_or_insert(error);
    }

    /// A thread is gone; the scope that joins it tells why.
    pub(super) fn break_down_silently(&self) {
        self.broken.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_broken(&self) -> bool {
        self.broken.load(Ordering::Relaxed)
    }

    pub(super) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// A scene, or a part of it, was done here.
    pub(super) fn went_well(&self) {
        self.failing.lock().expect("no holder of this lock panics").clear();
    }

    /// A scene failed here in a way that may be this machine's fault. The scenes that failed in a row, if those are too
    /// many.
    pub(super) fn went_wrong(&self, scene: &SceneId) -> Option<Vec<String>> {
        let mut failing = self.failing.lock().expect("no holder of this lock panics");
        failing.insert(scene.clone());
        let scenes = || failing.iter().map(ToString::to_string).collect();
        (failing.len() >= FAILURES_IN_A_ROW).then(scenes)
    }

    /// This worker leaves the rest to others. False if it does so already.
    pub(super) fn drain(&self) -> bool {
        !self.drained.swap(true, Ordering::AcqRel)
    }

    pub(super) fn take_failure(&self) -> Option<FarmError> {
        self.failure.lock().expect("no holder of this lock panics").take()
    }

    /// Why work ended before the end.
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
