//! Combines partials in a fixed order, weighted by their sample counts. Missing partials are an error.

use super::moves::{Moves, SMOOTH, SMOOTH_OF_STOPPED};
use super::noise::NoiseMap;
use super::photographs::PhotographRecord;
use super::tuple::{LabelRecord, LayerRecord, TUPLE_SCHEMA, Tuple, TupleRecord, layer_digest};
use super::write::{halved, is_half};
use crate::partial::Partial;
use crate::shard::{ShardLayout, scene_digest};
use crate::trace::TRACER_VERSION;
use glasshouse_line::SceneLine;
use glasshouse_line::label::{Label, LabelImages, reflected_share};
use glasshouse_line::layer::{Layer, PerLayer};
use std::borrow::Borrow;
use std::collections::BTreeMap;

/// Reason why partials cannot be combined.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    #[error("scene {scene}: {} of {total} shards are missing (first: {}); trace them with `work`, then merge again", missing.len(), missing[0])]
    Gaps { scene: String, missing: Vec<u32>, total: u32 },
    /// A partial of another scene, plan, tracer version or set of input files.
    #[error("scene {scene}: the partial of shard {shard} {reason}; delete it and run `work` again")]
    Foreign { scene: String, shard: u32, reason: &'static str },
    #[error(
        "scene {scene}: layer {layer} is not finite at pixel ({x}, {y}); check the inputs' radiance and depth"
    )]
    NotFinite { scene: String, layer: &'static str, x: u32, y: u32 },
}

/// Combines all partials of a scene. `partials` contains one for each shard of the layout, in any order.
pub fn combine<P: Borrow<Partial>>(
    line: &SceneLine,
    tile_px: u32,
    partials: &[P],
) -> Result<Tuple, MergeError> {
    let layout = ShardLayout::of(line, tile_px);
    let in_order = check_partials(line, &layout, partials.iter().map(Borrow::borrow))?;
    let mut combined = Combined::new(line);
    // The sample ranges of a tile are adjacent.
    for of_tile in in_order.chunks(layout.ranges() as usize) {
        combined.add_tile(line, of_tile)?;
    }
    Ok(combined.tuple(line, in_order[0]))
}

