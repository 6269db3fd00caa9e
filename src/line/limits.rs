//! Ranges of the numbers in scene lines and recipes.

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

    const fn from_to(least: Bound<f64>, most: Bound<f64>, allowed: &'static str) -> Self {
        Self::new((least, most), Grid::All, "", allowed)
    }

    /// Returns the limit of a range without its lower end 0.
    const fn above_0_to(most: f64, allowed: &'static str) -> Self {
        Self::from_to(Excluded(0.0), Included(most), allowed)
    }

    /// Returns the limit of a range that includes both ends.
    const fn between(least: f64, most: f64, allowed: &'static str) -> Self {
        Self::from_to(Included(least), Included(most), allowed)
    }

    const fn on(self, grid: Grid) -> Self {
        Self { grid, ..self }
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

pub(crate) const ABOVE_0: Limit = Limit::from_to(Excluded(0.0), Unbounded, "finite and above 0");
const FROM_0: Limit = Limit::from_to(Included(0.0), Unbounded, "finite and at least 0");
/// Thickness of a layer, m. Lengths of paths of 64 layers fit into whole femtometres of 64 bits.
const THICKNESS_M: Limit = Limit::between(0.0, 100.0, "0 to 100 m");
/// Absorption coefficient, per metre. Light falls to 1/e in 1 nm at most; more would show the rounding of lengths.
const ABSORPTION_PER_M: Limit = Limit::between(0.0, 1.0e9, "0 to 1e9 per m");
/// Sizes and places of pictures in the scene, m, whose squares single precision holds.
const SIZE_M: Limit = Limit::above_0_to(1.0e9, "above 0 and at most 1e9 m");
const PLACE_M: Limit = Limit::between(-1.0e9, 1.0e9, "-1e9 to 1e9 m");
const FINITE: Limit = Limit::from_to(Unbounded, Unbounded, "finite");
const BELOW_90_DEG: Limit =
    Limit::from_to(Excluded(-90.0), Excluded(90.0), "above -90 and below 90 degrees");
const SHARE: Limit = Limit::between(0.0, 1.0, "0 to 1");
const PERCENTILE: Limit = Limit::from_to(Excluded(0.0), Included(100.0), "above 0 and at most 100");
/// Ends and mean of a relative depth, and distance of a panorama without a depth map, m.
pub(crate) const RELATIVE_DEPTH_M: Limit = Limit::between(1.0e-3, 1.0e6, "0.001 to 1e6 m");
pub(crate) const FAR_OVER_NEAR: Limit =
    Limit::from_to(Excluded(1.0), Included(1.0e6), "above 1 and at most 1e6");
pub(crate) const PERCENT: Limit = Limit::between(0.0, 100.0, "0 to 100");
/// Start of the curve for clipped highlights, linear.
pub(crate) const BELOW_WHITE: Limit =
    Limit::from_to(Included(0.0), Excluded(1.0), "0 or more and below 1");
/// Value of white after the curve, linear.
pub(crate) const WHITE_BECOMES: Limit = Limit::between(1.0, 1.0e6, "1 to 1e6");

/// Returns the limit of the row `key`, if any. Most keys without `film`, `camera` or `glass` belong to a side.
#[allow(clippy::match_same_arms, reason = "an arm per group of keys is easier to scan")]
fn row(key: &str) -> Option<Limit> {
    Some(match key {
        "film.width" | "film.height" => {
            Limit::between(1.0, 16_384.0, "1 to 16384 px").on(Grid::Whole)
        }
        "film.spp" => {
            Limit::between(1.0, 65_536.0, "a power of two from 1 to 65536").on(Grid::PowersOfTwo)
        }
        "film.target_error" | "camera.focal_length_mm" | "camera.f_number" | "camera.focus" => {
            ABOVE_0
        }
        "focus.distance_m" | "auto_exposure.level" => ABOVE_0,
        // Single precision holds the squares of these distances, and products of the squares with sizes.
        "glass.distance_m" => Limit::above_0_to(1.0e15, "above 0 and at most 1e15 m"),
        "depth_unit_m" | "unit_m" | "intrinsics.fx" | "intrinsics.fy" => ABOVE_0,
        "film.order_tolerance" | "camera.aperture_radius_m" | "camera.white_balance" => FROM_0,
        "exposure" | "illuminant" => FROM_0,
        "glass.thickness_m" | "layers.glass_m" | "layers.gap_m" => THICKNESS_M,
        "glass.absorption_per_m" | "layers.absorption_per_m" => ABSORPTION_PER_M,
        "glass.ior" | "layers.ior" => Limit::between(1.0, 10.0, "1 to 10"),
        "coatings.reflectance" | "coatings.reflectance_back" | "coatings.transmittance" => SHARE,
        "smudges.coverage" | "smudges.haze" | "smudges.transmittance" => SHARE,
        // Smaller marks exceed the precision of the tracer's texel coordinates.
        "smudges.mark_m" => Limit::between(0.001, 1000.0, "0.001 to 1000 m"),
        "smudges.width_m" | "cards.distance_m" | "cards.width_m" => SIZE_M,
        "smudges.center_m" | "cards.center_m" => PLACE_M,
        "glass.roughness" | "smudges.roughness" => Limit::between(0.0, 0.1, "0 to 0.1"),
        "glass.bow_radius_m" | "outline.x_m" | "outline.y_m" => FINITE,
        "outline.frame_m" => FROM_0,
        "outline.frame_radiance" => Limit::between(0.0, 1.0e9, "0 to 1e9"),
        // The phase of shorter waves exceeds single precision.
        "wave.length_m" => Limit::between(1.0e-5, 1.0e6, "1e-5 to 1e6 m"),
        "wave.amplitude_m" => Limit::between(0.0, 1.0e4, "0 to 1e4 m"),
        "wedge_deg" => Limit::between(-5.0, 5.0, "-5 to 5 degrees"),
        "wave.direction_deg" => Limit::between(-360.0, 360.0, "-360 to 360 degrees"),
        "photographer.distance_m" | "photographer.width_m" | "gap_m" | "view_width" => ABOVE_0,
        "photographer.offset_m" | "view_x" | "view_y" => FINITE,
        "frame.frame_m" | "frame.frame_radiance" => FROM_0,
        "glass.tilt_deg" => BELOW_90_DEG,
        "auto_exposure.percentile" => PERCENTILE,
        "exposure_ev" => Limit::between(-30.0, 30.0, "-30 to 30 stops"),
        // In this range, the light of a black body has no negative channel and its formula holds.
        "illuminant_k" => Limit::between(2000.0, 25_000.0, "2000 to 25000 K"),
        "intrinsics.cx" | "intrinsics.cy" | "depth_none_code" => FINITE,
        "intrinsics.size" => Limit::between(1.0, 4_294_967_295.0, "at least 1 px"),
        // The tracer accepts coordinates up to this limit.
        "pose.translation_m" => Limit::between(-1.0e7, 1.0e7, "-1e7 to 1e7"),
        "depth_m" | "plane_m" | "wall_m" => RELATIVE_DEPTH_M,
        "camera_height_m" => Limit::between(0.01, 1000.0, "0.01 to 1000 m"),
        "horizon" => SHARE,
        "field_of_view_deg" => Limit::between(1.0, 170.0, "1 to 170 degrees"),
        "yaw_deg" => Limit::between(-360.0, 360.0, "-360 to 360 degrees"),
        "pitch_deg" => Limit::between(-90.0, 90.0, "-90 to 90 degrees"),
        _ => return key.strip_prefix("sensor.").and_then(row_of_sensor),
    })
}

/// Returns the limit of the row `sensor.KEY`, if any.
#[allow(clippy::match_same_arms, reason = "an arm per group of keys is easier to scan")]
fn row_of_sensor(key: &str) -> Option<Limit> {
    Some(match key {
        "exposure.factor" | "exposure.level" => Limit::between(1e-6, 1e6, "1e-6 to 1e6"),
        "exposure.percentile" => PERCENTILE,
        "blur_px" => Limit::between(0.0, 20.0, "0 to 20 px"),
        "gain_dn_per_e" => Limit::between(1e-4, 1e4, "1e-4 to 1e4 DN per electron"),
        "full_well_e" => Limit::between(1.0, 1e9, "1 to 1e9 electrons"),
        "bits" => Limit::between(8.0, 16.0, "8 to 16").on(Grid::Whole),
        "black_level_dn" => Limit::between(0.0, 65_534.0, "0 to 65534 DN").on(Grid::Whole),
        "read_noise_dn" | "row_noise_dn" => Limit::between(0.0, 1e4, "0 to 10000 DN"),
        // The variance is infinite from -0.5 downwards, and the distribution is bounded above 0.5.
        "read_noise_lambda" => Limit::between(-0.4, 0.5, "-0.4 to 0.5"),
        "white_balance" | "white_balance_error" => Limit::between(0.1, 10.0, "0.1 to 10"),
        "colour_matrix" => Limit::between(-10.0, 10.0, "-10 to 10"),
        "tone.gamma" | "gamma" => Limit::between(0.2, 5.0, "0.2 to 5"),
        "tone.s_curve" | "s_curve" => Limit::between(-0.9, 0.9, "-0.9 to 0.9"),
        "tone.filmic" | "filmic" => Limit::between(0.01, 100.0, "0.01 to 100"),
        "scale" => Limit::between(0.05, 1.0, "0.05 to 1"),
        "sharpen" => Limit::between(0.0, 5.0, "0 to 5"),
        "sharpen_px" => Limit::between(0.1, 20.0, "0.1 to 20 px"),
        "jpeg_quality" => Limit::between(1.0, 100.0, "1 to 100").on(Grid::Whole),
        _ => return None,
    })
}

/// Returns the limit of a number by its key in a scene line or recipe, such as `glass.tilt_deg[1]`, `front.exposure` or
/// `sources.diode.intrinsics.fx`. Ignores indices, and uses the row of the longest suffix of `key` in the table.
///
/// # Panics
///
/// If the table has no row for `key`; every new number needs a row.
pub fn limit_of(key: &str) -> Limit {
    let without_indices: String =
        key.split('[').map(|part| part.split_once(']').map_or(part, |(_, rest)| rest)).collect();
    let mut end = without_indices.as_str();
    loop {
        if let Some(limit) = row(end) {
            return limit;
        }
        let Some((_, rest)) = end.split_once('.') else {
            panic!("{key} has no row in the table of limits");
        };
        end = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_find_their_row() {
        for (key, allowed) in [
            ("film.spp", "a power of two from 1 to 65536"),
            ("glass.tilt_deg[1]", "above -90 and below 90 degrees"),
            ("glass.distance_m", "above 0 and at most 1e15 m"),
            ("glass.layers[3].gap_m", "0 to 100 m"),
            ("cover.plant.gap_m", "finite and above 0"),
            ("camera.exposure", "finite and at least 0"),
            ("back.exposure_ev", "-30 to 30 stops"),
            ("back.depth_m", "0.001 to 1e6 m"),
            ("sources.diode.depth_unit_m", "finite and above 0"),
            ("sources.diode.intrinsics.cx", "finite"),
        ] {
            assert_eq!(limit_of(key).allowed, allowed, "{key}");
        }
    }

    #[test]
    fn limits_contain_their_ends_and_their_grid() {
        let spp = limit_of("film.spp");
        assert_eq!(
            [1.0, 96.0, 256.0, 256.5, 65_536.0, 131_072.0, 0.0].map(|v| spp.contains(v)),
            [true, false, true, false, true, false, false]
        );
        let tilt = limit_of("glass.tilt_deg[0]");
        assert_eq!(
            [-90.0, -89.9, f64::NAN, 90.0].map(|v| tilt.contains(v)),
            [false, true, false, false]
        );
        assert!(!limit_of("intrinsics.cx").contains(f64::INFINITY));
    }
}
