//! `{ choice = [..], weights = [..] }`: a list of alternatives, from which each scene draws one.

use serde::de::{self, MapAccess};
use serde::{Deserialize, Serialize};
use std::fmt;

/// True for the keys with which the table of a choice may begin.
pub fn is_key(key: &str) -> bool {
    ["choice", "weights"].contains(&key)
}

/// Alternatives with their relative probabilities.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice<T> {
    /// One or more alternatives.
    #[serde(rename = "choice")]
    pub values: Vec<T>,
    /// One number for each alternative: finite, at least 0, not all 0. Without them, all are equally likely.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weights: Option<Vec<f64>>,
}

impl<T> From<Vec<T>> for Choice<T> {
    fn from(values: Vec<T>) -> Self {
        Self { values, weights: None }
    }
}

impl<T> Choice<T> {
    /// Returns the alternative at `unit`, a uniform number in [0, 1).
    pub fn at(&self, unit: f64) -> &T {
        &self.values[self.place(unit)]
    }

    /// Returns the index of the alternative at `unit`, a uniform number in [0, 1).
    ///
    /// Equal weights give the alternative that a choice without weights gives, to the bit of `unit`.
    fn place(&self, unit: f64) -> usize {
        let count = self.values.len();
        let weights = match &self.weights {
            Some(weights) if weights.iter().any(|weight| *weight != weights[0]) => weights,
            _ => return ((unit * count as f64) as usize).min(count - 1),
        };
        let mut left = unit * weights.iter().sum::<f64>();
        for (index, weight) in weights.iter().enumerate() {
            if left < *weight {
                return index;
            }
            left -= weight;
        }
        // Rounding may leave a little behind the last alternative.
        weights.iter().rposition(|weight| *weight > 0.0).expect("a weight is above 0")
    }

    /// Checks the weights.
    fn check(self) -> Result<Self, String> {
        // An empty choice is the error of whoever knows what it should list.
        let (Some(weights), false) = (&self.weights, self.values.is_empty()) else {
            return Ok(self);
        };
        if weights.len() != self.values.len() {
            return Err(format!(
                "choice and weights have {} and {} entries: give one weight for each entry of choice",
                self.values.len(),
                weights.len()
            ));
        }
        if let Some(wrong) = weights.iter().find(|weight| !(weight.is_finite() && **weight >= 0.0))
        {
            return Err(format!("weights has {wrong}, but each must be finite and at least 0"));
        }
        let sum: f64 = weights.iter().sum();
        if !(sum > 0.0 && sum.is_finite()) {
            return Err(format!(
                "weights add up to {sum}, but must add up to a finite number above 0"
            ));
        }
        Ok(self)
    }
}

impl<'de, T: Deserialize<'de>> Choice<T> {
    /// Reads the rest of a table after its first key, for which [`is_key`] is true.
    pub fn read<A: MapAccess<'de>>(first: &str, mut map: A) -> Result<Self, A::Error> {
        let (mut values, mut weights) = (None, None);
        let mut key = Some(first.to_owned());
        while let Some(name) = key {
            match name.as_str() {
                "choice" => values = Some(map.next_value()?),
                "weights" => weights = Some(map.next_value()?),
                other => {
                    return Err(de::Error::custom(format!(
                        "a parameter has one distribution, not choice and {other}: only weights may stand beside choice"
                    )));
                }
            }
            key = map.next_key()?;
        }
        let Some(values) = values else {
            return Err(de::Error::custom("weights need choice = [..] beside them"));
        };
        Self { values, weights }.check().map_err(de::Error::custom)
    }
}

impl<T: fmt::Debug> fmt::Display for Choice<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "choice of {:?}", self.values)?;
        match &self.weights {
            Some(weights) => write!(f, " with weights {weights:?}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighted(weights: &[f64]) -> Choice<usize> {
        Choice { values: (0..weights.len()).collect(), weights: Some(weights.to_vec()) }
    }

    #[test]
    fn places_have_the_shares_of_their_weights() {
        let choice = weighted(&[3.0, 0.0, 1.0, 4.0]);
        let mut counts = [0; 4];
        (0..800).for_each(|i| counts[choice.place((f64::from(i) + 0.5) / 800.0)] += 1);
        assert_eq!(counts, [300, 0, 100, 400]);
        assert_eq!(choice.place(0.0), 0);
        assert_eq!(choice.place(0.375), 2);
        // The last number below 1 stays inside, also if the last weight is 0.
        let below_1 = 1.0 - f64::EPSILON / 2.0;
        assert_eq!(weighted(&[0.1, 0.2, 0.7, 0.0]).place(below_1), 2);
        assert_eq!(weighted(&[0.0, 5.0]).place(0.0), 1);
    }

    #[test]
    fn equal_weights_change_no_draw() {
        for count in 1..9 {
            let plain: Choice<usize> = (0..count).collect::<Vec<_>>().into();
            let equal = weighted(&vec![0.1; count]);
            for step in 0..=1000 {
                let unit = f64::from(step) / 1000.0;
                assert_eq!(plain.place(unit), equal.place(unit), "{count} {unit}");
            }
        }
    }
}
