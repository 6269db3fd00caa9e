//! Measures the composition of examples, by part.

use super::clock::{cpu_s, median};
use compose::{
    Composition, Cut, Draw, Layer, Layering, LinearTuple, Shot, Side, Stream, TupleLayers,
};
use plan::SensorRecipe;
use std::thread::ScopedJoinHandle;
use std::time::Instant;

/// Waves of the synthetic pictures.
const WAVES: usize = 12;

/// Tuples in memory, from which the benchmark composes examples.
pub struct CompositionBench {
    tuples: Vec<LinearTuple>,
    settings: Composition,
    size_px: usize,
}

/// Speed of the examples up to a stage.
#[derive(Clone, Debug, serde::Serialize)]
pub struct CompositionRow {
    /// Last stage of the examples.
    pub up_to: &'static str,
    /// Median CPU seconds of an example on one thread.
    pub cpu_seconds: f64,
    pub examples_per_core_second: f64,
}

/// Speed of the camera on one thread: medians over sensors.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct CameraTimes {
    pub stages: Vec<CameraStage>,
    /// CPU seconds of the input with noise, and of T and R~ without: all stages, without JPEG.
    pub three_layers_cpu_seconds: f64,
}

/// Speed of a stage of the camera.
#[derive(Clone, Debug, serde::Serialize)]
pub struct CameraStage {
    pub stage: &'static str,
    pub us_per_megapixel: f64,
}

impl CompositionBench {
    /// Makes four tuples of `size_px` px: smooth pictures with a few edges.
    pub fn new(size_px: usize, settings: &Composition) -> Self {
        let tuples = (0..4).filter_map(|seed| tuple(seed, size_px)).collect();
        Self { tuples, settings: settings.clone(), size_px }
    }

    /// Measures `count` examples up to each stage. All stages draw the same numbers.
    pub fn rows(&self, count: u64) -> Vec<CompositionRow> {
        let of = |up_to, change: &dyn Fn(&mut Composition), layering, is_linear| {
            let mut settings = self.settings.clone();
            settings.camera.enabled = true;
            settings.camera.jpeg_share = 0.0;
            change(&mut settings);
            let seconds: Vec<f64> = (0..count + 2)
                .map(|k| cpu_s(|| self.example(&settings, k, layering, is_linear)).1)
                .skip(2)
                .collect();
            let cpu_seconds = median(&seconds);
            CompositionRow { up_to, cpu_seconds, examples_per_core_second: 1.0 / cpu_seconds }
        };
        let rendered = Layering::Rendered;
        vec![
            of("linear light", &|_| (), rendered, true),
            of("codes, without camera", &|c| c.camera.enabled = false, rendered, false),
            of("camera without JPEG", &|_| (), rendered, false),
            of("camera with JPEG", &|c| c.camera.jpeg_share = 1.0, rendered, false),
            self.sensor_row("calibrated sensor without JPEG", count, false),
            self.sensor_row("calibrated sensor with JPEG", count, true),
            of("linear mixture, camera without JPEG", &|_| (), Layering::LinearMixture, false),
            of("Zhang's mixture, camera without JPEG", &|_| (), Layering::ZhangMixture, false),
            of("CEILNet's mixture, camera without JPEG", &|_| (), Layering::CeilnetMixture, false),
        ]
    }

    /// Measures examples behind a calibrated sensor.
    fn sensor_row(&self, up_to: &'static str, count: u64, has_jpeg: bool) -> CompositionRow {
        let recipe = SensorRecipe::default();
        let one = |k: u64| {
            let mut stream = Stream::new(k, "composition");
            let sensor = recipe.draw_for(2020, &format!("example {k}"));
            let draw = Draw::new(&self.settings, &mut stream).with_sensor(sensor, k);
            if has_jpeg {
                self.compose(&draw, k, Layering::Rendered, false, &mut stream);
            } else if let Some(sensor) = &draw.sensor {
                let (front, other) = self.sides(&draw, k, Layering::Rendered);
                let linear = draw.linear(Layering::Rendered, front, other, self.size_px);
                std::hint::black_box(sensor.before_jpeg(linear, self.size_px, false));
            }
        };
        let seconds: Vec<f64> = (0..count + 2).map(|k| cpu_s(|| one(k)).1).skip(2).collect();
        let cpu_seconds = median(&seconds);
        let examples_per_core_second = 1.0 / cpu_seconds;
        CompositionRow { up_to, cpu_seconds, examples_per_core_second }
    }

