//! Photographs of flat fields and charts.

use super::Shot;
use glasshouse_line::{Mosaic, Sensor, SensorExposure, Tone};
use render::trace::Isa;

const SIZE: [usize; 2] = [512, 512];
const PIXELS: usize = SIZE[0] * SIZE[1];

fn sensor() -> Sensor {
    let line = r#"{"exposure":{"factor":1},"gain_dn_per_e":0.5,"bits":14,"black_level_dn":512,"jpeg_quality":90}"#;
    serde_json::from_str(line).unwrap()
}

/// A sensor with all that a photograph can have.
fn rich() -> Sensor {
    Sensor {
        exposure: SensorExposure::Metered { percentile: 99.0, level: 0.8 },
        blur_px: 0.5,
        gain_dn_per_e: 4.0,
        read_noise_dn: 5.0,
        read_noise_lambda: Some(-0.1),
        row_noise_dn: 1.5,
        mosaic: Mosaic::Grbg,
        white_balance: [2.1, 1.0, 1.7],
        white_balance_error: [1.03, 1.0, 0.96],
        colour_matrix: [[1.7, -0.5, -0.2], [-0.15, 1.5, -0.35], [0.02, -0.5, 1.48]],
        tone: Tone::Parametric { gamma: 0.95, s_curve: 0.2 },
        scale: 0.75,
        sharpen: 0.4,
        sharpen_px: 0.8,
        ..sensor()
    }
}

fn flat(light: f32) -> Vec<f32> {
    vec![light; 3 * PIXELS]
}

/// A picture with edges, ramps and a light beyond white.
fn chart([width, height]: [usize; 2]) -> Vec<f32> {
    let value = |c: usize, y: usize, x: usize| {
        let ramp = (x + 1) as f32 / width as f32 * (y + 2) as f32 / height as f32;
        let edge = if 3 * x + y > 2 * width { 0.6 } else { 0.15 };
        let lamp = if y < 6 && x < 6 { 3.0 } else { 0.0 };
        edge * (0.5 + ramp) * [1.0, 0.8, 0.5][c] + lamp
    };
    let places = |c| (0..height).flat_map(move |y| (0..width).map(move |x| value(c, y, x)));
    (0..3).flat_map(places).collect()
}

fn mean_and_variance(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    [mean, values.map(|value| (value - mean).powi(2)).sum::<f64>() / count]
}

/// The photon transfer curve: the variance is gain x signal + read noise^2 + 1/12 of quantisation, within 1 %.
#[test]
fn variance_follows_the_signal() {
    for (number, gain_dn_per_e) in [0.2, 0.5, 1.5, 5.0, 12.0].into_iter().enumerate() {
        for lambda in [None, Some(-0.026), Some(0.1)] {
            let sensor =
                Sensor { gain_dn_per_e, read_noise_dn: 3.0, read_noise_lambda: lambda, ..sensor() };
            for light in [0.0, 0.0005, 0.004, 0.02, 0.1, 0.35, 0.7] {
                let shot = Shot::new(&sensor, &flat(light), SIZE);
                let numbers = shot.expose(&flat(light), 11 + number as u64);
                let [mean, variance] = mean_and_variance(numbers.iter().map(|dn| f64::from(*dn)));
                let signal = f64::from(light) * (16_383.0 - 512.0);
                let expected = gain_dn_per_e * signal + 9.0 + 1.0 / 12.0;
                let error = variance / expected - 1.0;
                assert!(error.abs() < 0.01, "gain {gain_dn_per_e}, light {light}: {error}");
                let allowed = 4.0 * (expected / PIXELS as f64).sqrt();
                assert!((mean - 512.0 - signal).abs() < allowed, "{gain_dn_per_e} {light}: {mean}");
            }
        }
    }
}

