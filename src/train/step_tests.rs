//! Tests steps of the separation stage, in part against PyTorch in double precision (`tests/train/step.py`).

use super::*;
use candle_core::{Device, Tensor, Var};
use std::collections::HashMap;

/// Network widths in the script, which divides VGG's widths by `DIVISOR`.
const DIVISOR: usize = 32;
const WIDTH: usize = 6;
const DISCRIMINATOR_WIDTH: usize = 4;

struct Fixture(HashMap<String, Tensor>);

impl Fixture {
    fn read() -> Self {
        let bytes = include_bytes!("../../tests/train/step.safetensors");
        Self(candle_core::safetensors::load_buffer(bytes, &Device::Cpu).unwrap())
    }

    fn batch(&self) -> Batch {
        let image = |name: &str| self.0[&format!("image.{name}")].clone();
        Batch {
            input: image("input"),
            transmission: image("transmission"),
            glass_reflection: Some(image("glass_reflection")),
            clean_reflection: Some(image("clean_reflection")),
        }
    }

    fn learner(&self, slope: f32) -> Learner {
        let settings = TrainSettings {
            features: FeatureSource::File,
            width: WIDTH,
            discriminator_width: DISCRIMINATOR_WIDTH,
            ..TrainSettings::default()
        };
        let vgg = Vgg::new(&self.0, DIVISOR).unwrap();
        let learner = Learner::with_slope(Stage::Separation, &settings, Some(vgg), slope);
        let learner = learner.unwrap();
        for (name, variable) in learner.variables() {
            variable.set(&self.0[&name]).unwrap();
        }
        learner
    }

    fn numbers(&self, name: &str) -> Vec<f32> {
        self.0[name].flatten_all().unwrap().to_vec1().unwrap()
    }
}

fn off(found: &Tensor, expected: &[f32]) -> f64 {
    let found: Vec<f32> = found.flatten_all().unwrap().to_vec1().unwrap();
    let square = |a: f64| a * a;
    let pairs = found.iter().zip(expected);
    let difference: f64 = pairs.map(|(a, b)| square(f64::from(a - b))).sum();
    let length: f64 = expected.iter().map(|b| square(f64::from(*b))).sum();
    (difference / length).sqrt()
}

#[test]
fn gradients_of_the_whole_step_equal_pytorch() {
    let fixture = Fixture::read();
    let learner = fixture.learner(1.0);
    let (loss, gradients) = learner.gradients(&fixture.batch()).unwrap();
    let worst = off(&loss, &fixture.numbers("loss.linear"));
    assert!(worst < 1e-5, "loss: {worst}");
    let mut compared = 0;
    for moments in &learner.generator_adam.moments {
        let name = &moments.name;
        let gradient = gradients.get(&moments.variable);
        let gradient = gradient.unwrap_or_else(|| panic!("{name} has no gradient"));
        let worst = off(gradient, &fixture.numbers(&format!("gradient.{name}")));
        assert!(worst < 1e-5, "{name}: {worst}");
        compared += 1;
    }
    let expected = fixture.0.keys().filter(|k| k.starts_with("gradient.")).count();
    assert_eq!(compared, expected);
    // The generator's loss has no gradients for the frozen discriminator.
    let discriminator = learner.discriminator.as_ref().unwrap();
    let judged: Vec<Var> = discriminator.variables().into_iter().map(|(_, v)| v).collect();
    assert!(judged.iter().all(|v| gradients.get(v).is_none()));
}

