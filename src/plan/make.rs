//! Procedural photographs that a recipe asks for, made in the run's folder.

use super::content::Made;
use procedural::SampleError;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes a pixel: depth and mask of four bytes each, and a PNG of which 0.76 were measured.
const BYTES_A_PIXEL: f64 = 8.76;

impl Made {
    /// About the size of its files.
    pub fn about_bytes(&self) -> u64 {
        let [width, height] = self.size.map(f64::from);
        (width * height * BYTES_A_PIXEL) as u64
    }
}

/// The folder in which planning makes the files of the root `source`, below the run's folder.
pub(crate) fn inputs_folder(run: &Path, source: &str) -> PathBuf {
    run.join("inputs").join(source)
}

/// Makes those that are not there yet.
pub fn make_photographs(
    run: &Path,
    all: &[Made],
    threads: usize,
    on_photograph: &(dyn Fn(usize, usize) + Sync),
) -> Result<(), SampleError> {
    let is_missing =
        |made: &&Made| !procedural::is_written(&inputs_folder(run, &made.root), &made.photograph);
    let missing: Vec<_> = all.iter().filter(is_missing).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let done = AtomicUsize::new(0);
    on_photograph(0, missing.len());
    let make = || {
        missing.par_iter().try_for_each(|made| {
            let [width, height] = made.size;
            procedural::write(
                &inputs_folder(run, &made.root),
                &made.photograph,
                width,
                height,
            )?;
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