#[test]
fn row_noise_is_white_and_shared_by_rows() {
    let sensor = Sensor { row_noise_dn: 4.0, read_noise_dn: 2.0, ..sensor() };
    let size = [256, 8192];
    let dark = vec![0.0; 3 * size[0] * size[1]];
    let numbers = Shot::new(&sensor, &dark, size).expose(&dark, 5);
    let mean = |values: &mut dyn Iterator<Item = u16>| {
        let values: Vec<f64> = values.map(f64::from).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let rows: Vec<f64> =
        numbers.chunks_exact(size[0]).map(|row| mean(&mut row.iter().copied())).collect();
    let [centre, variance] = mean_and_variance(rows.iter().copied());
    let of_pixels = (4.0 + 1.0 / 12.0) / size[0] as f64;
    // 8,192 rows give the variance to 1.6 %.
    assert!((variance / (16.0 + of_pixels) - 1.0).abs() < 0.05, "{variance}");
    for lag in 1..6 {
        let product = |pair: &[f64]| (pair[0] - centre) * (pair[lag] - centre);
        let sum: f64 = rows.windows(lag + 1).map(product).sum();
        let correlation = sum / (rows.len() - lag) as f64 / variance;
        assert!(correlation.abs() < 0.045, "lag {lag}: {correlation}");
    }
    let columns = (0..size[0]).map(|x| mean(&mut numbers.iter().skip(x).step_by(size[0]).copied()));
    let [_, variance] = mean_and_variance(columns.collect::<Vec<f64>>().into_iter());
    let expected = (4.0 + 1.0 / 12.0) / size[1] as f64;
    assert!((variance / expected - 1.0).abs() < 0.3, "columns: {variance} {expected}");
}

/// A photosite's noise depends on its place and the seed alone: a larger film has the same numbers in its corner.
#[test]
fn noise_is_a_function_of_seed_and_place() {
    let sensor = Sensor { read_noise_dn: 3.0, row_noise_dn: 1.0, ..sensor() };
    let expose = |size: [usize; 2], seed| {
        let planes = vec![0.2; 3 * size[0] * size[1]];
        Shot::new(&sensor, &planes, size).expose(&planes, seed)
    };
    let (small, large) = (expose([40, 30], 7), expose([64, 50], 7));
    for (row, other) in small.chunks_exact(40).zip(large.chunks_exact(64)) {
        assert_eq!(row, &other[..40]);
    }
    assert_ne!(small, expose([40, 30], 8));
    assert_ne!(small, expose([40, 30], 7 + (1 << 32)));
}

#[test]
fn a_grey_card_stays_grey() {
    let plain = Sensor { exposure: SensorExposure::Factor { factor: 1.0 }, ..rich() };
    let plain = Sensor { white_balance_error: [1.0; 3], scale: 1.0, sharpen: 0.0, ..plain };
    for light in [0.01, 0.18, 0.6, 1.0, 2.5] {
        let shot = Shot::new(&plain, &flat(light), SIZE);
        let codes = shot.noiseless(&flat(light));
        for pixel in 0..PIXELS {
            let [r, g, b] = [0, 1, 2].map(|c| codes[c * PIXELS + pixel]);
            assert!((r - g).abs() < 2e-5 && (b - g).abs() < 2e-5, "{light}: {r} {g} {b}");
        }
        let expected = crate::curve::Curve::of(plain.tone).code(light);
        assert!((codes[PIXELS] - expected).abs() < 2e-5, "{light}");
        // With noise, the channels have equal means: in raw values, where no curve bends the noise.
        let numbers = shot.expose(&flat(light), 3);
        let mut sums = [[0.0; 2]; 3];
        for (place, dn) in numbers.iter().enumerate() {
            let sum = &mut sums[plain.mosaic.channel(place / SIZE[0], place % SIZE[0])];
            (sum[0], sum[1]) = (sum[0] + f64::from(*dn) - 512.0, sum[1] + 1.0);
        }
        if light < 0.9 {
            let balanced = [0, 1, 2].map(|c| sums[c][0] / sums[c][1] * plain.white_balance[c]);
            for value in balanced {
                assert!((value / balanced[1] - 1.0).abs() < 0.01, "{light}: {balanced:?}");
            }
        }
    }
}

/// Below saturation, raw values of a sum are the sum of raw values, so the photographs of all layers share one exposure.
#[test]
fn layers_share_the_decisions_of_the_mixture() {
    let size = [48, 40];
    let (front, reflection) = (chart(size), flat(0.1)[..3 * 48 * 40].to_vec());
    let mixture: Vec<f32> = front.iter().zip(&reflection).map(|(a, b)| a + b).collect();
    let sensor = Sensor {
        exposure: SensorExposure::Metered { percentile: 50.0, level: 0.2 },
        tone: Tone::Srgb,
        scale: 1.0,
        sharpen: 0.0,
        ..rich()
    };
    let shot = Shot::new(&sensor, &mixture, size);
    let again = Shot::with_factor(&sensor, size, shot.factor());
    assert_eq!(shot.noiseless(&front), again.noiseless(&front));
    let linear = |code: f32| {
        let code = f64::from(code);
        if code <= 0.04045 { code / 12.92 } else { libm::pow((code + 0.055) / 1.055, 2.4) }
    };
    let light = |codes: Vec<f32>| codes.into_iter().map(linear).collect::<Vec<f64>>();
    let [sum, a, b] = [&mixture, &front, &reflection].map(|layer| light(shot.noiseless(layer)));
    let mut compared = 0;
    for (k, sum) in sum.iter().enumerate() {
        let inside = (8..32).contains(&(k % (48 * 40) / 48)) && (8..40).contains(&(k % 48));
        if inside && *sum < 0.7 && a[k] > 1e-3 && b[k] > 1e-3 {
            assert!((sum - a[k] - b[k]).abs() < 2e-5, "{k}: {sum} {} {}", a[k], b[k]);
            compared += 1;
        }
    }
    assert!(compared > 1000, "{compared}");
}

#[test]
fn clipped_light_is_white_and_black_light_is_black() {
    let sensor = Sensor { full_well_e: Some(8000.0), white_balance: [2.0, 1.0, 1.6], ..sensor() };
    let shot = Shot::new(&sensor, &flat(30.0), SIZE);
    let numbers = shot.expose(&flat(30.0), 1);
    assert!(numbers.iter().all(|dn| *dn == 512 + 4000), "the full well is 4,000 DN");
    assert!(shot.develop(&numbers).iter().all(|code| *code == 1.0));
    assert!(shot.noiseless(&flat(30.0)).iter().all(|code| *code == 1.0));
    assert!(shot.noiseless(&flat(0.0)).iter().all(|code| *code == 0.0));
}

#[test]
fn photographs_have_their_scale() {
    let sensor = rich();
    let planes = chart([50, 31]);
    let shot = Shot::new(&sensor, &planes, [50, 31]);
    assert_eq!(shot.photograph_px(), [38, 23]);
    let codes = shot.develop(&shot.expose(&planes, 1));
    assert_eq!(codes.len(), 3 * 38 * 23);
    assert!(codes.iter().all(|code| (0.0..=1.0).contains(code)));
}

/// Photographs of one chart, for means and variances of each photosite.
const SEEDS: u64 = 400;

/// `tests/camera/twin.py` computes the camera of [`rich`] in double precision, from its description.
#[test]
fn a_twin_in_double_precision_agrees() {
    let file = include_bytes!("../../../tests/camera/twin.safetensors");
    let tensors = safetensors::SafeTensors::deserialize(file).unwrap();
    let of = |name: &str| -> Vec<f32> {
        let bytes = tensors.tensor(name).unwrap().data().chunks_exact(4);
        bytes.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    };
    let (size, sensor) = ([64, 48], Sensor { read_noise_lambda: None, ..rich() });
    let planes = chart(size);
    let shot = Shot::new(&sensor, &planes, size);
    assert_eq!(tensors.tensor("codes").unwrap().shape(), [3, 36, 48]);
    let (codes, expected) = (shot.noiseless(&planes), of("codes"));
    let worst = codes.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 2e-5, "{worst}");
    // Means and variances of each photosite over seeds, as standard scores.
    let (means, variances) = (of("mean_dn"), of("variance_dn"));
    let mut sums = vec![[0.0f64; 2]; means.len()];
    for seed in 0..SEEDS {
        for (sum, (dn, mean)) in sums.iter_mut().zip(shot.expose(&planes, seed).iter().zip(&means))
        {
            let difference = f64::from(*dn) - f64::from(*mean);
            (sum[0], sum[1]) = (sum[0] + difference, sum[1] + difference * difference);
        }
    }
    let (mut scores, mut ratios, mut count) = (0.0, 0.0, 0.0);
    for (place, [sum, squares]) in sums.iter().enumerate() {
        if means[place] > 12_000.0 {
            continue;
        }
        let (mean, variance) = (sum / SEEDS as f64, f64::from(variances[place]));
        let score = mean / (variance / SEEDS as f64).sqrt();
        assert!(score.abs() < 5.5, "{place}: {score}");
        (scores, count) = (scores + score * score, count + 1.0);
        ratios += (squares / SEEDS as f64 - mean * mean) / variance;
    }
    let (score, ratio) = (scores / count, ratios / count);
    // Rows share a number, so scores of a row are not independent.
    assert!(count > 2500.0 && (score - 1.0).abs() < 0.1 && (ratio - 1.0).abs() < 0.01);
}