    /// Measures `count` photographs of a tuple by each calibrated sensor, stage by stage.
    pub fn camera(&self, count: u64) -> CameraTimes {
        let size = [self.size_px; 2];
        let Some(tuple) = self.tuples.first() else { return CameraTimes::default() };
        let layer = |layer: &Layer| -> Vec<f32> { layer.planes() };
        let layers = [&tuple.input, &tuple.transmission, &tuple.glass_reflection].map(layer);
        let recipe = SensorRecipe::default();
        let mut seconds: [Vec<f64>; 7] = Default::default();
        for k in 0..count + 2 {
            let sensor = recipe.draw_for(2020, &format!("photograph {k}"));
            let (shot, meter) = cpu_s(|| Shot::new(&sensor, &layers[0], size));
            let (light, photosites) = cpu_s(|| shot.light_of_photosites(&layers[0]));
            let (numbers, expose) = cpu_s(|| shot.expose_light(&light, k));
            let (mut planes, demosaic) = cpu_s(|| shot.demosaic(&light));
            let ((), render) = cpu_s(|| shot.render(&mut planes));
            let (_, finish) = cpu_s(|| shot.finish(planes));
            let (_, chain) = cpu_s(|| {
                let shot = Shot::new(&sensor, &layers[0], size);
                let photo = shot.develop(&shot.expose(&layers[0], k));
                std::hint::black_box([
                    photo,
                    shot.noiseless(&layers[1]),
                    shot.noiseless(&layers[2]),
                ])
            });
            std::hint::black_box(&numbers);
            if k >= 2 {
                let all = [meter, photosites, expose, demosaic, render, finish, chain];
                seconds.iter_mut().zip(all).for_each(|(list, one)| list.push(one));
            }
        }
        let [meter, photosites, expose, demosaic, render, finish, chain] =
            seconds.map(|list| median(&list));
        let megapixels = (self.size_px * self.size_px) as f64 / 1e6;
        let of = |stage, seconds: f64| CameraStage {
            stage,
            us_per_megapixel: 1e6 * seconds / megapixels,
        };
        CameraTimes {
            stages: vec![
                of("meter, matrices and curve, once a tuple", meter),
                of("blur, matrix, mosaic", photosites),
                of("photons, noise, converter, the input alone", expose),
                of("demosaic", demosaic),
                of("white balance, matrix, curve", render),
                of("sharpen", finish),
            ],
            three_layers_cpu_seconds: chain,
        }
    }

    /// Composes `count` examples on several threads, with the settings as they are. Returns examples per second of wall
    /// time, and CPU seconds of an example.
    pub fn on_threads(&self, count: u64, threads: usize) -> [f64; 2] {
        let clock = Instant::now();
        let work = |thread: u64| {
            cpu_s(|| {
                for k in (thread..count).step_by(threads) {
                    self.example(&self.settings, k, Layering::Rendered, false);
                }
            })
            .1
        };
        let work = &work;
        let cpu_seconds: f64 = std::thread::scope(|scope| {
            let started: Vec<_> =
                (0..threads as u64).map(|thread| scope.spawn(move || work(thread))).collect();
            let ended = started.into_iter().map(ScopedJoinHandle::join);
            ended.map(|seconds| seconds.expect("no example panics")).sum()
        });
        [count as f64 / clock.elapsed().as_secs_f64(), cpu_seconds / count as f64]
    }

    fn example(&self, settings: &Composition, k: u64, layering: Layering, is_linear: bool) {
        let mut stream = Stream::new(k, "composition");
        let draw = Draw::new(settings, &mut stream);
        self.compose(&draw, k, layering, is_linear, &mut stream);
    }

