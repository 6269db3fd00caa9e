//! Properties of composed examples of synthetic tuples.

use super::code::srgb_code;
use super::layers::{channel_means, luminance};
use super::*;
use crate::Stream;
use proptest::prelude::*;

mod texture;

const SIDE: usize = 48;

const LAYERINGS: [Layering; 4] =
    [Layering::Rendered, Layering::LinearMixture, Layering::ZhangMixture, Layering::CeilnetMixture];

/// Makes a tuple of smooth noise. The pane passes 0.9 of the front, and reflects a tenth or more of the back.
fn tuple(seed: u64) -> LinearTuple {
    let mut stream = Stream::new(seed, "tuple");
    let mut picture = |level: f64| -> Vec<[f32; 3]> {
        let waves: Vec<[f64; 4]> = (0..6)
            .map(|_| {
                [
                    stream.uniform([-0.4, 0.4]),
                    stream.uniform([-0.4, 0.4]),
                    stream.unit(),
                    stream.unit(),
                ]
            })
            .collect();
        let pixel = |k: usize| {
            let (y, x) = ((k / SIDE) as f64, (k % SIDE) as f64);
            [0, 1, 2].map(|channel| {
                let light: f64 = waves
                    .iter()
                    .map(|[a, b, phase, size]| {
                        let wave = libm::sin(a * x + b * y + 6.0 * phase + 0.3 * channel as f64);
                        size * (wave + 1.0)
                    })
                    .sum();
                (level * light) as f32
            })
        };
        (0..SIDE * SIDE).map(pixel).collect()
    };
    let (transmission, clean) = (picture(0.2), picture(0.3));
    let share = stream.uniform([0.1, 0.6]) as f32;
    let reflection: Vec<[f32; 3]> = clean.iter().map(|p| p.map(|v| v * share)).collect();
    let input: Vec<[f32; 3]> = (0..SIDE * SIDE)
        .map(|k| [0, 1, 2].map(|c| 0.9 * transmission[k][c] + reflection[k][c]))
        .collect();
    // Tuples store half floats.
    let layer = |pixels: Vec<[f32; 3]>| {
        let halved = |v: f32| exr::prelude::f16::from_f32(v).to_f32();
        Layer::of_pixels(&pixels.iter().map(|p| p.map(halved)).collect::<Vec<_>>())
    };
    let layers = TupleLayers {
        input: layer(input),
        transmission: layer(transmission),
        glass_reflection: layer(reflection),
        clean_reflection: Some(layer(clean)),
        coverage: None,
    };
    LinearTuple::new(SIDE, SIDE, layers).unwrap()
}

fn whole(tuple: &LinearTuple) -> Side<'_> {
    Side { tuple, cut: Cut { row: 0, column: 0, size: SIDE, mirrored: false } }
}

/// The default settings, but targets have the front's own light.
fn own_light() -> Composition {
    Composition { target_light: TargetLight::WithoutPane, ..Composition::default() }
}

fn draw(settings: &Composition, seed: u64) -> Draw {
    Draw::new(settings, &mut Stream::new(seed, "composition 0"))
}

fn example(draw: &Draw, layering: Layering, front: Side, other: Option<Side>) -> ComposedExample {
    draw.example(layering, front, other, SIDE, &mut Stream::new(1, "camera noise 0")).unwrap()
}

fn luminance_of(planes: &[f32]) -> f64 {
    luminance(channel_means(planes))
}

/// Settings with the stated camera's effects alone.
fn only_camera(change: fn(&mut Camera)) -> Composition {
    let mut composition = Composition::off();
    composition.camera = Camera {
        enabled: true,
        blur_share: 0.0,
        shot_noise: [1e-9; 2],
        read_noise: [1e-9; 2],
        gamma_sigma: 0.0,
        s_curve: [0.0; 2],
        jpeg_share: 0.0,
        ..Camera::default()
    };
    change(&mut composition.camera);
    composition
}

