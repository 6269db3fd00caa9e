//! Owen-scrambled Sobol points as a pure function of (scene seed, pixel, sample index).
//!
//! A sample has four coordinates: a pair for the pixel and a pair for the lens. Both pairs use the first two Sobol
//! dimensions, which form a (0,2)-sequence: each aligned power-of-two block of indices puts exactly one point into
//! every elementary interval of its size. *Padding* decorrelates the pairs: each pair has its own Owen shuffle of the
//! index and its own Owen scramble of the values. (A plain xor of the index is not enough: it makes the lens point a
//! function of the pixel point, and the error stops decreasing at 16 samples.)
//!
//! Source: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020. The hash is that of Laine and Karras with
//! Vegdahl's constants. Limits: indices below 2^32, 24 bits per coordinate.

use super::lanes::{LANES, Lane};
use super::scene::Sampling;
use crate::hash::{GOLDEN_GAMMA, mix64};

/// Largest number of samples in a call of `block`. Longer sample ranges consist of whole blocks.
pub const BLOCK: usize = 256;

/// Seeds of one pixel: one per pair for the index shuffle, and one per coordinate for the scramble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelSeed {
    index: [u32; 2],
    value: [u32; 4],
}

impl PixelSeed {
    /// Derives the seeds of pixel (`x`, `y`) from the scene's seed.
    pub fn new(scene_seed: u64, x: u32, y: u32) -> Self {
        let pixel = mix64(u64::from(x) | u64::from(y) << 32);
        let key = mix64(scene_seed.wrapping_add(GOLDEN_GAMMA) ^ pixel);
        let word = |k: u64| (mix64(key.wrapping_add(k.wrapping_mul(GOLDEN_GAMMA))) >> 32) as u32;
        Self { index: [word(1), word(2)], value: [word(3), word(4), word(5), word(6)] }
    }
}

