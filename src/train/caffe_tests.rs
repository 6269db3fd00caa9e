//! Features in caffe's style against PyTorch in double precision (`tests/train/caffe.py`).

use super::*;
use candle_core::{Device, Tensor, Var};
use plan::FeatureStyle;
use std::collections::HashMap;

fn read(bytes: &[u8]) -> HashMap<String, Tensor> {
    candle_core::safetensors::load_buffer(bytes, &Device::Cpu).unwrap()
}

/// Returns the length of the difference of two tensors by that of the second.
fn off(found: &Tensor, expected: &Tensor) -> f64 {
    let numbers = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let (found, expected) = (numbers(found), numbers(expected));
    assert_eq!(found.len(), expected.len());
    let square = |v: f64| v * v;
    let difference: f64 = found.iter().zip(&expected).map(|(a, b)| square(f64::from(a - b))).sum();
    let length: f64 = expected.iter().map(|b| square(f64::from(*b))).sum();
    (difference / length).sqrt()
}

#[test]
fn features_in_caffes_style_equal_those_of_pytorch() {
    let given = read(include_bytes!("../../tests/train/step.safetensors"));
    let expected = read(include_bytes!("../../tests/train/caffe.safetensors"));
    let vgg = || Vgg::new(&given, 32).unwrap();
    let caffe = vgg().with_style(FeatureStyle::Caffe);
    let image = Var::from_tensor(&given["image.input"]).unwrap();
    let features = caffe.features(&image).unwrap();
    assert!(off(&features[4], &expected["conv5_2"]) < 1e-5);
    assert!(off(&vgg().features(&image).unwrap()[4], &expected["conv5_2"]) > 0.1);
    let truth = caffe.features(&given["image.transmission"]).unwrap();
    let loss = (feature_difference(&features, &truth).unwrap() * caffe.loss_factor()).unwrap();
    assert!(off(&loss.unsqueeze(0).unwrap(), &expected["loss"].reshape(1).unwrap()) < 1e-5);
    let gradients = loss.backward().unwrap();
    assert!(off(gradients.get(&image).unwrap(), &expected["gradient"]) < 1e-4);
}

#[test]
fn a_network_with_caffes_features_equals_that_of_pytorch() {
    let given = read(include_bytes!("../../tests/train/step.safetensors"));
    let expected = read(include_bytes!("../../tests/train/caffe.safetensors"));
    let settings = |feature_style| TrainSettings {
        features: FeatureSource::File,
        width: 6,
        discriminator_width: 4,
        feature_style,
        ..TrainSettings::default()
    };
    let made = |feature_style| {
        let vgg = Vgg::new(&given, 32).unwrap();
        let settings = settings(feature_style);
        let learner = Learner::new(Stage::Separation, &settings, Some(vgg)).unwrap();
        for (name, variable) in learner.variables() {
            variable.set(&given[&name]).unwrap();
        }
        let image = &given["image.input"];
        let features = learner.vgg.as_ref().unwrap().features(image).unwrap();
        let made = learner.separation.as_ref().unwrap().forward(image, &features).unwrap();
        Tensor::cat(&[&made.transmission, &made.glass_reflection.unwrap()], 1).unwrap()
    };
    assert!(off(&made(FeatureStyle::Caffe), &expected["made"]) < 1e-5);
    assert!(off(&made(FeatureStyle::Torch), &expected["made"]) > 0.01);
}
