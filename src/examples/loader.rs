//! Reads and crops examples ahead of the steps, on separate threads.

use super::example::Example;
use super::example_sampler::ExampleSampler;
use super::source::ExampleError;
use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Largest number of steps read ahead.
const AHEAD: usize = 8;

/// Interval between checks of the stop flag.
const LOOK_EVERY: Duration = Duration::from_millis(200);

type Ready = (u64, Result<Vec<Example>, ExampleError>);

/// A prefetcher that returns the examples of one step after another.
pub struct Loader {
    /// Receiver of finished steps, dropped before the threads are joined.
    ready: Option<Receiver<Ready>>,
    /// Sender of the steps for the threads to read.
    tickets: Option<Sender<u64>>,
    waiting: BTreeMap<u64, Result<Vec<Example>, ExampleError>>,
    steps: Range<u64>,
    asked: u64,
    /// Sender that is dropped to stop the sampler.
    stop: Option<Sender<()>>,
    threads: Vec<JoinHandle<()>>,
}

impl Loader {
    /// Starts threads that read the examples of `steps`. `stop` is the other end of the sampler's channel.
    pub fn start(
        sampler: ExampleSampler,
        steps: Range<u64>,
        threads: usize,
        stop: Sender<()>,
    ) -> Self {
        let sampler = Arc::new(sampler);
        let (tickets, to_do) = bounded::<u64>(AHEAD);
        let (done, ready) = bounded::<Ready>(AHEAD);
        let threads = (0..threads.max(1)).map(|_| {
            let (sampler, to_do, done) = (Arc::clone(&sampler), to_do.clone(), done.clone());
            std::thread::spawn(move || {
                for step in to_do {
                    if done.send((step, sampler.examples(step))).is_err() {
                        return;
                    }
                }
            })
        });
        let mut loader = Self {
            threads: threads.collect(),
            ready: Some(ready),
            tickets: Some(tickets),
            waiting: BTreeMap::new(),
            asked: steps.start,
            steps,
            stop: Some(stop),
        };
        loader.ask();
        loader
    }

    /// Fills the queue of steps.
    fn ask(&mut self) {
        let Some(tickets) = &self.tickets else {
            return;
        };
        while self.asked < self.steps.end.min(self.steps.start + AHEAD as u64) {
            if tickets.try_send(self.asked).is_err() {
                return;
            }
            self.asked += 1;
        }
    }

    /// Returns the examples of the next step, or `None` after the last. Fails if `stop` is set while waiting.
    pub fn next_step(&mut self, stop: &AtomicBool) -> Option<Result<Vec<Example>, ExampleError>> {
        if self.steps.is_empty() {
            return None;
        }
        let step = self.steps.start;
        let examples = loop {
            if let Some(examples) = self.waiting.remove(&step) {
                break examples;
            }
            match self.ready.as_ref()?.recv_timeout(LOOK_EVERY) {
                Ok((step, examples)) => {
                    self.waiting.insert(step, examples);
                }
                Err(RecvTimeoutError::Timeout) if !stop.load(Ordering::Relaxed) => {}
                Err(RecvTimeoutError::Timeout) => return Some(Err(ExampleError::Stopped)),
                Err(RecvTimeoutError::Disconnected) => {
                    let text = "the thread that reads examples panicked; its message is above";
                    return Some(Err(ExampleError::None(text.to_owned())));
                }
            }
        };
        self.steps.start += 1;
        self.ask();
        Some(examples)
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        self.stop = None;
        self.tickets = None;
        self.ready = None;
        for thread in self.threads.drain(..) {
            // A panicked thread has printed its message.
            let _ = thread.join();
        }
    }
}
