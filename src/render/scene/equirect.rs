//! Finds the pixels of a direction in an equirectangular image and interpolates between them.
//!
//! Columns are longitudes, rows latitudes. The capture coordinates of a side (+x right, +y down, +z forward) are those
//! of the panorama at yaw 0 and pitch 0: +z is the image's centre, +x the column a quarter of the width to its right,
//! and +y the lowest row. A direction d is at
//!
//! ```text
//! u = W (1/2 + atan2(d_x, d_z) / (2 pi)),      v = H (1/2 + atan2(d_y, sqrt(d_x^2 + d_z^2)) / pi)
//! ```
//!
//! with the image's corner at (0, 0) and the centre of pixel (i, j) at (i + 0.5, j + 0.5). The side borders meet.
//! The first and the last row are repeated beyond the centres of their pixels.

use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// Returns the rotation from a view's coordinates to the panorama's: the view rises by `pitch_deg`, then turns right by
/// `yaw_deg`.
pub(super) fn rotation(yaw_deg: f64, pitch_deg: f64) -> DMat3 {
    let (sin_yaw, cos_yaw) = libm::sincos(yaw_deg.to_radians());
    let (sin_pitch, cos_pitch) = libm::sincos(pitch_deg.to_radians());
    let rise = DMat3::from_cols(
        DVec3::X,
        DVec3::new(0.0, cos_pitch, sin_pitch),
        DVec3::new(0.0, -sin_pitch, cos_pitch),
    );
    let turn = DMat3::from_cols(
        DVec3::new(cos_yaw, 0.0, -sin_yaw),
        DVec3::Y,
        DVec3::new(sin_yaw, 0.0, cos_yaw),
    );
    turn * rise
}

/// The four pixels around a direction: two columns and two rows, with the weights of the second column and row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taps {
    columns: [usize; 2],
    rows: [usize; 2],
    fraction: [f64; 2],
}

impl Taps {
    /// Finds the pixels around direction `d`, of any length above 0, in an image of `width` x `height` pixels.
    pub(super) fn new(d: DVec3, width: usize, height: usize) -> Self {
        let longitude = libm::atan2(d.x, d.z);
        let latitude = libm::atan2(d.y, (d.x * d.x + d.z * d.z).sqrt());
        // `u` and `v` are relative to the first pixel's centre.
        let u = width as f64 * (0.5 + longitude / (2.0 * PI)) - 0.5;
        let last = (height - 1) as f64;
        let v = (height as f64 * (0.5 + latitude / PI) - 0.5).clamp(0.0, last);
        let left = u.floor();
        let column = (left as i64).rem_euclid(width as i64) as usize;
        let row = v.floor() as usize;
        Self {
            columns: [column, (column + 1) % width],
            rows: [row, (row + 1).min(height - 1)],
            fraction: [u - left, v - v.floor()],
        }
    }

    /// Returns the indices of the four pixels in an image of this width, with their weights, which add up to 1.
    pub(super) fn weights(&self, width: usize) -> [(usize, f64); 4] {
        let [fu, fv] = self.fraction;
        let at = |row: usize, column: usize| self.rows[row] * width + self.columns[column];
        [
            (at(0, 0), (1.0 - fu) * (1.0 - fv)),
            (at(0, 1), fu * (1.0 - fv)),
            (at(1, 0), (1.0 - fu) * fv),
            (at(1, 1), fu * fv),
        ]
    }

    /// Interpolates red, green and blue bilinearly.
    pub(super) fn color(&self, pixels: &[[f32; 4]], width: usize) -> [f32; 4] {
        let mut sum = [0.0f64; 3];
        for (at, weight) in self.weights(width) {
            for (sum, value) in sum.iter_mut().zip(pixels[at]) {
                *sum += weight * f64::from(value);
            }
        }
        let [r, g, b] = sum.map(|value| value as f32);
        [r, g, b, 0.0]
    }

