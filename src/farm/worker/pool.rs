//! The compute threads. Each thread takes jobs first, then bands from its own deque, then bands from other threads'
//! deques. If there is neither a job nor a band, it opens the next scene and fills its own deque. Without a scene, it sleeps
//! until the bell rings.

use super::core::Worker;
use super::jobs::{Band, Loaded, Order};
use crossbeam::channel::{Receiver, Sender, TryRecvError};
use crossbeam::deque::{Steal, Stealer, Worker as Deque};
use glasshouse_line::color::SrgbEncoder;
use std::time::Duration;

/// The state that all compute threads share.
pub(super) struct Pool<'a> {
    pub(super) files: Receiver<Loaded<'a>>,
    pub(super) stealers: Vec<Stealer<Band<'a>>>,
    pub(super) encoder: SrgbEncoder,
}

pub(super) struct ComputeThread<'s, 'a> {
    pub(super) worker: &'s Worker<'a>,
    pub(super) pool: &'s Pool<'a>,
    pub(super) index: usize,
    pub(super) deque: Deque<Band<'a>>,
    pub(super) writer: Sender<Order<'a>>,
}

/// Longest sleep of a compute thread per thread of the worker, after which it checks whether it must stop. All together wake a
/// thousand times a second.
const IDLE_PER_THREAD: Duration = Duration::from_millis(1);
/// Limits of the longest sleep.
const IDLE: [Duration; 2] = [Duration::from_millis(20), Duration::from_secs(1)];

impl<'a> ComputeThread<'_, 'a> {
    pub(super) fn run(&self) {
        let worker = self.worker;
        let threads = self.pool.stealers.len() as u32;
        let longest = (IDLE_PER_THREAD * threads).clamp(IDLE[0], IDLE[1]);
        while !worker.stop.is_broken() {
            let rings = worker.bell.rings();
            if let Some(job) = take(|| worker.jobs.steal()) {
                worker.step(&job.task(), || self.do_job(job));
                continue;
            }
            if let Some(band) = self.deque.pop().or_else(|| self.steal()) {
                worker.step(&band.task, || self.trace(&band));
                continue;
            }
            if worker.must_stop() {
                let actions = worker.tasks().store_all();
                if actions.is_empty() {
                    return;
                }
                worker.break_down_if(worker.perform(actions));
                continue;
            }
            if worker.stop.control.is_paused() && !self.pool.files.is_empty() {
                worker.bell.wait(rings, longest);
                continue;
            }
            match self.pool.files.try_recv() {
                Ok(loaded) => self.open(loaded),
                Err(error) => {
                    // A thread stays while a task is open, because bands or jobs of the task may still follow.
                    if error == TryRecvError::Disconnected && worker.tasks().is_empty() {
                        return;
                    }
                    worker.bell.wait(rings, longest);
                }
            }
        }
    }

    fn steal(&self) -> Option<Band<'a>> {
        let stealers = &self.pool.stealers;
        let count = stealers.len();
        (1..count).find_map(|offset| take(|| stealers[(self.index + offset) % count].steal()))
    }

    /// Sends an order to the writer; blocks while the channel is full. The writer runs until the last compute thread
    /// has ended.
    pub(super) fn order(&self, order: Order<'a>) {
        if self.writer.send(order).is_err() {
            self.worker.stop.break_down_silently();
        }
    }
}

fn take<T>(steal: impl Fn() -> Steal<T>) -> Option<T> {
    loop {
        match steal() {
            Steal::Success(taken) => return Some(taken),
            Steal::Empty => return None,
            Steal::Retry => {}
        }
    }
}
