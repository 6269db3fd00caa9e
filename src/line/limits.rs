//! The allowed values of a number.

use schemars::Schema;
use serde_json::Value;
use std::ops::Bound::{self, Excluded, Included, Unbounded};
use std::ops::RangeBounds;

/// The allowed values of a field.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    range: (Bound<f64>, Bound<f64>),
    grid: Grid,
    /// Unit of the number; empty without one.
    pub unit: &'static str,
    /// The range in words, as the end of a sentence such as "ior must be 1 to 10".
    pub allowed: &'static str,
}

/// Allowed values within a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Grid {
    All,
    Whole,
    PowersOfTwo,
}

impl Limit {
    pub(crate) const fn new(
        range: (Bound<f64>, Bound<f64>),
        grid: Grid,
        unit: &'static str,
        allowed: &'static str,
    ) -> Self {
        Self { range, grid, unit, allowed }
    }

    /// Returns the limit of a range without a unit, which the words name.
    pub const fn from_to(least: Bound<f64>, most: Bound<f64>, allowed: &'static str) -> Self {
        Self::new((least, most), Grid::All, "", allowed)
    }

    /// Returns the limit of a range that includes both ends.
    pub const fn between(least: f64, most: f64, allowed: &'static str) -> Self {
        Self::from_to(Included(least), Included(most), allowed)
    }

    /// True if `value` is allowed. NaN and infinities are never allowed.
    pub fn contains(&self, value: f64) -> bool {
        let is_on_grid = match self.grid {
            Grid::All => true,
            Grid::Whole => value.fract() == 0.0,
            Grid::PowersOfTwo => value.fract() == 0.0 && (value as u64).is_power_of_two(),
        };
        value.is_finite() && self.range.contains(&value) && is_on_grid
    }

    /// Returns the numbers at the ends of the range: those that are allowed, and their neighbours that are not. For tests.
    pub fn edges(&self) -> (Vec<f64>, Vec<f64>) {
        let step = |from: f64, up: bool| match (self.grid, up) {
            (Grid::All, true) => from.next_up(),
            (Grid::All, false) => from.next_down(),
            (Grid::Whole, true) => from + 1.0,
            (Grid::Whole, false) => from - 1.0,
            (Grid::PowersOfTwo, true) => 2.0 * from,
            (Grid::PowersOfTwo, false) => 0.5 * from,
        };
        let (mut inside, mut outside) = (vec![], vec![]);
        for (bound, is_upper) in [(self.range.0, false), (self.range.1, true)] {
            match bound {
                Included(end) => {
                    inside.push(end);
                    outside.push(step(end, is_upper));
                }
                Excluded(end) => {
                    outside.push(end);
                    inside.push(step(end, !is_upper));
                }
                Unbounded => {}
            }
        }
        (inside, outside)
    }

    /// True if only whole numbers are allowed.
    pub fn is_whole(&self) -> bool {
        self.grid != Grid::All
    }
}

/// Adds the allowed values of a number, or of the elements of a list, to a JSON Schema.
pub(crate) fn describe(schema: &mut Schema, limits: &[Limit]) {
    let Some(keywords) = schema.as_object_mut() else {
        return;
    };
    // Limits that differ from element to element are in the tables.
    let [limit] = limits else {
        return;
    };
    let mut of = keywords;
    while of.contains_key("items") {
        let Some(items) = of.get_mut("items").and_then(Value::as_object_mut) else {
            return;
        };
        of = items;
    }
    for (end, included, excluded) in [
        (limit.range.0, "minimum", "exclusiveMinimum"),
        (limit.range.1, "maximum", "exclusiveMaximum"),
    ] {
        match end {
            Included(end) => of.insert(included.to_owned(), end.into()),
            Excluded(end) => of.insert(excluded.to_owned(), end.into()),
            Unbounded => None,
        };
    }
}

pub(crate) const ABOVE_0: Limit = Limit::from_to(Excluded(0.0), Unbounded, "finite and above 0");
pub(crate) const FAR_OVER_NEAR: Limit =
    Limit::from_to(Excluded(1.0), Included(1.0e6), "above 1 and at most 1e6");

#[cfg(test)]
mod tests {
    use super::super::keys::limit_of;

    #[test]
    fn limits_contain_their_ends_and_their_grid() {
        let spp = limit_of("film.spp").unwrap();
        assert_eq!(
            [1.0, 96.0, 256.0, 256.5, 65_536.0, 131_072.0, 0.0].map(|v| spp.contains(v)),
            [true, false, true, false, true, false, false]
        );
        let tilt = limit_of("glass.tilt_deg[0]").unwrap();
        assert_eq!(
            [-90.0, -89.9, f64::NAN, 90.0].map(|v| tilt.contains(v)),
            [false, true, false, false]
        );
        assert!(!limit_of("front.intrinsics.cx").unwrap().contains(f64::INFINITY));
        assert!(limit_of("glass.colour").is_none());
    }
}
