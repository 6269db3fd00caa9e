//! The writer thread, which writes partials and tuples to the store while the compute threads trace.

use super::core::Worker;
use super::jobs::{ActiveTask, EncodedTuple, Objects, Order};
use crate::farm::FarmError;
use crate::farm::tuples::write_noise;
use crate::run::{Event, Makers, Provenance, Stage, Stopwatch, keys, other_workers};
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
        self.leave_receipt(task, &encoded.makers)?;
        if let Some(noise) = encoded.noise {
            write_noise(worker.store, task.job.line, &noise);
        }
        if !worker.put_tuple(task, encoded.files)? {
            return Ok(());
        }
        worker.tally.seconds.add(Stage::Write, start.spent());
        worker.tally.merged.add(1);
        worker.stop.went_well();
        let actions = worker.tasks().merged(task.id);
        let done = worker.perform(actions);
        let EncodedTuple { miss_share, has_odd_view, .. } = encoded;
        (worker.on_event)(Event::SceneMerged { scene: scene.clone(), miss_share, has_odd_view });
        done
    }

    /// Puts the receipt of a tuple before its first file, so that no tuple is without the names of its makers. A worker
    /// alone leaves none. A tuple that is already complete has its receipts, and gets nothing from this worker.
    fn leave_receipt(&self, task: &ActiveTask<'a>, makers: &Makers) -> Result<(), FarmError> {
        let (worker, scene) = (self.worker, &task.job.line.id);
        let who = &worker.options.who;
        let is_own = worker.shared_queue.is_none() && makers.are_only(&who.worker);
        if is_own || worker.store.get(&keys::tuple_record(scene))?.is_some() {
            return Ok(());
        }
        let mut makers = makers.clone();
        if makers.unknown > 0 {
            // Partials of earlier versions: notes and attempts name workers that may have made them.
            makers.workers.extend(other_workers(worker.store, scene, None, &who.worker)?);
        }
        Ok(Provenance::new(scene, who, &makers).put(worker.store, scene)?)
    }
}
