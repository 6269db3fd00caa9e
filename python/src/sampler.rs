//! The examples of a training, as the trainer of `glasshouse train` draws them.

use crate::arrays::{array, given};
use crate::engine::pool;
use crate::errors::error;
use crate::planning::{planned_run, roots_of};
use crate::process::{PerProcess, interruptible};
use crossbeam::channel::{Receiver, Sender, bounded};
use examples::{
    Example, ExampleError, ExampleSampler, PairSource, PhotographSource, Planes, SceneSource,
    ShardSource, TupleFiles, TupleFilesError, TupleSource, scenes_digest,
};
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Roots, SceneLine, Split};
use numpy::PyArrayMethods;
use plan::{LocalFiles, TrainSettings, Trainings};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use render::input_file;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// File of an export.
const EXPORT: &str = "export.json";

/// Examples of a run's tuples.
#[pyclass(frozen, module = "glasshouse._native")]
pub(crate) struct Sampler {
    run: PathBuf,
    lines: Vec<SceneLine>,
    roots: Roots,
    settings: TrainSettings,
    memory_bytes: usize,
    reader: PerProcess<Reader>,
}

/// Threads and tuples of one process.
struct Reader {
    pool: rayon::ThreadPool,
    sampler: ExampleSampler,
    /// Closed to stop a sampler that waits for tuples of a farm.
    open: Mutex<Option<Sender<()>>>,
}

#[pymethods]
impl Sampler {
    /// Opens the folder of a run, or of an export in the format of safetensors. `settings` is the JSON of a training's
    /// settings; examples are those of the split's scenes.
    #[new]
    fn new(
        run: PathBuf,
        roots: BTreeMap<String, PathBuf>,
        settings: &str,
        split: &str,
        memory_bytes: usize,
    ) -> PyResult<Self> {
        let settings: TrainSettings =
            serde_json::from_str(settings).map_err(|e| error(format!("settings: {e}")))?;
        settings.validate().map_err(error)?;
        let of_split: Split = serde_json::from_value(split.into()).map_err(|_| {
            error(format!("the split is {split:?}, but must be train, validation or test"))
        })?;
        let (mut lines, folders) = if run.join(EXPORT).exists() {
            if !settings.examples.is_composed() {
                return Err(error(format!(
                    "{} is an export, of which only composed examples are made",
                    run.display()
                )));
            }
            (ShardSource::open(&run, of_split).map_err(error)?.lines, BTreeMap::new())
        } else {
            planned_run(&run, roots)?
        };
        lines.retain(|line| line.split == of_split);
        if settings.scenes > 0 {
            lines.truncate(settings.scenes);
        }
        if lines.is_empty() {
            return Err(error(format!("{} has no scene in the split {split:?}", run.display())));
        }
        let roots = roots_of(&folders)?;
        let reader = PerProcess::default();
        Ok(Self { run, lines, roots, settings, memory_bytes, reader })
    }

    fn __len__(&self) -> usize {
        self.lines.len()
    }

    /// The digest of the scenes' lines, as checkpoints record it.
    #[getter]
    fn scenes_blake3(&self) -> String {
        scenes_digest(&self.lines)
    }

    /// Returns the examples of steps, one after another, as arrays (B,3,S,S) of sRGB codes. Arrays of `out` are filled in place of
    /// new ones. Layers that an example lacks are left out.
    fn steps<'py>(
        &self,
        py: Python<'py>,
        steps: Vec<u64>,
        out: Option<&Bound<'py, PyDict>>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        let reader = self.reader.get(py, || self.open(threads))?;
        let stop = AtomicBool::new(false);
        let work = || -> Result<Vec<Vec<Example>>, ExampleError> {
            let of_step = |step| {
                if stop.load(Ordering::Relaxed) {
                    return Err(ExampleError::Stopped);
                }
                reader.sampler.examples(step)
            };
            steps.into_par_iter().map(of_step).collect()
        };
        let end = || {
            stop.store(true, Ordering::Relaxed);
            *reader.open.lock().unwrap_or_else(PoisonError::into_inner) = None;
        };
        let made = interruptible(py, &reader.pool, &end, work)
            .inspect_err(|_| self.reader.clear(py))?
            .map_err(error)?;
        let made: Vec<Example> = made.into_iter().flatten().collect();
        arrays(py, &made, out)
    }
}