/// The photographs of a chart: numbers of the converter, codes of all layers, and files. They change only with `SENSOR_VERSION`.
#[test]
fn golden_photographs_keep_their_bits() {
    let size = [64, 48];
    let pixels: Vec<[f32; 3]> = {
        let planes = chart(size);
        (0..64 * 48).map(|k| [0, 1, 2].map(|c| planes[c * 64 * 48 + k])).collect()
    };
    let digest = |bytes: &[u8]| blake3::hash(bytes).to_hex()[..16].to_owned();
    let filmic = Tone::Filmic { exposure: 3.0 };
    let plain = Sensor { tone: filmic, raw: true, ..sensor() };
    let half = Sensor { jpeg_subsampling: glasshouse_line::Subsampling::Half, ..rich() };
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let mut found = Vec::new();
        for sensor in [&half, &plain] {
            let exposure = render::merge::PhotographRecord::new(sensor.exposure, &pixels);
            let planes = chart(size);
            let shot = Shot::with_factor(sensor, size, exposure.exposure_factor).with_isa(isa);
            let bytes: Vec<u8> =
                shot.expose(&planes, 9).iter().flat_map(|dn| dn.to_le_bytes()).collect();
            found.push(digest(&bytes));
            let codes = shot.noiseless(&planes);
            let codes: Vec<u8> = codes.iter().flat_map(|code| code.to_le_bytes()).collect();
            found.push(digest(&codes));
            for name in ["photo.jpg", "photo_transmission.png", "raw.dng"] {
                found.push(digest(
                    &crate::tuple_files::encode_shot(name, &shot, &planes, 9).unwrap(),
                ));
            }
        }
        assert_eq!(found, GOLDEN, "{}", isa.name());
    }
}
/// For each sensor: numbers, codes without noise, `photo.jpg`, `photo_transmission.png`, `raw.dng`.
const GOLDEN: [&str; 10] = [
    "e217f2859803a30a",
    "d7de84fe7a488051",
    "3f665b2e6e437a7c",
    "e1f42169acdc9c14",
    "cdf175208ed73fdb",
    "ad6096729625fbab",
    "b37106787599ee19",
    "d03ea1c89cad035c",
    "20fed7edbccd08fe",
    "e0092f799db92b75",
];
