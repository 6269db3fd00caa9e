//! A number of a recipe: a constant, a distribution with a draw per scene, or a value from a photograph.

mod choice;
mod normal;
mod one_of;
mod schema;

pub use choice::{Choice, is_key};
pub use one_of::OneOf;
pub use schema::choice_of;

use crate::limits::Limit;
use normal::{normal_cdf, truncated_normal};
use schemars::JsonSchema;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};
use std::fmt;

/// A constant, a distribution, or a value from a photograph.
#[derive(Clone, Debug, PartialEq)]
pub enum Param {
    /// `1.6`: a constant.
    Constant(f64),
    /// `{ uniform = [a, b] }`: uniform from a to b.
    Uniform([f64; 2]),
    /// `{ log_uniform = [a, b] }`: from a to b with a uniform logarithm; a is above 0.
    LogUniform([f64; 2]),
    /// `{ normal = { mean = m, std = s, min = a, max = b } }`: normal, truncated to the range from a to b.
    Normal(Normal),
    /// `{ choice = [a, b, c], weights = [1, 1, 2] }`: a list of values; equal probabilities without weights.
    Choice(Choice<f64>),
    /// `"from_source"`: a value from the back photograph for `back.*`, and from the front photograph otherwise.
    FromSource,
}

/// A normal distribution, truncated (not clamped) to values from `min` to `max`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Normal {
    /// Mean before truncation.
    pub mean: f64,
    /// Standard deviation before truncation, above 0.
    pub std: f64,
    /// Least value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

impl Normal {
    /// Returns `min` and `max` in standard deviations from the mean.
    pub(super) fn standardised(&self) -> (f64, f64) {
        ((self.min - self.mean) / self.std, (self.max - self.mean) / self.std)
    }

    /// Computes the share of the normal distribution between `min` and `max`.
    fn mass(&self) -> f64 {
        let (a, b) = self.standardised();
        if a > 0.0 { normal_cdf(-a) - normal_cdf(-b) } else { normal_cdf(b) - normal_cdf(a) }
    }
}

/// Where a scene's draws come from.
pub trait Drawing {
    /// Returns a uniform number in [0, 1) for a key.
    fn unit(&self, key: &str) -> f64;
    /// Returns the value of a key in the photograph's record; NaN if it has none.
    fn recorded(&self, key: &str) -> f64;
}

impl dyn Drawing + '_ {
    /// Draws a value of `param`; rounds values of continuous distributions by [`nine_digits`].
    pub fn value(&self, key: &str, param: &Param) -> f64 {
        let (least, most) = param.bounds();
        let drawn = match param {
            Param::Constant(value) => return *value,
            Param::FromSource => return self.recorded(key),
            Param::Choice(choice) => return *choice.at(self.unit(key)),
            Param::Uniform([a, b]) => a + self.unit(key) * (b - a),
            Param::LogUniform([a, b]) => {
                let (log_a, log_b) = (libm::log(*a), libm::log(*b));
                libm::exp(log_a + self.unit(key) * (log_b - log_a))
            }
            Param::Normal(normal) => truncated_normal(self.unit(key), normal),
        };
        nine_digits(drawn).clamp(least, most)
    }
}

/// Rounds a value to nine significant digits, so that it is short in the manifest and parses to the same bits.
pub fn nine_digits(value: f64) -> f64 {
    format!("{value:.8e}").parse().expect("a formatted number can be parsed")
}

impl From<f64> for Param {
    fn from(value: f64) -> Self {
        Self::Constant(value)
    }
}

