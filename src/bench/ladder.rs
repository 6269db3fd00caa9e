//! Renders at several sample counts (rungs) with every variant of sampling, and compares the images with a reference.

use super::deviation::Deviation;
use super::error::BenchError;
use super::fit::{Slope, log_log_slope};
use super::reference::Reference;
use super::render::{Work, render};
use super::scenes::BenchScene;
use glasshouse_line::layer::Layer;
use glasshouse_line::{LayerSet, SceneLine};
use render::trace::Sampling;
use serde::Serialize;

/// A variant of sampling.
#[derive(Clone, Copy)]
pub struct Variant {
    pub name: &'static str,
    pub title: &'static str,
    pub sampling: Sampling,
    /// Function that returns the scene line for one rung of the ladder.
    pub line: fn(&SceneLine, u32) -> SceneLine,
}

/// All variants, in the order of rendering and output.
pub const VARIANTS: [Variant; 3] = [
    Variant {
        name: "sobol",
        title: "Sobol, the same number for every pixel",
        sampling: Sampling::Sobol,
        line: with_samples,
    },
    Variant {
        name: "independent",
        title: "independent samples",
        sampling: Sampling::Independent,
        line: with_samples,
    },
    Variant {
        name: "adaptive",
        title: "Sobol, each cell until its error is below a target",
        sampling: Sampling::Sobol,
        line: with_target,
    },
];

/// Returns the line with all layers and `spp` samples for every pixel.
fn with_samples(line: &SceneLine, spp: u32) -> SceneLine {
    let mut line = line.clone();
    line.film.spp = spp;
    line.film.target_error = None;
    line.film.layers = LayerSet::default();
    line
}

/// Returns the line with a target error: the higher the rung, the lower the target. With this factor, rungs 1 to 1024
/// of the built-in pair take 0.4 to 1.2 times the CPU time of the same rungs of the Sobol variant (docs/benchmarks.md).
fn with_target(line: &SceneLine, rung: u32) -> SceneLine {
    let mut line = with_samples(line, MOST_SAMPLES);
    line.film.target_error = Some(0.03 / f64::from(rung).sqrt());
    line
}

/// Maximum number of samples per pixel in an adaptive rendering.
const MOST_SAMPLES: u32 = 65_536;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ladder {
    /// Samples per pixel, ascending powers of two.
    pub spp: Vec<u32>,
    /// Number of consecutive seeds, starting at the scene's. Errors are averages over the seeds.
    pub seeds: u32,
}

impl Ladder {
    /// Counts the camera samples of the whole ladder for all variants on a film of `pixels` px, for the progress.
    pub fn samples(&self, pixels: u64) -> u64 {
        let once: u64 = self.spp.iter().map(|&n| u64::from(n)).sum();
        once * u64::from(self.seeds) * pixels * VARIANTS.len() as u64
    }
}

/// Errors of one layer on one rung of a variant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LayerRow {
    pub variant: &'static str,
    pub layer: &'static str,
    /// The rung: requested samples per pixel.
    pub spp: u32,
    /// Samples per pixel of the layer (fewer for thinned layers); for adaptive sampling, the mean over the film.
    pub samples: f64,
    /// CPU seconds of the tracer for all four layers; the median over seeds and repetitions of short renderings.
    pub cpu_s: f64,
    #[serde(flatten)]
    pub deviation: Deviation,
    /// Stated RMS error of the tuples; `null` with one sample.
    pub stated_rmse: Option<f64>,
    pub stated_over_true: Option<f64>,
}

/// CPU time below which a rendering is timed again, s, and number of repetitions.
const SHORT_S: f64 = 0.25;
const MORE_TIMINGS: usize = 4;

