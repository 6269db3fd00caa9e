//! Repeats calls to a store that is unavailable or busy.

use super::error::is_passing;
use std::future::Future;
use std::time::{Duration, Instant};

/// First and longest pause between two tries.
const PAUSE: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(5)];

/// Pauses between the tries of one call: exponential backoff with jitter.
pub(super) struct Tries {
    until: Instant,
    pause: Duration,
}

impl Tries {
    /// Returns pauses for a call that starts now. No try starts later than `patience` from now.
    pub(super) fn new(patience: Duration) -> Self {
        Self { until: Instant::now() + patience, pause: PAUSE[0] }
    }

    /// Waits for the next try. Returns false if the patience is over.
    pub(super) async fn wait(&mut self) -> bool {
        // Jitter from half of the pause to all of it, so that workers that failed together do not retry together.
        let part = getrandom::u32().map_or(1.0, |n| 0.5 + f64::from(n) / f64::from(u32::MAX) / 2.0);
        let pause = self.pause.mul_f64(part);
        self.pause = (self.pause * 2).min(PAUSE[1]);
        if Instant::now() + pause > self.until {
            return false;
        }
        tokio::time::sleep(pause).await;
        true
    }
}

/// Repeats a call until it succeeds, fails permanently, or `patience` is over.
pub(super) async fn with_patience<T, F: Future<Output = object_store::Result<T>>>(
    patience: Duration,
    call: impl Fn() -> F,
) -> object_store::Result<T> {
    let mut tries = Tries::new(patience);
    loop {
        match call().await {
            Err(error) if is_passing(&error) => {
                if !tries.wait().await {
                    return Err(error);
                }
            }
            other => return other,
        }
    }
}
