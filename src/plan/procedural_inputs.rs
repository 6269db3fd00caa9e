//! The procedural pictures of a recipe: their files in the run's folder, and the same bytes in memory for previews.

use super::draw::keyed;
use super::recipe::Recipe;
use super::request::Request;
use glasshouse_line::Split;
use procedural::{CoverKind, SampleError, SamplePhotograph};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use render::atomic_file;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes per pixel of a photograph's files: four each for depth and mask, and a measured 0.76 for the PNG.
const BYTES_A_PIXEL: f64 = 8.76;

/// Measured bytes per pixel of a cover's PNG, the mean of all kinds.
const COVER_BYTES_A_PIXEL: f64 = 1.0;

/// Height of the pictures of covers, px.
const COVER_HEIGHT_PX: u32 = 512;

/// Name of the root of the pictures of covers.
pub(super) const COVER_ROOT: &str = "cover";

/// A procedural picture that planning writes into the run's folder.
#[derive(Clone, Debug)]
pub struct ProceduralInput {
    pub(crate) root: String,
    pub(crate) picture: ProceduralPicture,
}

/// What a procedural picture shows.
#[derive(Clone, Debug)]
pub(crate) enum ProceduralPicture {
    /// A photograph with depth and mask; width and height, px.
    Photograph { photograph: SamplePhotograph, size: [u32; 2] },
    /// A card of `[cover]`, at `path` relative to the root.
    Cover { kind: CoverKind, seed: u64, path: PathBuf },
}

/// The bytes of a picture's files.
type FileBytes = Vec<Vec<u8>>;

impl ProceduralInput {
    /// True if the run's folder has all files of the picture.
    pub fn is_written(&self, run: &Path) -> bool {
        self.paths(run).iter().all(|path| path.is_file())
    }

    /// Returns the paths of the picture's files in the folder of a run: colours, depths and mask of a photograph, or the PNG of
    /// a cover.
    pub fn paths(&self, run: &Path) -> Vec<PathBuf> {
        let folder = inputs_folder(run, &self.root);
        match &self.picture {
            ProceduralPicture::Photograph { photograph, .. } => {
                photograph.paths().map(|path| folder.join(path)).into()
            }
            ProceduralPicture::Cover { path, .. } => vec![folder.join(path)],
        }
    }

    /// Estimates the total size of the files.
    pub fn estimated_bytes(&self) -> u64 {
        match &self.picture {
            ProceduralPicture::Photograph { size, .. } => {
                let [width, height] = size.map(f64::from);
                (width * height * BYTES_A_PIXEL) as u64
            }
            ProceduralPicture::Cover { kind, .. } => {
                let height = f64::from(COVER_HEIGHT_PX);
                (height * height * f64::from(kind.aspect()) * COVER_BYTES_A_PIXEL) as u64
            }
        }
    }

    /// Returns the name of the picture's colour image in scene lines: `ROOT:path`.
    pub(super) fn name(&self) -> String {
        let path = match &self.picture {
            ProceduralPicture::Photograph { photograph, .. } => photograph.color_path(),
            ProceduralPicture::Cover { path, .. } => path.clone(),
        };
        format!("{}:{}", self.root, path.display())
    }

    /// Makes the picture. Returns the bytes of its files, in the order of [`Self::paths`].
    fn encode(&self) -> Result<FileBytes, SampleError> {
        match &self.picture {
            ProceduralPicture::Photograph { photograph, size: [width, height] } => {
                let files = procedural::encode(photograph, *width, *height)?;
                Ok(vec![files.color, files.depth, files.mask])
            }
            ProceduralPicture::Cover { kind, seed, path } => {
                let encoded = procedural::cover_png(*kind, *seed, COVER_HEIGHT_PX);
                let named = |source| SampleError::Code { path: path.clone(), source };
                Ok(vec![encoded.map_err(named)?])
            }
        }
    }

    /// Writes the files, each atomically, the colour image last.
    fn write(&self, run: &Path) -> Result<(), SampleError> {
        let files = self.encode()?;
        for (path, bytes) in self.paths(run).iter().zip(&files).rev() {
            if let Some(folder) = path.parent() {
                atomic_file::create_dir(folder)?;
            }
            atomic_file::write_whole(path, bytes)?;
        }
        Ok(())
    }
}

/// Returns the path in scene lines of a picture of `[cover]`. No two splits share a picture.
pub(super) fn cover_path(split: Split, kind: CoverKind, index: u32) -> String {
    format!("{COVER_ROOT}:{split}/{}-{index:04}.png", kind.name())
}

