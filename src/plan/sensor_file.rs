//! A file with a `[sensor]` table alone, for photographs of tuples that exist.

use super::draw::Draw;
use super::recipe_check::{bad, within};
use super::recipe_error::RecipeError;
use super::sensor::SensorRecipe;
use glasshouse_line::Sensor;
use glasshouse_line::param::Param;
use serde::Deserialize;
use std::collections::BTreeMap;

/// A sensor's distributions, and the seed of the draws.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    /// Dataset seed. Default 2020. With the seed of a recipe that has the same `[sensor]`, each scene draws what its line has.
    #[serde(default = "super::recipe::default_seed")]
    pub seed: u64,
    /// The camera.
    pub sensor: SensorRecipe,
}

impl SensorFile {
    /// Parses and checks a file.
    pub fn parse(text: &str) -> Result<Self, RecipeError> {
        let file: Self = toml::from_str(text).map_err(Box::new)?;
        file.sensor.check_numbers()?;
        Ok(file)
    }

    /// Draws the sensor of a scene.
    pub fn draw(&self, scene: &str) -> Sensor {
        self.sensor.draw_for(self.seed, scene)
    }
}

impl SensorRecipe {
    /// Checks all numbers of a sensor that no photograph's record can give.
    pub fn check_numbers(&self) -> Result<(), RecipeError> {
        for (key, param) in self.params() {
            if *param == Param::FromSource {
                return bad(
                    &key,
                    "is from_source, but there is no photograph's record here: give a number",
                );
            }
            within(&key, param)?;
        }
        self.check()
    }

    /// Draws a sensor as a function of a seed and a name.
    pub fn draw_for(&self, seed: u64, name: &str) -> Sensor {
        self.draw(Draw { dataset_seed: seed, scene: name, attempt: 0, values: &BTreeMap::new() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_a_sensor_and_a_seed() {
        let file = SensorFile::parse("seed = 3\n[sensor]\ncamera = \"imx686\"").unwrap();
        assert_eq!((file.seed, file.draw("a").name.as_deref()), (3, Some("imx686")));
        assert_eq!(file.draw("a"), file.draw("a"));
        assert_ne!(file.draw("a"), file.draw("b"));
        for (text, message) in [
            ("seed = 1", "missing field `sensor`"),
            ("[sensor]\n[film]", "unknown field `film`"),
            ("[sensor]\nblur_px = \"from_source\"", "sensor.blur_px is from_source, but"),
            ("[sensor]\nscale = 2", "sensor.scale is 2, but must be 0.05 to 1"),
        ] {
            let error = SensorFile::parse(text).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