impl Param {
    /// Returns the least and the largest possible value; infinite for `from_source`.
    pub fn bounds(&self) -> (f64, f64) {
        match self {
            Self::Constant(value) => (*value, *value),
            Self::Uniform([a, b]) | Self::LogUniform([a, b]) => (*a, *b),
            Self::Normal(normal) => (normal.min, normal.max),
            Self::FromSource => (f64::NEG_INFINITY, f64::INFINITY),
            Self::Choice(choice) => choice
                .values
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), &v| {
                    (least.min(v), most.max(v))
                }),
        }
    }

    /// True if every draw gives the same value.
    pub fn is_constant(&self) -> bool {
        let (least, most) = self.bounds();
        least == most
    }

    /// Returns the first bound or choice outside `limit`, if any.
    pub fn outside(&self, limit: Limit) -> Option<f64> {
        if *self == Self::FromSource {
            // The value of each photograph is checked with its scene line.
            return None;
        }
        let (least, most) = self.bounds();
        let values = match self {
            Self::Choice(choice) => choice.values.as_slice(),
            _ => &[least, most],
        };
        values.iter().copied().find(|&v| !limit.contains(v))
    }

    /// Checks the numbers of the distribution.
    fn check(self) -> Result<Self, String> {
        let interval = |name: &str, [a, b]: [f64; 2]| {
            if a.is_finite() && b.is_finite() && a <= b {
                Ok(())
            } else {
                Err(format!(
                    "{name} = [{a}, {b}] is not an interval: write two finite numbers, the smaller first"
                ))
            }
        };
        match &self {
            Self::Constant(value) if !value.is_finite() => {
                return Err(format!("{value} is not finite"));
            }
            Self::Constant(_) | Self::FromSource => {}
            Self::Uniform(ends) => interval("uniform", *ends)?,
            Self::LogUniform(ends) => {
                interval("log_uniform", *ends)?;
                if ends[0] <= 0.0 {
                    return Err(format!(
                        "log_uniform starts at {}, but must start above 0",
                        ends[0]
                    ));
                }
            }
            Self::Normal(normal) => {
                interval("normal's [min, max]", [normal.min, normal.max])?;
                if !(normal.mean.is_finite() && normal.std.is_finite() && normal.std > 0.0) {
                    return Err(format!(
                        "normal has mean {} and std {}: both must be finite, and std above 0",
                        normal.mean, normal.std
                    ));
                }
                if normal.min < normal.max && normal.mass() < 1e-12 {
                    return Err(format!(
                        "normal with mean {} and std {} never falls in {} to {}: widen min and max",
                        normal.mean, normal.std, normal.min, normal.max
                    ));
                }
            }
            Self::Choice(Choice { values, .. }) => {
                if values.is_empty() || !values.iter().all(|v| v.is_finite()) {
                    return Err("choice must list one or more finite numbers".to_owned());
                }
            }
        }
        Ok(self)
    }
}

impl fmt::Display for Param {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Constant(value) => write!(f, "{value}"),
            Self::Uniform([a, b]) => write!(f, "uniform {a} to {b}"),
            Self::LogUniform([a, b]) => write!(f, "log_uniform {a} to {b}"),
            Self::Normal(n) => write!(f, "normal {} to {}", n.min, n.max),
            Self::Choice(choice) => write!(f, "{choice}"),
            Self::FromSource => f.write_str("from_source"),
        }
    }
}

impl Serialize for Param {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Constant(value) => serializer.serialize_f64(*value),
            Self::Uniform(ends) => serializer.collect_map([("uniform", ends)]),
            Self::LogUniform(ends) => serializer.collect_map([("log_uniform", ends)]),
            Self::Normal(normal) => serializer.collect_map([("normal", normal)]),
            Self::Choice(choice) => choice.serialize(serializer),
            Self::FromSource => serializer.serialize_str("from_source"),
        }
    }
}

impl<'de> Deserialize<'de> for Param {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ParamVisitor)
    }
}

/// A reader of parameters. A derived untagged enum would give errors without reason and position.
pub struct ParamVisitor;

