//! Checks a partial's numbers for sense. A digest proves that a file is as written, not that a tracer wrote it.

use super::Partial;
use glasshouse_line::layer::Layer;

impl Partial {
    /// Returns what no tracer writes: radiance that is negative or not finite, more misses than paths, or more samples
    /// than the range holds. Such a partial is traced again, like a damaged one.
    pub(super) fn nonsense(&self) -> Option<String> {
        let header = &self.header;
        let Some(range) = header.samples[1].checked_sub(header.samples[0]) else {
            return Some(format!("its samples end before they begin: {:?}", header.samples));
        };
        for layer in Layer::ALL {
            let (samples, paths, misses) =
                (header.layer_samples[layer], header.paths[layer], header.misses[layer]);
            if samples > range {
                return Some(format!("{layer} has {samples} samples in a range of {range}"));
            }
            if misses > paths {
                return Some(format!("{layer} has {misses} misses of {paths} paths"));
            }
            if let Some(sums) = header.sample_sums {
                let most = u64::from(samples) * self.pixels.len() as u64;
                if sums[layer] > most {
                    let sum = sums[layer];
                    return Some(format!("the samples of {layer} add up to {sum}, above {most}"));
                }
            }
        }
        // Depths may be infinite, but no label is negative.
        for (label, values) in &self.labels {
            let length = label.channels().len() * self.pixels.len();
            if values.len() != length || !values.iter().all(|value| *value >= 0.0) {
                return Some(format!("its {label} has values that are no {label}"));
            }
        }
        // The negated condition also finds NaN, because every comparison with NaN is false.
        let is_radiance = |v: &f32| *v >= 0.0 && *v < f32::INFINITY;
        let is_sound = |part: &[[f32; 3]; 4]| part.as_flattened().iter().all(is_radiance);
        let wrong = self.pixels.iter().position(|pixel| {
            ![&pixel.mean, &pixel.half, &pixel.quarter].into_iter().all(is_sound)
        })?;
        let (width, tile) = (header.tile.width.max(1), header.tile);
        let (x, y) = (tile.x + wrong as u32 % width, tile.y + wrong as u32 / width);
        Some(format!("its radiance at pixel ({x}, {y}) is negative or not finite"))
    }
}
