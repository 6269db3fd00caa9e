//! Writes the procedural photographs of a recipe into the run's folder.

use super::content::ProceduralPhotograph;
use procedural::SampleError;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes per pixel: four each for depth and mask, and a measured 0.76 for the PNG.
const BYTES_A_PIXEL: f64 = 8.76;

impl ProceduralPhotograph {
    /// Estimated total size of the three files.
    pub fn estimated_bytes(&self) -> u64 {
        let [width, height] = self.size.map(f64::from);
        (width * height * BYTES_A_PIXEL) as u64
    }
}

/// The folder for the files that planning writes for the root `source`, below the run's folder.
pub(crate) fn inputs_folder(run: &Path, source: &str) -> PathBuf {
    run.join("inputs").join(source)
}

/// Writes the photographs that are missing in the run's folder. `on_photograph` receives (done, all).
pub fn make_photographs(
    run: &Path,
    all: &[ProceduralPhotograph],
    threads: usize,
    on_photograph: &(dyn Fn(usize, usize) + Sync),
) -> Result<(), SampleError> {
    let is_missing = |made: &&ProceduralPhotograph| {
        !procedural::is_written(&inputs_folder(run, &made.root), &made.photograph)
    };
    let missing: Vec<_> = all.iter().filter(is_missing).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let done = AtomicUsize::new(0);
    on_photograph(0, missing.len());
    let make = || {
        missing.par_iter().try_for_each(|made| {
            let [width, height] = made.size;
            procedural::write(&inputs_folder(run, &made.root), &made.photograph, width, height)?;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            on_photograph(done, missing.len());
            Ok(())
        })
    };
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(make),
        // The system refuses threads: use the caller's.
        Err(_) => make(),
    }
}
