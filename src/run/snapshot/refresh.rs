//! Reads a run's store: each refresh lists keys and reads only new objects.

use super::{Scene, SeenAttempt, SeenTuple, Snapshot};
use crate::run::attempts::AttemptRecord;
use crate::run::control::Control;
use crate::run::done;
use crate::run::keys;
use crate::run::open::Run;
use crate::run::provenance::Provenance;
use crate::run::quarantine::QuarantineRecord;
use crate::store::{Store, StoreError};
use glasshouse_line::ids::SceneId;
use render::merge::is_record_of;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

impl Snapshot {
    /// Lists all keys in the scope and reads new objects.
    pub fn refresh(&mut self, run: &Run, store: &Store) -> Result<(), StoreError> {
        self.control = Control::get(store)?;
        // Attempts come first: if a scene finishes meanwhile, the later list of tuples hides its attempts.
        self.refresh_attempts(store)?;
        self.refresh_receipts(store)?;
        self.refresh_tuples(run, store)?;
        self.refresh_quarantine(store)?;
        self.refresh_partials(store)?;
        self.refresh_roster();
        self.remember();
        Ok(())
    }

    /// Like [`Self::refresh`], but ignores partials and finds new tuples by listing receipts (about one key per scene),
    /// which the workers of a farm put before the tuple. Returns true if a receipt or a quarantine record has disappeared, so
    /// that [`Self::refresh`] is due.
    pub fn refresh_news(&mut self, run: &Run, store: &Store) -> Result<bool, StoreError> {
        self.control = Control::get(store)?;
        self.refresh_attempts(store)?;
        let is_gone = self.refresh_receipts(store)?;
        for (index, line) in run.lines.iter().enumerate() {
            let Scene { is_done, receipt, .. } = self.scenes[index];
            if let (false, Some(put)) = (is_done, receipt)
                && done::is_done(run, store, line)?
            {
                self.add_tuple(index, put);
            }
        }
        let is_freed = self.refresh_quarantine(store)?;
        self.refresh_roster();
        self.remember();
        Ok(is_gone || is_freed)
    }

    fn refresh_tuples(&mut self, run: &Run, store: &Store) -> Result<(), StoreError> {
        let listed: BTreeMap<String, SystemTime> =
            store.list_times(keys::TUPLES)?.into_iter().collect();
        let mut new = Vec::new();
        for (index, line) in run.lines.iter().enumerate() {
            let put = listed.get(&keys::tuple_record(&line.id));
            let is_done = &mut self.scenes[index].is_done;
            *is_done &= put.is_some();
            let mut files = keys::tuple_keys(line);
            if let (false, Some(put)) = (*is_done, put)
                && files.all(|key| listed.contains_key(&key))
            {
                new.push((index, *put));
            }
        }
        self.tuples.retain(|tuple| self.scenes[tuple.scene].is_done);
        if self.scope.records || store.is_local() {
            let record =
                |(index, _): &(usize, SystemTime)| keys::tuple_record(&run.lines[*index].id);
            let records: Vec<String> = new.iter().map(record).collect();
            let mut is_ours = Vec::new();
            store.for_each(&records, |at, bytes| {
                let line = &run.lines[new[at].0];
                is_ours.push(
                    bytes.is_some_and(|bytes| is_record_of(&bytes, line, run.spec.tracer_version)),
                );
            })?;
            let mut is_ours = is_ours.into_iter();
            new.retain(|_| is_ours.next().unwrap_or(false));
        }
        for (index, put) in new {
            self.add_tuple(index, put);
        }
        Ok(())
    }

    fn add_tuple(&mut self, scene: usize, put: SystemTime) {
        self.scenes[scene].is_done = true;
        let is_new = !self.history.is_empty();
        self.tuples.push(SeenTuple { scene, seen: is_new.then(Instant::now), put });
    }

