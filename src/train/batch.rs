//! Batches of examples as tensors.

use candle_core::{Device, Result, Tensor};
use examples::{Example, Planes};

/// Images of one step, each of shape (batch, 3, rows, columns).
pub struct Batch {
    pub input: Tensor,
    pub transmission: Tensor,
    /// `None` if an example lacks this layer; the same holds for `clean_reflection`.
    pub glass_reflection: Option<Tensor>,
    pub clean_reflection: Option<Tensor>,
}

impl Batch {
    /// Stacks examples of one size. A reflection layer is `None` if one of the examples lacks it.
    pub fn new(examples: &[Example]) -> Result<Self> {
        let Some(first) = examples.first() else {
            candle_core::bail!("a batch needs an example");
        };
        let shape = (examples.len(), 3, first.rows, first.columns);
        let stack = |layer: fn(&Example) -> Option<&Planes>| -> Result<Option<Tensor>> {
            let planes: Option<Vec<&Planes>> = examples.iter().map(layer).collect();
            let Some(planes) = planes else {
                return Ok(None);
            };
            let values: Vec<f32> = planes.into_iter().flatten().copied().collect();
            Tensor::from_vec(values, shape, &Device::Cpu).map(Some)
        };
        let needed = |layer: Option<Tensor>| {
            layer.ok_or_else(|| candle_core::Error::Msg("no input or no transmission".to_owned()))
        };
        Ok(Self {
            input: needed(stack(|e| Some(&e.input))?)?,
            transmission: needed(stack(|e| Some(&e.transmission))?)?,
            glass_reflection: stack(|e| e.glass_reflection.as_ref())?,
            clean_reflection: stack(|e| e.clean_reflection.as_ref())?,
        })
    }
}
