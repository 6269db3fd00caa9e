//! Memory of images that training uses again in every step. New memory of this size comes from the system, which clears it.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

/// Vectors by their length, for use by several threads.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    is_reused: bool,
    free: Mutex<HashMap<usize, Vec<Vec<f32>>>>,
}

impl Buffers {
    /// Creates buffers that keep what is given back. Those of [`Self::default`] free it, because the images of a large
    /// photograph have many sizes.
    pub(crate) fn reused() -> Self {
        Self { is_reused: true, ..Self::default() }
    }

    /// Returns `len` arbitrary values.
    pub(crate) fn take(&self, len: usize) -> Vec<f32> {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let found = free.get_mut(&len).and_then(Vec::pop);
        drop(free);
        let mut values = found.unwrap_or_else(|| vec![0.0; len]);
        if cfg!(test) {
            // A pixel that is not written makes a result that no test accepts.
            values.fill(f32::NAN);
        }
        values
    }

    /// Gives values back.
    pub(crate) fn put(&self, values: Vec<f32>) {
        if self.is_reused && !values.is_empty() {
            let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.entry(values.len()).or_default().push(values);
        }
    }

    /// Returns the number of vectors that wait for use.
    #[cfg(test)]
    pub(crate) fn waiting(&self) -> usize {
        self.free.lock().unwrap().values().map(Vec::len).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_buffers_that_are_reused_keep_memory() {
        for (buffers, kept) in [(Buffers::reused(), 1), (Buffers::default(), 0)] {
            buffers.put(buffers.take(7));
            assert_eq!(buffers.waiting(), kept);
            assert_eq!(buffers.take(7).len(), 7);
            assert_eq!(buffers.waiting(), 0);
        }
    }
}