    fn compose(
        &self,
        draw: &Draw,
        k: u64,
        layering: Layering,
        is_linear: bool,
        stream: &mut Stream,
    ) {
        let (front, other) = self.sides(draw, k, layering);
        if is_linear {
            std::hint::black_box(draw.linear(layering, front, other, self.size_px));
        } else {
            let made = draw.example(layering, front, other, self.size_px, stream);
            let _ = std::hint::black_box(made);
        }
    }
}

impl CompositionBench {
    /// Returns the crops of front and reflection of an example.
    fn sides(&self, draw: &Draw, k: u64, layering: Layering) -> (Side<'_>, Option<Side<'_>>) {
        let cut = Cut { row: 0, column: 0, size: self.size_px, mirrored: k.is_multiple_of(2) };
        let side = |at: usize| Side { tuple: &self.tuples[at % self.tuples.len()], cut };
        let (front, other) = (side(k as usize), side(k as usize + 1));
        (front, (draw.is_other || layering.is_mixture()).then_some(other))
    }
}

/// Makes a tuple whose pane passes 0.9 of the front and reflects a fifth of the back.
fn tuple(seed: u64, size_px: usize) -> Option<LinearTuple> {
    let mut stream = Stream::new(seed, "bench tuple");
    let [front, back] = [(); 2].map(|()| picture(size_px, &mut stream));
    let share = |picture: &[[f32; 3]], share: f32| -> Vec<[f32; 3]> {
        picture.iter().map(|pixel| pixel.map(|v| share * v)).collect()
    };
    let reflection = share(&back, 0.2);
    let input: Vec<[f32; 3]> = share(&front, 0.9)
        .iter()
        .zip(&reflection)
        .map(|(f, r)| [f[0] + r[0], f[1] + r[1], f[2] + r[2]])
        .collect();
    let layer = |pixels: &[[f32; 3]]| Layer::of_pixels(&halved(pixels));
    let layers = TupleLayers {
        input: layer(&input),
        transmission: layer(&front),
        glass_reflection: layer(&reflection),
        clean_reflection: Some(layer(&back)),
        coverage: None,
    };
    LinearTuple::new(size_px, size_px, layers)
}

/// Clears the 13 bits of the mantissa that half floats lack.
fn halved(pixels: &[[f32; 3]]) -> Vec<[f32; 3]> {
    pixels.iter().map(|pixel| pixel.map(|v| f32::from_bits(v.to_bits() & !0x1fff))).collect()
}

/// Makes a picture of sine waves and square waves.
fn picture(size_px: usize, stream: &mut Stream) -> Vec<[f32; 3]> {
    let waves: Vec<[f64; 4]> = (0..WAVES)
        .map(|_| {
            let [a, b] = [(); 2].map(|()| stream.uniform([-20.0, 20.0]) / size_px as f64);
            [a, b, stream.uniform([0.0, 6.0]), stream.uniform([0.02, 0.1])]
        })
        .collect();
    let pixel = |at: usize| {
        let (y, x) = ((at / size_px) as f64, (at % size_px) as f64);
        [0, 1, 2].map(|channel| {
            let light = waves.iter().enumerate().map(|(k, [a, b, phase, size])| {
                let wave = libm::sin(a * x + b * y + phase + 0.2 * f64::from(channel));
                size * (1.0 + if k % 3 == 0 { wave.signum() } else { wave })
            });
            // Half floats below 2^-14 have fewer bits.
            (light.sum::<f64>() as f32).max(1e-3)
        })
    };
    (0..size_px * size_px).map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_is_measured_and_tuples_are_halves() {
        let bench = CompositionBench::new(32, &Composition::default());
        assert_eq!(bench.tuples.len(), 4);
        assert!(bench.tuples.iter().all(|tuple| matches!(tuple.input, Layer::Halves(_))));
        let rows = bench.rows(3);
        assert_eq!(rows.len(), 9);
        assert!(rows.iter().all(|row| row.cpu_seconds > 0.0), "{rows:?}");
        let camera = bench.camera(3);
        assert_eq!(camera.stages.len(), 6);
        assert!(camera.three_layers_cpu_seconds > 0.0, "{camera:?}");
        assert!(bench.on_threads(4, 2).iter().all(|value| *value > 0.0));
    }
}
