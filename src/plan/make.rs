//! Procedural photographs that a recipe asks for, made in the run's folder.

use super::content::Made;
use super::run_dir::RunDir;
use crate::sample::{self, SampleError};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes a pixel: depth and mask of four bytes each, and a PNG of which 0.76 were measured.
const BYTES_A_PIXEL: f64 = 8.76;

impl Made {
    /// About the size of its files.
    pub(super) fn about_bytes(&self) -> u64 {
        let [width, height] = self.size.map(f64::from);
        (width * height * BYTES_A_PIXEL) as u64
    }
}

/// Makes those that are not there yet.
pub(super) fn make_photographs(
    dir: &RunDir,
    all: &[Made],
    threads: usize,
    on_photograph: &(dyn Fn(usize, usize) + Sync),
) -> Result<(), SampleError> {
    let is_missing = |made: &&Made| !sample::is_written(&dir.inputs(&made.root), &made.photograph);
    let missing: Vec<_> = all.iter().filter(is_missing).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let done = AtomicUsize::new(0);
    on_photograph(0, missing.len());
    let make = || {
        missing.par_iter().try_for_each(|made| {
            let [width, height] = made.size;
            sample::write(&dir.inputs(&made.root), &made.photograph, width, height)?;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            on_photograph(done, missing.len());
            Ok(())
        })
    };
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(make),
        // No thread to be had: the caller's own will do.
        Err(_) => make(),
    }
}
