//! Fetches a scene's partials from the store.

use super::jobs::ActiveTask;
use super::pool::ComputeThread;
use crate::farm::FarmError;
use crate::run::{Event, keys};
use render::partial::{self, Partial};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Largest number of partials fetched in one call.
const FETCHED_AT_ONCE: usize = 32;

impl<'a> ComputeThread<'_, 'a> {
    /// Fetches all valid partials of the scene from the store. Returns their shards.
    pub(super) fn fetch_found(&self, task: &ActiveTask<'a>) -> Result<Vec<u32>, FarmError> {
        let (worker, job) = (self.worker, &task.job);
        let mut found = Vec::new();
        if job.layout.len() == 1 {
            // A scene with a single shard has no partials.
            return Ok(found);
        }
        let mut there: Vec<String> = worker.store.list(&keys::partials(&job.line.id))?;
        there.sort();
        self.fetch(task, &there, |partial| {
            worker.tally.resumed.add(1);
            (worker.on_event)(Event::ShardDone { resumed: true });
            found.push(partial.header.shard);
            job.add(partial);
        })?;
        Ok(found)
    }

    /// Fetches the partials of other workers, and requeues missing and damaged shards.
    pub(super) fn gather(&self, task: &ActiveTask<'a>) -> Result<(), FarmError> {
        let (worker, job) = (self.worker, &task.job);
        let mut missing: BTreeSet<u32> = (0..job.layout.len()).collect();
        missing.retain(|&shard| job.result(shard).is_none());
        let key = |&shard: &u32| keys::partial(&job.line.id, shard);
        let wanted: Vec<String> = missing.iter().map(key).collect();
        // A partial is absent if another worker has merged the scene meanwhile.
        self.fetch(task, &wanted, |partial| {
            missing.remove(&partial.header.shard);
            job.add(partial);
        })?;
        let missing: Vec<u32> = missing.into_iter().collect();
        let actions = worker.tasks().gathered(task.id, &missing);
        worker.perform(actions)
    }

    /// Fetches partials in batches and passes the valid ones to `take`.
    fn fetch(
        &self,
        task: &ActiveTask<'a>,
        keys: &[String],
        mut take: impl FnMut(Partial),
    ) -> Result<(), FarmError> {
        let worker = self.worker;
        for keys in keys.chunks(FETCHED_AT_ONCE) {
            for (key, bytes) in keys.iter().zip(worker.store.get_all(keys)?) {
                let (Some(shard), Some(bytes)) = (keys::shard_of(key), bytes) else {
                    continue;
                };
                if let Some(partial) = self.read(task, shard, key, &bytes)? {
                    take(partial);
                }
            }
            // A slow store does not count as a hang.
            worker.progress(task.id);
        }
        Ok(())
    }

    /// Decodes a partial. Deletes an invalid one, so that its shard is traced again.
    fn read(
        &self,
        task: &ActiveTask<'a>,
        shard: u32,
        key: &str,
        bytes: &[u8],
    ) -> Result<Option<Partial>, FarmError> {
        let (worker, job) = (self.worker, &task.job);
        let path = PathBuf::from(worker.store.name()).join(key);
        let known = shard < job.layout.len();
        let reason = match partial::decode(&path, bytes) {
            Ok(found) if known && job.accepts(&job.layout.shard(shard), &found) => {
                return Ok(Some(found));
            }
            Ok(_) => format!(
                "partial {} belongs to other inputs or another spec; it will be traced again",
                path.display()
            ),
            Err(error) => error.to_string(),
        };
        (worker.on_event)(Event::PartialRejected { reason });
        worker.store.delete(&[key.to_owned()])?;
        Ok(None)
    }
}
