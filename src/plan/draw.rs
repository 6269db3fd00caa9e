//! Random numbers of a manifest: pure functions of the dataset seed and of names.
//!
//! Adding a scene, split, source or parameter therefore changes no other draw.

pub(crate) use glasshouse_line::param::{Drawing, nine_digits};

use glasshouse_line::param::{Choice, Param};
use std::collections::BTreeMap;

/// Generator of the random numbers of one scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Draw<'a> {
    pub dataset_seed: u64,
    pub scene: &'a str,
    /// Number of earlier draws of this scene that failed the geometry check or were rejected.
    pub attempt: u32,
    /// Values of the photographs' records by parameter, for [`Param::FromSource`].
    pub values: &'a BTreeMap<String, f64>,
}

impl Draw<'_> {
    /// Draws an alternative of `choice` for the parameter with this key in the recipe.
    pub(crate) fn pick<'c, T>(&self, parameter: &str, choice: &'c Choice<T>) -> &'c T {
        choice.at(self.unit(parameter))
    }

    /// Draws a value of `param`; rounds values of continuous distributions by [`nine_digits`].
    pub(crate) fn value(&self, parameter: &str, param: &Param) -> f64 {
        let draw: &dyn Drawing = self;
        draw.value(parameter, param)
    }
}

impl Drawing for Draw<'_> {
    fn unit(&self, parameter: &str) -> f64 {
        let attempt = self.attempt.to_string();
        let bits = keyed(self.dataset_seed, &["parameter", self.scene, parameter, &attempt]);
        (bits >> 11) as f64 / TWO_TO_53
    }

    // `source_values` has checked that the value exists. If it does not, validation rejects the line for its NaN.
    fn recorded(&self, parameter: &str) -> f64 {
        self.values.get(parameter).copied().unwrap_or(f64::NAN)
    }
}

const TWO_TO_53: f64 = 9_007_199_254_740_992.0;

/// Computes the seed of a scene's sample points, below 2^53 so that every JSON reader keeps it exactly.
pub(crate) fn scene_seed(dataset_seed: u64, id: &str) -> u64 {
    keyed(dataset_seed, &["scene seed", id]) >> 11
}

/// Hashes the seed and all parts of `key` to 64 uniform bits.
pub(super) fn keyed(dataset_seed: u64, key: &[&str]) -> u64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(b"glasshouse.draw/1");
    hasher.update(&dataset_seed.to_le_bytes());
    for part in key {
        // The length distinguishes ("ab", "c") from ("a", "bc").
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(bytes)
}

/// Sorts `items` by a hash of each name, so that an additional item does not change the order of the others.
pub(super) fn shuffled<'a, T>(
    dataset_seed: u64,
    key: &[&str],
    items: impl IntoIterator<Item = &'a T>,
    name: impl Fn(&T) -> &str,
) -> Vec<&'a T> {
    let mut placed: Vec<(u64, &'a T)> = items
        .into_iter()
        .map(|item| {
            let mut key = key.to_vec();
            key.push(name(item));
            (keyed(dataset_seed, &key), item)
        })
        .collect();
    placed.sort_by(|(a, x), (b, y)| a.cmp(b).then_with(|| name(x).cmp(name(y))));
    placed.into_iter().map(|(_, item)| item).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::param::Normal;
    use proptest::prelude::*;

    fn draw(scene: &str) -> Draw<'_> {
        Draw { dataset_seed: 2020, scene, attempt: 0, values: const { &BTreeMap::new() } }
    }

    #[test]
    fn draws_are_pinned() {
        // New values here mean that every recipe yields another manifest.
        assert_eq!(scene_seed(2020, "train-000000"), 8_089_883_437_783_281);
        let ior = Param::Uniform([1.3, 1.7]);
        assert_eq!(draw("train-000000").value("glass.ior", &ior), 1.57465236);
    }

    #[test]
    fn keys_are_independent() {
        let base = draw("a").unit("glass.ior");
        assert_ne!(base, draw("b").unit("glass.ior"));
        assert_ne!(base, draw("a").unit("glass.thickness_m"));
        let second = Draw { attempt: 1, ..draw("a") };
        assert_ne!(base, second.unit("glass.ior"));
        assert_ne!(keyed(1, &["ab", "c"]), keyed(1, &["a", "bc"]));
        assert_ne!(keyed(1, &["a"]), keyed(2, &["a"]));
    }

    /// Returns the mean and the variance of 20,000 draws.
    fn moments(param: &Param) -> (f64, f64) {
        let n = 20_000;
        let values: Vec<f64> = (0..n).map(|i| draw(&format!("s-{i}")).value("x", param)).collect();
        let mean = values.iter().sum::<f64>() / f64::from(n);
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / f64::from(n);
        (mean, variance)
    }

    #[test]
    fn distributions_have_their_moments() {
        let (mean, variance) = moments(&Param::Uniform([1.0, 3.0]));
        assert!((mean - 2.0).abs() < 0.02 && (variance - 1.0 / 3.0).abs() < 0.01);

        // The mean is (b - a) / ln(b / a).
        let (mean, _) = moments(&Param::LogUniform([0.01, 1.0]));
        assert!((mean - 0.99 / 100f64.ln()).abs() < 0.007, "{mean}");

        // Truncation at plus and minus one sigma leaves a variance of 0.2912 sigma^2.
        let normal = |mean, std, min, max| Param::Normal(Normal { mean, std, min, max });
        let (mean, variance) = moments(&normal(5.0, 2.0, 3.0, 7.0));
        assert!((mean - 5.0).abs() < 0.03 && (variance / 4.0 - 0.2912).abs() < 0.01);

        // Far in the upper tail, the excess over 8 is nearly exponential, with mean 1 / 8 - 2 / 8^3.
        let (mean, _) = moments(&normal(0.0, 1.0, 8.0, 20.0));
        assert!((mean - 8.0 - 0.1213).abs() < 0.005, "{mean}");

        let (mean, _) = moments(&Param::Choice(vec![0.0, 1.0, 5.0].into()));
        assert!((mean - 2.0).abs() < 0.06, "{mean}");

        let (values, weights) = (vec![0.0, 1.0, 5.0], Some(vec![1.0, 5.0, 2.0]));
        let (mean, _) = moments(&Param::Choice(Choice { values, weights }));
        assert!((mean - 15.0 / 8.0).abs() < 0.05, "{mean}");
    }

    proptest! {
        #[test]
        fn values_stay_in_bounds_and_survive_json(
            a in 1e-6..1e3f64, width in 1e-9..1e3f64, scene in "[a-z]{1,8}", seed: u64,
        ) {
            let normal = Normal { mean: a + width, std: width, min: a, max: a + 1.5 * width };
            for param in [
                Param::Uniform([a, a + width]),
                Param::LogUniform([a, a + width]),
                Param::Normal(normal),
            ] {
                let draw = Draw { dataset_seed: seed, scene: &scene, attempt: 0, values: &BTreeMap::new() };
                let value = draw.value("x", &param);
                let (least, most) = param.bounds();
                prop_assert!((least..=most).contains(&value));
                if value != least && value != most {
                    let text = serde_json::to_string(&value).unwrap();
                    prop_assert_eq!(serde_json::from_str::<f64>(&text).unwrap(), value);
                }
            }
            prop_assert!(scene_seed(seed, &scene) < 1 << 53);
        }
    }
}
