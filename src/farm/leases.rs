//! The thread that keeps a worker's leases while there is progress, gives work to whoever asks, and asks when there is
//! nothing left.

use super::queue::Answer;
use super::shared::Shared;
use super::work::SharedQueue;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Pauses between two questions for work, at least and at most. The simulator chose them.
const ASK: [Duration; 2] = [Duration::from_millis(20), Duration::from_secs(10)];
/// How long one look for questions waits.
const WAIT: Duration = Duration::from_millis(20);

impl Shared<'_> {
    /// Until the hands have gone home.
    pub(super) fn keep_leases(&self, shared: &SharedQueue) {
        let every = shared.lease / 3;
        let (mut renewed, mut asked) = (Instant::now(), Instant::now());
        let mut pause = ASK[0];
        while !self.over.load(Ordering::Acquire) {
            let able = !self.must_stop() && self.held.has_something_to_give(self.costs());
            shared.queue.offer(able);
            if let Some(ask) = shared.queue.asked(WAIT) {
                self.hear_of(ask.load_s);
                let spans = self.give(shared, ask.load_s);
                let load_s = self.costs().known_load_s();
                ask.answer(Answer { spans, load_s });
            }
            if !self.is_idle() {
                pause = ASK[0];
            } else if self.hungry.load(Ordering::Acquire)
                && !self.control.is_paused()
                && asked.elapsed() > pause
            {
                // What is given for it goes through the queue, where this worker waits.
                let costs = self.costs();
                shared
                    .queue
                    .ask(costs.load_is_known.then_some(costs.load_s));
                asked = Instant::now();
                pause = (pause * 2).min(ASK[1]);
            }
            if renewed.elapsed() < every {
                continue;
            }
            renewed = Instant::now();
            (shared.on_sign)();
            if let Err(hung) = self.held.renew(shared.queue, self.options.hang) {
                let scene = &self.run.lines[hung.waiting.span.scene as usize].id;
                shared.queue.offer(false);
                let hurried = self.store.with_patience(Duration::ZERO);
                self.held.leave_unbegun(shared.queue, &hurried);
                (shared.on_hung)(&format!(
                    "scene {scene} made no progress for {} s: this worker hangs and leaves it to others; see --hang-s",
                    self.options.hang.as_secs_f64()
                ));
            }
        }
        shared.queue.offer(false);
    }

    fn give(&self, shared: &SharedQueue, load_s: Option<f64>) -> u32 {
        if self.must_stop() {
            return 0;
        }
        let given = self.held.give(shared.queue, self.costs(), load_s);
        self.given
            .fetch_add(u64::from(given.count), Ordering::Relaxed);
        for attempt in given.unbegun {
            attempt.forget(self.store);
        }
        for span in given.shared {
            self.to_checkpoint.push(span);
        }
        for span in given.ended {
            if let Err(error) = self.end_in_part(&span) {
                self.break_down(error);
            }
        }
        given.count
    }

    /// Another worker loads a scene in this time.
    fn hear_of(&self, load_s: Option<f64>) {
        let Some(load_s) = load_s else { return };
        let known = self.others_load_us.load(Ordering::Relaxed);
        let heard = (load_s * 1e6) as u64;
        // Scenes differ, and so do those who ask: the mean of what was heard, the latest most.
        let mean = if known == 0 {
            heard
        } else {
            u64::midpoint(known, heard)
        };
        self.others_load_us.store(mean.max(1), Ordering::Relaxed);
    }

    /// How much longer than others this worker needs for the same, as far as is known.
    pub(super) fn slowness(&self) -> Option<f64> {
        let others_us = self.others_load_us.load(Ordering::Relaxed);
        let load_s = (others_us > 0).then_some(others_us as f64 * 1e-6)?;
        Some(1.0 / self.costs().slowness(Some(load_s)))
    }

    /// Nothing is held.
    pub(super) fn is_idle(&self) -> bool {
        self.held.is_empty()
    }
}
