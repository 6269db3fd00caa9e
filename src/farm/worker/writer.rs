//! The writer thread: it waits for the store, so that no compute thread has to.

use super::active_task::ActiveTask;
use super::core::Worker;
use super::finished::Encoded;
use crate::farm::FarmError;
use crate::farm::tuples::write_noise;
use crate::run::{Event, Provenance, Stage, Stopwatch};
use crossbeam::channel::Receiver;
use std::sync::Arc;

/// Something to write, encoded already.
pub(super) struct Order<'a> {
    pub(super) task: Arc<ActiveTask<'a>>,
    pub(super) what: What,
}

pub(super) enum What {
    Partial {
        shard: u32,
        bytes: Vec<u8>,
    },
    /// A scene's tuple; when it is in the store, the scene's partials are removed.
    Tuple {
        encoded: Encoded,
        miss_share: f64,
    },
}

pub(super) struct Writer<'s, 'a> {
    pub(super) worker: &'s Worker<'a>,
    pub(super) orders: Receiver<Order<'a>>,
}

impl<'a> Writer<'_, 'a> {
    /// Writes all that is ordered, also after a stop; once the farm is broken only takes it, so that no thread waits.
    pub(super) fn run(&self) {
        let worker = self.worker;
        for Order { task, what } in &self.orders {
            // What is left of a task that has ended is of no use.
            if worker.stop.is_broken() || !worker.tasks().has(task.id) {
                continue;
            }
            worker.step(&task, || match what {
                What::Partial { shard, bytes } => self.partial(&task, shard, bytes),
                What::Tuple { encoded, miss_share } => self.tuple(&task, encoded, miss_share),
            });
        }
    }

    fn partial(&self, task: &ActiveTask<'a>, shard: u32, bytes: Vec<u8>) -> Result<(), FarmError> {
        let worker = self.worker;
        let start = Stopwatch::start();
        let put = worker.put_partial(task, shard, &bytes.into());
        if put.is_err() && worker.is_done_elsewhere(task)? {
            // Its folder went while this was being written.
            return Ok(());
        }
        if !put? {
            return Ok(());
        }
        worker.tally.seconds.add(Stage::Checkpoint, start.spent());
        let actions = worker.tasks().stored(task.id, shard);
        worker.perform(actions)
    }

    fn tuple(
        &self,
        task: &ActiveTask<'a>,
        encoded: Encoded,
        miss_share: f64,
    ) -> Result<(), FarmError> {
        let (worker, line) = (self.worker, task.job.line);
        let start = Stopwatch::start();
        // Made before the tuple is there: from then on others may take away the notes that it is made from.
        let receipt = self.receipt(task);
        if let Some(noise) = encoded.noise {
            write_noise(worker.store, line, &noise);
        }
        if !worker.put_tuple(task, encoded.files)? {
            return Ok(());
        }
        if let Some(receipt) = receipt {
            // Nothing depends on it.
            let _ = receipt.put(worker.store, &line.id);
        }
        worker.tally.seconds.add(Stage::Write, start.spent());
        worker.tally.add_merged(1);
        worker.stop.went_well();
        let actions = worker.tasks().merged(task.id);
        let done = worker.perform(actions);
        (worker.on_event)(Event::SceneMerged { scene: line.id.clone(), miss_share });
        done
    }

    /// Beside other workers: which worker makes the tuple.
    fn receipt(&self, task: &ActiveTask<'a>) -> Option<Provenance> {
        let worker = self.worker;
        worker.shared_queue?;
        let alone = worker.tasks().is_alone(task.id);
        let (scene, who) = (&task.job.line.id, &worker.options.who);
        Some(Provenance::new(worker.store, scene, who, alone))
    }
}
