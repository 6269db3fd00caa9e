//! Measures a training step and its parts.

use crate::run::process_cpu_s;
use std::time::Instant;
use train::candle_core::{Device, Result, Tensor};
use train::{Batch, FeatureSource, Learner, Stage, Stream, TrainSettings, Vgg};

#[derive(Clone, Debug)]
pub struct TrainStep {
    /// User and system time of all threads, s.
    pub cpu_s: f64,
    pub wall_s: f64,
    /// Names and CPU seconds of the parts, in order; names may repeat.
    pub parts: Vec<(&'static str, f64)>,
    /// Loss of the generators.
    pub loss: f32,
}

/// The networks of the separation stage, and the batch of the measured steps.
pub struct TrainBench {
    learner: Learner,
    batch: Batch,
}

impl TrainBench {
    /// Creates SP-net, BT-net, random images and, if enabled, a random VGG-19 and a discriminator, which always learns.
    pub fn new(settings: &TrainSettings, size_px: usize) -> Result<Self> {
        let settings = TrainSettings { discriminator_every: 1, ..settings.clone() };
        let vgg = match settings.features {
            FeatureSource::None => None,
            _ => Some(Vgg::random(settings.seed, settings.vgg_divisor)?),
        };
        let mut stream = Stream::new(settings.seed, "bench images");
        let mut image = || -> Result<Tensor> {
            let shape = (settings.batch, 3, size_px, size_px);
            let count = settings.batch * 3 * size_px * size_px;
            let values: Vec<f32> = (0..count).map(|_| stream.unit() as f32).collect();
            Tensor::from_vec(values, shape, &Device::Cpu)
        };
        Ok(Self {
            batch: Batch {
                input: image()?,
                transmission: image()?,
                glass_reflection: Some(image()?),
                clean_reflection: Some(image()?),
            },
            learner: Learner::new(Stage::Separation, &settings, vgg)?,
        })
    }

    /// Returns the number of trainable weights, without those of VGG.
    pub fn parameters(&self) -> usize {
        self.learner.parameters()
    }

    pub fn step(&mut self) -> Result<TrainStep> {
        let (wall, cpu) = (Instant::now(), process_cpu_s());
        let mut parts = Vec::new();
        let mut last = cpu;
        let losses = self.learner.step(0, &self.batch, &mut |part| {
            let now = process_cpu_s();
            parts.push((part, now - last));
            last = now;
        })?;
        Ok(TrainStep {
            cpu_s: process_cpu_s() - cpu,
            wall_s: wall.elapsed().as_secs_f64(),
            parts,
            loss: losses.total,
        })
    }
}
