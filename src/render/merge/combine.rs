//! Partials are combined in a fixed order, weighted by their sample counts, and gaps are refused.

use super::moves::{Moves, SMOOTH, SMOOTH_OF_STOPPED};
use super::noise::NoiseMap;
use super::tuple::{LayerRecord, TUPLE_SCHEMA, Tuple, TupleRecord, layer_digest};
use super::write::{halved, is_half};
use crate::line::SceneLine;
use crate::partial::Partial;
use crate::shard::{ShardLayout, scene_digest};
use crate::trace::{LAYERS, TRACER_VERSION};
use std::borrow::Borrow;
use std::collections::BTreeMap;

/// Why partials do not make a tuple.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// Shards are missing.
    #[error("scene {scene}: {} of {total} shards are missing (first: {}); trace them with `work`, then merge again", missing.len(), missing[0])]
    Gaps {
        /// The scene.
        scene: String,
        /// Their numbers.
        missing: Vec<u32>,
        /// All shards.
        total: u32,
    },
    /// A partial belongs to something else.
    #[error("scene {scene}: shard {shard} {reason}; delete that partial and run `work` again")]
    Foreign {
        /// The scene.
        scene: String,
        /// The shard.
        shard: u32,
        /// Why it does not belong.
        reason: &'static str,
    },
    /// A pixel is not a number.
    #[error(
        "scene {scene}: layer {layer} is not finite at pixel ({x}, {y}); check the inputs' radiance and depth"
    )]
    NotFinite {
        /// The scene.
        scene: String,
        /// The layer.
        layer: &'static str,
        /// Pixel.
        x: u32,
        /// Pixel.
        y: u32,
    },
}

