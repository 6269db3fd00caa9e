//! The layers of a tuple's files.

use crate::arrays::array;
use crate::errors::error;
use glasshouse_line::layer::Layer;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use render::input_file;
use render::merge::{TupleRecord, decode_tuple_exr, decode_tuple_labels};
use std::path::PathBuf;

/// Reads the linear layers and labels of a tuple's folder, compared with their digests.
///
/// Returns the layers, (H,W,3), the labels, (H,W) or (H,W,3), and the text of tuple.json.
#[pyfunction]
pub(crate) fn read_tuple(
    py: Python<'_>,
    folder: PathBuf,
) -> PyResult<(Bound<'_, PyDict>, Bound<'_, PyDict>, String)> {
    let read = |name: &str| {
        let path = folder.join(name);
        input_file::read(&path)
            .map_err(|e| error(format!("cannot read {}: {e}; check the path", path.display())))
    };
    let json = read("tuple.json")?;
    let damaged = |name: &str, reason: &dyn std::fmt::Display| {
        error(format!(
            "{}: {reason}; `glasshouse audit` finds other damage of a run",
            folder.join(name).display()
        ))
    };
    let record: TupleRecord = TupleRecord::parse(&json).map_err(|e| damaged("tuple.json", &e))?;
    let exr = read("tuple.exr")?;
    let decoded = py.detach(|| {
        record.check_file("tuple.exr", &exr)?;
        let layers = decode_tuple_exr(&exr, &record)?;
        Ok((layers, decode_tuple_labels(&exr, &record)?))
    });
    let (decoded, decoded_labels) = decoded.map_err(|e: String| damaged("tuple.exr", &e))?;
    let film = &record.scene.film;
    let size = [film.height as usize, film.width as usize];
    let (layers, labels) = (PyDict::new(py), PyDict::new(py));
    for (layer, pixels) in Layer::ALL.into_iter().zip(decoded.0) {
        if !pixels.is_empty() {
            let shape = [size[0], size[1], 3];
            layers.set_item(layer.name(), array(py, pixels.into_flattened(), &shape)?)?;
        }
    }
    for (label, values) in decoded_labels {
        let channels = label.channels().len();
        let shape: Vec<usize> =
            size.into_iter().chain((channels > 1).then_some(channels)).collect();
        labels.set_item(label.name(), array(py, values, &shape)?)?;
    }
    let json = String::from_utf8(json).map_err(|e| damaged("tuple.json", &e))?;
    Ok((layers, labels, json))
}

/// Returns the BLAKE3 digest of bytes, in hexadecimal.
#[pyfunction]
pub(crate) fn blake3(data: &[u8]) -> String {
    ::blake3::hash(data).to_hex().to_string()
}
