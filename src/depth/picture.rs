//! Pictures as the network sees them.

use super::config::PATCH_PX;
use image::RgbImage;
use train::candle_core::{Device, Result, Tensor};

/// Shorter side at which the network works, px.
const SIDE_PX: u32 = 518;
/// Means and standard deviations of ImageNet's colours, which the weights expect.
const MEANS: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATIONS: [f32; 3] = [0.229, 0.224, 0.225];

/// Returns the size at which the network sees a picture: the shorter side near 518 px, the aspect kept, whole patches.
pub(crate) fn working_px([width, height]: [u32; 2]) -> [u32; 2] {
    let scale = f64::from(SIDE_PX) / f64::from(width.min(height));
    let patch = PATCH_PX as f64;
    [width, height].map(|side| {
        let patches = (f64::from(side) * scale / patch).round().max(1.0);
        (patches * patch) as u32
    })
}

/// Scales a picture and normalises it to planes (3, rows, columns).
pub(crate) fn planes(picture: RgbImage) -> Result<Tensor> {
    let [width, height] = working_px(picture.dimensions().into());
    let small = compose::resize(picture, [width, height]);
    let channel = |c: usize| {
        let pixels = small.as_raw().iter().skip(c).step_by(3);
        pixels.map(move |code| (f32::from(*code) / 255.0 - MEANS[c]) / DEVIATIONS[c])
    };
    let values: Vec<f32> = (0..3).flat_map(channel).collect();
    Tensor::from_vec(values, (3, height as usize, width as usize), &Device::Cpu)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_keep_the_aspect_in_whole_patches() {
        assert_eq!(working_px([518, 518]), [518, 518]);
        assert_eq!(working_px([4000, 3000]), [686, 518]);
        assert_eq!(working_px([300, 900]), [518, 1554]);
        assert_eq!(working_px([1, 1]), [518, 518]);
    }
}
