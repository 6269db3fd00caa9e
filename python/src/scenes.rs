//! Scene lines that are rendered when they are asked for.

use crate::arrays::{array, given, write_planes};
use crate::engine::{Engine, Untraced};
use crate::errors::{BadScene, error};
use crate::planning::roots_of;
use crate::process::{PerProcess, interruptible};
use glasshouse_line::label::Label;
use glasshouse_line::layer::Layer;
use glasshouse_line::{Roots, SceneLine, parse_jsonl, parse_scene};
use numpy::PyArrayMethods;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};
use render::merge::Tuple;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Names of layers and labels, and the shape of each: channels, rows, columns.
type Parts = Vec<(&'static str, Vec<usize>)>;

/// Scene lines with the folders of their files.
#[pyclass(frozen, module = "glasshouse._native")]
pub(crate) struct Scenes {
    lines: Vec<SceneLine>,
    roots: Roots,
    base: PathBuf,
    cache_bytes: usize,
    engine: PerProcess<Engine>,
}

#[pymethods]
impl Scenes {
    /// Parses lines. `spp`, `size` (width, height), `seed` and `layers` replace those of all lines.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "the wrapper in Python names them")]
    fn new(
        jsonl: &str,
        roots: BTreeMap<String, PathBuf>,
        base: PathBuf,
        spp: Option<u32>,
        size: Option<[u32; 2]>,
        seed: Option<u64>,
        layers: Option<Vec<String>>,
        cache_bytes: usize,
        is_scene: bool,
    ) -> PyResult<Self> {
        let lines =
            if is_scene { parse_scene(jsonl).map(|line| vec![line]) } else { parse_jsonl(jsonl) };
        let mut lines = lines.map_err(error)?;
        let layers = match layers {
            Some(names) => {
                let names = serde_json::to_value(names).map_err(error)?;
                Some(serde_json::from_value(names).map_err(error)?)
            }
            None => None,
        };
        for line in &mut lines {
            line.film.spp = spp.unwrap_or(line.film.spp);
            [line.film.width, line.film.height] =
                size.unwrap_or([line.film.width, line.film.height]);
            line.seed = seed.unwrap_or(line.seed);
            line.film.layers = layers.unwrap_or(line.film.layers);
            line.validate().map_err(|e| error(format!("scene {}: {e}", line.id)))?;
        }
        let roots = roots_of(&roots)?;
        Ok(Self { lines, roots, base, cache_bytes, engine: PerProcess::default() })
    }

    fn __len__(&self) -> usize {
        self.lines.len()
    }

    /// Returns the id of a scene.
    fn id(&self, index: usize) -> PyResult<String> {
        Ok(self.line(index)?.id.to_string())
    }

    /// Returns a line as JSON, with the replaced values.
    fn json(&self, index: usize) -> PyResult<String> {
        serde_json::to_string(self.line(index)?).map_err(error)
    }

    /// Returns the numbers of a split's scenes.
    fn of_split(&self, split: &str) -> Vec<usize> {
        let is_in = |index: &usize| self.lines[*index].split.to_string() == split;
        (0..self.lines.len()).filter(is_in).collect()
    }

    /// Renders one scene on `threads` threads, which the first call of a process starts.
    ///
    /// Returns its layers, (H,W,3), its labels, (H,W) or (H,W,3), and its record as JSON.
    fn render<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        threads: usize,
    ) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>, String)> {
        let line = self.line(index)?;
        let engine = self.engine(py, threads)?;
        let stop = AtomicBool::new(false);
        let work = || engine.tuple(line, &self.roots, &self.base, &stop);
        let tuple = interruptible(py, &engine.pool, &|| stop.store(true, Relaxed), work)?
            .map_err(|e| untraced(py, e))?;
        let json = serde_json::to_string(&tuple.record).map_err(error)?;
        let (height, width) = (tuple.height as usize, tuple.width as usize);
        let (layers, labels) = (PyDict::new(py), PyDict::new(py));
        for (layer, pixels) in Layer::ALL.into_iter().zip(tuple.layers.0) {
            if !pixels.is_empty() {
                let values = array(py, pixels.into_flattened(), &[height, width, 3])?;
                layers.set_item(layer.name(), values)?;
            }
        }
        for (label, values) in tuple.labels {
            let shape: &[usize] = match label.channels().len() {
                1 => &[height, width],
                _ => &[height, width, 3],
            };
            labels.set_item(label.name(), array(py, values, shape)?)?;
        }
        Ok((layers, labels, json))
    }

    /// Renders scenes of one size into arrays (B,3,H,W), labels with one channel (B,1,H,W). Arrays of `out` are filled in place
    /// of new ones. With `replace`, the next scene that can be rendered replaces one that cannot.
    ///
    /// Returns the arrays by name, the numbers of the rendered scenes, and the reasons of those that cannot be rendered.
    #[expect(clippy::type_complexity, reason = "the wrapper in Python names the parts")]
    fn batch<'py>(
        &self,
        py: Python<'py>,
        indices: Vec<usize>,
        out: Option<&Bound<'py, PyDict>>,
        replace: bool,
        threads: usize,
    ) -> PyResult<(Bound<'py, PyDict>, Vec<usize>, Vec<(String, String)>)> {
        let parts = self.parts(&indices)?;
        let engine = self.engine(py, threads)?;
        let stop = AtomicBool::new(false);
        let arrays = PyDict::new(py);
        let mut views = Vec::with_capacity(parts.len());
        for (name, shape) in &parts {
            let shape = [&[indices.len()], &shape[..]].concat();
            let values = match out {
                Some(out) => given(out, name, &shape)?,
                None => array(py, vec![0.0; shape.iter().product()], &shape)?,
            };
            arrays.set_item(name, &values)?;
            views.push(values.readwrite());
        }
        let mut slots: Vec<Vec<&mut [f32]>> = indices.iter().map(|_| Vec::new()).collect();
        for values in &mut views {
            let values = values.as_slice_mut().map_err(error)?;
            let picture = values.len() / indices.len();
            for (slot, part) in slots.iter_mut().zip(values.chunks_exact_mut(picture.max(1))) {
                slot.push(part);
            }
        }
        let names: Vec<&'static str> = parts.iter().map(|(name, _)| *name).collect();
        let work = || -> Result<Vec<(usize, Vec<BadScene>)>, Untraced> {
            let one = |(index, slot): (usize, Vec<&mut [f32]>)| {
                let (rendered, tuple, bad) = self.usable(&engine, index, replace, &stop)?;
                fill(&tuple, &names, slot).map_err(Untraced::Bad)?;
                Ok((rendered, bad))
            };
            indices.into_par_iter().zip(slots).map(one).collect()
        };
        let made = interruptible(py, &engine.pool, &|| stop.store(true, Relaxed), work)?
            .map_err(|e| untraced(py, e))?;
        let bad = made.iter().flat_map(|(_, bad)| bad);
        let bad = bad.map(|bad| (bad.id.to_string(), bad.reason.clone())).collect();
        Ok((arrays, made.into_iter().map(|(index, _)| index).collect(), bad))
    }
}