#[test]
fn the_loss_and_five_steps_of_adam_equal_pytorch() {
    let fixture = Fixture::read();
    let mut learner = fixture.learner(SLOPE);
    let batch = fixture.batch();
    let (loss, _) = learner.gradients(&batch).unwrap();
    let worst = off(&loss, &fixture.numbers("loss.leaky"));
    assert!(worst < 1e-5, "loss: {worst}");
    let mut told = fixture.numbers("discriminator_losses").into_iter();
    for (step, expected) in (0..).zip(fixture.numbers("losses")) {
        let losses = learner.step(step, &batch, &mut |_| {}).unwrap();
        let worst = (losses.total / expected - 1.0).abs();
        assert!(worst < 1e-5, "step {step}: {worst}");
        let terms: f32 = losses.terms.iter().map(|term| term.value).sum();
        assert!((terms / losses.total - 1.0).abs() < 1e-5);
        assert_eq!(losses.discriminator.is_some(), step % 2 == 0, "step {step}");
        if let Some(loss) = losses.discriminator {
            let worst = (loss / told.next().unwrap() - 1.0).abs();
            assert!(worst < 1e-5, "step {step}, discriminator: {worst}");
        }
    }
}

fn bt_net(learner: &Learner) -> Vec<(String, Var)> {
    learner.backtrack.as_ref().unwrap().variables()
}

#[test]
fn bt_net_does_not_change_without_the_a_priori_loss() {
    let fixture = Fixture::read();
    let mut settings = TrainSettings {
        width: 4,
        discriminator_width: 2,
        a_priori: false,
        ..TrainSettings::default()
    };
    let step = |settings: &TrainSettings| {
        let mut learner = Learner::new(Stage::Separation, settings, None).unwrap();
        let before: Vec<Tensor> = bt_net(&learner).iter().map(|(_, v)| v.copy().unwrap()).collect();
        let losses = learner.step(0, &fixture.batch(), &mut |_| {}).unwrap();
        let after = bt_net(&learner);
        let same = before.iter().zip(&after).all(|(a, (_, b))| {
            let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            numbers(a) == numbers(b)
        });
        let names: Vec<&str> = losses.terms.iter().map(|term| term.name).collect();
        (same, names.join(" "))
    };
    let (same, names) = step(&settings);
    assert!(same);
    assert_eq!(names, "transmission_l1 glass_reflection_l1 adversarial");
    settings.a_priori = true;
    let (same, names) = step(&settings);
    assert!(!same);
    assert_eq!(names, "transmission_l1 glass_reflection_l1 clean_reflection_l1 adversarial");
}

/// Returns an image of sine waves.
fn waves(phase: f64, scale: f64) -> Vec<f32> {
    let value = |channel: usize, y: usize, x: usize| {
        let (x, y) = (x as f64 / 8.0, y as f64 / 11.0);
        0.5 + 0.45 * libm::sin(phase + x * (1.0 + channel as f64 * 0.3) + y * phase)
    };
    let planes = (0..3).flat_map(|c| (0..40).flat_map(move |y| (0..48).map(move |x| (c, y, x))));
    planes.map(|(c, y, x)| (scale * value(c, y, x)) as f32).collect()
}

#[test]
fn one_example_can_be_overfitted() {
    let (transmission, reflection) = (waves(0.4, 0.8), waves(2.1, 0.2));
    let sum = transmission.iter().zip(&reflection);
    let example = Example {
        rows: 40,
        columns: 48,
        input: sum.map(|(t, r)| 0.9 * t + r).collect(),
        clean_reflection: Some(waves(2.1, 1.0)),
        transmission,
        glass_reflection: Some(reflection),
    };
    let settings = TrainSettings {
        width: 8,
        discriminator_width: 2,
        learning_rate: 3e-3,
        ..TrainSettings::default()
    };
    let mut learner = Learner::new(Stage::Separation, &settings, None).unwrap();
    let batch = Batch::new(std::slice::from_ref(&example)).unwrap();
    let mut term = |step| {
        let losses = learner.step(step, &batch, &mut |_| {}).unwrap();
        losses.terms.iter().find(|t| t.name == "transmission_l1").unwrap().value
    };
    let first = term(0);
    let last = (1..400).map(term).collect::<Vec<_>>()[390..].iter().sum::<f32>() / 9.0;
    let input = example.input.iter().zip(&example.transmission);
    let unprocessed = input.map(|(a, b)| (a - b).abs()).sum::<f32>() / example.input.len() as f32;
    assert!(last < 0.3 * unprocessed, "error: {first}, then {last}; of the input: {unprocessed}");
}
