//! Develops raw planes: white balance, colours, curve, size and sharpness.

use super::matrix::scaled;
use crate::blur::blurred;
use crate::curve::Curve;
use crate::resample::resample;
use glasshouse_line::Sensor;

/// The development of a sensor's values.
#[derive(Clone, Debug)]
pub(super) struct Development {
    balance: [f32; 3],
    matrix: [[f32; 3]; 3],
    curve: Curve,
    sharpen: f32,
    sharpen_px: f64,
}

impl Development {
    pub(super) fn new(sensor: &Sensor) -> Self {
        Self {
            balance: sensor.white_balance.map(|gain| gain as f32),
            matrix: scaled(&sensor.colour_matrix, sensor.white_balance_error),
            curve: Curve::of(sensor.tone),
            sharpen: sensor.sharpen as f32,
            sharpen_px: sensor.sharpen_px,
        }
    }

    /// Turns raw planes into codes. Balanced values above 1 become 1, so that clipped light is white, not magenta.
    pub(super) fn apply(&self, planes: &mut [f32]) {
        let pixels = planes.len() / 3;
        let (red, rest) = planes.split_at_mut(pixels);
        let (green, blue) = rest.split_at_mut(pixels);
        let [of_red, of_green, of_blue] = self.matrix;
        for ((red, green), blue) in red.iter_mut().zip(green).zip(blue) {
            let r = (*red * self.balance[0]).min(1.0);
            let g = (*green * self.balance[1]).min(1.0);
            let b = (*blue * self.balance[2]).min(1.0);
            let dot = |row: [f32; 3]| row[0] * r + row[1] * g + row[2] * b;
            (*red, *green, *blue) = (dot(of_red), dot(of_green), dot(of_blue));
        }
        self.curve.apply(planes);
    }

    /// Scales codes down and sharpens them.
    pub(super) fn finish(&self, planes: Vec<f32>, from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
        let mut planes = if from == to { planes } else { resample(&planes, from, to) };
        if self.sharpen > 0.0 {
            let soft = blurred(&planes, to, self.sharpen_px);
            for (value, soft) in planes.iter_mut().zip(&soft) {
                *value = (*value + self.sharpen * (*value - soft)).clamp(0.0, 1.0);
            }
        }
        planes
    }
}
