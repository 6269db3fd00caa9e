//! Examples composed in linear light: the choice of the other tuple and of both crops.

use super::example::Example;
use super::example_sampler::{ExampleSampler, too_small};
use super::source::{Base, ExampleError};
use compose::{Cut, Draw, Layering, LinearTuple, Side, Stream};
use plan::ExampleKind;
use std::sync::Arc;

impl ExampleSampler {
    /// Composes the example at a position of the sequence of scenes. `index` is the front's scene, and the reflection
    /// comes from one of the first `others` scenes that are not the front's. `stream` draws the crops and the other
    /// scene; streams of their own draw all other numbers and the noise, so that crops are those of rendered examples.
    pub(crate) fn composed(
        &self,
        position: u64,
        [index, others]: [usize; 2],
        front: &LinearTuple,
        stream: &mut Stream,
    ) -> Result<Example, ExampleError> {
        let seed = self.settings.seed;
        let mut numbers = Stream::new(seed, &format!("composition {position}"));
        let mut noise = Stream::new(seed, &format!("camera noise {position}"));
        let mut draw = Draw::new(&self.settings.composition, &mut numbers);
        if let Some(sensor) = &self.settings.sensor {
            let drawn = sensor.draw_for(seed, &format!("example {position}"));
            draw = draw.with_sensor(drawn, noise.bits());
        }
        let front = self.side(front, draw.front_scale, stream)?;
        let layering = match self.settings.examples {
            ExampleKind::LinearMixtures => Layering::LinearMixture,
            ExampleKind::ZhangMixtures => Layering::ZhangMixture,
            ExampleKind::CeilnetMixtures => Layering::CeilnetMixture,
            _ => Layering::Rendered,
        };
        let other = if draw.is_other || layering.is_mixture() {
            self.other_scene(index, others, stream)?
        } else {
            None
        };
        if other.is_none() && layering.is_mixture() {
            return Err(ExampleError::None(
                "mixtures need two scenes with tuples in the split \"train\"".to_owned(),
            ));
        }
        let back = match other.as_deref() {
            Some(Base::Linear(tuple)) => Some(self.side(tuple, draw.reflection_scale, stream)?),
            _ => None,
        };
        let example = draw
            .example(layering, front, back, self.settings.crop_px, &mut noise)
            .map_err(|e| ExampleError::None(format!("an example cannot pass through JPEG: {e}")))?;
        Ok(example.into())
    }

    /// Draws one of the first `others` scenes that are not at `index`, or the next one that has a tuple. The first scene
    /// of a farm that still renders has none before it, and takes the second.
    fn other_scene(
        &self,
        index: usize,
        others: usize,
        stream: &mut Stream,
    ) -> Result<Option<Arc<Base>>, ExampleError> {
        let others = others.max(1).min(self.scenes.len() - 1);
        if others == 0 {
            return Ok(None);
        }
        let first = stream.below(others);
        for further in 0..others {
            let other = (first + further) % others;
            let other = other + usize::from(other >= index);
            if let Some(base) = self.scene(other)? {
                return Ok(Some(base));
            }
        }
        Ok(None)
    }

    /// Draws the crop of a tuple: `scale` times the side of the example, if the tuple is large enough.
    fn side<'a>(
        &self,
        tuple: &'a LinearTuple,
        scale: f64,
        stream: &mut Stream,
    ) -> Result<Side<'a>, ExampleError> {
        let (rows, columns, crop_px) = (tuple.rows, tuple.columns, self.settings.crop_px);
        let wanted = (crop_px as f64 * scale).round() as usize;
        let size = wanted.min(rows.min(columns)).max(crop_px);
        let cut = Cut::draw(rows, columns, size, self.settings.flip, stream);
        Ok(Side { tuple, cut: cut.ok_or_else(|| too_small(rows, columns, crop_px))? })
    }
}
