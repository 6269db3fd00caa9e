//! Finds the largest code of 16 bits in depth images. Many data sets mean "no depth" by it, and not a distance.

use super::far::is_metric;
use super::place::Placed;
use crate::line::{DepthKind, Intrinsics, Photograph, Side};

/// Largest code of 16 bits.
const LARGEST: f64 = 65535.0;

/// A larger share of a depth image is no accident.
const SHARE: f64 = 0.001;

/// Returns the share of a photograph's pixels whose depth is that of the largest code, if it is above 0.1 %. Holes and
/// masked pixels do not count, nor do relative depths, which use their whole range.
pub(super) fn largest_code_share(side: &Side, placed: &Placed) -> Option<f64> {
    let (Side::Photograph(line), Placed::Sheet(sheet)) = (side, placed) else {
        return None;
    };
    let code_m = code_m(line)?;
    // A depth is at most the distance along the ray.
    let [least, _] = sheet.grid.extremes();
    if line.depth_kind == DepthKind::Z && least > inverse(code_m) {
        return None;
    }
    let depths = sheet.inverse_depths_per_m().zip(&*sheet.valid).enumerate();
    let count = depths
        .filter(|&(at, (w, valid))| {
            let of_pixel =
                || along_axis(line, &sheet.intrinsics, at % sheet.width, at / sheet.width);
            *valid && w == inverse(code_m / of_pixel())
        })
        .count();
    above(count, sheet.width * sheet.height)
}

/// Returns the share of a depth image's depths in metres that are those of the largest code, if it is above 0.1 %.
pub(super) fn largest_code_share_of(line: &Photograph, depths_m: &[f64]) -> Option<f64> {
    let code_m = code_m(line)?;
    above(depths_m.iter().filter(|depth_m| **depth_m == code_m).count(), depths_m.len())
}

/// Returns the depth of the largest code, m; `None` for a relative depth.
fn code_m(line: &Photograph) -> Option<f64> {
    is_metric(line).then_some(LARGEST * line.depth_unit_m)
}

/// Returns the ratio of the distance along the ray to that along the axis, or 1 for depths along the axis.
fn along_axis(line: &Photograph, intrinsics: &Intrinsics, column: usize, row: usize) -> f64 {
    match line.depth_kind {
        DepthKind::Distance => super::depth::secant(intrinsics, column, row),
        _ => 1.0,
    }
}

fn inverse(depth_m: f64) -> f32 {
    (1.0 / depth_m) as f32
}

fn above(count: usize, pixels: usize) -> Option<f64> {
    let share = count as f64 / pixels as f64;
    (share > SHARE).then_some(share)
}

/// Formats the remark on a photograph.
pub(super) fn largest_code_text(what: &str, share: f64) -> String {
    format!(
        "{what}: {:.1} % of its depth image have the largest code, 65535, which often means \"no depth\", but is a surface \
         here: if so, write \"depth_none_code\": 65535, or mask these pixels out",
        100.0 * share
    )
}
