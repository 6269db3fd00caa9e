//! Random numbers of a manifest: pure functions of the dataset seed and of names.
//!
//! Adding a scene, split, source or parameter therefore changes no other draw.

use super::choice::Choice;
use super::param::{Normal, Param};
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
    /// Draws a uniform number in [0, 1) for the parameter with this key in the recipe.
    pub(crate) fn unit(&self, parameter: &str) -> f64 {
        let attempt = self.attempt.to_string();
        let bits = keyed(self.dataset_seed, &["parameter", self.scene, parameter, &attempt]);
        (bits >> 11) as f64 / TWO_TO_53
    }

    /// Draws an alternative of `choice` for the parameter with this key in the recipe.
    pub(crate) fn pick<'c, T>(&self, parameter: &str, choice: &'c Choice<T>) -> &'c T {
        &choice.values[choice.place(self.unit(parameter))]
    }

    /// Draws a value of `param`; rounds values of continuous distributions by [`nine_digits`].
    pub(crate) fn value(&self, parameter: &str, param: &Param) -> f64 {
        let (least, most) = param.bounds();
        let drawn = match param {
            Param::Constant(value) => return *value,
            // `source_values` has checked that the value exists. If it does not, validation rejects the line for its
            // NaN.
            Param::FromSource => return self.values.get(parameter).copied().unwrap_or(f64::NAN),
            Param::Choice(choice) => return *self.pick(parameter, choice),
            Param::Uniform([a, b]) => a + self.unit(parameter) * (b - a),
            Param::LogUniform([a, b]) => {
                let (log_a, log_b) = (libm::log(*a), libm::log(*b));
                libm::exp(log_a + self.unit(parameter) * (log_b - log_a))
            }
            Param::Normal(normal) => truncated_normal(self.unit(parameter), normal),
        };
        nine_digits(drawn).clamp(least, most)
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

/// Rounds a value to nine significant digits, so that it is short in the manifest and parses to the same bits.
pub(crate) fn nine_digits(value: f64) -> f64 {
    format!("{value:.8e}").parse().expect("a formatted number can be parsed")
}

fn truncated_normal(unit: f64, normal: &Normal) -> f64 {
    let (mut a, mut b) = normal.standardised();
    // In the upper tail, the distribution function is too close to 1 to resolve values, so the interval is mirrored.
    let sign = if a > 0.0 { -1.0 } else { 1.0 };
    if sign < 0.0 {
        (a, b) = (-b, -a);
    }
    let (low, high) = (normal_cdf(a), normal_cdf(b));
    normal.mean + sign * normal.std * inverse_normal_cdf(low + unit * (high - low)).clamp(a, b)
}

/// Computes the share of a standard normal distribution below `x`, with full relative precision in the lower tail.
pub(super) fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// Computes the value below which a share `p` of a standard normal distribution lies; infinite at 0 and 1.
///
/// The relative error is about 1e-16 (Wichura, algorithm AS 241 (PPND16), Applied Statistics 37, 1988).
fn inverse_normal_cdf(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * polynomial(&CENTRE_ABOVE, r) / polynomial(&CENTRE_BELOW, r);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    if tail <= 0.0 {
        return f64::INFINITY.copysign(q);
    }
    let r = libm::sqrt(-libm::log(tail));
    let x = if r <= 5.0 {
        polynomial(&SIDE_ABOVE, r - 1.6) / polynomial(&SIDE_BELOW, r - 1.6)
    } else {
        polynomial(&TAIL_ABOVE, r - 5.0) / polynomial(&TAIL_BELOW, r - 5.0)
    };
    x.copysign(q)
}

/// Evaluates a polynomial; `coefficients` start with the constant term.
fn polynomial(coefficients: &[f64; 8], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

const CENTRE_ABOVE: [f64; 8] = [
    3.387_132_872_796_366_5,
    1.331_416_678_917_843_8e2,
    1.971_590_950_306_551_3e3,
    1.373_169_376_550_946e4,
    4.592_195_393_154_987e4,
    6.726_577_092_700_87e4,
    3.343_057_558_358_813e4,
    2.509_080_928_730_122_7e3,
];
const CENTRE_BELOW: [f64; 8] = [
    1.0,
    4.231_333_070_160_091e1,
    6.871_870_074_920_579e2,
    5.394_196_021_424_751e3,
    2.121_379_430_158_66e4,
    3.930_789_580_009_271e4,
    2.872_908_573_572_194_3e4,
    5.226_495_278_852_854e3,
];
const SIDE_ABOVE: [f64; 8] = [
    1.423_437_110_749_683_5,
    4.630_337_846_156_546,
    5.769_497_221_460_691,
    3.647_848_324_763_204_5,
    1.270_458_252_452_368_4,
    2.417_807_251_774_506e-1,
    2.272_384_498_926_918_4e-2,
    7.745_450_142_783_414e-4,
];
const SIDE_BELOW: [f64; 8] = [
    1.0,
    2.053_191_626_637_759,
    1.676_384_830_183_803_8,
    6.897_673_349_851e-1,
    1.481_039_764_274_800_8e-1,
    1.519_866_656_361_645_7e-2,
    5.475_938_084_995_345e-4,
    1.050_750_071_644_416_9e-9,
];
const TAIL_ABOVE: [f64; 8] = [
    6.657_904_643_501_103,
    5.463_784_911_164_114,
    1.784_826_539_917_291_3,
    2.965_605_718_285_048_7e-1,
    2.653_218_952_657_612_4e-2,
    1.242_660_947_388_078_4e-3,
    2.711_555_568_743_487_6e-5,
    2.010_334_399_292_288_1e-7,
];
const TAIL_BELOW: [f64; 8] = [
    1.0,
    5.998_322_065_558_88e-1,
    1.369_298_809_227_358e-1,
    1.487_536_129_085_061_5e-2,
    7.868_691_311_456_133e-4,
    1.846_318_317_510_054_8e-5,
    1.421_511_758_316_446e-7,
    2.044_263_103_389_939_8e-15,
];

#[cfg(test)]
mod tests {
    use super::*;
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

    #[test]
    fn inverse_normal_cdf_inverts_normal_cdf() {
        for step in -370..=60 {
            let x = f64::from(step) / 10.0;
            let back = inverse_normal_cdf(normal_cdf(x));
            // Above 0, `normal_cdf` is near 1 and has fewer digits for the tail.
            let tolerance = if x > 0.0 { 1e-7 } else { 1e-12 * (1.0 + x.abs()) };
            assert!((back - x).abs() < tolerance, "{x} {back}");
        }
        assert_eq!(inverse_normal_cdf(0.0), f64::NEG_INFINITY);
        assert_eq!(inverse_normal_cdf(1.0), f64::INFINITY);
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
