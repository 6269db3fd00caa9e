//! Finds the largest code of 16 bits in depth images. Many data sets mean "no depth" by it, and not a distance.

use super::far::is_metric;
use super::place::Placed;
use glasshouse_line::{DepthKind, Intrinsics, Photograph, Side};

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::PhotographFiles;
    use crate::formats::npy::tests::npy;
    use crate::formats::raster::tests::png;
    use crate::scene::decode_photograph;
    use image::ExtendedColorType as Png;

    /// Returns the share for a photograph of 50 x 20 px whose first rows have the largest code.
    fn share(keys: &str, mask: Option<&[u8]>) -> Option<f64> {
        let camera = r#""intrinsics":{"fx":31.7,"fy":29.3,"cx":24.1,"cy":9.7}"#;
        let line = format!(r#"{{"color":"c","depth":"d",{camera}{keys}}}"#);
        let line: Photograph = serde_json::from_str(&line).unwrap();
        let codes: Vec<u16> = (0..1000).map(|k| if k < 150 { 65535 } else { 2000 + k }).collect();
        let words: Vec<u8> = codes.iter().flat_map(|code| code.to_le_bytes()).collect();
        let files = PhotographFiles {
            color: png(&[9; 1000], 50, 20, Png::L8),
            depth: npy("<u2", false, "(20, 50)", &words),
            mask: mask.map(|mask| png(mask, 50, 20, Png::L8)),
        };
        let sheet = decode_photograph(&line, &files).unwrap();
        largest_code_share(&line.into(), &Placed::Sheet(sheet))
    }

    #[test]
    fn pixels_with_the_largest_code_are_counted_after_the_mask() {
        for keys in [
            r#","depth_unit_m":0.001"#,
            r#","depth_unit_m":0.001953125"#,
            r#","depth_unit_m":0.0003,"depth_kind":"distance""#,
        ] {
            assert_eq!(share(keys, None), Some(0.15), "{keys}");
            let half: Vec<u8> = (0..1000).map(|k| u8::from(k % 100 < 50)).collect();
            assert_eq!(share(keys, Some(&half)), Some(0.1), "{keys}");
            let none: Vec<u8> = (0..1000).map(|k| u8::from(k >= 150)).collect();
            assert_eq!(share(keys, Some(&none)), None, "{keys}");
            assert_eq!(share(&format!(r#"{keys},"depth_none_code":65535"#), None), None, "{keys}");
        }
        let relative = r#","depth_kind":"relative","depth_range":{"mean_m":3}"#;
        assert_eq!(share(relative, None), None);
    }
}