impl<'de> Visitor<'de> for ParamVisitor {
    type Value = Param;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "a number, { uniform = [a, b] }, { log_uniform = [a, b] }, { normal = { mean, std, min, \
             max } }, { choice = [..], weights = [..] } or \"from_source\"",
        )
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Param, E> {
        match text {
            "from_source" => Ok(Param::FromSource),
            _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
        }
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Param, E> {
        self.visit_f64(value as f64)
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Param, E> {
        self.visit_f64(value as f64)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Param, E> {
        Param::Constant(value).check().map_err(E::custom)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Param, A::Error> {
        let Some(kind) = map.next_key::<String>()? else {
            return Err(de::Error::invalid_length(0, &self));
        };
        Self::visit_kind(&kind, map)
    }
}

impl ParamVisitor {
    /// Reads the rest of a distribution after the key `kind`.
    pub fn visit_kind<'de, A: MapAccess<'de>>(kind: &str, mut map: A) -> Result<Param, A::Error> {
        const KINDS: &[&str] = &["uniform", "log_uniform", "normal", "choice"];
        if is_key(kind) {
            let param = Param::Choice(Choice::read(kind, map)?);
            return param.check().map_err(de::Error::custom);
        }
        let param = match kind {
            "uniform" => Param::Uniform(map.next_value()?),
            "log_uniform" => Param::LogUniform(map.next_value()?),
            "normal" => Param::Normal(map.next_value()?),
            other => return Err(de::Error::unknown_field(other, KINDS)),
        };
        if let Some(second) = map.next_key::<String>()? {
            if second == "weights" {
                return Err(de::Error::custom(format!(
                    "weights belong to choice, not to {kind}: remove them"
                )));
            }
            return Err(de::Error::custom(format!(
                "a parameter has one distribution, not {kind} and {second}"
            )));
        }
        param.check().map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    struct Holder {
        x: Param,
    }

    fn parse(text: &str) -> Result<Param, String> {
        toml::from_str::<Holder>(&format!("x = {text}"))
            .map(|holder| holder.x)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn every_form_is_read() {
        assert_eq!(parse("1").unwrap(), Param::Constant(1.0));
        assert_eq!(parse("-1.5").unwrap(), Param::Constant(-1.5));
        assert_eq!(parse("{ uniform = [1, 1.7] }").unwrap(), Param::Uniform([1.0, 1.7]));
        assert_eq!(parse("{ log_uniform = [0.1, 10] }").unwrap(), Param::LogUniform([0.1, 10.0]));
        let normal = parse("{ normal = { mean = 1, std = 2, min = -1, max = 3 } }").unwrap();
        assert_eq!(normal.bounds(), (-1.0, 3.0));
        assert_eq!(parse("{ choice = [3, 1, 2] }").unwrap().bounds(), (1.0, 3.0));
        let weighted = parse("{ choice = [3, 1], weights = [1, 0.5] }").unwrap();
        let weights = Some(vec![1.0, 0.5]);
        assert_eq!(weighted, Param::Choice(Choice { values: vec![3.0, 1.0], weights }));
        assert_eq!(parse("{ weights = [1, 0.5], choice = [3, 1] }").unwrap(), weighted);
        for param in [weighted.clone(), normal, Param::Constant(2.0), Param::FromSource] {
            let text = serde_json::to_string(&param).unwrap();
            assert_eq!(serde_json::from_str::<Param>(&text).unwrap(), param, "{text}");
        }
        assert_eq!(weighted.to_string(), "choice of [3.0, 1.0] with weights [1.0, 0.5]");
    }

    #[test]
    fn errors_name_the_problem() {
        for (text, message) in [
            ("\"a\"", "expected a number, { uniform"),
            ("\"from_sources\"", "or \"from_source\""),
            ("true", "expected a number"),
            ("{}", "expected a number"),
            ("nan", "not finite"),
            ("{ unifrom = [1, 2] }", "unknown field `unifrom`, expected one of `uniform`"),
            ("{ uniform = [2, 1] }", "not an interval"),
            ("{ uniform = [1] }", "invalid length 1"),
            ("{ uniform = [1, 2], choice = [1] }", "has one distribution, not"),
            ("{ log_uniform = [0, 1] }", "must start above 0"),
            ("{ normal = { mean = 1, std = 0, min = 0, max = 2 } }", "std above 0"),
            ("{ normal = { mean = 1, std = 1, min = 0 } }", "missing field `max`"),
            ("{ normal = { mean = 0, std = 1, min = 20, max = 30 } }", "never falls"),
            ("{ choice = [] }", "one or more"),
            ("{ choice = [1, nan] }", "one or more finite numbers"),
            ("{ choice = [], weights = [] }", "one or more"),
            ("{ choice = [1, 2], weights = [1] }", "choice and weights have 2 and 1 entries"),
            ("{ choice = [1, 2], weights = [1, -1] }", "weights has -1, but each must be finite"),
            ("{ choice = [1, 2], weights = [1, inf] }", "weights has inf, but each must be finite"),
            ("{ choice = [1, 2], weights = [0, 0] }", "weights add up to 0, but must"),
            ("{ choice = [1, 2], weights = [1e308, 1e308] }", "weights add up to inf, but must"),
            ("{ weights = [1, 2] }", "weights need choice = [..]"),
            ("{ uniform = [1, 2], weights = [1, 1] }", "weights belong to choice, not to uniform"),
            ("{ choice = [1], wieghts = [1] }", "not choice and wieghts: only weights may"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(message), "{text}: {error}");
            assert!(error.contains("line 1"), "{text}: {error}");
        }
    }
}