/// Returns the partials in the order of their shards, or an error if a partial is missing or foreign.
fn check_partials<'a>(
    line: &SceneLine,
    layout: &ShardLayout,
    partials: impl Iterator<Item = &'a Partial>,
) -> Result<Vec<&'a Partial>, MergeError> {
    let by_shard: BTreeMap<u32, &Partial> = partials.map(|p| (p.header.shard, p)).collect();
    let missing: Vec<u32> =
        (0..layout.len()).filter(|index| !by_shard.contains_key(index)).collect();
    if !missing.is_empty() {
        return Err(MergeError::Gaps { scene: line.id.to_string(), missing, total: layout.len() });
    }
    let digest = scene_digest(line);
    let first = &by_shard[&0].header;
    for shard in layout.shards() {
        let header = &by_shard[&shard.index].header;
        let foreign = |reason| {
            Err(MergeError::Foreign { scene: line.id.to_string(), shard: shard.index, reason })
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
    Ok((0..layout.len()).map(|index| by_shard[&index]).collect())
}

/// Images of the partials added so far.
struct Combined {
    layers: PerLayer<Vec<[f32; 3]>>,
    /// Moves of each pixel, which are later summed row by row, regardless of the tiles.
    moves: PerLayer<Moves>,
    samples: PerLayer<u32>,
    sample_sums: Option<PerLayer<u64>>,
    paths: PerLayer<u64>,
    misses: PerLayer<u64>,
    labels: LabelImages,
}

impl Combined {
    /// Makes black images of the layers that the line requests.
    fn new(line: &SceneLine) -> Self {
        let asked = line.film.layers.asked();
        let film_pixels = line.film.width as usize * line.film.height as usize;
        let pixels = |layer| film_pixels * usize::from(asked[layer]);
        Self {
            layers: PerLayer::of(|layer| vec![[0.0; 3]; pixels(layer)]),
            moves: PerLayer::of(|layer| Moves::new(pixels(layer))),
            samples: PerLayer::default(),
            sample_sums: line.film.target_error.map(|_| PerLayer::default()),
            paths: PerLayer::default(),
            misses: PerLayer::default(),
            labels: traced_labels(line)
                .map(|label| (label, vec![0.0; film_pixels * label.channels().len()]))
                .collect(),
        }
    }

    /// Adds the partials of one tile, in the order of their sample ranges.
    fn add_tile(&mut self, line: &SceneLine, of_tile: &[&Partial]) -> Result<(), MergeError> {
        let tile = of_tile[0].header.tile;
        let width = line.film.width as usize;
        for layer in line.film.layers.iter() {
            let counts =
                |p: &&Partial| p.header.layer_samples[layer] > 0 || p.header.is_closed_form(layer);
            let counted: Vec<&Partial> = of_tile.iter().copied().filter(counts).collect();
            let total: u32 = counted.iter().map(|p| p.header.layer_samples[layer]).sum();
            self.samples[layer] = self.samples[layer].max(total);
            for q in 0..of_tile[0].pixels.len() {
                let x = tile.x as usize + q % tile.width as usize;
                let y = tile.y as usize + q / tile.width as usize;
                for c in 0..3 {
                    let [mean, half, quarter] = combine_value(&counted, layer, q, c, total);
                    if !mean.is_finite() {
                        return Err(MergeError::NotFinite {
                            scene: line.id.to_string(),
                            layer: layer.name(),
                            x: x as u32,
                            y: y as u32,
                        });
                    }
                    self.layers[layer][y * width + x][c] = mean as f32;
                    self.moves[layer].add(y * width + x, half - mean, quarter - half);
                }
            }
        }
        for (label, image) in &mut self.labels {
            add_label(*label, image, line, of_tile)?;
        }
        for partial in of_tile {
            for layer in Layer::ALL {
                self.paths[layer] += partial.header.paths[layer];
                self.misses[layer] += partial.header.misses[layer];
                if let (Some(sums), Some(of_shard)) =
                    (&mut self.sample_sums, partial.header.sample_sums)
                {
                    sums[layer] += of_shard[layer];
                }
            }
        }
        Ok(())
    }

    /// Makes the tuple, with the stated errors and the digests of its layers.
    fn tuple(self, line: &SceneLine, first: &Partial) -> Tuple {
        let (width, height) = (line.film.width, line.film.height);
        let half = is_half(line, &self.layers);
        let mut noise = NoiseMap::of(&line.film);
        let mut records = BTreeMap::new();
        for layer in line.film.layers.iter() {
            let (pixels, samples) = (&self.layers[layer], self.samples[layer]);
            // All layers except R are seen through the lens and need the larger tail in adaptive scenes.
            let tail = if self.sample_sums.is_some() && layer != Layer::CleanReflection {
                SMOOTH_OF_STOPPED
            } else {
                SMOOTH
            };
            // A layer without samples is in closed form, so its error is 0.
            let error_rms = (samples != 1).then(|| self.moves[layer].rms_error(tail));
            let (paths, misses) = (self.paths[layer], self.misses[layer]);
            let mut record = LayerRecord::new(pixels, samples, error_rms, paths, misses);
            record.bound(layer, &first.header.facts);
            record.exr_blake3 = half.then(|| layer_digest(&halved(pixels)));
            let mean_samples = |sums: PerLayer<u64>| sums[layer] as f64 / pixels.len() as f64;
            record.mean_samples = self.sample_sums.map(mean_samples);
            if let Some(error_rms) = error_rms.filter(|_| samples > 0) {
                noise.layers[layer] = self.moves[layer].map(width as usize, error_rms);
            }
            records.insert(layer.name().to_owned(), record);
        }
        let mut labels = self.labels;
        if line.film.layers.labels().contains(Label::ReflectedShare) {
            let [input, _, glass_reflection, _] = &self.layers.0;
            labels.insert(Label::ReflectedShare, reflected_share(input, glass_reflection));
        }
        let of_label = |(label, values): (&Label, &Vec<f32>)| {
            (label.name().to_owned(), LabelRecord::new(*label, values, half))
        };
        let record = TupleRecord {
            schema: TUPLE_SCHEMA.to_owned(),
            tracer_version: TRACER_VERSION,
            // The files are encoded later.
            files: BTreeMap::new(),
            base: "../..".to_owned(),
            layers: records,
            labels: labels.iter().map(of_label).collect(),
            photographs: None,
            facts: first.header.facts.clone(),
            inputs: first.header.inputs.clone(),
            scene: line.clone(),
        };
        let mut tuple = Tuple { width, height, layers: self.layers, labels, record, noise };
        if let Some(sensor) = &line.sensor {
            let metered = PhotographRecord::new(sensor.exposure, &tuple.stored(Layer::Input));
            tuple.record.photographs = Some(metered);
        }
        tuple
    }
}

/// Returns the requested labels that partials have.
fn traced_labels(line: &SceneLine) -> impl Iterator<Item = Label> {
    line.film.layers.labels().iter().filter(|label| !label.is_derived())
}

/// Adds a label of one tile to its image. `of_tile` are the tile's partials in the order of their sample ranges.
fn add_label(
    label: Label,
    image: &mut [f32],
    line: &SceneLine,
    of_tile: &[&Partial],
) -> Result<(), MergeError> {
    let weight = |partial: &Partial| match label {
        Label::Ghosts => partial.header.layer_samples[Layer::GlassReflection],
        _ => partial.header.samples[1] - partial.header.samples[0],
    };
    // The depth needs no samples; the first range has it.
    let counted = if label == Label::FrontDepth { &of_tile[..1] } else { of_tile };
    let total: f64 = counted.iter().map(|partial| f64::from(weight(partial))).sum();
    let mut parts = vec![];
    for partial in counted {
        let Some(values) = partial.labels.get(&label) else {
            return Err(MergeError::Foreign {
                scene: line.id.to_string(),
                shard: partial.header.shard,
                reason: "lacks a label of the scene line",
            });
        };
        parts.push((values, f64::from(weight(partial)) / total));
    }
    let (tile, channels) = (of_tile[0].header.tile, label.channels().len());
    let row = tile.width as usize * channels;
    for y in 0..tile.height as usize {
        let start = ((tile.y as usize + y) * line.film.width as usize + tile.x as usize) * channels;
        for k in 0..row {
            let at = y * row + k;
            image[start + k] = match parts.as_slice() {
                [(only, _)] => only[at],
                parts => {
                    parts.iter().map(|(v, share)| f64::from(v[at]) * share).sum::<f64>() as f32
                }
            };
        }
    }
    Ok(())
}

/// Computes the means of all samples, of the first half and of the first quarter from one or more ranges.
fn combine_value(
    counted: &[&Partial],
    layer: Layer,
    pixel: usize,
    colour: usize,
    total: u32,
) -> [f64; 3] {
    let of = |partial: &Partial| {
        let means = &partial.pixels[pixel];
        [means.mean, means.half, means.quarter].map(|part| f64::from(part[layer as usize][colour]))
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
        // With two ranges, the first quarter is the first half of the first range.
        [first, _] => of(first)[1],
        _ => mean_of(quarter),
    };
    [sum / f64::from(total), mean_of(half), quarter]
}
