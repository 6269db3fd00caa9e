//! Checks `[sensor]` of a recipe, beyond the limits of single numbers.

use super::limits::limit_of;
use super::recipe_check::bad;
use super::recipe_error::RecipeError;
use super::sensor::SensorRecipe;
use super::sensor_model::{NoiseModel, SensorModel};

impl SensorRecipe {
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        if self.camera.is_some() && self.model.is_some() {
            return bad("sensor.camera", "and sensor.model are both given: remove one");
        }
        if let Some(model) = &self.model {
            model.check("sensor.model")?;
        }
        let Some(gain) = &self.gain_dn_per_e else {
            return Ok(());
        };
        // A calibration says nothing of other gains.
        let (least, most) = gain.bounds();
        for (name, model) in self.models() {
            let [low, high] = model.ln_gain.map(libm::exp);
            if least.is_finite() && (least < low * 0.999 || most > high * 1.001) {
                return bad(
                    "sensor.gain_dn_per_e",
                    format!(
                        "({gain}) leaves the range in which {name} was calibrated, {low:.3} to {high:.3}: narrow it, choose \
                         another camera, or give sensor.model"
                    ),
                );
            }
        }
        Ok(())
    }
}

impl SensorModel {
    /// Checks the numbers of a sensor. Errors begin with `key`.
    pub(super) fn check(&self, key: &str) -> Result<(), RecipeError> {
        let within = |name: &str, value: f64| {
            let limit = limit_of(&format!("sensor.{name}"));
            if limit.contains(value) {
                return Ok(());
            }
            bad(&format!("{key}.{name}"), format!("is {value}, but must be {}", limit.allowed))
        };
        within("bits", self.bits.into())?;
        within("black_level_dn", self.black_level_dn.into())?;
        if self.black_level_dn >= (1 << self.bits) - 1 {
            return bad(
                &format!("{key}.black_level_dn"),
                "must be below the converter's largest number",
            );
        }
        let [low, high] = self.ln_gain;
        if !(low <= high && limit_of("sensor.gain_dn_per_e").contains(libm::exp(low)) && high < 9.0)
        {
            return bad(
                &format!("{key}.ln_gain"),
                format!("is [{low}, {high}], but must be a rising range from -9 to 9"),
            );
        }
        for (name, noise) in [("read_noise", self.read_noise), ("row_noise", self.row_noise)] {
            noise.check(&format!("{key}.{name}"), self.ln_gain)?;
        }
        if self.row_noise.lambda.is_some() {
            return bad(
                &format!("{key}.row_noise.lambda"),
                "is given, but row noise is normal: remove it",
            );
        }
        if self.srgb_to_balanced().is_none() {
            return bad(
                key,
                "must have exactly one of xyz_to_camera and srgb_to_camera, and light must give positive raw values",
            );
        }
        if self.blue_gain.is_some() == self.blue_gain_of_red.is_some() {
            return bad(key, "must have exactly one of blue_gain and blue_gain_of_red");
        }
        let gains = self.red_gain.into_iter().chain(self.blue_gain.into_iter().flatten());
        for gain in gains.chain(self.blue_at_the_ends()) {
            within("white_balance", gain)?;
        }
        let rises = |[low, high]: [f64; 2]| low <= high;
        if !(rises(self.red_gain) && self.blue_gain.is_none_or(rises)) {
            return bad(key, "has a range of red_gain or blue_gain that does not rise");
        }
        Ok(())
    }

    /// Returns the factors of blue at the ends of the range of red.
    fn blue_at_the_ends(&self) -> Vec<f64> {
        let of = |[constant, linear, square]: [f64; 3]| {
            self.red_gain.map(|red| constant + linear * red + square * red * red)
        };
        self.blue_gain_of_red.map(of).into_iter().flatten().collect()
    }
}