#[test]
fn everything_off_is_the_tuple() {
    let tuple = tuple(3);
    let cut = Cut { row: 5, column: 9, size: 32, mirrored: true };
    let draw = draw(&Composition::off(), 4);
    let side = Side { tuple: &tuple, cut };
    let made = draw.example(Layering::Rendered, side, None, 32, &mut Stream::new(1, "n")).unwrap();
    let coded = |layer: &Layer| -> Vec<f32> {
        tuple.crop(layer, cut, 32).iter().map(|v| srgb_code(*v)).collect()
    };
    assert_eq!(made.input, coded(&tuple.input));
    assert_eq!(made.transmission, coded(&tuple.transmission));
    assert_eq!(made.glass_reflection, coded(&tuple.glass_reflection));
    assert_eq!(made.clean_reflection.unwrap(), coded(tuple.clean_reflection.as_ref().unwrap()));
    // The general path forms F and adds R~ to it, with the same bits before the codes.
    let linear = draw.linear(Layering::Rendered, side, None, 32);
    assert!(linear.input == tuple.crop(&tuple.input, cut, 32));
    assert!(linear.transmission == tuple.crop(&tuple.transmission, cut, 32));
}

/// The target's light is the front's through the pane, and nothing else changes.
#[test]
fn targets_have_the_light_behind_the_pane() {
    let (front, back) = (tuple(3), tuple(4));
    for layering in LAYERINGS {
        let settings = Composition::default();
        let made = |settings: &Composition| {
            draw(settings, 8).linear(layering, whole(&front), Some(whole(&back)), SIDE)
        };
        let (dimmed, full) = (made(&settings), made(&own_light()));
        assert!(dimmed.input == full.input && dimmed.glass_reflection == full.glass_reflection);
        let passed = if layering.is_mixture() { draw(&settings, 8).transmitted } else { 0.9 };
        let share = luminance_of(&dimmed.transmission) / luminance_of(&full.transmission);
        assert!((share - passed).abs() < 1e-3, "{layering:?}: {share} {passed}");
        let factor = dimmed.transmission[0] / full.transmission[0];
        for (target, before) in dimmed.transmission.iter().zip(&full.transmission) {
            assert!(
                (target - factor * before).abs() <= 1e-5 * before,
                "one factor for all channels"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// The input exceeds the front by the reflection, and every strength is the drawn one.
    #[test]
    fn light_adds(seed in 0u64..1_000_000, kind in 0usize..4) {
        let (front, back) = (tuple(seed), tuple(seed + 1));
        let layering = LAYERINGS[kind];
        let mixture = layering.is_mixture();
        let draw = draw(&own_light(), seed);
        let other = draw.is_other.then(|| whole(&back)).or(mixture.then(|| whole(&back)));
        let linear = draw.linear(layering, whole(&front), other, SIDE);
        let DrawnStrength::Ratio(strength) = draw.strength else { panic!("{draw:?}") };
        prop_assert!((linear.strength - strength).abs() < 1e-5 * strength.max(1e-3));
        let ahead: Vec<f32> =
            linear.input.iter().zip(&linear.glass_reflection).map(|(i, r)| i - r).collect();
        let measured = luminance_of(&linear.glass_reflection) / luminance_of(&ahead);
        match layering {
            Layering::ZhangMixture => prop_assert!(measured < strength + 1e-4, "{measured} {strength}"),
            Layering::CeilnetMixture => {}
            _ => prop_assert!((measured - strength).abs() < 1e-4, "{measured} {strength}"),
        }
        prop_assert!(linear.input.iter().zip(&linear.glass_reflection).all(|(i, r)| i >= r));
        // The pane, or the drawn factor of a mixture, passes a share of the target's light.
        let passed = if mixture { draw.transmitted } else { 0.9 };
        for (front, target) in ahead.iter().zip(&linear.transmission) {
            let expected = passed as f32 * target;
            prop_assert!((front - expected).abs() < 2e-3 * (1.0 + expected), "{front} {expected}");
        }
        if strength == 0.0 {
            prop_assert!(linear.glass_reflection.iter().all(|v| *v == 0.0));
        }
        // The exposure keeps the percentile's level and, where it can, the front's mean.
        let exposure = draw.exposure.unwrap();
        let mut brightest: Vec<f32> = (0..SIDE * SIDE)
            .map(|k| [0, 1, 2].map(|c| linear.input[c * SIDE * SIDE + k]).into_iter().fold(0.0, f32::max))
            .collect();
        brightest.sort_by(f32::total_cmp);
        let rank = (exposure.percentile / 100.0 * (brightest.len() - 1) as f64).round() as usize;
        let level = f64::from(brightest[rank]);
        prop_assert!((0.0999..=1.3001).contains(&level), "{level}");
        let mean = luminance_of(&ahead);
        prop_assert!(mean < 0.4001 || level < 0.1001, "{mean} {level}");
        prop_assert!(mean > 0.0299 || level > 1.2999, "{mean} {level}");
    }

    /// All codes are numbers from 0 to 1, and equal streams give equal bits.
    #[test]
    fn examples_are_codes_and_repeat(seed in 0u64..1_000_000) {
        let (front, back) = (tuple(seed), tuple(seed + 1));
        let draw = draw(&Composition::default(), seed);
        let cut = Cut { row: 1, column: 2, size: 40, mirrored: true };
        let other = Side { tuple: &back, cut };
        let make = || {
            let mut noise = Stream::new(seed, "camera noise 0");
            draw.example(Layering::Rendered, Side { tuple: &front, cut }, Some(other), 32, &mut noise)
        };
        let made = make().unwrap();
        prop_assert_eq!(&made, &make().unwrap());
        prop_assert_eq!(made.input.len(), 3 * 32 * 32);
        let layers = [&made.input, &made.transmission, &made.glass_reflection];
        let layers = layers.into_iter().chain(&made.clean_reflection);
        prop_assert!(layers.flatten().all(|v| (0.0..=1.0).contains(v)));
    }
}

#[test]
fn noise_and_jpeg_change_the_input_alone() {
    let front = tuple(7);
    let make =
        |change| example(&draw(&only_camera(change), 2), Layering::Rendered, whole(&front), None);
    let plain = make(|_| ());
    for change in [
        (|c| c.jpeg_share = 1.0) as fn(&mut Camera),
        |c| c.shot_noise = [1e-3; 2],
        |c| c.read_noise = [4e-3; 2],
    ] {
        let made = make(change);
        assert_ne!(made.input, plain.input);
        assert_eq!(
            (&made.transmission, &made.glass_reflection, &made.clean_reflection),
            (&plain.transmission, &plain.glass_reflection, &plain.clean_reflection)
        );
    }
    // Rounding to 8 bits, and the least noise, change the input by half a step.
    let stored = example(&draw(&Composition::off(), 2), Layering::Rendered, whole(&front), None);
    let far =
        |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(far(&plain.input, &stored.input) < 0.55 / 255.0);
    assert!(far(&plain.transmission, &stored.transmission) < 2e-6);
}

#[test]
fn curve_and_blur_are_the_same_for_input_and_target() {
    // Without a reflection, and with a pane that loses nothing, input and target are equal.
    let like = tuple(11);
    let black = Layer::of_pixels(&vec![[0.0; 3]; SIDE * SIDE]);
    let layers = TupleLayers {
        input: like.transmission.clone(),
        transmission: like.transmission.clone(),
        glass_reflection: black,
        clean_reflection: None,
        coverage: None,
    };
    let clear = LinearTuple::new(SIDE, SIDE, layers).unwrap();
    for seed in 0..20 {
        let camera = only_camera(|c| {
            c.blur_share = 0.5;
            c.gamma_sigma = 0.12;
            c.s_curve = [-0.25, 0.35];
        })
        .camera;
        let settings = Composition { camera, ..Composition::default() };
        let draw = draw(&settings, seed);
        let made = example(&draw, Layering::Rendered, whole(&clear), None);
        for (input, target) in made.input.iter().zip(&made.transmission) {
            assert!((input - target).abs() < 0.6 / 255.0, "{input} {target}");
        }
        assert!(made.glass_reflection.iter().all(|v| *v == 0.0));
    }
}

#[test]
fn mixtures_and_composed_examples_have_equal_strengths() {
    let tuples: Vec<LinearTuple> = (100..108).map(tuple).collect();
    for strength in [Composition::default().strength, Strength::OfTuple] {
        let settings = Composition { strength, other_share: 1.0, ..Composition::default() };
        let strengths = |layering| {
            let mut all: Vec<f64> = (0..200)
                .map(|k| {
                    let draw = draw(&settings, k as u64);
                    let [front, back] =
                        [&tuples[k % 8], &tuples[(k + 1 + k / 8 % 7) % 8]].map(whole);
                    draw.linear(layering, front, Some(back), SIDE).strength
                })
                .collect();
            all.sort_by(f64::total_cmp);
            [20, 50, 100, 150, 180].map(|rank| all[rank])
        };
        let [composed, mixtures @ ..] = LAYERINGS.map(strengths);
        for mixed in mixtures {
            for (a, b) in composed.into_iter().zip(mixed) {
                assert!((a - b).abs() <= 1e-5 * a, "{composed:?} {mixed:?}");
            }
        }
        assert!(composed[0] > 0.0 && composed[4] > 1.5 * composed[0], "{composed:?}");
    }
}

/// Mixtures of equal numbers have equal targets, and differ by the reflection alone.
#[test]
fn mixtures_differ_by_the_way_of_mixing_alone() {
    let (front, back) = (tuple(31), tuple(32));
    let exposure = Exposure::OfTuple;
    let settings = Composition { exposure, none_share: 0.0, ..own_light() };
    let draw = draw(&settings, 3);
    let made = LAYERINGS.map(|kind| draw.linear(kind, whole(&front), Some(whole(&back)), SIDE));
    let [rendered, linear, zhang, ceilnet] = &made;
    let ahead = |at: usize| draw.transmitted as f32 * linear.transmission[at];
    for mixture in [linear, zhang, ceilnet] {
        assert!(mixture.transmission == rendered.transmission);
        let sums = mixture.input.iter().zip(&mixture.glass_reflection).enumerate();
        for (at, (input, reflection)) in sums {
            assert!((ahead(at) + reflection - input).abs() < 1e-5, "{input}");
        }
    }
    assert!(linear.clean_reflection == zhang.clean_reflection);
    let of = |mixture: &LinearExample| luminance_of(&mixture.glass_reflection);
    assert!(of(zhang) < 0.95 * of(linear) && of(zhang) > 0.05 * of(linear));
    assert!((of(ceilnet) / of(linear) - 1.0).abs() > 0.05);
}

/// Both switches change the reflection, and input and reflection alike, so that I = F + R~ to the bit.
#[test]
fn rough_and_partial_reflections_add_to_the_same_front() {
    let (front, back) = (tuple(51), tuple(52));
    let mut settings = Composition { exposure: Exposure::OfTuple, ..Composition::default() };
    (settings.none_share, settings.rough_px) = (0.0, [2.0; 2]);
    let switched = |partial_cover, rough| {
        let settings = Composition { partial_cover, rough, ..settings.clone() };
        draw(&settings, 6)
    };
    for layering in LAYERINGS {
        let make = |draw: Draw| draw.linear(layering, whole(&front), Some(whole(&back)), SIDE);
        let plain = make(switched(0.0, 0.0));
        let ahead = make(Draw { strength: DrawnStrength::Ratio(0.0), ..switched(0.0, 0.0) }).input;
        let is_sum = |made: &LinearExample| {
            let layers = ahead.iter().zip(&made.glass_reflection).zip(&made.input);
            layers.into_iter().all(|((front, reflection), input)| front + reflection == *input)
        };
        let partial = make(switched(1.0, 0.0));
        let rough = make(switched(0.0, 1.0));
        assert!(is_sum(&plain) && is_sum(&partial) && is_sum(&rough), "{layering:?}");
        assert!(partial.transmission == plain.transmission && partial.strength == plain.strength);
        assert!(partial.glass_reflection != plain.glass_reflection);
        if layering != Layering::CeilnetMixture && layering != Layering::ZhangMixture {
            let layers = partial.glass_reflection.iter().zip(&plain.glass_reflection);
            assert!(layers.into_iter().all(|(part, whole)| part <= whole));
        }
        // A rough pane blurs, and keeps the strength; mixtures have no pane.
        let steps = |made: &LinearExample| -> f32 {
            made.glass_reflection.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum()
        };
        if layering == Layering::Rendered {
            assert!(steps(&rough) < 0.95 * steps(&plain));
            assert!((rough.strength - plain.strength).abs() < 1e-6);
        } else {
            assert!(rough == plain);
        }
    }
}

#[test]
fn mixtures_without_a_reflection_are_their_target() {
    let mut settings = Composition { none_share: 1.0, ..Composition::default() };
    settings.mixture.transmitted = [1.0; 2];
    let (front, back) = (tuple(41), tuple(42));
    for layering in &LAYERINGS[1..] {
        let made = draw(&settings, 5).linear(*layering, whole(&front), Some(whole(&back)), SIDE);
        assert!(made.input == made.transmission, "{layering:?}");
        assert!(made.strength == 0.0 && made.glass_reflection.iter().all(|v| *v == 0.0));
    }
}

#[test]
fn another_tuples_reflection_is_where_the_fronts_pane_is() {
    let (mut front, back) = (tuple(21), tuple(22));
    let half: Vec<f32> =
        (0..SIDE * SIDE).map(|k| f32::from(u8::from(k % SIDE < SIDE / 2))).collect();
    front.coverage = Some(Layer::Floats(half));
    let draw = draw(&Composition { none_share: 0.0, ..Composition::default() }, 1);
    let other = draw.linear(Layering::Rendered, whole(&front), Some(whole(&back)), SIDE);
    let column = |planes: &[f32], x: usize| (0..SIDE).map(|y| planes[y * SIDE + x]).sum::<f32>();
    let reflection = &other.glass_reflection;
    assert!(column(reflection, SIDE / 2 - 1) > 0.0 && column(reflection, SIDE / 2) == 0.0);
    // The tuple's own reflection needs no second cover.
    let own = draw.linear(Layering::Rendered, whole(&front), None, SIDE);
    assert!(column(&own.glass_reflection, SIDE / 2) > 0.0);
}

/// Equal bits on every machine: the digest of examples with all effects but JPEG, and of one with JPEG.
#[test]
fn bits_do_not_change() {
    let digest = |target_light, jpeg_share, layerings: [Layering; 2]| {
        let mut settings = Composition { target_light, ..Composition::default() };
        settings.camera.jpeg_share = jpeg_share;
        settings.camera.blur_share = 1.0;
        let mut hasher = blake3::Hasher::new();
        for (seed, layering) in (5..).zip(layerings) {
            let (front, back) = (tuple(seed), tuple(seed + 1));
            let cut = Cut { row: 3, column: 0, size: 45, mirrored: true };
            let side = |tuple| Side { tuple, cut };
            let mut noise = Stream::new(seed, "camera noise 0");
            let made = draw(&settings, seed)
                .example(layering, side(&front), Some(side(&back)), 32, &mut noise)
                .unwrap();
            for layer in [&made.input, &made.transmission, &made.glass_reflection] {
                for value in layer {
                    hasher.update(&value.to_le_bytes());
                }
            }
        }
        hasher.finalize().to_hex()[..16].to_owned()
    };
    let [rendered, linear, zhang, ceilnet] = LAYERINGS;
    let own = TargetLight::WithoutPane;
    let found = [0.0, 1.0].map(|jpeg_share| digest(own, jpeg_share, [rendered, linear]));
    assert_eq!(found, ["083c87d02ce2e322", "4b30e446c5928d78"]);
    assert_eq!(digest(own, 0.0, [zhang, ceilnet]), "8e94d5c7bb629c81");
    assert_eq!(digest(TargetLight::ThroughPane, 0.0, [rendered, linear]), "4e6676990ff90ed6");
}

fn sensor(scale: f64) -> glasshouse_line::Sensor {
    serde_json::from_str(&format!(
        r#"{{"exposure":{{"percentile":99,"level":0.9}},"blur_px":0.4,"gain_dn_per_e":2,"bits":12,"black_level_dn":64,
            "read_noise_dn":3,"read_noise_lambda":0.1,"row_noise_dn":0.5,"white_balance":[2,1,1.5],
            "colour_matrix":[[1.6,-0.4,-0.2],[-0.2,1.5,-0.3],[0,-0.5,1.5]],"scale":{scale},"sharpen":0.3,"jpeg_quality":85,
            "jpeg_subsampling":"4:2:0"}}"#
    ))
    .unwrap()
}

/// With everything else off, an example of one tuple has the codes of the photographs that its merge writes.
#[test]
fn a_sensor_gives_the_photographs_of_the_tuple() {
    let (tuple, sensor) = (tuple(3), sensor(1.0));
    let off = draw(&Composition::off(), 1).with_sensor(sensor.clone(), 77);
    let made = example(&off, Layering::Rendered, whole(&tuple), None);
    let planes = |layer: &Layer| tuple.crop(layer, whole(&tuple).cut, SIDE);
    let pixels = |layer: &Layer| -> Vec<[f32; 3]> {
        let planes = planes(layer);
        (0..SIDE * SIDE).map(|k| [0, 1, 2].map(|c| planes[c * SIDE * SIDE + k])).collect()
    };
    let input = pixels(&tuple.input);
    let factor = render::merge::PhotographRecord::new(sensor.exposure, &input).exposure_factor;
    let size = [SIDE as u32; 2];
    for (name, layer, codes) in [
        ("photo.jpg", &tuple.input, &made.input),
        ("photo_transmission.png", &tuple.transmission, &made.transmission),
        ("photo_glass_reflection.png", &tuple.glass_reflection, &made.glass_reflection),
    ] {
        let file = crate::encode_photograph(name, &pixels(layer), size, &sensor, factor, 77);
        let picture = image::load_from_memory(&file.unwrap()).unwrap().to_rgb8();
        assert_eq!(crate::jpeg::to_rgb8(codes), picture.into_raw(), "{name}");
    }
}

/// A sensor changes neither strengths nor composition, and takes the exposure of `composition`.
#[test]
fn a_sensor_photographs_composed_examples() {
    let (front, back) = (tuple(5), tuple(6));
    for layering in LAYERINGS {
        let settings = Composition::default();
        let drawn = draw(&settings, 9).with_sensor(sensor(1.0), 3);
        let plain = Draw { camera: None, sensor: None, ..drawn.clone() };
        let linear = plain.linear(layering, whole(&front), Some(whole(&back)), SIDE);
        let made = example(&drawn, layering, whole(&front), Some(whole(&back)));
        let again = example(&drawn, layering, whole(&front), Some(whole(&back)));
        assert_eq!(made, again);
        let noiseless =
            crate::Shot::with_factor(&drawn.sensor.as_ref().unwrap().sensor, [SIDE; 2], 1.0);
        assert_eq!(made.transmission, noiseless.noiseless(&linear.transmission));
        assert_eq!(made.glass_reflection, noiseless.noiseless(&linear.glass_reflection));
        let clean = noiseless.noiseless(&linear.input);
        let error: f64 =
            made.input.iter().zip(&clean).map(|(a, b)| f64::from((a - b).powi(2))).sum();
        let rms = (error / clean.len() as f64).sqrt();
        assert!((0.002..0.08).contains(&rms), "noise and JPEG: {rms}");
        let other = drawn.clone().with_sensor(sensor(1.0), 4);
        assert_ne!(example(&other, layering, whole(&front), Some(whole(&back))).input, made.input);
    }
}

/// Photographs that are smaller than the film show the same part of the tuple, with less noise.
#[test]
fn a_sensor_scales_its_photographs() {
    let tuple = tuple(8);
    let half = draw(&Composition::off(), 1).with_sensor(sensor(0.5), 2);
    assert_eq!((half.front_scale, half.reflection_scale), (2.0, 2.0));
    let small =
        half.example(Layering::Rendered, whole(&tuple), None, SIDE / 2, &mut Stream::new(1, "n"));
    let small = small.unwrap();
    let full = draw(&Composition::off(), 1).with_sensor(sensor(1.0), 2);
    let full = example(&full, Layering::Rendered, whole(&tuple), None);
    assert_eq!((small.side_px, small.input.len()), (SIDE / 2, 3 * SIDE * SIDE / 4));
    let reduced = crate::resample::resample(&full.transmission, [SIDE; 2], [SIDE / 2; 2]);
    let worst =
        small.transmission.iter().zip(&reduced).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 0.05, "{worst}");
}