/// Applies the Laine-Karras permutation: an Owen scramble of a bit-reversed number.
#[inline(always)]
const fn laine_karras(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// Computes the bit-reversed second Sobol coordinate of `index` (direction numbers of x + 1: the Pascal matrix).
const fn sobol_1_reversed(mut index: u32) -> u32 {
    let mut column = 1u32 << 31;
    let mut value = 0;
    while index != 0 {
        if index & 1 == 1 {
            value ^= column;
        }
        column ^= column >> 1;
        index >>= 1;
    }
    value.reverse_bits()
}

/// [`sobol_1_reversed`] of every low byte. It is linear over xor, so callers add the share of the other bits by xor.
static LOW_BYTE: [u32; 256] = {
    let mut table = [0; 256];
    let mut i = 0;
    while i < 256 {
        table[i] = sobol_1_reversed(i as u32);
        i += 1;
    }
    table
};

/// Converts the 24 high bits to a number in [0, 1).
#[inline(always)]
fn unit(x: u32) -> f32 {
    (x >> 8) as i32 as f32 * (1.0 / 16_777_216.0)
}

/// Computes sample `index` of a pixel: `[pixel x, pixel y, lens u, lens v]`, each in [0, 1).
///
/// This function defines the samples; `block` computes the same bits for sixteen samples at a time.
pub fn sample(seed: &PixelSeed, index: u32) -> [f32; 4] {
    let mut point = [0.0; 4];
    for pair in 0..2 {
        let shuffled = laine_karras(index.reverse_bits(), seed.index[pair]).reverse_bits();
        point[2 * pair] = unit(laine_karras(shuffled, seed.value[2 * pair]).reverse_bits());
        let second = sobol_1_reversed(shuffled);
        point[2 * pair + 1] = unit(laine_karras(second, seed.value[2 * pair + 1]).reverse_bits());
    }
    point
}

/// Computes samples `first .. first + 16 * u.len()` of one pair (0: pixel, 1: lens).
///
/// `first` is a multiple of 16, and all samples lie in the same aligned block of 256.
#[inline(always)]
pub(crate) fn block(seed: &PixelSeed, pair: usize, first: u32, u: &mut [Lane], v: &mut [Lane]) {
    debug_assert!(u.len() == v.len() && (first as usize % BLOCK) + LANES * u.len() <= BLOCK);
    // An Owen shuffle keeps aligned power-of-two blocks together: within 256 samples the upper 24 bits of the shuffled
    // index are constant, and so is their share of the second coordinate.
    let high = laine_karras(first.reverse_bits(), seed.index[pair]).reverse_bits() & !0xff;
    let high_part = sobol_1_reversed(high);
    let (seed_u, seed_v) = (seed.value[2 * pair], seed.value[2 * pair + 1]);
    for (group, (u, v)) in u.iter_mut().zip(v).enumerate() {
        let start = first + (group * LANES) as u32;
        let mut shuffled = [0u32; LANES];
        let mut second = [0u32; LANES];
        for l in 0..LANES {
            let index = start + l as u32;
            shuffled[l] = laine_karras(index.reverse_bits(), seed.index[pair]).reverse_bits();
        }
        for l in 0..LANES {
            second[l] = LOW_BYTE[(shuffled[l] & 0xff) as usize];
        }
        for l in 0..LANES {
            u[l] = unit(laine_karras(shuffled[l], seed_u).reverse_bits());
            v[l] = unit(laine_karras(second[l] ^ high_part, seed_v).reverse_bits());
        }
    }
}

/// Computes samples of either kind, with the arguments of [`block`].
#[inline(always)]
pub(crate) fn points(
    sampling: Sampling,
    seed: &PixelSeed,
    pair: usize,
    first: u32,
    u: &mut [Lane],
    v: &mut [Lane],
) {
    match sampling {
        Sampling::Sobol => block(seed, pair, first, u, v),
        Sampling::Independent => independent(seed, pair, first, u, v),
    }
}

/// Mixes all 32 bits (Wellons, "Prospecting for Hash Functions", lowbias32).
#[inline(always)]
const fn mix32(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Computes independent points: each coordinate is a hash of its seed and the index. After a single round, pixels with
/// equal upper key bits would have the same points in another order, so two rounds use two keys.
#[inline(always)]
fn independent(seed: &PixelSeed, pair: usize, first: u32, u: &mut [Lane], v: &mut [Lane]) {
    let (key_u, key_v) = (seed.value[2 * pair], seed.value[2 * pair + 1]);
    let coordinate = |index: u32, key: u32| unit(mix32(mix32(index ^ key) ^ seed.index[pair]));
    for (group, (u, v)) in u.iter_mut().zip(v).enumerate() {
        let start = first + (group * LANES) as u32;
        for l in 0..LANES {
            u[l] = coordinate(start + l as u32, key_u);
            v[l] = coordinate(start + l as u32, key_v);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Independent points have the mean, variance, correlations and cell counts of uniform random numbers.
    #[test]
    fn independent_points_are_uniform_and_uncorrelated() {
        const N: usize = 4096;
        let (mut sum, mut square, mut count) = (0.0, 0.0, 0.0);
        let (mut across, mut ahead, mut between) = (0.0, 0.0, 0.0);
        let mut cells = [0u32; 64];
        let mut before = vec![0.0; N];
        for x in 0..16 {
            let seed = PixelSeed::new(9, x, 4);
            let (mut u, mut v) = (vec![[0.0; LANES]; N / LANES], vec![[0.0; LANES]; N / LANES]);
            independent(&seed, 1, 0, &mut u, &mut v);
            let (u, v) = (u.as_flattened(), v.as_flattened());
            for i in 0..N {
                assert!((0.0..1.0).contains(&u[i]) && (0.0..1.0).contains(&v[i]));
                let (a, b) = (f64::from(u[i]) - 0.5, f64::from(v[i]) - 0.5);
                sum += a + b;
                square += a * a + b * b;
                across += a * b;
                ahead += a * (f64::from(u[(i + 1) % N]) - 0.5);
                between += a * before[i];
                before[i] = a;
                count += 1.0;
                cells[(u[i] * 8.0) as usize * 8 + (v[i] * 8.0) as usize] += 1;
            }
        }
        // The mean of k numbers has the standard deviation 1/sqrt(12 k); every bound is five standard deviations.
        let n = f64::sqrt(count);
        assert!((sum / (2.0 * count)).abs() < 5.0 * 0.205 / n);
        assert!((square / (2.0 * count) - 1.0 / 12.0).abs() < 5.0 * 0.053 / n);
        for product in [across, ahead, between] {
            assert!((product / count).abs() < 5.0 / 12.0 / n, "{product}");
        }
        let expected = count / 64.0;
        let chi_square: f64 = cells
            .iter()
            .map(|&c| (f64::from(c) - expected) * (f64::from(c) - expected) / expected)
            .sum();
        // Chi square with 63 degrees of freedom is 63 +- 11; stratified points would yield almost 0.
        assert!((20.0..130.0).contains(&chi_square), "{chi_square}");
    }

    #[test]
    fn blocks_equal_the_definition() {
        let seed = PixelSeed::new(412, 17, 203);
        for first in [0u32, 256, 65_280, 16 * 3] {
            let groups = if first % 256 == 0 { 16 } else { 2 };
            for pair in 0..2 {
                let (mut u, mut v) = (vec![[0.0; LANES]; groups], vec![[0.0; LANES]; groups]);
                block(&seed, pair, first, &mut u, &mut v);
                for i in 0..groups * LANES {
                    let expected = sample(&seed, first + i as u32);
                    assert_eq!(u[i / LANES][i % LANES], expected[2 * pair]);
                    assert_eq!(v[i / LANES][i % LANES], expected[2 * pair + 1]);
                }
            }
        }
    }
}