impl NoiseModel {
    fn check(&self, key: &str, ln_gain: [f64; 2]) -> Result<(), RecipeError> {
        let is_small = |ln: f64| self.scale_dn(ln, 3.0) <= 1000.0;
        if !(ln_gain.into_iter().all(is_small) && (0.0..=2.0).contains(&self.deviation)) {
            return bad(key, "has a scale above 1000 DN, or a deviation outside 0 to 2");
        }
        let limit = limit_of("sensor.read_noise_lambda");
        match self.lambda {
            Some(lambda) if !limit.contains(lambda) => {
                bad(key, format!("has the lambda {lambda}, but it must be {}", limit.allowed))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::recipe::Recipe;
    use super::super::recipe::tests::PAPER;

    const MODEL: &str = "description = \"mine\"\nbits = 12\nblack_level_dn = 256\nln_gain = [-1, 1]\n\
        read_noise = { slope = 0.5, intercept = 0 }\nrow_noise = { slope = 0.5, intercept = -2 }\n\
        srgb_to_camera = [[0.6, 0.3, 0.1], [0.1, 0.8, 0.1], [0, 0.3, 0.7]]\nred_gain = [2, 2]\nblue_gain = [1.5, 1.6]\n";

    fn error(sensor: &str) -> String {
        let text = PAPER.replace("[sources.diode]", &format!("{sensor}\n[sources.diode]"));
        Recipe::parse(&text).unwrap_err().to_string()
    }

    #[test]
    fn errors_name_the_key() {
        for (sensor, message) in [
            (
                "[sensor]\ncamera = \"a7\"",
                "unknown sensor \"a7\", expected one of imx686, nikon-d850",
            ),
            ("[sensor]\ncamra = \"imx686\"", "unknown field `camra`"),
            ("[sensor]\ncamera = { choice = [] }", "choice must list one or more names"),
            ("[sensor]\nexposure = { percentile = 99 }", "exposure must be { factor = .. } or"),
            (
                "[sensor]\nexposure = { factor = 0 }",
                "sensor.exposure.factor is 0, but must be 1e-6",
            ),
            ("[sensor]\ntone = \"film\"", "unknown variant `film`, expected one of `srgb`"),
            (
                "[sensor]\ngamma = { uniform = [0.1, 1] }",
                "sensor.gamma (uniform 0.1 to 1) can be 0.1",
            ),
            (
                "[sensor]\njpeg_quality = { uniform = [60, 90] }",
                "sensor.jpeg_quality must be a whole",
            ),
            ("[sensor]\njpeg_subsampling = \"4:1:1\"", "unknown variant `4:1:1`"),
            ("[sensor]\nmosaic = \"rgbg\"", "unknown variant `rgbg`"),
            (
                "[sensor]\ncamera = \"imx686\"\ngain_dn_per_e = 0.1",
                "(0.1) leaves the range in which imx686 was calibrated, 0.826 to 8.743",
            ),
        ] {
            let found = error(sensor);
            assert!(found.contains(message), "{sensor}: {found}");
        }
    }

    #[test]
    fn own_models_are_checked() {
        let text = |model: &str| format!("[sensor]\nscale = 0.5\n[sensor.model]\n{model}");
        let parse = |sensor: &str| {
            Recipe::parse(&PAPER.replace("[sources.diode]", &format!("{sensor}\n[sources.diode]")))
        };
        assert!(parse(&text(MODEL)).unwrap().sensor.is_some());
        for (from, to, message) in [
            ("bits = 12", "bits = 20", "sensor.model.bits is 20, but must be 8 to 16"),
            ("black_level_dn = 256", "black_level_dn = 4095", "must be below the converter's"),
            ("ln_gain = [-1, 1]", "ln_gain = [1, -1]", "sensor.model.ln_gain is [1, -1], but"),
            ("intercept = 0 }", "intercept = 9 }", "sensor.model.read_noise has a scale above"),
            ("intercept = 0 }", "intercept = 0, lambda = -0.5 }", "has the lambda -0.5"),
            ("intercept = -2 }", "intercept = -2, lambda = 0.1 }", "row noise is normal"),
            (
                "srgb_to_camera",
                "xyz_to_camera = [[0, 0, 1], [0, 1, 0], [1, 0, 0]]\nsrgb_to_camera",
                "exactly one of xyz_to_camera",
            ),
            ("blue_gain = [1.5, 1.6]", "", "exactly one of blue_gain and"),
            ("red_gain = [2, 2]", "red_gain = [2, 20]", "white_balance is 20, but must be"),
        ] {
            let found = error(&text(&MODEL.replace(from, to)));
            assert!(found.contains(message), "{to}: {found}");
        }
        let both = error(&text(MODEL).replace("scale = 0.5", "camera = \"imx686\""));
        assert!(both.contains("sensor.camera and sensor.model are both given"), "{both}");
    }
}
