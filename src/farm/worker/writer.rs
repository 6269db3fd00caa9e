//! The writer thread, which writes partials and tuples to the store while the compute threads trace.

use super::core::Worker;
use super::jobs::{ActiveTask, EncodedTuple, Objects, Order};
use crate::farm::FarmError;
use crate::farm::tuples::write_noise;
use crate::run::{Event, Provenance, Stage, Stopwatch};
use crossbeam::channel::Receiver;

pub(super) struct Writer<'s, 'a> {
    pub(super) worker: &'s Worker<'a>,
    pub(super) orders: Receiver<Order<'a>>,
}

impl<'a> Writer<'_, 'a> {
    /// Writes all orders, even after a stop. After an error, drops them, so that no thread blocks.
    pub(super) fn run(&self) {
        let worker = self.worker;
        for Order { task, objects } in &self.orders {
            if worker.stop.is_broken() || !worker.tasks().has(task.id) {
                continue;
            }
            worker.step(&task, || match objects {
                Objects::Partial(shard, bytes) => self.partial(&task, shard, bytes),
                Objects::Tuple(encoded) => self.tuple(&task, encoded),
            });
        }
    }

    fn partial(&self, task: &ActiveTask<'a>, shard: u32, bytes: Vec<u8>) -> Result<(), FarmError> {
        let worker = self.worker;
        let start = Stopwatch::start();
        let put = worker.put_partial(task, shard, &bytes.into());
        if put.is_err() && worker.is_done_elsewhere(task)? {
            // Another worker removed the scene's folder of partials during the put.
            return Ok(());
        }
        if !put? {
            return Ok(());
        }
        worker.tally.seconds.add(Stage::Checkpoint, start.spent());
        let actions = worker.tasks().stored(task.id, shard);
        worker.perform(actions)
    }

    fn tuple(&self, task: &ActiveTask<'a>, encoded: EncodedTuple) -> Result<(), FarmError> {
        let (worker, scene) = (self.worker, &task.job.line.id);
        let start = Stopwatch::start();
        // The receipt needs the partials' records, which other workers may remove as soon as the tuple exists.
        let receipt = self.receipt(task);
        if let Some(noise) = encoded.noise {
            write_noise(worker.store, task.job.line, &noise);
        }
        if !worker.put_tuple(task, encoded.files)? {
            return Ok(());
        }
        if let Some(receipt) = receipt {
            // Without the receipt, the coordinator finds the tuple in its next full round.
            let _ = receipt.put(worker.store, scene);
        }
        worker.tally.seconds.add(Stage::Write, start.spent());
        worker.tally.merged.add(1);
        worker.stop.went_well();
        let actions = worker.tasks().merged(task.id);
        let done = worker.perform(actions);
        let (scene, miss_share) = (scene.clone(), encoded.miss_share);
        (worker.on_event)(Event::SceneMerged { scene, miss_share });
        done
    }

    /// Returns the record of the worker that makes the tuple, if other workers take part in the run.
    fn receipt(&self, task: &ActiveTask<'a>) -> Option<Provenance> {
        let worker = self.worker;
        worker.shared_queue?;
        let alone = worker.tasks().is_alone(task.id);
        let (scene, who) = (&task.job.line.id, &worker.options.who);
        Some(Provenance::new(worker.store, scene, who, alone))
    }
}
