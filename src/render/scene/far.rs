//! Finds depths that are probably in another unit than the scene line says.

use super::depth;
use super::place::Placed;
use crate::formats::{NamedBytes, SceneError};
use crate::line::{DepthKind, Photograph, Side};

/// A median depth above this is probably a mistake: photographs with depth show nearer things, and millimetres that are
/// read as metres are a thousand times too far.
pub const FAR_MEDIAN_M: f64 = 1000.0;

/// True for depths in units of `depth_unit_m`; a relative depth has a range in metres.
fn is_metric(line: &Photograph) -> bool {
    matches!(line.depth_kind, DepthKind::Z | DepthKind::Distance)
}

/// Returns the median of a photograph's valid metric depths, m, if it is above [`FAR_MEDIAN_M`].
pub(super) fn far_median_m(side: &Side, placed: &Placed) -> Option<f64> {
    let (Side::Photograph(line), Placed::Sheet(sheet)) = (side, placed) else {
        return None;
    };
    // No depth is far if the farthest is not.
    let [least, _] = sheet.grid.extremes();
    if !is_metric(line) || 1.0 / f64::from(least) <= FAR_MEDIAN_M {
        return None;
    }
    let pixels = sheet.inverse_depths_per_m().zip(&*sheet.valid);
    far_median(pixels.filter(|(_, valid)| **valid).map(|(w, _)| 1.0 / f64::from(w)))
}

/// Returns the median of a depth file's metric depths, m, if it is above [`FAR_MEDIAN_M`]. The mask is not applied.
pub fn far_depth_m(line: &Photograph, file: &NamedBytes) -> Result<Option<f64>, SceneError> {
    if !is_metric(line) {
        return Ok(None);
    }
    let depth = depth::decode(file, line.orientation, line.depth_unit_m)?;
    Ok(far_median(depth.z_m.into_iter().filter(|&z| z > 0.0 && z < f64::INFINITY)))
}

/// Returns the upper median of the depths, if it is above [`FAR_MEDIAN_M`].
fn far_median(depths_m: impl Iterator<Item = f64>) -> Option<f64> {
    let mut count = 0usize;
    let mut far: Vec<f64> =
        depths_m.inspect(|_| count += 1).filter(|&z| z > FAR_MEDIAN_M).collect();
    // The upper median is the element count / 2; those before it are nearer.
    let near = count - far.len();
    let at = (count / 2).checked_sub(near).filter(|at| *at < far.len())?;
    Some(*far.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// Formats the remark on a far photograph.
pub fn far_text(what: &str, median_m: f64) -> String {
    format!(
        "{what}: its median depth is {median_m:.0} m; if the file holds millimetres, depth_unit_m must be 0.001"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::npy::tests::npy;

    #[test]
    fn only_a_median_above_a_kilometre_is_far() {
        let far = |depths: &[f64]| far_median(depths.iter().copied());
        assert_eq!(far(&[]), None);
        assert_eq!(far(&[1.0, 2.0, 5000.0]), None);
        assert_eq!(far(&[1.0, 3000.0, 2000.0]), Some(2000.0));
        assert_eq!(far(&[4000.0, 1500.0]), Some(4000.0));
        assert_eq!(far(&[1000.0; 3]), None);
    }

    #[test]
    fn a_depth_file_in_millimetres_is_far() {
        let line = |keys: &str| -> Photograph {
            let camera = r#""intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}"#;
            serde_json::from_str(&format!(r#"{{"color":"c","depth":"d",{camera}{keys}}}"#)).unwrap()
        };
        let words: Vec<u8> =
            [0u16, 1500, 2500, 4000].iter().flat_map(|v| v.to_le_bytes()).collect();
        let file = npy("<u2", false, "(2, 2)", &words);
        let far = |keys: &str| far_depth_m(&line(keys), &file).unwrap();
        assert_eq!(far(""), Some(2500.0));
        assert_eq!(far(r#","depth_unit_m":0.001"#), None);
        assert_eq!(far(r#","depth_kind":"relative","depth_range":{"mean_m":3}"#), None);
        let text = far_text("front photograph", 2500.0);
        assert!(text.contains("2500 m") && text.contains("depth_unit_m must be 0.001"), "{text}");
    }
}