impl Scenes {
    fn line(&self, index: usize) -> PyResult<&SceneLine> {
        let outside = || {
            pyo3::exceptions::PyIndexError::new_err(format!(
                "scene {index} of {}",
                self.lines.len()
            ))
        };
        self.lines.get(index).ok_or_else(outside)
    }

    fn engine(&self, py: Python<'_>, threads: usize) -> PyResult<Arc<Engine>> {
        self.engine.get(py, || Engine::start(threads, self.cache_bytes)).map_err(error)
    }

    /// Returns the names and shapes of what the scenes have, which must be the same for all.
    fn parts(&self, indices: &[usize]) -> PyResult<Parts> {
        let of = |line: &SceneLine| -> Parts {
            let (height, width) = (line.film.height as usize, line.film.width as usize);
            let layers = line.film.layers.names().map(|name| (name, vec![3, height, width]));
            let labels = line.film.layers.labels();
            let shape = |label: Label| vec![label.channels().len(), height, width];
            layers.chain(labels.iter().map(|label| (label.name(), shape(label)))).collect()
        };
        let mut parts: Option<(Parts, &SceneLine)> = None;
        for &index in indices {
            let line = self.line(index)?;
            let own = of(line);
            match &parts {
                Some((first, other)) if *first != own => {
                    return Err(error(format!(
                        "scenes {} and {} have other sizes or layers: give `size` and `layers`, or batches of equal scenes",
                        other.id, line.id
                    )));
                }
                Some(_) => {}
                None => parts = Some((own, line)),
            }
        }
        Ok(parts.map(|(parts, _)| parts).unwrap_or_default())
    }

    /// Renders a scene, or with `replace` the next one that can be rendered. Also returns the scenes that cannot.
    fn usable(
        &self,
        engine: &Engine,
        index: usize,
        replace: bool,
        stop: &AtomicBool,
    ) -> Result<(usize, Tuple, Vec<BadScene>), Untraced> {
        let mut bad = Vec::new();
        let count = self.lines.len();
        for further in 0..count {
            let at = (index + further) % count;
            match engine.tuple(&self.lines[at], &self.roots, &self.base, stop) {
                Ok(tuple) => return Ok((at, tuple, bad)),
                Err(Untraced::Bad(scene)) if replace && further + 1 < count => bad.push(scene),
                Err(error) => return Err(error),
            }
        }
        Err(Untraced::Stopped)
    }
}

fn untraced(py: Python<'_>, reason: Untraced) -> PyErr {
    match reason {
        Untraced::Bad(scene) => scene.to_error(py),
        Untraced::Stopped => PyKeyboardInterrupt::new_err(()),
    }
}

/// Writes the parts of a tuple into their places. A replacement must have the same.
fn fill(tuple: &Tuple, names: &[&'static str], slot: Vec<&mut [f32]>) -> Result<(), BadScene> {
    let misfit = || BadScene {
        id: tuple.record.scene.id.clone(),
        reason:
            "it replaces a scene of another size or with other layers: give `size` and `layers`"
                .to_owned(),
    };
    for (name, out) in names.iter().zip(slot) {
        match (Layer::from_name(name), Label::from_name(name)) {
            (Some(layer), _) => {
                let pixels = &tuple.layers[layer];
                if 3 * pixels.len() != out.len() {
                    return Err(misfit());
                }
                write_planes(pixels, out);
            }
            (None, label) => {
                let values = label.and_then(|label| tuple.labels.get(&label)).ok_or_else(misfit)?;
                if values.len() != out.len() {
                    return Err(misfit());
                }
                let pixels = tuple.width as usize * tuple.height as usize;
                for (channel, plane) in out.chunks_exact_mut(pixels.max(1)).enumerate() {
                    let of_pixel = values.len() / pixels.max(1);
                    for (at, value) in plane.iter_mut().enumerate() {
                        *value = values[at * of_pixel + channel];
                    }
                }
            }
        }
    }
    Ok(())
}
