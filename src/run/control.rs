//! Pausing, resuming and cancelling a run: one small object in its store, at which workers and coordinators look now and
//! then. No queue and no coordinator is needed for it.
//!
//! *Paused*: workers finish the scenes that they have opened, keep the leases of what else they hold, and take nothing
//! new; coordinators publish nothing. *Cancelled*: workers finish the shards in flight and end without handing anything
//! back; coordinators remove the queue and end. Either is taken back by removing the object; what is done stays done.

use super::keys;
use crate::store::{Store, StoreError};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

/// The schema name of `control.json`.
pub const CONTROL_SCHEMA: &str = "glasshouse.control/1";

/// What a run has been told to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlState {
    /// Go on: nothing is said.
    #[default]
    Running,
    /// Take nothing new.
    Paused,
    /// Give the rest up.
    Cancelled,
}

impl ControlState {
    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Cancelled => "cancelled",
        }
    }
}

/// What a run has been told, and why.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Control {
    /// What.
    pub state: ControlState,
    /// As the user gave it.
    pub reason: Option<String>,
}

/// `control.json`
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    schema: String,
    state: ControlState,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

impl Control {
    /// What the run in `store` has been told.
    pub fn get(store: &Store) -> Result<Self, StoreError> {
        let bytes = store.get(keys::CONTROL)?;
        Ok(bytes.map_or_else(Self::default, |bytes| Self::parse(&bytes)))
    }

    /// Somebody meant to hold the run, so a damaged record holds it.
    fn parse(bytes: &[u8]) -> Self {
        Self::read(bytes).unwrap_or_else(|reason| Self::damaged(&reason))
    }

    /// Reads the object's bytes; an error says in words what is wrong with them.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        match serde_json::from_slice::<Record>(bytes) {
            Ok(record) if record.schema == CONTROL_SCHEMA => Ok(Self {
                state: record.state,
                reason: record.reason,
            }),
            Ok(record) => Err(format!("its schema is {:?}", record.schema)),
            Err(error) => Err(error.to_string()),
        }
    }

    fn damaged(what: &dyn std::fmt::Display) -> Self {
        Self {
            state: ControlState::Paused,
            reason: Some(format!(
                "{} is damaged ({what}); `glasshouse resume RUN` removes it",
                keys::CONTROL
            )),
        }
    }

    /// ` (reason)`, or nothing.
    pub fn because(&self) -> String {
        let reason = self.reason.as_ref();
        reason.map_or_else(String::new, |reason| format!(" ({reason})"))
    }
}

/// Why a run cannot be told so.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Nothing is left to do in it.
    #[error("every scene of the run is done or in quarantine: there is nothing to hold")]
    Finished,
    /// A pause would weaken a cancel.
    #[error("the run is cancelled; `glasshouse resume RUN` takes that back")]
    Cancelled,
}

/// What telling a run did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Changed {
    /// What it had been told before.
    pub before: ControlState,
    /// What it is told now.
    pub now: ControlState,
}

/// Tells a run to pause, to end or to go on; with `dry_run` only looks whether that could be done. Telling it what it
/// has been told is no error.
pub fn set_control(
    store: &Store,
    state: ControlState,
    reason: Option<&str>,
    dry_run: bool,
) -> Result<Changed, ControlError> {
    let before = Control::get(store)?.state;
    let changed = Changed { before, now: state };
    if state == ControlState::Running {
        if !dry_run {
            store.delete(&[keys::CONTROL.to_owned()])?;
        }
        return Ok(changed);
    }
    if store.get(keys::FINISHED)?.is_some() {
        return Err(ControlError::Finished);
    }
    if before == ControlState::Cancelled && state == ControlState::Paused {
        return Err(ControlError::Cancelled);
    }
    if !dry_run {
        let record = Record {
            schema: CONTROL_SCHEMA.to_owned(),
            state,
            reason: reason.map(str::to_owned),
        };
        let json = serde_json::to_string(&record).expect("strings are JSON");
        store.replace(keys::CONTROL, format!("{json}\n").as_bytes())?;
    }
    Ok(changed)
}

/// Between two looks in a folder.
const LOOK_LOCAL: Duration = Duration::from_secs(2);
/// Between two looks in a bucket, where each costs something.
const LOOK_REMOTE: Duration = Duration::from_secs(5);

/// Looks now and then at what a run has been told.
#[derive(Debug, Default)]
pub(crate) struct ControlLook {
    looked: Option<Instant>,
    pub(crate) known: Control,
}

impl ControlLook {
    pub(crate) fn every(store: &Store) -> Duration {
        if store.local_root().is_some() {
            LOOK_LOCAL
        } else {
            LOOK_REMOTE
        }
    }

    /// What the run has been told, as far as is known: a store that does not answer changes nothing.
    pub(crate) fn look(&mut self, store: &Store) -> &Control {
        let every = Self::every(store);
        if self.looked.is_none_or(|at| at.elapsed() >= every) {
            self.looked = Some(Instant::now());
            if let Ok(control) = Control::get(store) {
                self.known = control;
            }
        }
        &self.known
    }
}

/// What a worker's threads know of it.
#[derive(Debug, Default)]
pub(crate) struct ControlFlag(AtomicU8);

impl ControlFlag {
    pub(crate) fn set(&self, state: ControlState) {
        self.0.store(state as u8, Ordering::Relaxed);
    }

    fn is(&self, state: ControlState) -> bool {
        self.0.load(Ordering::Relaxed) == state as u8
    }

    /// Nothing new may be taken or opened.
    pub(crate) fn is_paused(&self) -> bool {
        self.is(ControlState::Paused)
    }

    /// No further shard may be begun.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.is(ControlState::Cancelled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        (folder, store)
    }

    #[test]
    fn a_run_is_told_and_told_otherwise() {
        use ControlState::{Cancelled, Paused, Running};
        let (_folder, store) = store();
        assert_eq!(Control::get(&store).unwrap(), Control::default());
        let changed = set_control(&store, Paused, Some("backup"), false).unwrap();
        assert_eq!((changed.before, changed.now), (Running, Paused));
        let control = Control::get(&store).unwrap();
        assert_eq!(control.state, Paused);
        assert_eq!(control.because(), " (backup)");
        // Nothing is written in a dry run.
        assert_eq!(
            set_control(&store, Running, None, true).unwrap().before,
            Paused
        );
        assert_eq!(Control::get(&store).unwrap(), control);
        set_control(&store, Cancelled, None, false).unwrap();
        let weaker = set_control(&store, Paused, None, false).unwrap_err();
        assert!(matches!(weaker, ControlError::Cancelled), "{weaker}");
        set_control(&store, Running, None, false).unwrap();
        assert_eq!(store.get(keys::CONTROL).unwrap(), None);
        store.replace(keys::FINISHED, b"{}").unwrap();
        let late = set_control(&store, Paused, None, false).unwrap_err();
        assert!(matches!(late, ControlError::Finished), "{late}");
    }

    #[test]
    fn a_damaged_record_holds_the_run() {
        let (_folder, store) = store();
        let other = br#"{"schema":"glasshouse.control/2","state":"running"}"#;
        for damage in [&b""[..], b"{", b"\xff", other] {
            store.replace(keys::CONTROL, damage).unwrap();
            let control = Control::get(&store).unwrap();
            assert_eq!(control.state, ControlState::Paused);
            assert!(control.because().contains("damaged"), "{control:?}");
        }
    }
}
