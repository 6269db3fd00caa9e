//! Arrays that own or borrow memory of this module.

use crate::errors::error;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Makes an array of a shape that takes over the vector's memory.
pub(crate) fn array<'py>(
    py: Python<'py>,
    values: Vec<f32>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    PyArray1::from_vec(py, values).reshape(shape.to_vec())
}

/// Takes the array of a name from `out`, which must have this shape and rows in C order.
pub(crate) fn given<'py>(
    out: &Bound<'py, PyDict>,
    name: &str,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let wrong = |found: &str| {
        error(format!(
            "out[{name:?}] {found}, but must be a writable float32 array of shape {shape:?} in C order"
        ))
    };
    let Some(value) = out.get_item(name)? else {
        return Err(wrong("is missing"));
    };
    let array = value.cast_into::<PyArrayDyn<f32>>().map_err(|_| wrong("is no float32 array"))?;
    if array.shape() != shape || !array.is_c_contiguous() {
        return Err(wrong("has another shape or order"));
    }
    array.try_readwrite().map_err(|_| wrong("cannot be written"))?;
    Ok(array)
}

/// Writes pixels as planes: red, green, blue, each row by row.
pub(crate) fn write_planes(pixels: &[[f32; 3]], planes: &mut [f32]) {
    for (channel, plane) in planes.chunks_exact_mut(pixels.len().max(1)).enumerate() {
        for (out, pixel) in plane.iter_mut().zip(pixels) {
            *out = pixel[channel];
        }
    }
}
