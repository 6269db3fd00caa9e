//! State that belongs to one process, and calls that signals interrupt.

use crossbeam::channel::{RecvTimeoutError, bounded};
use pyo3::prelude::*;
use std::any::Any;
use std::mem;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Interval between checks for signals.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// A value that each process makes at its first use. After a fork, the child has the memory of the parent without its
/// threads, so the parent's value is of no use there: its threads are gone, and its locks may be held for ever.
pub(crate) struct PerProcess<T>(Mutex<Option<(u32, Arc<T>)>>);

impl<T> Default for PerProcess<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T> PerProcess<T> {
    /// Returns the value of this process, or makes it. Only threads that hold Python's lock call this function, and a fork
    /// holds it, too: therefore no child finds this lock held.
    pub(crate) fn get<E>(
        &self,
        _: Python<'_>,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<Arc<T>, E> {
        let process = std::process::id();
        let mut value = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        match &*value {
            Some((of, value)) if *of == process => return Ok(Arc::clone(value)),
            // Dropping the parent's value would wait for threads that the child does not have.
            Some(_) => mem::forget(value.take()),
            None => {}
        }
        let made = Arc::new(make()?);
        *value = Some((process, Arc::clone(&made)));
        Ok(made)
    }

    /// Forgets the value of this process. The next use makes a new one.
    pub(crate) fn clear(&self, _: Python<'_>) {
        let mut value = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if value.as_ref().is_some_and(|(of, _)| *of == std::process::id()) {
            *value = None;
        }
    }
}

/// Runs `work` on the threads of `pool` without Python's lock. A signal calls `stop`, and becomes an exception when the work
/// has ended. A panic becomes an exception, too.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    pool: &rayon::ThreadPool,
    stop: &(dyn Fn() + Sync),
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    let (sender, receiver) = bounded(1);
    let wait = || loop {
        match receiver.recv_timeout(LOOK_EVERY) {
            Ok(result) => return Ok(result),
            Err(RecvTimeoutError::Timeout) => {
                if let Err(signal) = Python::attach(look) {
                    stop();
                    let _ = receiver.recv();
                    return Err(signal);
                }
            }
            Err(RecvTimeoutError::Disconnected) => unreachable!("the thread sends its result"),
        }
    };
    let result = py.detach(|| {
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let result = catch_unwind(AssertUnwindSafe(|| pool.install(work)));
                // The receiver waits until it has the result.
                let _ = sender.send(result);
            });
            wait()
        })
    })?;
    result.map_err(|panic| super::errors::error(format!("a bug of glasshouse: {}", text(&*panic))))
}

/// Raises the exception of a signal that has arrived.
fn look(py: Python<'_>) -> PyResult<()> {
    py.check_signals()
}

/// Returns the text of a panic.
pub(crate) fn text(panic: &(dyn Any + Send)) -> &str {
    let of_string = panic.downcast_ref::<String>().map(String::as_str);
    of_string.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a text")
}
