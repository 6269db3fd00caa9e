//! Counts of photons: Poisson numbers below a mean of 50, and normal ones from there.

use crate::quantiles::Quantiles;
use std::sync::LazyLock;

/// Mean from which numbers are normal.
pub(super) const NORMAL_FROM: f32 = 50.0;

/// 2^32: the number of random words.
const WORDS: f64 = 4_294_967_296.0;
/// Words of one entry of a guide.
const GUIDE_BITS: u32 = 24;
/// Tables per unit of the mean. With more of them, the rest of a mean is smaller, and its number nearly always 0.
const PER_UNIT: f32 = 8.0;

/// Poisson numbers of one mean.
struct Poisson {
    /// The number of a word is the number of entries up to the word.
    ends: Vec<u32>,
    /// The number of the first word of each 2^24.
    guide: [u8; 1 << (32 - GUIDE_BITS)],
}

/// Poisson numbers of the multiples of 1 / [`PER_UNIT`] below [`NORMAL_FROM`].
pub(super) struct Photons {
    tables: Vec<Poisson>,
    normal: &'static Quantiles,
}

static PHOTONS: LazyLock<Photons> = LazyLock::new(|| {
    let mean = |k: u32| f64::from(k) / f64::from(PER_UNIT);
    Photons {
        tables: (0..(NORMAL_FROM * PER_UNIT) as u32).map(|k| Poisson::new(mean(k))).collect(),
        normal: Quantiles::normal(),
    }
});

/// Makes the table that is otherwise made at its first use.
pub(crate) fn prepare() {
    LazyLock::force(&PHOTONS);
}

impl Poisson {
    fn new(mean: f64) -> Self {
        let mut ends: Vec<u32> = Vec::new();
        let mut share = libm::exp(-mean);
        let mut below = share;
        while below * WORDS < WORDS - 0.5 && ends.len() < 200 {
            ends.push((below * WORDS) as u32);
            share *= mean / ends.len() as f64;
            below += share;
        }
        let number = |word: u32| ends.partition_point(|end| *end <= word) as u8;
        let guide = std::array::from_fn(|k| number((k as u32) << GUIDE_BITS));
        Self { ends, guide }
    }

    #[inline]
    fn of(&self, word: u32) -> u32 {
        let mut number = u32::from(self.guide[(word >> GUIDE_BITS) as usize]);
        while self.ends.get(number as usize).is_some_and(|end| *end <= word) {
            number += 1;
        }
        number
    }
}

/// Returns the Poisson number of a word for a mean from 0 to 1 / [`PER_UNIT`].
#[inline]
fn of_rest(mean: f64, word: u32) -> u32 {
    let place = (f64::from(word) + 0.5) / WORDS;
    // exp(-mean), with a relative error below 1e-9.
    let series = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0];
    let mut share = series.iter().fold(-1.0 / 720.0, |sum, term| term - mean * sum);
    share = 1.0 - mean * share;
    let mut below = share;
    let mut number = 0;
    while place >= below && number < 10 {
        number += 1;
        share *= mean / f64::from(number);
        below += share;
    }
    number
}

impl Photons {
    pub(super) fn tables() -> &'static Self {
        &PHOTONS
    }

    /// Returns the electrons of a photosite with a mean of `mean`.
    ///
    /// Below a mean of 50, it is the sum of two Poisson numbers, of a multiple of 1/8 and of the rest of the mean, which is a
    /// Poisson number. From 50 on, it is a normal number with the same variance.
    #[inline]
    pub(super) fn electrons(&self, mean: f32, words: [u32; 2]) -> f32 {
        if mean >= NORMAL_FROM {
            return mean + mean.sqrt() * self.normal.of(words[0]);
        }
        let mean = mean.max(0.0);
        let place = (mean * PER_UNIT) as usize;
        let rest = mean - place as f32 / PER_UNIT;
        (self.tables[place].of(words[0]) + of_rest(f64::from(rest), words[1])) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::super::philox::philox;
    use super::*;

    fn counts(mean: f32, count: u32) -> impl Iterator<Item = f32> {
        (0..count).map(move |k| {
            let [a, b, ..] = philox([k, 0, 0, 0], [7, mean.to_bits()]);
            Photons::tables().electrons(mean, [a, b])
        })
    }

    #[test]
    fn numbers_have_the_shares_of_poisson() {
        const COUNT: u32 = 200_000;
        for mean in [0.0f32, 0.02, 0.7, 1.0, 3.3, 12.0, 30.6, 49.99] {
            let mut found = vec![0u32; 200];
            counts(mean, COUNT).for_each(|number| found[number as usize] += 1);
            // Pearson's test over all numbers that are expected at least five times, and the rest together.
            let (mut share, mut chi_square, mut freedom) = (libm::exp(-f64::from(mean)), 0.0, 0);
            let (mut rest, mut rest_found) = (1.0, COUNT);
            for (number, found) in found.iter().enumerate() {
                let expected = share * f64::from(COUNT);
                if expected >= 5.0 {
                    chi_square += (f64::from(*found) - expected).powi(2) / expected;
                    freedom += 1;
                    rest -= share;
                    rest_found -= found;
                }
                share *= f64::from(mean) / (number + 1) as f64;
            }
            let expected = rest.max(0.0) * f64::from(COUNT);
            assert!((f64::from(rest_found) - expected).abs() < 6.0 * (expected + 5.0).sqrt());
            let freedom = f64::from(freedom);
            let bound = freedom + 4.0 * (2.0 * freedom).sqrt();
            assert!(chi_square < bound, "mean {mean}: chi^2 {chi_square} of {freedom}");
        }
    }

    #[test]
    fn mean_and_variance_are_the_mean() {
        for mean in [0.3f32, 8.0, 47.0, 50.0, 400.0, 1e5] {
            let numbers: Vec<f64> = counts(mean, 300_000).map(f64::from).collect();
            let count = numbers.len() as f64;
            let found = numbers.iter().sum::<f64>() / count;
            let variance = numbers.iter().map(|v| (v - found).powi(2)).sum::<f64>() / count;
            let mean = f64::from(mean);
            assert!((found - mean).abs() < 4.0 * (mean / count).sqrt(), "{mean}: {found}");
            assert!((variance / mean - 1.0).abs() < 0.012, "{mean}: {variance}");
        }
    }
}
