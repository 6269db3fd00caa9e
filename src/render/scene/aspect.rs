//! Finds depth images with another aspect ratio than their colour image.

use super::place::Placed;
use serde::{Deserialize, Serialize};

/// Aspect ratios that differ by a larger factor are probably a mistake, such as a turned or a cropped depth image.
const FACTOR: f64 = 1.05;

/// Sizes of a photograph's upright images, if their aspect ratios differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct OtherAspect {
    /// Width and height of the colour image, px.
    pub color_px: [usize; 2],
    /// Width and height of the depth image, px.
    pub depth_px: [usize; 2],
}

impl OtherAspect {
    /// Compares two sizes. Returns `None` if their aspect ratios differ by a factor of at most 1.05.
    pub fn find(color_px: [usize; 2], depth_px: [usize; 2]) -> Option<Self> {
        let aspect = |[width, height]: [usize; 2]| width as f64 / height as f64;
        let factor = aspect(color_px) / aspect(depth_px);
        (factor.max(1.0 / factor) > FACTOR).then_some(Self { color_px, depth_px })
    }

    pub(super) fn of(placed: &Placed) -> Option<Self> {
        match placed {
            Placed::Sheet(sheet) => Self::find(
                [sheet.texture.width(), sheet.texture.height()],
                [sheet.width, sheet.height],
            ),
            Placed::Mesh(_) => None,
        }
    }

    /// Formats the remark on a photograph.
    pub fn text(&self, what: &str) -> String {
        let Self { color_px: [color_w, color_h], depth_px: [depth_w, depth_h] } = self;
        format!(
            "{what}: its depth image has {depth_w}x{depth_h} pixels and its colour image {color_w}x{color_h}: the depth is \
             stretched to the shape of the colour; is it turned or cropped?"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_another_shape_is_remarked() {
        let is_other = |color, depth| OtherAspect::find(color, depth).is_some();
        assert!(!is_other([1024, 768], [256, 192]) && !is_other([640, 480], [608, 448]));
        assert!(is_other([128, 96], [96, 128]) && is_other([96, 128], [128, 96]));
        assert!(is_other([1920, 1080], [512, 424]));
        let text = OtherAspect::find([128, 96], [96, 128]).unwrap().text("front photograph");
        assert!(
            text.contains("depth image has 96x128") && text.contains("colour image 128x96"),
            "{text}"
        );
    }
}
