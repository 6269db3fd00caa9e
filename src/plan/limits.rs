//! Ranges of a recipe's numbers: those declared with the keys of lines, and those of words that only recipes have.

use glasshouse_line::keys;
use glasshouse_line::limits::Limit;
use std::ops::Bound::{Excluded, Included, Unbounded};

const ABOVE_0: Limit = Limit::from_to(Excluded(0.0), Unbounded, "finite and above 0");
const FROM_0: Limit = Limit::from_to(Included(0.0), Unbounded, "finite and at least 0");
const FINITE: Limit = Limit::from_to(Unbounded, Unbounded, "finite");

/// Returns the limit of a word of recipes, if any. `sensor.filmic` is the exposure of that curve.
fn of_words(key: &str) -> Option<Limit> {
    Some(match key {
        "photographer.distance_m"
        | "photographer.width_m"
        | "gap_m"
        | "view_width"
        | "auto_exposure.level" => ABOVE_0,
        "photographer.offset_m" | "view_x" | "view_y" => FINITE,
        "frame.frame_m" | "frame.frame_radiance" => FROM_0,
        "auto_exposure.percentile" => {
            Limit::from_to(Excluded(0.0), Included(100.0), "above 0 and at most 100")
        }
        "exposure_ev" => Limit::between(-30.0, 30.0, "-30 to 30 stops"),
        // In this range, the light of a black body has no negative channel and its formula holds.
        "illuminant_k" => Limit::between(2000.0, 25_000.0, "2000 to 25000 K"),
        "sensor.filmic" => keys::limit_of("sensor.tone.filmic.exposure")?,
        "field_of_view_deg" => Limit::between(1.0, 170.0, "1 to 170 degrees"),
        _ => return None,
    })
}

/// Where a line has the number of a recipe's key with another path.
const ELSEWHERE: [&str; 3] = ["front", "front.sketch", "sensor.tone.parametric"];

/// Returns the limit of a number by its key in a recipe, such as `glass.tilt_deg[1]` or `sources.diode.intrinsics.fx`. Ignores
/// indices, and uses the longest known end of `key`.
///
/// # Panics
///
/// If neither lines nor words have a number with this key.
pub(super) fn limit_of(key: &str) -> Limit {
    let without_indices: String =
        key.split('[').map(|part| part.split_once(']').map_or(part, |(_, rest)| rest)).collect();
    let mut end = without_indices.as_str();
    loop {
        let elsewhere = || ELSEWHERE.iter().find_map(|at| keys::limit_of(&format!("{at}.{end}")));
        if let Some(limit) = keys::limit_of(end).or_else(|| of_words(end)).or_else(elsewhere) {
            return limit;
        }
        let Some((_, rest)) = end.split_once('.') else {
            panic!("{key} has no range");
        };
        end = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_find_their_range() {
        for (key, allowed) in [
            ("film.spp", "a power of two from 1 to 65536"),
            ("glass.tilt_deg[1]", "above -90 and below 90 degrees"),
            ("cover.plant.gap_m", "finite and above 0"),
            ("cover.plant.exposure", "finite and at least 0"),
            ("cover.photographer.offset_m[0]", "finite"),
            ("cover.frame.frame_m", "finite and at least 0"),
            ("back.exposure_ev", "-30 to 30 stops"),
            ("sources.diode.depth_unit_m", "finite and above 0"),
            ("sources.diode.intrinsics.cx", "finite"),
            ("sources.folder.depth.wall_m", "0.001 to 1e6 m"),
            ("sensor.gamma", "0.2 to 5"),
            ("sensor.filmic", "0.01 to 100"),
            ("sensor.exposure.percentile", "above 0 and at most 100"),
            ("sensor.white_balance_error[2]", "0.1 to 10"),
        ] {
            assert_eq!(limit_of(key).allowed, allowed, "{key}");
        }
    }
}