    /// Lists receipts and, if the scope includes workers, reads new ones. Returns true if a receipt has disappeared.
    fn refresh_receipts(&mut self, store: &Store) -> Result<bool, StoreError> {
        let mut listed = vec![None; self.scenes.len()];
        for (key, put) in store.list_times(keys::RECEIPTS)? {
            if let Some(index) = self.index_of(&key) {
                // The receipt of a second worker that merged the scene makes the tuple no newer.
                let at = &mut listed[index];
                *at = Some(at.map_or(put, |before: SystemTime| before.min(put)));
            }
        }
        let (mut is_gone, mut new) = (false, Vec::new());
        for (index, (scene, put)) in self.scenes.iter_mut().zip(listed).enumerate() {
            is_gone |= scene.receipt.is_some() && put.is_none();
            if scene.receipt != put {
                (scene.receipt, scene.provenance) = (put, None);
            }
            if self.scope.workers && put.is_some() && scene.provenance.is_none() {
                new.push(index);
            }
        }
        let key = |&index: &usize| keys::receipt(&self.plan.ids[index]);
        let receipts: Vec<String> = new.iter().map(key).collect();
        store.for_each(&receipts, |at, bytes| {
            let provenance = bytes.map(|bytes| Arc::new(Provenance::parse(&bytes)));
            self.scenes[new[at]].provenance = provenance;
        })?;
        Ok(is_gone)
    }

    /// Lists quarantine records and reads new ones. Returns true if a scene has left the quarantine.
    fn refresh_quarantine(&mut self, store: &Store) -> Result<bool, StoreError> {
        let listed = store.list(keys::QUARANTINE)?;
        let listed: BTreeSet<usize> = listed.iter().filter_map(|key| self.index_of(key)).collect();
        let mut is_freed = false;
        for (index, scene) in self.scenes.iter_mut().enumerate() {
            if !listed.contains(&index) {
                is_freed |= scene.reason.take().is_some();
            } else if scene.reason.is_none() {
                let record = QuarantineRecord::get(store, &self.plan.ids[index])?;
                scene.reason = record.map(|record| record.reason.into());
            }
        }
        Ok(is_freed)
    }

    fn refresh_partials(&mut self, store: &Store) -> Result<(), StoreError> {
        if !self.scope.partials {
            return Ok(());
        }
        for scene in &mut self.scenes {
            scene.partials = 0;
        }
        for key in store.list(keys::PARTIALS)? {
            if let (Some(index), Some(shard)) = (self.index_of(&key), keys::shard_of(&key))
                && shard < self.plan.shards[index]
            {
                self.scenes[index].partials += 1;
            }
        }
        Ok(())
    }

    fn refresh_attempts(&mut self, store: &Store) -> Result<(), StoreError> {
        if !self.scope.workers {
            return Ok(());
        }
        let seen = Instant::now();
        let listed: BTreeMap<String, SystemTime> =
            store.list_times(keys::ATTEMPTS)?.into_iter().collect();
        self.listed = Some(seen);
        self.attempts.retain(|key, attempt| listed.get(key) == Some(&attempt.put));
        // Signs of life have no content of interest, only a time.
        let sign_of = |record: &AttemptRecord| {
            listed.get(&keys::sign(&record.scene, record.shards, record.n)).copied()
        };
        for attempt in self.attempts.values_mut() {
            let sign = sign_of(&attempt.record);
            if sign > attempt.sign {
                (attempt.sign, attempt.signed) = (sign, seen);
            }
        }
        let is_new =
            |key: &&String| keys::attempt_of(key).is_some() && !self.attempts.contains_key(*key);
        let new: Vec<String> = listed.keys().filter(is_new).cloned().collect();
        store.for_each(&new, |at, bytes| {
            let key = &new[at];
            let scene = keys::scene_of(key).and_then(|id| SceneId::new(id).ok());
            let record = scene.and_then(|scene| AttemptRecord::parse(&scene, key, &bytes?));
            self.attempts.extend(record.map(|record| {
                let (put, sign) = (listed[key], sign_of(&record));
                (key.clone(), SeenAttempt { record, signed: seen, put, sign })
            }));
        })
    }

    /// Returns the index of a key's scene.
    fn index_of(&self, key: &str) -> Option<usize> {
        self.plan.index(keys::scene_of(key)?)
    }
}
