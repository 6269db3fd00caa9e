//! Wakes compute threads that sleep because there is no work.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex};
use std::time::Duration;

/// A count of pieces of work that were added. A thread reads it, looks for work, and sleeps only if it is unchanged, so that
/// no work stays unseen.
#[derive(Default)]
pub(super) struct Bell {
    rings: AtomicU64,
    sleepers: AtomicUsize,
    lock: Mutex<()>,
    rang: Condvar,
}

impl Bell {
    /// Returns the count, for a later [`Self::wait`].
    pub(super) fn rings(&self) -> u64 {
        self.rings.load(Ordering::SeqCst)
    }

    /// Wakes a thread for each of `count` new pieces of work.
    pub(super) fn ring(&self, count: usize) {
        self.rings.fetch_add(1, Ordering::SeqCst);
        let sleepers = self.sleepers.load(Ordering::SeqCst);
        if sleepers > 0 {
            let _guard = self.lock.lock().expect("no holder of this lock panics");
            (0..count.min(sleepers)).for_each(|_| self.rang.notify_one());
        }
    }

    /// Wakes all threads, because the work may be over.
    pub(super) fn ring_all(&self) {
        self.ring(usize::MAX);
    }

    /// Sleeps until the bell rings, for `longest` at most. Returns at once if it rang since [`Self::rings`] returned `seen`.
    pub(super) fn wait(&self, seen: u64, longest: Duration) {
        let guard = self.lock.lock().expect("no holder of this lock panics");
        self.sleepers.fetch_add(1, Ordering::SeqCst);
        if self.rings() == seen {
            drop(self.rang.wait_timeout(guard, longest).expect("no holder of this lock panics"));
        }
        self.sleepers.fetch_sub(1, Ordering::SeqCst);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    const LONG: Duration = Duration::from_mins(1);

    #[test]
    fn work_that_was_added_while_a_thread_looked_keeps_it_awake() {
        let bell = Bell::default();
        let seen = bell.rings();
        bell.ring(1);
        bell.wait(seen, LONG);
        let start = Instant::now();
        bell.wait(bell.rings(), Duration::from_millis(30));
        assert!((Duration::from_millis(30)..LONG).contains(&start.elapsed()));
    }

    /// Threads that take pieces of work take all of them, and end, however the pieces and the ends are ordered.
    #[test]
    fn no_piece_of_work_is_overlooked() {
        let (bell, left, is_over) = (Bell::default(), AtomicUsize::new(0), AtomicUsize::new(0));
        let taken = AtomicUsize::new(0);
        let start = Instant::now();
        std::thread::scope(|scope| {
            for _ in 0..32 {
                scope.spawn(|| {
                    loop {
                        let seen = bell.rings();
                        let take = |count: usize| count.checked_sub(1);
                        if left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, take).is_ok() {
                            taken.fetch_add(1, Ordering::SeqCst);
                        } else if is_over.load(Ordering::SeqCst) == 1 {
                            return;
                        } else {
                            bell.wait(seen, LONG);
                        }
                    }
                });
            }
            for piece in 0..2000 {
                left.fetch_add(1 + piece % 3, Ordering::SeqCst);
                bell.ring(1 + piece % 3);
            }
            while taken.load(Ordering::SeqCst) < 3999 {
                assert!(start.elapsed() < LONG / 2, "pieces are left while threads sleep");
                std::thread::yield_now();
            }
            is_over.store(1, Ordering::SeqCst);
            bell.ring_all();
        });
        assert!(start.elapsed() < LONG / 2, "{:?}", start.elapsed());
    }
}
