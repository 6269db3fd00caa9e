//! Ranges, in metres, of relative depths, which are known only up to scale and shift.

use super::error::{LineError, check_section, within};
use super::image::DepthKind;
use super::limits;
use glasshouse_keys::keys;

/// Distances of the near and the far end of a relative depth image.
#[keys]
#[derive(Copy)]
#[serde(
    untagged,
    expecting = "depth_range must be {\"mean_m\": z} or {\"near_m\": z, \"far_m\": z}, optionally with far_over_near \
                 (for a mean) and percentiles"
)]
pub enum DepthRange {
    /// A mean and the ratio of the ends: `{"mean_m": 4.0}`.
    Mean {
        /// Mean z (for a panorama, distance along the ray) of the valid pixels of a relative depth, which needs this range.
        #[key("[0.001, 1e6] m")]
        mean_m: f64,
        /// Ratio of the far end to the near end.
        // A room spans 1.5 m to 8 m (a ratio of 5), and a street spans 5 m to 50 m (a ratio of 10). Depth estimators do not resolve
        // larger ratios.
        #[key("(1, 1e6]", default = 8.0, written)]
        far_over_near: f64,
        /// Percentiles of the valid values that become the ends; values beyond are clamped.
        // They exclude the few outliers of any estimate.
        #[key("[0, 100]", default = [2.0, 98.0], written)]
        percentiles: [f64; 2],
    },
    /// Both ends: `{"near_m": 1.0, "far_m": 12.0}`.
    Ends {
        /// Distance of the near end.
        #[key("[0.001, 1e6] m")]
        near_m: f64,
        /// Distance of the far end.
        #[key("[0.001, 1e6] m")]
        far_m: f64,
        /// Percentiles of the values that become the ends.
        #[key("[0, 100]", default = [2.0, 98.0], written)]
        percentiles: [f64; 2],
    },
}

impl DepthRange {
    /// Returns the percentiles of the values that become the ends.
    pub fn percentiles(&self) -> [f64; 2] {
        match *self {
            Self::Mean { percentiles, .. } | Self::Ends { percentiles, .. } => percentiles,
        }
    }

    /// Checks the numbers; errors name `field`.
    pub fn validate(&self, field: &str) -> Result<(), LineError> {
        check_section(self, field)?;
        if let Self::Ends { near_m, far_m, .. } = *self {
            let ratio = far_m / near_m;
            within(&format!("{field}.far_m / near_m"), ratio, limits::FAR_OVER_NEAR)?;
        }
        let [low, high] = self.percentiles();
        within(
            &format!("{field}.percentiles[1] - {field}.percentiles[0]"),
            high - low,
            limits::ABOVE_0,
        )
    }
}

/// Checks that a relative depth has a valid range and that any other depth has none.
pub(crate) fn check(
    side: &str,
    kind: DepthKind,
    range: Option<&DepthRange>,
) -> Result<(), LineError> {
    let is_relative = matches!(kind, DepthKind::Relative | DepthKind::RelativeInverse);
    match range {
        Some(range) if is_relative => range.validate(&format!("{side}.depth_range")),
        None if !is_relative => Ok(()),
        range => Err(LineError::DepthRange { side: side.to_owned(), given: range.is_some() }),
    }
}

#[cfg(test)]
mod tests {
    use super::super::jsonl::parse_scene;
    use super::super::published::published;

    fn line(kind: &str, range: &str) -> Result<(), String> {
        let text = serde_json::to_string(&published()).unwrap();
        let kind = format!(r#""depth_kind":"{kind}"{range}"#);
        let text = text.replacen(r#""depth_kind":"z""#, &kind, 1);
        parse_scene(&text).map(|_| ()).map_err(|e| e.to_string())
    }

    #[test]
    fn a_range_belongs_to_relative_depths() {
        let mean = r#","depth_range":{"mean_m":4.0}"#;
        let ends = r#","depth_range":{"near_m":1,"far_m":12,"percentiles":[0,100]}"#;
        for kind in ["relative", "relative_inverse"] {
            assert_eq!(line(kind, mean), Ok(()));
            assert_eq!(line(kind, ends), Ok(()));
            let error = line(kind, "").unwrap_err();
            assert!(error.contains("front.depth_kind is relative"), "{error}");
        }
        for kind in ["z", "distance"] {
            let error = line(kind, mean).unwrap_err();
            assert!(error.contains("front.depth_range is given"), "{error}");
        }
    }

    #[test]
    fn wrong_ranges_are_named() {
        for (range, words) in [
            (r#"{"mean_m":0}"#, "front.depth_range.mean_m is 0"),
            (r#"{"mean_m":1,"far_over_near":0.5}"#, "far_over_near is 0.5"),
            (r#"{"near_m":2,"far_m":1}"#, "far_m / near_m is 0.5"),
            (
                r#"{"mean_m":1,"percentiles":[50,50]}"#,
                "percentiles[1] - front.depth_range.percentiles[0] is 0",
            ),
            (r#"{"mean_m":1,"percentiles":[-1,50]}"#, "percentiles[0] is -1"),
            (r#"{"mean_m":1,"near_m":1}"#, "depth_range must be"),
            (r#"{"far_m":1}"#, "depth_range must be"),
        ] {
            let error = line("relative", &format!(r#","depth_range":{range}"#)).unwrap_err();
            assert!(error.contains(words), "{range}: {error}");
        }
    }
}