/// Combines all partials of a scene, one for each shard of the layout, in any order.
pub fn combine<P: Borrow<Partial>>(
    line: &SceneLine,
    tile_px: u32,
    partials: &[P],
) -> Result<Tuple, MergeError> {
    let scene = || line.id.to_string();
    let layout = ShardLayout::of(line, tile_px);
    let partials = partials.iter().map(Borrow::borrow);
    let by_shard: BTreeMap<u32, &Partial> = partials.map(|p| (p.header.shard, p)).collect();
    let missing: Vec<u32> = (0..layout.len())
        .filter(|index| !by_shard.contains_key(index))
        .collect();
    if !missing.is_empty() {
        return Err(MergeError::Gaps {
            scene: scene(),
            missing,
            total: layout.len(),
        });
    }
    let digest = scene_digest(line);
    let first = &by_shard[&0].header;
    for shard in layout.shards() {
        let header = &by_shard[&shard.index].header;
        let foreign = |reason| {
            Err(MergeError::Foreign {
                scene: scene(),
                shard: shard.index,
                reason,
            })
        };
        if header.line_blake3 != digest || header.scene != line.id {
            return foreign("belongs to another scene line");
        }
        if header.tracer_version != TRACER_VERSION {
            return foreign("was made by another version of the tracer");
        }
        if header.tile != shard.tile || header.samples != [shard.samples.start, shard.samples.end] {
            return foreign("covers another tile or sample range");
        }
        if header.inputs != first.inputs || header.facts != first.facts {
            return foreign("was made from other input files than shard 0");
        }
    }

    let (width, height) = (line.film.width as usize, line.film.height as usize);
    let asked = line.film.layers.asked();
    let mut layers = asked.map(|asked| vec![[0f32; 3]; width * height * usize::from(asked)]);
    // Values for each pixel, so that they are added row by row whatever the tile.
    let mut moves = asked.map(|asked| Moves::new(width * height * usize::from(asked)));
    let (mut paths, mut misses, mut samples) = ([0u64; 4], [0u64; 4], [0u32; 4]);
    let mut sample_sums: Option<[u64; 4]> = line.film.target_error.map(|_| [0; 4]);
    let ranges = layout.ranges();
    for tile_index in 0..layout.len() / ranges {
        let of_tile: Vec<&Partial> = (0..ranges)
            .map(|range| by_shard[&(tile_index * ranges + range)])
            .collect();
        let tile = of_tile[0].header.tile;
        for layer in (0..4).filter(|&layer| asked[layer]) {
            let counted: Vec<&Partial> = of_tile
                .iter()
                .copied()
                .filter(|p| p.header.layer_samples[layer] > 0)
                .collect();
            let total: u32 = counted.iter().map(|p| p.header.layer_samples[layer]).sum();
            samples[layer] = samples[layer].max(total);
            for q in 0..of_tile[0].pixels.len() {
                let x = tile.x as usize + q % tile.width as usize;
                let y = tile.y as usize + q / tile.width as usize;
                for c in 0..3 {
                    let [mean, half, quarter] = combine_value(&counted, layer, q, c, total);
                    if !mean.is_finite() {
                        return Err(MergeError::NotFinite {
                            scene: scene(),
                            layer: LAYERS[layer],
                            x: x as u32,
                            y: y as u32,
                        });
                    }
                    layers[layer][y * width + x][c] = mean as f32;
                    moves[layer].add(y * width + x, half - mean, quarter - half);
                }
            }
        }
        for partial in of_tile {
            for layer in 0..4 {
                paths[layer] += partial.header.paths[layer];
                misses[layer] += partial.header.misses[layer];
                if let (Some(sums), Some(of_shard)) = (&mut sample_sums, partial.header.sample_sums)
                {
                    sums[layer] += of_shard[layer];
                }
            }
        }
    }
    let pixels = (width * height) as f64;
    let half = is_half(line, &layers);
    let made = LAYERS.iter().enumerate().filter(|(k, _)| asked[*k]);
    let mut noise = NoiseMap::of(&line.film);
    let mut records = BTreeMap::new();
    for (k, name) in made {
        // R has no lens.
        let tail = if sample_sums.is_some() && k != 3 {
            SMOOTH_OF_STOPPED
        } else {
            SMOOTH
        };
        let error_rms = (samples[k] > 1).then(|| moves[k].rms_error(tail));
        let mut record = LayerRecord::new(&layers[k], samples[k], error_rms, paths[k], misses[k]);
        record.exr_blake3 = half.then(|| layer_digest(&halved(&layers[k])));
        record.mean_samples = sample_sums.map(|sums| sums[k] as f64 / pixels);
        if let Some(error_rms) = error_rms {
            noise.layers[k] = moves[k].map(width, error_rms);
        }
        records.insert((*name).to_owned(), record);
    }
    let record = TupleRecord {
        schema: TUPLE_SCHEMA.to_owned(),
        tracer_version: TRACER_VERSION,
        base: "../..".to_owned(),
        layers: records,
        facts: first.facts.clone(),
        inputs: first.inputs.clone(),
        scene: line.clone(),
    };
    Ok(Tuple {
        width: line.film.width,
        height: line.film.height,
        layers,
        record,
        noise,
    })
}

/// Means of all samples, of the first half and of the first quarter: from the ranges, or from within the only one.
fn combine_value(
    counted: &[&Partial],
    layer: usize,
    pixel: usize,
    colour: usize,
    total: u32,
) -> [f64; 3] {
    let of = |partial: &Partial| {
        let means = &partial.pixels[pixel];
        [means.mean, means.half, means.quarter].map(|part| f64::from(part[layer][colour]))
    };
    if let [only] = counted {
        return of(only);
    }
    let (mut sum, mut half, mut quarter) = (0.0, (0.0, 0u32), (0.0, 0u32));
    for (k, partial) in counted.iter().enumerate() {
        let count = partial.header.layer_samples[layer];
        let [mean, ..] = of(partial);
        sum += mean * f64::from(count);
        if k < counted.len() / 2 {
            half = (sum, half.1 + count);
        }
        if k < counted.len() / 4 {
            quarter = (sum, quarter.1 + count);
        }
    }
    let mean_of = |(sum, count): (f64, u32)| sum / f64::from(count.max(1));
    let quarter = match counted {
        // Two ranges: the first quarter is the first half of the first.
        [first, _] => of(first)[1],
        _ => mean_of(quarter),
    };
    [sum / f64::from(total), mean_of(half), quarter]
}
