//! Pauses, resumes and cancels a run through a small object in its store, which workers and coordinators poll. This
//! needs neither a queue nor a coordinator.
//!
//! *Paused*: workers finish the scenes that they have opened, keep the leases of their other tasks, and take no new
//! ones; coordinators publish nothing. *Cancelled*: workers finish the shards in flight and end without requeueing
//! anything; coordinators remove the queue and end. `resume` removes the object. Finished tuples always stay.

use super::json_line;
use super::keys;
use crate::store::{Store, StoreError};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Instant;

/// Schema of `control.json`.
pub(crate) const CONTROL_SCHEMA: &str = "glasshouse.control/1";

/// The user's last order for a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlState {
    /// Workers trace; the default without an object.
    #[default]
    Running,
    /// Workers take no new tasks.
    Paused,
    Cancelled,
}

impl ControlState {
    /// Returns the state's name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Cancelled => "cancelled",
        }
    }
}

/// Content of `control.json`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Control {
    pub state: ControlState,
    pub reason: Option<String>,
}

/// JSON form of [`Control`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    schema: String,
    state: ControlState,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

impl Control {
    /// Reads a run's control object; a run without one is running.
    pub fn get(store: &Store) -> Result<Self, StoreError> {
        let bytes = store.get(keys::CONTROL)?;
        Ok(bytes.map_or_else(Self::default, |bytes| Self::parse(&bytes)))
    }

    /// Parses the object. A damaged object pauses the run, because its writer meant to stop the run.
    fn parse(bytes: &[u8]) -> Self {
        Self::read(bytes).unwrap_or_else(|error| Self {
            state: ControlState::Paused,
            reason: Some(format!(
                "{} is damaged ({error}); `glasshouse resume RUN` removes it",
                keys::CONTROL
            )),
        })
    }

    /// Parses the object's bytes; fails if they are damaged.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        match serde_json::from_slice::<Record>(bytes) {
            Ok(record) if record.schema == CONTROL_SCHEMA => {
                Ok(Self { state: record.state, reason: record.reason })
            }
            Ok(record) => Err(format!("its schema is {:?}", record.schema)),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Returns ` (reason)`, or an empty string.
    pub fn because(&self) -> String {
        let reason = self.reason.as_ref();
        reason.map_or_else(String::new, |reason| format!(" ({reason})"))
    }
}

/// Reason why a run cannot be paused, cancelled or resumed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ControlError {
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("every scene of the run is done or in quarantine: nothing is left to pause or cancel")]
    Finished,
    /// A pause must not replace a cancel.
    #[error("the run is cancelled; `glasshouse resume RUN` undoes the cancel")]
    Cancelled,
}

/// Pauses, cancels or resumes a run; with `dry_run`, only checks the request. Returns the earlier state. Setting the
/// same state again is not an error.
pub(crate) fn set_control(
    store: &Store,
    state: ControlState,
    reason: Option<&str>,
    dry_run: bool,
) -> Result<ControlState, ControlError> {
    let before = Control::get(store)?.state;
    if state == ControlState::Running {
        if !dry_run {
            store.delete(&[keys::CONTROL.to_owned()])?;
        }
        return Ok(before);
    }
    if store.get(keys::FINISHED)?.is_some() {
        return Err(ControlError::Finished);
    }
    if before == ControlState::Cancelled && state == ControlState::Paused {
        return Err(ControlError::Cancelled);
    }
    if !dry_run {
        let record =
            Record { schema: CONTROL_SCHEMA.to_owned(), state, reason: reason.map(str::to_owned) };
        store.replace(keys::CONTROL, &json_line(&record))?;
    }
    Ok(before)
}

/// Last known content of `control.json`, and the time of the last poll.
#[derive(Debug, Default)]
pub(crate) struct ControlPoll {
    polled: Option<Instant>,
    pub(crate) known: Control,
}

impl ControlPoll {
    /// Returns the last known control; first reads it again if a poll is due. Ignores a store that does not answer.
    pub(crate) fn poll(&mut self, store: &Store) -> &Control {
        let every = store.poll_interval();
        if self.polled.is_none_or(|at| at.elapsed() >= every) {
            self.polled = Some(Instant::now());
            if let Ok(control) = Control::get(store) {
                self.known = control;
            }
        }
        &self.known
    }
}

/// The control's state, shared by a worker's threads.
#[derive(Debug, Default)]
pub(crate) struct ControlFlag(AtomicU8);

impl ControlFlag {
    pub(crate) fn set(&self, state: ControlState) {
        self.0.store(state as u8, Ordering::Relaxed);
    }

    fn is(&self, state: ControlState) -> bool {
        self.0.load(Ordering::Relaxed) == state as u8
    }

    /// True if the run is paused: the worker may neither take a task nor open a scene.
    pub(crate) fn is_paused(&self) -> bool {
        self.is(ControlState::Paused)
    }

    /// True if no further shard may start.
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
    fn a_run_is_paused_cancelled_and_resumed() {
        use ControlState::{Cancelled, Paused, Running};
        let (_folder, store) = store();
        assert_eq!(Control::get(&store).unwrap(), Control::default());
        assert_eq!(set_control(&store, Paused, Some("backup"), false).unwrap(), Running);
        let control = Control::get(&store).unwrap();
        assert_eq!(control.state, Paused);
        assert_eq!(control.because(), " (backup)");
        // A dry run writes nothing.
        assert_eq!(set_control(&store, Running, None, true).unwrap(), Paused);
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
    fn a_damaged_record_pauses_the_run() {
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
