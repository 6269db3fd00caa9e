//! The `[reject]` bounds of a recipe.

use super::images::Preview;
use crate::light::RejectRecipe;
use std::fmt;

/// A measure outside its bounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Violation {
    /// Key of the measure in `[reject]`.
    pub measure: &'static str,
    pub value: f64,
    /// Least and largest value that the recipe allows.
    pub allowed: [f64; 2],
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { measure, value, allowed: [least, most] } = self;
        write!(f, "{measure} is {value:.4}, but must be {least} to {most}")
    }
}

/// Returns the first bound that a preview violates, if any.
pub(crate) fn first_violation(preview: &Preview, rules: &RejectRecipe) -> Option<Violation> {
    let measures: [&dyn Fn() -> f64; 4] = [
        &|| preview.reflected_share(),
        &|| preview.contrast(),
        &|| preview.clipped_share(),
        &|| preview.ssim(),
    ];
    rules.bounds().into_iter().zip(measures).find_map(|((measure, allowed), value)| {
        let (allowed, value) = (allowed?, value());
        let [least, most] = allowed;
        let is_kept = (least..=most).contains(&value);
        (!is_kept).then_some(Violation { measure, value, allowed })
    })
}