impl Sampler {
    fn open(&self, threads: usize) -> PyResult<Reader> {
        compose::prepare();
        let (stop, stopped): (Sender<()>, Receiver<()>) = bounded(0);
        let scenes = if self.run.join(EXPORT).exists() {
            let mut source = ShardSource::open(&self.run, self.lines[0].split).map_err(error)?;
            source.lines.truncate(self.lines.len());
            SceneSource::Shards(source)
        } else if self.settings.examples.needs_tuples() {
            SceneSource::Tuples(TupleSource {
                files: Arc::new(RunFolder(self.run.clone())),
                lines: self.lines.clone(),
                pixels: self.settings.pixels,
            })
        } else {
            SceneSource::Photographs(PhotographSource {
                lines: self.lines.clone(),
                roots: self.roots.clone(),
                base: self.run.clone(),
                inputs: Box::new(LocalFiles),
            })
        };
        let pairs = PairSource { pairs: Vec::new() };
        let sampler =
            ExampleSampler::new(&self.settings, scenes, pairs, self.memory_bytes, stopped);
        Ok(Reader {
            pool: pool(threads).map_err(error)?,
            sampler: sampler.map_err(error)?,
            open: Mutex::new(Some(stop)),
        })
    }
}

/// Returns a layer of an example.
type LayerOf = fn(&Example) -> Option<&Planes>;

/// Joins the layers of examples of one size.
fn arrays<'py>(
    py: Python<'py>,
    made: &[Example],
    out: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let joined = PyDict::new(py);
    let Some(first) = made.first() else {
        return Ok(joined);
    };
    let shape = [made.len(), 3, first.rows, first.columns];
    let layers: [(&str, LayerOf); 4] = [
        ("input", |example| Some(&example.input)),
        ("transmission", |example| Some(&example.transmission)),
        ("glass_reflection", |example| example.glass_reflection.as_ref()),
        ("clean_reflection", |example| example.clean_reflection.as_ref()),
    ];
    for (name, of) in layers {
        let Some(planes) = made.iter().map(of).collect::<Option<Vec<_>>>() else {
            continue;
        };
        if let Some(out) = out.filter(|out| out.contains(name).unwrap_or(false)) {
            let values = given(out, name, &shape)?;
            let mut writable = values.readwrite();
            let slots = writable.as_slice_mut().map_err(error)?;
            for (slot, plane) in slots.chunks_exact_mut(planes[0].len().max(1)).zip(planes) {
                slot.copy_from_slice(plane);
            }
            joined.set_item(name, &values)?;
        } else {
            let slices: Vec<&[f32]> = planes.into_iter().map(|plane| &plane[..]).collect();
            // Whole slices are copied at once; at this crate's level of optimisation, iterators over values are slow.
            let values = slices.concat();
            joined.set_item(name, array(py, values, &shape)?)?;
        }
    }
    Ok(joined)
}

/// Returns the settings of a training of a run's recipe, as JSON; the defaults without `[train]`.
///
/// With `of_recipe`, the first training stands for no name, and an unknown name is an error. Otherwise names mean the same as on
/// the command line, where an unknown one begins a training with the default settings.
#[pyfunction]
pub(crate) fn train_settings(
    run: PathBuf,
    name: Option<&str>,
    of_recipe: bool,
) -> PyResult<String> {
    let path = run.join("train.json");
    let unusable = |e: &dyn std::fmt::Display| error(format!("{}: {e}", path.display()));
    let trainings: Trainings = match input_file::read_to_string(&path) {
        Ok(text) => serde_json::from_str(&text).map_err(|e| unusable(&e))?,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Trainings::default(),
        Err(e) => return Err(unusable(&e)),
    };
    let found = if of_recipe && name.is_none() {
        trainings.seeded().into_iter().next()
    } else {
        trainings.find(name)
    };
    if let (None, Some(name), true) = (&found, name, of_recipe) {
        let names: Vec<String> = trainings.seeded().into_iter().filter_map(|t| t.name).collect();
        let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(error(format!(
            "the recipe of {} has no training {name:?}; it has: {names}",
            run.display()
        )));
    }
    serde_json::to_string(&found.map(|training| training.settings).unwrap_or_default())
        .map_err(error)
}

/// The tuples of a run's folder.
struct RunFolder(PathBuf);

impl RunFolder {
    fn is_there(&self, path: &Path) -> Result<bool, TupleFilesError> {
        self.0.join(path).try_exists().map_err(|e| TupleFilesError(e.into()))
    }
}

impl TupleFiles for RunFolder {
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Vec<u8>>, TupleFilesError> {
        match input_file::read(&self.0.join("tuples").join(scene.as_str()).join(file)) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(TupleFilesError(e.into())),
        }
    }

    fn is_quarantined(&self, scene: &SceneId) -> Result<bool, TupleFilesError> {
        self.is_there(&Path::new("quarantine").join(format!("{scene}.json")))
    }

    fn count(&self, scenes: &[SceneId]) -> Result<usize, TupleFilesError> {
        let mut count = 0;
        for scene in scenes {
            let record = Path::new("tuples").join(scene.as_str()).join("tuple.json");
            count += usize::from(self.is_there(&record)?);
        }
        Ok(count)
    }
}
