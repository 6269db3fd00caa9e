//! Sensors drawn from recipes.

use super::draw::Draw;
use super::expand::expand;
use super::recipe::Recipe;
use super::recipe::tests::PAPER;
use super::sensor::SensorRecipe;
use super::sensor_model::sensor_models;
use super::split::tests::set;
use glasshouse_line::{Mosaic, Sensor, SensorExposure, Subsampling, Tone};
use std::collections::BTreeMap;

fn drawn(recipe: &SensorRecipe, number: usize) -> Sensor {
    let scene = format!("scene-{number}");
    let values = BTreeMap::new();
    recipe.draw(Draw { dataset_seed: 7, scene: &scene, attempt: 0, values: &values })
}

#[test]
fn known_sensors_have_sources_and_valid_numbers() {
    let models = sensor_models();
    assert!(models.by_name.len() >= 4);
    for (name, model) in &models.by_name {
        model.check(name).unwrap();
        assert!(!model.sources.is_empty(), "{name}");
        for source in &model.sources {
            assert!(models.sources.contains_key(source), "{name}: {source}");
        }
    }
    let cited = |key: &String| models.by_name.values().any(|model| model.sources.contains(key));
    assert!(models.sources.keys().all(cited));
}

#[test]
fn defaults_draw_all_sensors_with_valid_numbers() {
    let recipe = SensorRecipe::default();
    let sensors: Vec<Sensor> = (0..400).map(|number| drawn(&recipe, number)).collect();
    for sensor in &sensors {
        sensor.check().unwrap();
        let model = &sensor_models().by_name[sensor.name.as_ref().unwrap()];
        let ln_gain = sensor.gain_dn_per_e.ln();
        assert!((model.ln_gain[0] - 1e-6..=model.ln_gain[1] + 1e-6).contains(&ln_gain));
        assert!(
            sensor.colour_matrix.iter().all(|row| (row.iter().sum::<f64>() - 1.0).abs() < 1e-7)
        );
    }
    let share =
        |is: &dyn Fn(&Sensor) -> bool| sensors.iter().filter(|s| is(s)).count() as f64 / 400.0;
    for name in sensor_models().by_name.keys() {
        assert!((share(&|s| s.name.as_ref() == Some(name)) - 0.25).abs() < 0.08, "{name}");
    }
    assert!((share(&|s| matches!(s.tone, Tone::Parametric { .. })) - 0.5).abs() < 0.08);
    assert!((share(&|s| s.jpeg_subsampling == Subsampling::Half) - 0.667).abs() < 0.08);
    assert!((share(&|s| s.mosaic == Mosaic::Grbg) - 0.25).abs() < 0.08);
    assert!(!sensors[0].raw);
}

/// The noise of a sensor at a gain, against the published formulas.
#[test]
fn noise_follows_the_gain() {
    let text = "camera = \"sony-a7s2\"\ngain_dn_per_e = 1.0\nexposure = { factor = 2 }\nraw = true";
    let recipe: SensorRecipe = toml::from_str(text).unwrap();
    for number in 0..50 {
        let sensor = drawn(&recipe, number);
        assert_eq!((sensor.gain_dn_per_e, sensor.raw), (1.0, true));
        assert_eq!(sensor.exposure, SensorExposure::Factor { factor: 2.0 });
        // exp(0.86182) is the scale of Tukey's lambda distribution; its standard deviation at -0.026 is 1.94 of the scale.
        let expected = 0.86182_f64.exp() * compose::tukey_deviation(-0.026);
        assert!((sensor.read_noise_dn / expected).ln().abs() < 3.01 * 0.00712);
        assert!((sensor.row_noise_dn.ln() + 0.34227).abs() < 3.01 * 0.02832);
        let [red, green, blue] = sensor.white_balance;
        assert!((1.75..=2.65).contains(&red) && green == 1.0 && (1.7..3.4).contains(&blue));
    }
}

#[test]
fn scenes_without_a_sensor_keep_their_lines_and_others_gain_one() {
    let sources: BTreeMap<_, _> = ["diode", "places"].map(|n| (n.to_owned(), set(6, 6))).into();
    let small = PAPER
        .replace("diode = 3000, places = 2000", "diode = 4")
        .replace("diode = 120, places = 80", "diode = 2");
    let plain = expand(&Recipe::parse(&small).unwrap(), &sources).unwrap();
    let with = small.replace("[sources.diode]", "[sensor]\nraw = true\n[sources.diode]");
    let with = expand(&Recipe::parse(&with).unwrap(), &sources).unwrap();
    assert_eq!(plain.len(), with.len());
    for (plain, with) in plain.iter().zip(&with) {
        assert!(plain.sensor.is_none());
        let text = serde_json::to_string(&with.sensor).unwrap();
        assert_eq!(serde_json::from_str::<Option<Sensor>>(&text).unwrap(), with.sensor);
        let without = glasshouse_line::SceneLine { sensor: None, ..with.clone() };
        assert_eq!(*plain, without);
        assert!(with.sensor.as_ref().unwrap().raw);
    }
    let sensors: Vec<_> = with.iter().map(|line| &line.sensor).collect();
    assert!(sensors.windows(2).any(|pair| pair[0] != pair[1]));
}

/// The table of docs/camera.md has the numbers of sensors.toml, and the page cites the sources.
#[test]
fn the_page_has_all_sensors() {
    let page = include_str!("../../docs/camera.md");
    for (name, model) in &sensor_models().by_name {
        let ends = model.ln_gain.map(|ln| {
            let gain = ln.exp();
            let white_e = f64::from((1 << model.bits) - 1 - model.black_level_dn) / gain;
            let deviation = model.read_noise.lambda.map_or(1.0, compose::tukey_deviation);
            let read_e = model.read_noise.scale_dn(ln, 0.0) * deviation / gain;
            [format!("{gain:.2}"), format!("{white_e:.0}"), format!("{read_e:.1}")]
        });
        let range = |k: usize| format!("{} to {}", ends[0][k], ends[1][k]);
        let row = format!(
            "| `{name}` | {} | {} | {} | {} | {} | {} |",
            model.description,
            model.bits,
            range(0),
            range(1),
            range(2),
            model.sources.join(", ")
        );
        assert!(page.contains(&row), "docs/camera.md lacks this row:\n{row}");
    }
    for (key, source) in &sensor_models().sources {
        let item = format!("- {key}: {source}");
        assert!(page.contains(&item), "docs/camera.md lacks this source:\n{item}");
    }
}
