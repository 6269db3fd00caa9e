//! The `[reject]` bounds of a recipe.

use super::images::Preview;
use crate::light::RejectRecipe;
use std::fmt;

/// A measure of a preview.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Measure {
    /// Mean luminance of R~ / that of I.
    ReflectedShare,
    /// Standard deviation of R~'s luminance / mean luminance of I.
    Contrast,
    /// Share of I's pixels that clip.
    ClippedShare,
    /// Structural similarity of I and T.
    Ssim,
}

impl fmt::Display for Measure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ReflectedShare => "reflected_share",
            Self::Contrast => "contrast",
            Self::ClippedShare => "clipped_share",
            Self::Ssim => "ssim",
        })
    }
}

/// A measure outside its bounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Violation {
    pub measure: Measure,
    pub value: f64,
    /// Least and largest value that the recipe allows.
    pub allowed: [f64; 2],
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [least, most] = self.allowed;
        let Self { measure, value, .. } = self;
        write!(f, "{measure} is {value:.4}, but must be {least} to {most}")
    }
}

/// The first bound that a preview violates.
pub(crate) fn first_violation(preview: &Preview, rules: &RejectRecipe) -> Option<Violation> {
    type Rule<'a> = (Measure, Option<[f64; 2]>, &'a dyn Fn() -> f64);
    let clipped = rules.clipped_share.map(|most| [0.0, most]);
    let rules: [Rule; 4] = [
        (Measure::ReflectedShare, rules.reflected_share, &|| preview.reflected_share()),
        (Measure::Contrast, rules.contrast, &|| preview.contrast()),
        (Measure::ClippedShare, clipped, &|| preview.clipped_share()),
        (Measure::Ssim, rules.ssim, &|| preview.ssim()),
    ];
    rules.into_iter().find_map(|(measure, allowed, value)| {
        let (allowed, value) = (allowed?, value());
        let [least, most] = allowed;
        let is_kept = (least..=most).contains(&value);
        (!is_kept).then_some(Violation { measure, value, allowed })
    })
}
