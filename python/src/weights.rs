//! The weights of new networks.

use crate::arrays::array;
use crate::errors::error;
use plan::{Stage, TrainSettings};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Returns the weights with which a training of a stage begins, by their names in a checkpoint. `settings` is JSON.
#[pyfunction]
pub(crate) fn initial_weights<'py>(
    py: Python<'py>,
    settings: &str,
    stage: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let settings: TrainSettings =
        serde_json::from_str(settings).map_err(|e| error(format!("settings: {e}")))?;
    settings.validate().map_err(error)?;
    let stage: Stage = serde_json::from_value(stage.into()).map_err(error)?;
    let made = py.detach(|| train::initial_weights(stage, &settings)).map_err(error)?;
    let weights = PyDict::new(py);
    for (name, tensor) in made {
        let values = tensor.flatten_all().and_then(|flat| flat.to_vec1()).map_err(error)?;
        weights.set_item(name, array(py, values, tensor.dims())?)?;
    }
    Ok(weights)
}