    /// Interpolates inverse distance bilinearly among the valid pixels (holes are 0). Returns a hole if the nearest
    /// pixel is a hole.
    pub(super) fn inverse_distance(&self, inverse_per_m: &[f32], width: usize) -> f64 {
        let weights = self.weights(width);
        let nearest =
            weights.iter().fold(weights[0], |best, &tap| if tap.1 > best.1 { tap } else { best });
        if inverse_per_m[nearest.0] == 0.0 {
            return 0.0;
        }
        let (mut sum, mut total) = (0.0, 0.0);
        for (at, weight) in weights {
            let value = f64::from(inverse_per_m[at]);
            if value > 0.0 {
                sum += weight * value;
                total += weight;
            }
        }
        sum / total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the position in an image of 8 x 4 pixels, with the corner at (0, 0).
    fn place(d: DVec3) -> [f64; 2] {
        let taps = Taps::new(d, 8, 4);
        let u = taps.columns[0] as f64 + taps.fraction[0] + 0.5;
        let v = taps.rows[0] as f64 + taps.fraction[1] + 0.5;
        [u.rem_euclid(8.0), v]
    }

    #[test]
    fn the_axes_follow_the_convention() {
        for (d, expected) in [
            (DVec3::Z, [4.0, 2.0]),
            (DVec3::X, [6.0, 2.0]),
            (DVec3::NEG_X, [2.0, 2.0]),
            (DVec3::new(1.0, 0.0, 1.0), [5.0, 2.0]),
            // 45 degrees down: a quarter of the rows below the middle.
            (DVec3::new(0.0, 1.0, 1.0), [4.0, 3.0]),
            // The poles are at the centres of the outermost rows.
            (DVec3::Y, [4.0, 3.5]),
            (DVec3::NEG_Y, [4.0, 0.5]),
            (DVec3::NEG_Z, [0.0, 2.0]),
        ] {
            let found = place(d * 7.0);
            let off = (found[0] - expected[0]).abs() + (found[1] - expected[1]).abs();
            assert!(off < 1e-12, "{d}: {found:?}");
        }
    }

    #[test]
    fn the_left_and_right_borders_meet() {
        let row: Vec<[f32; 4]> = (0..8u8).map(|i| [f32::from(i), 0.0, 1.0, 0.0]).collect();
        let pixels = [row.clone(), row.clone(), row.clone(), row].concat();
        // The backward direction is between the last column and the first column.
        let behind = Taps::new(DVec3::NEG_Z, 8, 4).color(&pixels, 8);
        assert_eq!(behind, [3.5, 0.0, 1.0, 0.0]);
        let taps = Taps::new(DVec3::new(-0.0, 0.0, -1.0), 8, 4);
        assert_eq!(taps.color(&pixels, 8), behind);
    }

    #[test]
    fn a_view_rises_and_turns_to_the_right() {
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-15, "{a} {b}");
        near(rotation(90.0, 0.0) * DVec3::Z, DVec3::X);
        near(rotation(0.0, 90.0) * DVec3::Z, DVec3::NEG_Y);
        near(rotation(90.0, 90.0) * DVec3::X, DVec3::NEG_Z);
        // The view rises and then turns about the vertical, so that the horizon stays level.
        let half = 0.5f64.sqrt();
        near(rotation(90.0, 45.0) * DVec3::Z, DVec3::new(half, -half, 0.0));
        near(rotation(30.0, 45.0) * DVec3::X * DVec3::Y, DVec3::ZERO);
        let turned = rotation(123.0, -34.0);
        assert!((turned * turned.transpose() - DMat3::IDENTITY).abs_diff_eq(DMat3::ZERO, 1e-15));
    }

    #[test]
    fn holes_are_not_interpolated() {
        // An image of 4 x 2 pixels with two equal rows; column 1 is a hole.
        let inverse = [1.0f32, 0.0, 0.5, 0.25, 1.0, 0.0, 0.5, 0.25];
        let at = |u: f64| {
            let longitude = (u / 4.0 - 0.5) * 2.0 * PI;
            let d = DVec3::new(libm::sin(longitude), 0.0, libm::cos(longitude));
            Taps::new(d, 4, 2).inverse_distance(&inverse, 4)
        };
        assert!((at(0.75) - 1.0).abs() < 1e-12, "beside the hole: {}", at(0.75));
        assert_eq!(at(1.25), 0.0);
        assert!((at(3.0) - 0.375).abs() < 1e-12);
        assert!((at(4.0) - 0.625).abs() < 1e-12);
    }
}
