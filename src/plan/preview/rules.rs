//! Whether a scene keeps to a recipe's bounds.

use super::images::Look;
use crate::RejectRecipe;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What is measured of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
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

/// A bound that a scene does not keep to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Bound {
    /// What was measured.
    pub measure: Measure,
    /// Its value.
    pub value: f64,
    /// The least and the most that the recipe allows.
    pub allowed: [f64; 2],
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [least, most] = self.allowed;
        let Self { measure, value, .. } = self;
        write!(
            f,
            "{measure} is {value:.4}, but {least} to {most} is allowed"
        )
    }
}

/// The first bound that a scene does not keep to.
pub(crate) fn reject(look: &Look, rules: &RejectRecipe) -> Option<Bound> {
    type Rule<'a> = (Measure, Option<[f64; 2]>, &'a dyn Fn() -> f64);
    let clipped = rules.clipped_share.map(|most| [0.0, most]);
    let rules: [Rule; 4] = [
        (Measure::ReflectedShare, rules.reflected_share, &|| {
            look.reflected_share()
        }),
        (Measure::Contrast, rules.contrast, &|| look.contrast()),
        (Measure::ClippedShare, clipped, &|| look.clipped_share()),
        (Measure::Ssim, rules.ssim, &|| look.ssim()),
    ];
    rules.into_iter().find_map(|(measure, allowed, value)| {
        let (allowed, value) = (allowed?, value());
        let [least, most] = allowed;
        let is_kept = (least..=most).contains(&value);
        (!is_kept).then_some(Bound {
            measure,
            value,
            allowed,
        })
    })
}