/// Lists the pictures of a recipe's `[cover]`.
pub(super) fn covers(recipe: &Recipe) -> Vec<ProceduralInput> {
    let Some(cover) = &recipe.cover else {
        return vec![];
    };
    let of = |split: Split, kind: CoverKind, index: u32| {
        let name = cover_path(split, kind, index);
        let (root, path) = name.split_once(':').expect("the path has a root");
        // As every seed, below 2^53.
        let seed = keyed(recipe.seed, &["cover picture", path]) >> 11;
        let picture = ProceduralPicture::Cover { kind, seed, path: PathBuf::from(path) };
        ProceduralInput { root: root.to_owned(), picture }
    };
    let mut all = Vec::new();
    for split in &recipe.splits {
        for kind in cover.kinds() {
            all.extend((0..cover.pictures).map(|index| of(split.name, kind, index)));
        }
    }
    all
}

/// Returns the folder below `run` for the files that planning writes for the root `source`.
fn inputs_folder(run: &Path, source: &str) -> PathBuf {
    run.join("inputs").join(source)
}

/// Writes the pictures that are missing from the run's folder, and makes all of them durable, also those that previews
/// wrote. `on_picture` receives the number of pictures that this call has written so far, and the number that were missing
/// at its start.
pub fn make_inputs(
    run: &Path,
    all: &[ProceduralInput],
    threads: usize,
    on_picture: &(dyn Fn(usize, usize) + Sync),
) -> Result<(), SampleError> {
    let missing: Vec<_> = all.iter().filter(|made| !made.is_written(run)).collect();
    let done = AtomicUsize::new(0);
    if !missing.is_empty() {
        on_picture(0, missing.len());
    }
    let make = || -> Result<(), SampleError> {
        missing.par_iter().try_for_each(|made| {
            made.write(run)?;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            on_picture(done, missing.len());
            Ok(())
        })
    };
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(make)?,
        // If the system cannot start threads, the caller's pool does the work.
        Err(_) => make()?,
    }
    let paths = all.iter().flat_map(|made| made.paths(run));
    Ok(atomic_file::sync_names(paths)?)
}

/// Files of procedural pictures. Makes a picture once, at the first read of a file that is not on disk.
pub(super) struct ProceduralBytes<'a> {
    request: &'a Request<'a>,
    pictures: Vec<(&'a ProceduralInput, OnceLock<Made>)>,
    /// Index of the picture and of its file, by path.
    places: BTreeMap<PathBuf, (usize, usize)>,
}

/// A picture that previews have made. Errors are texts, because several previews read them.
enum Made {
    Written(Result<(), String>),
    InMemory(Result<FileBytes, String>),
}

impl<'a> ProceduralBytes<'a> {
    pub(super) fn new(request: &'a Request<'a>, all: &'a [ProceduralInput]) -> Self {
        let (mut pictures, mut places) = (Vec::new(), BTreeMap::new());
        for one in all {
            for (kind, file) in one.paths(request.run).into_iter().enumerate() {
                places.insert(file, (pictures.len(), kind));
            }
            pictures.push((one, OnceLock::new()));
        }
        Self { request, pictures, places }
    }

    /// Reads a file. Returns `None` if the path belongs to no procedural picture.
    pub(super) fn read(&self, path: &Path) -> Option<io::Result<Vec<u8>>> {
        let &(index, kind) = self.places.get(path)?;
        if path.is_file() {
            return Some(render::input_file::read(path));
        }
        let (one, made) = &self.pictures[index];
        let bytes = match made.get_or_init(|| self.make(one)) {
            Made::Written(Ok(())) => return Some(render::input_file::read(path)),
            Made::InMemory(Ok(files)) => Ok(files[kind].clone()),
            Made::Written(Err(text)) | Made::InMemory(Err(text)) => {
                Err(io::Error::other(text.clone()))
            }
        };
        Some(bytes)
    }

    /// Removes the pictures that were written for draws which the plan does not keep.
    pub(super) fn remove_unless(&self, is_used: impl Fn(&ProceduralInput) -> bool) {
        for (one, made) in &self.pictures {
            if matches!(made.get(), Some(Made::Written(Ok(())))) && !is_used(one) {
                for path in one.paths(self.request.run) {
                    // A file that stays costs its space, and nothing reads it.
                    let _ = std::fs::remove_file(path);
                }
            }
        }
    }

    fn make(&self, one: &ProceduralInput) -> Made {
        let Some(begin) = self.request.begin_writing else {
            return Made::InMemory(one.encode().map_err(|error| error.to_string()));
        };
        let begun = begin().map_err(|error| error.to_string());
        Made::Written(begun.and_then(|()| one.write(self.request.run).map_err(|e| e.to_string())))
    }
}
