//! The keys of a recipe that are numbers.

use glasshouse_line::keys::{Row, declared_rows};
use std::collections::BTreeSet;
use std::sync::LazyLock;

/// Keys of [`super::recipe::Recipe::numbers`] that are not declared with the keys of lines.
pub(super) const OTHERS: [&str; 48] = [
    "cover.photographer.distance_m",
    "cover.photographer.width_m",
    "cover.photographer.offset_m[0]",
    "cover.photographer.offset_m[1]",
    "cover.photographer.exposure",
    "cover.blind.gap_m",
    "cover.blind.view_width",
    "cover.blind.view_x",
    "cover.blind.view_y",
    "cover.blind.exposure",
    "cover.curtain.gap_m",
    "cover.curtain.view_width",
    "cover.curtain.view_x",
    "cover.curtain.view_y",
    "cover.curtain.exposure",
    "cover.plant.gap_m",
    "cover.plant.view_width",
    "cover.plant.view_x",
    "cover.plant.view_y",
    "cover.plant.exposure",
    "cover.frame.view_x[0]",
    "cover.frame.view_x[1]",
    "cover.frame.view_y[0]",
    "cover.frame.view_y[1]",
    "cover.frame.frame_m",
    "cover.frame.frame_radiance",
    "sensor.exposure.factor",
    "sensor.exposure.percentile",
    "sensor.exposure.level",
    "sensor.gain_dn_per_e",
    "sensor.full_well_e",
    "sensor.blur_px",
    "sensor.white_balance_error[0]",
    "sensor.white_balance_error[1]",
    "sensor.white_balance_error[2]",
    "sensor.gamma",
    "sensor.s_curve",
    "sensor.filmic",
    "sensor.scale",
    "sensor.sharpen",
    "sensor.sharpen_px",
    "sensor.jpeg_quality",
    "front.exposure",
    "front.exposure_ev",
    "front.illuminant_k",
    "back.exposure",
    "back.exposure_ev",
    "back.illuminant_k",
];

/// True for the key of a number that a recipe may have, with the index of an element of a list.
pub(super) fn is_number(key: &str) -> bool {
    static DECLARED: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
        let rows = declared_rows();
        rows.iter().filter(|row| row.in_recipes).flat_map(Row::paths).collect()
    });
    DECLARED.contains(key) || OTHERS.contains(&key)
}