/// Renders the whole ladder. Returns rows by variant, rung and layer, or `None` if the work was stopped.
pub fn climb(
    scene: &BenchScene,
    ladder: &Ladder,
    reference: &Reference,
    work: &Work,
) -> Result<Option<Vec<LayerRow>>, BenchError> {
    let mut rows = Vec::new();
    // Warm-up: the first rendering of a process also allocates its memory.
    let first = (VARIANTS[0].line)(&scene.line, 1);
    let uncounted = Work { on_samples: &|_| {}, ..*work };
    if render(scene, &first, VARIANTS[0].sampling, &uncounted)?.is_none() {
        return Ok(None);
    }
    for variant in VARIANTS {
        for &spp in &ladder.spp {
            let mut seconds = Vec::new();
            let mut deviations = Layer::NAMES.map(|_| Vec::new());
            let mut stated = Layer::NAMES.map(|_| Vec::new());
            let mut samples = Layer::NAMES.map(|_| 0.0);
            for seed in 0..ladder.seeds {
                let mut line = (variant.line)(&scene.line, spp);
                line.seed = line.seed.wrapping_add(u64::from(seed));
                // Progress counts an adaptive rung as its nominal sample count.
                let on_samples = |count: u64| {
                    (work.on_samples)(count / u64::from(line.film.spp) * u64::from(spp));
                };
                let counted = Work { on_samples: &on_samples, ..*work };
                let Some(rendering) = render(scene, &line, variant.sampling, &counted)? else {
                    return Ok(None);
                };
                seconds.push(rendering.cpu_s);
                if rendering.cpu_s < SHORT_S {
                    for _ in 0..MORE_TIMINGS {
                        let Some(again) = render(scene, &line, variant.sampling, &uncounted)?
                        else {
                            return Ok(None);
                        };
                        seconds.push(again.cpu_s);
                    }
                }
                for (k, layer) in Layer::ALL.into_iter().enumerate() {
                    let record = &rendering.tuple.record.layers[layer.name()];
                    deviations[k].push(Deviation::between(
                        &rendering.tuple.layers[layer],
                        &reference.layers[layer],
                        line.film.width as usize,
                    ));
                    stated[k].extend(record.error_rms);
                    samples[k] = record.mean_samples.unwrap_or(f64::from(record.samples));
                }
            }
            let (cpu_s, _) = super::clock::median_and_best(&seconds);
            for (k, layer) in Layer::NAMES.into_iter().enumerate() {
                let deviation = Deviation::over_seeds(&deviations[k]);
                let square: f64 = stated[k].iter().map(|s| s * s).sum();
                let stated_rmse =
                    (!stated[k].is_empty()).then(|| (square / stated[k].len() as f64).sqrt());
                rows.push(LayerRow {
                    variant: variant.name,
                    layer,
                    spp,
                    samples: samples[k],
                    cpu_s,
                    deviation,
                    stated_rmse,
                    stated_over_true: stated_rmse
                        .filter(|_| deviation.rmse > 0.0)
                        .map(|s| s / deviation.rmse),
                });
            }
        }
    }
    Ok(Some(rows))
}

/// Least ratio of a fitted rung's RMSE to the reference's stated error.
const CLEAR_OF_REFERENCE: f64 = 3.0;

/// Least number of samples per pixel in the tail.
const TAIL_SAMPLES: f64 = 16.0;

/// Fits the slopes of RMSE against the layer's samples, by variant and layer. Omits rungs near the reference's error,
/// and layers in closed form, which have no samples.
pub fn slopes(rows: &[LayerRow], reference: &Reference) -> Vec<Slope> {
    let mut slopes = Vec::new();
    for variant in VARIANTS {
        for (k, layer) in Layer::NAMES.into_iter().enumerate() {
            let noise = reference.record.as_ref().and_then(|r| r.error_rms[k]);
            let floor = CLEAR_OF_REFERENCE * noise.unwrap_or(0.0);
            let points: Vec<(f64, f64)> = rows
                .iter()
                .filter(|row| row.variant == variant.name && row.layer == layer)
                .map(|row| (row.samples, row.deviation.rmse))
                .filter(|(samples, rmse)| *samples > 0.0 && *rmse >= floor)
                .collect();
            let tail: Vec<(f64, f64)> =
                points.iter().copied().filter(|(samples, _)| *samples >= TAIL_SAMPLES).collect();
            slopes.push(Slope {
                variant: variant.name,
                layer,
                slope: log_log_slope(&points),
                rungs: points.len(),
                tail_slope: log_log_slope(&tail),
            });
        }
    }
    slopes
}
