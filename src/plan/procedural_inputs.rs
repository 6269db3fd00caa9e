//! The procedural photographs of a recipe: their files in the run's folder, and the same bytes in memory for previews.

use procedural::{SampleError, SampleFiles, SamplePhotograph};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use render::atomic_file;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes per pixel of a photograph's files: four each for depth and mask, and a measured 0.76 for the PNG.
const BYTES_A_PIXEL: f64 = 8.76;

/// A procedural photograph that planning writes into the run's folder.
#[derive(Clone, Debug)]
pub struct ProceduralPhotograph {
    pub(crate) root: String,
    pub(crate) photograph: SamplePhotograph,
    /// Width and height, px.
    pub(crate) size: [u32; 2],
}

impl ProceduralPhotograph {
    /// True if the run's folder has all three files.
    pub fn is_written(&self, run: &Path) -> bool {
        procedural::is_written(&inputs_folder(run, &self.root), &self.photograph)
    }

    /// Returns the paths of colours, depths and mask in the folder of a run.
    pub fn paths(&self, run: &Path) -> [PathBuf; 3] {
        let folder = inputs_folder(run, &self.root);
        self.photograph.paths().map(|path| folder.join(path))
    }

    /// Estimates the total size of the three files.
    pub fn estimated_bytes(&self) -> u64 {
        let [width, height] = self.size.map(f64::from);
        (width * height * BYTES_A_PIXEL) as u64
    }
}

/// Returns the folder below `run` for the files that planning writes for the root `source`.
fn inputs_folder(run: &Path, source: &str) -> PathBuf {
    run.join("inputs").join(source)
}

/// Writes the photographs that are missing from the run's folder, durably. `on_photograph` receives the number of photographs
/// that this call has written so far, and the number that were missing at its start.
pub fn make_photographs(
    run: &Path,
    all: &[ProceduralPhotograph],
    threads: usize,
    on_photograph: &(dyn Fn(usize, usize) + Sync),
) -> Result<(), SampleError> {
    let missing: Vec<_> = all.iter().filter(|made| !made.is_written(run)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let done = AtomicUsize::new(0);
    on_photograph(0, missing.len());
    let make = || -> Result<(), SampleError> {
        missing.par_iter().try_for_each(|made| {
            let [width, height] = made.size;
            procedural::write(&inputs_folder(run, &made.root), &made.photograph, width, height)?;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            on_photograph(done, missing.len());
            Ok(())
        })
    };
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(make)?,
        // If the system cannot start threads, the caller's pool does the work.
        Err(_) => make()?,
    }
    let paths = missing.iter().flat_map(|made| made.paths(run));
    Ok(atomic_file::sync_names(paths)?)
}

/// Files of procedural photographs. Renders a photograph once, at the first read of a file that is not on disk.
pub(super) struct SampleBytes<'a> {
    photographs: Vec<(&'a ProceduralPhotograph, OnceLock<Option<SampleFiles>>)>,
    /// Index of the photograph and of its file, by path.
    places: BTreeMap<PathBuf, (usize, usize)>,
}

impl<'a> SampleBytes<'a> {
    pub(super) fn new(run: &Path, all: &'a [ProceduralPhotograph]) -> Self {
        let (mut photographs, mut places) = (Vec::new(), BTreeMap::new());
        for one in all {
            for (kind, file) in one.paths(run).into_iter().enumerate() {
                places.insert(file, (photographs.len(), kind));
            }
            photographs.push((one, OnceLock::new()));
        }
        Self { photographs, places }
    }

    /// Reads a file. Returns `None` if the path belongs to no procedural photograph.
    pub(super) fn read(&self, path: &Path) -> Option<io::Result<Vec<u8>>> {
        let &(index, kind) = self.places.get(path)?;
        if path.is_file() {
            return Some(render::input_file::read(path));
        }
        let (one, made) = &self.photographs[index];
        let [width, height] = one.size;
        let files = made.get_or_init(|| procedural::encode(&one.photograph, width, height).ok());
        Some(match files {
            Some(files) => Ok([&files.color, &files.depth, &files.mask][kind].clone()),
            None => Err(io::Error::other("the photograph cannot be encoded")),
        })
    }
}
