//! Threads that share one work.

use std::thread::{Builder, scope};

/// Calls `work`, which ends once nothing is left to do, on this thread and on `threads - 1` others. If the system cannot
/// start all of them, those that run do the whole work.
pub(crate) fn on_threads(threads: usize, work: impl Fn() + Sync) {
    scope(|scope| {
        for _ in 1..threads {
            if Builder::new().spawn_scoped(scope, &work).is_err() {
                break;
            }
        }
        work();
    });
}
