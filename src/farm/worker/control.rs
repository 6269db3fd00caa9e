//! The thread that watches whether the run is paused or cancelled.

use super::core::Worker;
use crate::run::ControlLook;
use crate::run::Event;
use crate::run::{Control, ControlState, keys};
use crossbeam::channel::{Receiver, RecvTimeoutError};

impl Worker<'_> {
    /// Looks what the run has been told, and tells it on if that is something new.
    pub(super) fn look_at_control(&self, look: &mut ControlLook) {
        // A child goes on with its task while its parent lets it.
        if self.shared_queue.is_some_and(|shared| shared.is_child) {
            return;
        }
        let before = look.known.clone();
        let mut now = look.look(self.store).clone();
        // A pause of a run that is over meanwhile holds no worker.
        let is_over = || matches!(self.store.get(keys::FINISHED), Ok(Some(_)));
        if now.state == ControlState::Paused && self.shared_queue.is_some() && is_over() {
            now = Control::default();
        }
        self.stop.control.set(now.state);
        if now != before {
            (self.on_event)(Event::Controlled {
                state: now.state,
                reason: now.reason,
            });
        }
    }

    /// Looks again and again, until `ended` is closed.
    pub(super) fn watch_control(&self, mut look: ControlLook, ended: &Receiver<()>) {
        let every = self.store.poll_interval();
        while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
            self.look_at_control(&mut look);
        }
    }
}
