//! Separation of photographs at a reduced size: networks work at the size of their training examples, and the
//! photographs keep their detail.

use examples::Picture;
use glasshouse_line::color::{SrgbEncoder, srgb_to_linear};
use image::{Rgb, RgbImage};
use rayon::prelude::*;

/// Sizes at which networks process a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorkSize {
    /// Longest side of the picture for the networks, px; larger pictures are scaled down. `None` for the full size.
    pub longest_px: Option<u32>,
    /// Side of the overlapping tiles of a picture that is still larger, px; `None` for whole pictures.
    pub tile_px: Option<u32>,
}

/// Adds a change of codes, computed at a smaller size, to a picture. Enlarges the change linearly, which keeps its sign: a
/// network that does not brighten the small picture does not brighten the large one.
pub(super) fn changed(picture: &RgbImage, change: &Picture) -> RgbImage {
    by_pixels(picture.dimensions().into(), change, |x, y, change| {
        let Rgb(before) = picture.get_pixel(x, y);
        [0, 1, 2].map(|c| f32::from(before[c]) + 255.0 * change[c])
    })
}

/// Enlarges a picture of codes linearly.
pub(super) fn enlarged(picture: &Picture, size: [u32; 2]) -> RgbImage {
    by_pixels(size, picture, |_, _, codes| codes.map(|code| 255.0 * code))
}

/// Returns the codes of the light of `input` less that of `transmission`, at least 0: what a network with T* alone says
/// of R~.
pub(super) fn difference_of_light(input: &RgbImage, transmission: &RgbImage) -> RgbImage {
    let encoder = SrgbEncoder::new();
    let light: Vec<f32> = (0..=255).map(srgb_to_linear).collect();
    let mut out = input.clone();
    out.par_iter_mut().zip(transmission.par_iter()).with_min_len(1 << 14).for_each(|(i, t)| {
        *i = encoder.encode((light[usize::from(*i)] - light[usize::from(*t)]).max(0.0));
    });
    out
}

/// Makes a picture of `size` from the linearly enlarged values of `small` (half-pixel centres) at each pixel. `codes`
/// returns codes from 0 to 255; others are limited.
fn by_pixels(
    [width, height]: [u32; 2],
    small: &Picture,
    codes: impl Fn(u32, u32, [f32; 3]) -> [f32; 3] + Sync,
) -> RgbImage {
    let across = places(small.columns, width);
    let down = places(small.rows, height);
    let mut out = RgbImage::new(width, height);
    let rows = out.par_chunks_exact_mut(3 * width as usize).zip(&down).enumerate();
    rows.for_each(|(y, (row, down))| {
        for ((x, pixel), across) in row.chunks_exact_mut(3).enumerate().zip(&across) {
            let values = [0, 1, 2].map(|channel| {
                let plane = &small.planes[channel * small.rows * small.columns..];
                let line = |row: usize| {
                    let line = &plane[row * small.columns..];
                    line[across.first] + across.share * (line[across.second] - line[across.first])
                };
                let (above, below) = (line(down.first), line(down.second));
                above + down.share * (below - above)
            });
            let found = codes(x as u32, y as u32, values);
            for (code, value) in pixel.iter_mut().zip(found) {
                *code = value.clamp(0.0, 255.0).round() as u8;
            }
        }
    });
    out
}

/// Two neighbouring samples of the small picture, and the share of the second.
struct Place {
    first: usize,
    second: usize,
    share: f32,
}

fn places(from: usize, to: u32) -> Vec<Place> {
    let scale = from as f64 / f64::from(to);
    let place = |k: u32| {
        let at = ((f64::from(k) + 0.5) * scale - 0.5).clamp(0.0, (from - 1) as f64);
        let first = at as usize;
        Place { first, second: (first + 1).min(from - 1), share: (at - first as f64) as f32 }
    };
    (0..to).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small(rows: usize, columns: usize, value: impl Fn(usize, usize, usize) -> f32) -> Picture {
        let mut planes = Vec::new();
        for c in 0..3 {
            for y in 0..rows {
                planes.extend((0..columns).map(|x| value(c, x, y)));
            }
        }
        Picture { rows, columns, planes }
    }

    #[test]
    fn a_ramp_is_enlarged_to_a_ramp() {
        let picture = small(4, 8, |c, x, _| (x as f32 + c as f32) / 255.0 * 8.0);
        let large = enlarged(&picture, [64, 32]);
        // The centre of column x is at (x + 0.5) / 8 - 0.5 of the small picture.
        for x in 4..60 {
            let expected = 8.0 * ((f64::from(x) + 0.5) / 8.0 - 0.5);
            for c in 0..3 {
                let found = f64::from(large.get_pixel(x, 17)[c]);
                assert!((found - (expected + 8.0 * c as f64)).abs() <= 0.5 + 1e-4);
            }
        }
    }

    #[test]
    fn no_change_keeps_every_code_and_a_darkening_brightens_none() {
        let picture =
            RgbImage::from_fn(45, 33, |x, y| Rgb([x * 5, y * 7, x * y % 256].map(|v| v as u8)));
        assert_eq!(changed(&picture, &small(5, 7, |_, _, _| 0.0)), picture);
        let change = small(5, 7, |c, x, y| ((c * 31 + x * 17 + y * 23) % 10) as f32 / -50.0);
        let darker = changed(&picture, &change);
        assert!(darker.iter().zip(picture.iter()).all(|(after, before)| after <= before));
        assert_ne!(darker, picture);
        let r = difference_of_light(&picture, &darker);
        // The light of both parts is the light of the picture, to the rounding of two codes.
        for ((i, t), r) in picture.iter().zip(darker.iter()).zip(r.iter()) {
            let sum = srgb_to_linear(*t) + srgb_to_linear(*r);
            assert!((sum - srgb_to_linear(*i)).abs() < 0.005, "{i} {t} {r}");
        }
    }
}
