//! Watches whether the run is paused or cancelled.

use super::core::Worker;
use crate::run::{Control, ControlPoll, ControlState, Event, keys};
use crossbeam::channel::{Receiver, RecvTimeoutError};

impl Worker<'_> {
    pub(super) fn poll_control(&self, poll: &mut ControlPoll) {
        // The parent of a child process watches the run.
        if self.shared_queue.is_some_and(|shared| shared.is_child) {
            return;
        }
        let before = poll.known.clone();
        let mut now = poll.poll(self.store).clone();
        // A pause must not hold the workers of a run that is over.
        let is_over = || matches!(self.store.get(keys::FINISHED), Ok(Some(_)));
        if now.state == ControlState::Paused && self.shared_queue.is_some() && is_over() {
            now = Control::default();
        }
        self.stop.control.set(now.state);
        if now != before {
            (self.on_event)(Event::Controlled { state: now.state, reason: now.reason });
        }
    }

    pub(super) fn watch_control(&self, mut poll: ControlPoll, ended: &Receiver<()>) {
        let every = self.store.poll_interval();
        while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
            self.poll_control(&mut poll);
            if let Err(error) = self.store.check_place() {
                self.stop.break_down(error.into());
            }
        }
    }
}
