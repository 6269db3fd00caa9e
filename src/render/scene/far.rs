//! Finds depths that are probably in another unit than the scene line says.

use super::depth;
use super::largest_code::{largest_code_share_of, largest_code_text};
use super::photograph::codes;
use super::place::Placed;
use crate::formats::{NamedBytes, SceneError};
use glasshouse_line::{DepthKind, Photograph, Side};

/// A median depth above this is probably a mistake: photographs with depth show nearer things, and millimetres that are
/// read as metres are a thousand times too far.
pub const FAR_MEDIAN_M: f64 = 1000.0;

/// True for depths in units of `depth_unit_m`; a relative depth has a range in metres.
pub(super) fn is_metric(line: &Photograph) -> bool {
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

/// Returns remarks on a depth file: depths that are probably in another unit, and codes that probably mean "no depth".
/// The mask is not applied; a photograph with a mask has no remark on codes. `what` names the file.
pub fn depth_remarks(
    line: &Photograph,
    file: &NamedBytes,
    what: &str,
) -> Result<Vec<String>, SceneError> {
    if !is_metric(line) {
        return Ok(vec![]);
    }
    let depths_m = depth::decode(file, line.orientation, codes(line))?.z_m;
    let code_share = largest_code_share_of(line, &depths_m).filter(|_| line.mask.is_none());
    let far_m = far_median(depths_m.into_iter().filter(|&z| z > 0.0 && z < f64::INFINITY));
    let far = far_m.map(|far_m| far_text(what, far_m));
    Ok(far.into_iter().chain(code_share.map(|share| largest_code_text(what, share))).collect())
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
pub(super) fn far_text(what: &str, median_m: f64) -> String {
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

    fn line(keys: &str) -> Photograph {
        let camera = r#""intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}"#;
        serde_json::from_str(&format!(r#"{{"color":"c","depth":"d",{camera}{keys}}}"#)).unwrap()
    }

    fn remarks(codes: &[u16], keys: &str) -> Vec<String> {
        let words: Vec<u8> = codes.iter().flat_map(|v| v.to_le_bytes()).collect();
        let file = npy("<u2", false, &format!("(1, {})", codes.len()), &words);
        depth_remarks(&line(keys), &file, "a.npy").unwrap()
    }

    #[test]
    fn a_depth_file_in_millimetres_is_far() {
        let far = |keys: &str| remarks(&[0, 1500, 2500, 4000], keys);
        let found = far("");
        let words = "a.npy: its median depth is 2500 m; if the file holds millimetres, depth_unit_m must be 0.001";
        assert_eq!(found, [words]);
        assert!(far(r#","depth_unit_m":0.001"#).is_empty());
        assert!(far(r#","depth_kind":"relative","depth_range":{"mean_m":3}"#).is_empty());
    }

    #[test]
    fn many_pixels_with_the_largest_code_are_remarked() {
        let mut codes = vec![1000; 2000];
        let millimetres = r#","depth_unit_m":0.001"#;
        codes[..2].fill(65535);
        assert!(remarks(&codes, millimetres).is_empty());
        codes[..30].fill(65535);
        let found = remarks(&codes, millimetres);
        assert!(found[0].starts_with("a.npy: 1.5 % of its depth image"), "{found:?}");
        assert!(found[0].contains("65535") && found[0].contains(r#""depth_none_code": 65535"#));
        assert_eq!(found.len(), 1);
        // The unit needs no exact binary fraction, and the kind may be the distance.
        for keys in
            [r#","depth_unit_m":0.001953125"#, r#","depth_unit_m":0.0003,"depth_kind":"distance""#]
        {
            assert_eq!(remarks(&codes, keys).len(), 1, "{keys}");
        }
        for keys in [
            r#","depth_unit_m":0.001,"mask":"m""#,
            r#","depth_unit_m":0.001,"depth_none_code":65535"#,
            r#","depth_kind":"relative","depth_range":{"mean_m":3}"#,
        ] {
            assert!(remarks(&codes, keys).is_empty(), "{keys}");
        }
    }
}
