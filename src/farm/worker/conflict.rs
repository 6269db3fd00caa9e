//! Conflicts: two workers have made different bytes for the same object. The stored object stays, `conflicts/` gets the
//! other bytes, and the scene goes into quarantine with the names of both workers.

use super::core::Worker;
use super::jobs::ActiveTask;
use super::work::check_golden;
use crate::farm::FarmError;
use crate::farm::tuples::write_tuple;
use crate::run::{keys, other_workers};
use crate::store::StoreError;
use bytes::Bytes;
use glasshouse_line::SceneLine;
use render::merge::encode_tuple_record_1;
use render::partial;
use std::path::PathBuf;

/// The stored object under the key of a partial that another worker has put.
enum There {
    /// The same result.
    Same,
    /// Another result.
    Differs,
    /// No valid partial of this shard, so that it must be replaced.
    Damaged,
    /// Nothing any more: another worker has merged the scene, or has removed a damaged partial.
    Gone,
}

/// Number of attempts to put a partial whose key other workers fill and clear meanwhile.
const PUTS: usize = 8;

impl<'a> Worker<'a> {
    /// Puts a shard's partial, and replaces a damaged one. Returns false after a conflict.
    pub(super) fn put_partial(
        &self,
        task: &ActiveTask<'a>,
        shard: u32,
        bytes: &Bytes,
    ) -> Result<bool, FarmError> {
        let key = keys::partial(&task.job.line.id, shard);
        let mut puts = 0;
        loop {
            puts += 1;
            let Err(error) = self.store.create_bytes(&key, bytes.clone()) else {
                return Ok(true);
            };
            let StoreError::Differs { here, there, .. } = &error else {
                return Err(error.into());
            };
            match self.compare(task, shard, &key, bytes)? {
                There::Same => return Ok(true),
                There::Differs => {
                    let own = [(key, bytes.clone())];
                    self.disagree(task, [here, there], Some(shard), &own)?;
                    return Ok(false);
                }
                There::Damaged | There::Gone if puts == PUTS => return Err(error.into()),
                There::Damaged => self.store.delete(std::slice::from_ref(&key))?,
                There::Gone => {}
            }
        }
    }

    /// Compares a stored partial with `bytes`. Partials of two makers are the same if their digests are.
    fn compare(
        &self,
        task: &ActiveTask<'a>,
        shard: u32,
        key: &str,
        bytes: &Bytes,
    ) -> Result<There, FarmError> {
        let Some(there) = self.store.get(key)? else {
            return Ok(There::Gone);
        };
        let path = PathBuf::from(self.store.name()).join(key);
        let expected = task.job.layout.shard(shard);
        let found = partial::decode(&path, &there).ok();
        let Some(found) = found.filter(|found| task.job.accepts(&expected, found)) else {
            return Ok(There::Damaged);
        };
        let own = partial::decode(&path, bytes);
        let is_same = own.is_ok_and(|own| own.header.blake3 == found.header.blake3);
        Ok(if is_same { There::Same } else { There::Differs })
    }

    /// Puts a scene's tuple. Returns false after a conflict.
    pub(super) fn put_tuple(
        &self,
        task: &ActiveTask<'a>,
        files: Vec<(String, Vec<u8>)>,
    ) -> Result<bool, FarmError> {
        let line = task.job.line;
        let named = |(name, bytes): (String, Vec<u8>)| (keys::tuple(&line.id, &name), bytes.into());
        let mut own: Vec<(String, Bytes)> = files.into_iter().map(named).collect();
        match write_tuple(self.store, &own) {
            Err(StoreError::Differs { key, .. }) if self.is_older(line, &key, &own)? => Ok(true),
            Err(StoreError::Differs { key, here, there, .. }) => {
                let first = own.iter().position(|(own, _)| *own == key).unwrap_or(0);
                own.swap(0, first);
                self.disagree(task, [&here, &there], None, &own)?;
                Ok(false)
            }
            written => Ok(written.map(|()| true)?),
        }
    }

    /// True if the object under `key` is the record of the same tuple by an older version of the program.
    fn is_older(
        &self,
        line: &SceneLine,
        key: &str,
        own: &[(String, Bytes)],
    ) -> Result<bool, StoreError> {
        let Some((_, own)) = own.last().filter(|_| key == keys::tuple_record(&line.id)) else {
            return Ok(false);
        };
        let older =
            serde_json::from_slice(own).ok().and_then(|own| encode_tuple_record_1(&own).ok());
        Ok(older.is_some() && older.as_deref() == self.store.get(key)?.as_deref())
    }

    /// Checks this machine, and then records a conflict over the first object of `own` and fails the scene.
    fn disagree(
        &self,
        task: &ActiveTask<'a>,
        [here, there]: [&str; 2],
        shard: Option<u32>,
        own: &[(String, Bytes)],
    ) -> Result<(), FarmError> {
        // This machine may have become faulty since its first check.
        check_golden(self.run, self.options)?;
        let (scene, me) = (&task.job.line.id, &self.options.who.worker);
        let key = &own[0].0;
        for (key, bytes) in own {
            self.store.replace(&keys::conflict(me, key), bytes)?;
        }
        let others = other_workers(self.store, scene, shard, me)?;
        let others = if others.is_empty() {
            "another worker, which left no record,".to_owned()
        } else {
            let names: Vec<String> = others.into_iter().collect();
            format!("worker {}", names.join(" or "))
        };
        let reason = format!(
            "two workers made different bytes of {key}: {others} put the stored ones (BLAKE3 {there}), and \
             worker {me} made others (BLAKE3 {here}, kept as {}); one of the machines computes wrong bits, or the \
             object was damaged. `glasshouse audit RUN --scene {scene}` on a third machine shows which are right; \
             remove the faulty machine, then `glasshouse retry RUN {scene} --anew` traces the scene again",
            keys::conflict(me, key),
        );
        self.fail(task.id, &reason)?;
        self.went_wrong(task.job.line);
        Ok(())
    }
}
