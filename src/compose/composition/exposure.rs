//! Exposure: the factor that gives a percentile of the input its level.

use super::draw::DrawnExposure;

impl DrawnExposure {
    /// Returns the factor of all layers for an input of three planes and the mean luminance of its front. The level is
    /// uniform in the part of its range in which the front's mean lies in the range `front_mean`; without such a part it
    /// is the end of its range that is nearest to it. Returns 1 for a black input.
    pub(super) fn factor(&self, input: &[f32], front_mean: f64) -> f64 {
        let top = f64::from(percentile_of(input, self.percentile));
        if top <= 0.0 {
            return 1.0;
        }
        let [low, high] = self.level;
        // A black front has a mean of 0 at any level.
        let [least, most] = if front_mean > 0.0 {
            self.front_mean.map(|mean| (mean * top / front_mean).clamp(low, high))
        } else {
            [low, high]
        };
        (least + (most - least) * self.place) / top
    }
}

/// Returns the percentile, from 0 to 100, of the pixels' brightest channels: the value of the nearest rank.
pub(super) fn percentile_of(planes: &[f32], percentile: f64) -> f32 {
    render::merge::percentile(brightest(planes), percentile)
}

/// Iterates over the brightest channels of all pixels; 0 in place of negative ones.
pub(crate) fn brightest(planes: &[f32]) -> impl Iterator<Item = f32> {
    let pixels = planes.len() / 3;
    let [red, green, blue] = [0, 1, 2].map(|channel| &planes[channel * pixels..][..pixels]);
    red.iter().zip(green).zip(blue).map(|((r, g), b)| r.max(*g).max(*b).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exposure(place: f64) -> DrawnExposure {
        DrawnExposure { percentile: 90.0, place, level: [0.1, 1.3], front_mean: [0.03, 0.4] }
    }

    #[test]
    fn percentiles_are_of_the_brightest_channels() {
        let mut planes = vec![0.0; 303];
        for pixel in 0..101 {
            planes[(pixel * 7 % 3) * 101 + pixel] = pixel as f32;
        }
        assert_eq!(
            [0.0, 50.0, 93.0, 100.0].map(|p| percentile_of(&planes, p)),
            [0.0, 50.0, 93.0, 100.0]
        );
    }

    #[test]
    fn levels_keep_the_fronts_mean_in_its_range() {
        let input = vec![2.0; 30];
        // The percentile is 2, so a factor of 0.05 to 0.65 gives a level from 0.1 to 1.3.
        let factor = |place, front_mean| exposure(place).factor(&input, front_mean);
        assert_eq!([0.0, 1.0].map(|place| factor(place, 0.6)), [0.05, 0.65]);
        // The front's mean allows factors from 0.03 / 0.2 and up to 0.4 / 2.
        assert!((factor(0.0, 0.2) - 0.15).abs() < 1e-12);
        assert!((factor(1.0, 2.0) - 0.2).abs() < 1e-12);
        // No level gives a mean of 0.03, or one as low as 0.4.
        assert_eq!([0.0, 0.5, 1.0].map(|place| factor(place, 0.01)), [0.65; 3]);
        assert_eq!(factor(0.3, 100.0), 0.05);
        assert_eq!(exposure(0.5).factor(&[0.0; 30], 0.0), 1.0);
        assert!((factor(0.5, 0.0) - 0.35).abs() < 1e-12);
    }
}
