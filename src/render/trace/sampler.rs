//! Owen-scrambled Sobol points as a pure function of (scene seed, pixel, sample index).
//!
//! A sample has four coordinates: a pair for the pixel and a pair for the lens; behind rough glass, it has another pair for each face that
//! its path meets, and one for smudges. All pairs use the first two Sobol dimensions, which form a (0,2)-sequence: each aligned power-of-two block of indices puts exactly one point into
//! every elementary interval of its size. *Padding* decorrelates the pairs: each pair has its own Owen shuffle of the
//! index and its own Owen scramble of the values. (A plain xor of the index is not enough: it makes the lens point a
//! function of the pixel point, and the error stops decreasing at 16 samples.)
//!
//! Source: Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020. The hash is that of Laine and Karras with
//! Vegdahl's constants. Limits: indices below 2^32, 24 bits per coordinate.

use super::lanes::{LANES, Lane};
use super::scene::Sampling;
use glasshouse_line::hash::{GOLDEN_GAMMA, mix64};

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

/// Computes the bit-reversed second Sobol coordinate of `index`. Its direction numbers are those of x + 1, the Pascal matrix, so
/// that the coordinate is the Taylor shift p(x) -> p(x + 1) over GF(2) of the polynomial with the index's bits.
#[inline(always)]
const fn sobol_1_reversed(mut index: u32) -> u32 {
    index ^= index >> 16;
    index ^= (index >> 8) & 0x00ff_00ff;
    index ^= (index >> 4) & 0x0f0f_0f0f;
    index ^= (index >> 2) & 0x3333_3333;
    index ^ ((index >> 1) & 0x5555_5555)
}

/// Converts the 24 high bits to a number in [0, 1).
#[inline(always)]
fn unit(x: u32) -> f32 {
    (x >> 8) as i32 as f32 * (1.0 / 16_777_216.0)
}

/// Computes sample `index` of a pixel: `[pixel x, pixel y, lens u, lens v]`, each in [0, 1).
///
/// This function defines the samples; `points` computes the same bits for sixteen pixels at a time.
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

/// Seeds of sixteen pixels.
pub(crate) struct SeedLanes {
    index: [[u32; LANES]; 2],
    value: [[u32; LANES]; 4],
}

impl SeedLanes {
    /// Arranges the seeds that `of` returns for each lane.
    #[inline(always)]
    pub(crate) fn new(of: impl Fn(usize) -> PixelSeed) -> Self {
        let (mut index, mut value) = ([[0; LANES]; 2], [[0; LANES]; 4]);
        for l in 0..LANES {
            let seed = of(l);
            (0..2).for_each(|k| index[k][l] = seed.index[k]);
            (0..4).for_each(|k| value[k][l] = seed.value[k]);
        }
        Self { index, value }
    }
}

impl PixelSeed {
    /// Derives the seeds whose first pair is that of the facet at meeting `k` of a path with rough faces.
    #[must_use]
    pub fn of_meeting(&self, k: u32) -> Self {
        let salt = mix32(k.wrapping_add(1));
        let derive = |seed: u32| mix32(seed ^ salt);
        Self { index: self.index.map(derive), value: self.value.map(derive) }
    }
}

impl SeedLanes {
    /// Computes [`PixelSeed::of_meeting`] of each lane.
    #[inline(always)]
    pub(crate) fn of_meeting(&self, k: u32) -> Self {
        let salt = mix32(k.wrapping_add(1));
        let (mut index, mut value) = (self.index, self.value);
        for seed in index.as_flattened_mut().iter_mut().chain(value.as_flattened_mut()) {
            *seed = mix32(*seed ^ salt);
        }
        Self { index, value }
    }
}

/// Computes samples `first .. first + u.len()` of one pair (0: pixel, 1: lens) for sixteen pixels.
#[inline(always)]
pub(crate) fn points(
    sampling: Sampling,
    seeds: &SeedLanes,
    pair: usize,
    first: u32,
    u: &mut [Lane],
    v: &mut [Lane],
) {
    match sampling {
        Sampling::Sobol => sobol(seeds, pair, first, u, v),
        Sampling::Independent => independent(seeds, pair, first, u, v),
    }
}

#[inline(always)]
fn sobol(seeds: &SeedLanes, pair: usize, first: u32, u: &mut [Lane], v: &mut [Lane]) {
    let (index, [seed_u, seed_v]) =
        (&seeds.index[pair], [&seeds.value[2 * pair], &seeds.value[2 * pair + 1]]);
    for (sample, (u, v)) in (first..).zip(u.iter_mut().zip(v)) {
        let reversed = sample.reverse_bits();
        let mut shuffled = [0u32; LANES];
        for l in 0..LANES {
            shuffled[l] = laine_karras(reversed, index[l]).reverse_bits();
        }
        for l in 0..LANES {
            u[l] = unit(laine_karras(shuffled[l], seed_u[l]).reverse_bits());
        }
        for l in 0..LANES {
            v[l] = unit(laine_karras(sobol_1_reversed(shuffled[l]), seed_v[l]).reverse_bits());
        }
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
fn independent(seeds: &SeedLanes, pair: usize, first: u32, u: &mut [Lane], v: &mut [Lane]) {
    let (key_u, key_v) = (&seeds.value[2 * pair], &seeds.value[2 * pair + 1]);
    let second_key = &seeds.index[pair];
    let coordinate = |sample: u32, key: u32, second: u32| unit(mix32(mix32(sample ^ key) ^ second));
    for (sample, (u, v)) in (first..).zip(u.iter_mut().zip(v)) {
        for l in 0..LANES {
            u[l] = coordinate(sample, key_u[l], second_key[l]);
            v[l] = coordinate(sample, key_v[l], second_key[l]);
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
        let seeds = SeedLanes::new(|x| PixelSeed::new(9, x as u32, 4));
        let (mut all_u, mut all_v) = (vec![[0.0; LANES]; N], vec![[0.0; LANES]; N]);
        independent(&seeds, 1, 0, &mut all_u, &mut all_v);
        for x in 0..LANES {
            let of = |all: &[Lane]| all.iter().map(|lanes| lanes[x]).collect::<Vec<f32>>();
            let (u, v) = (of(&all_u), of(&all_v));
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
    fn lanes_equal_the_definition() {
        let pixel = |l: usize| PixelSeed::new(412, 17 + l as u32, 203);
        let seeds = SeedLanes::new(pixel);
        for first in [0u32, 256, 65_280, 16 * 3, 5] {
            for pair in 0..2 {
                let (mut u, mut v) = ([[0.0; LANES]; 11], [[0.0; LANES]; 11]);
                sobol(&seeds, pair, first, &mut u, &mut v);
                for (s, l) in (0..11).flat_map(|s| (0..LANES).map(move |l| (s, l))) {
                    let expected = sample(&pixel(l), first + s as u32);
                    assert_eq!([u[s][l], v[s][l]], [expected[2 * pair], expected[2 * pair + 1]]);
                }
            }
        }
    }

    /// The pair of a facet is a (0,2)-sequence of its own: independent of the pairs of pixel, lens and other facets.
    #[test]
    fn facets_have_points_of_their_own() {
        const N: usize = 256;
        let mut sums = [[0.0; 6]; 6];
        for x in 0..64 {
            let seed = PixelSeed::new(7, x, 3);
            let lanes = SeedLanes::new(|_| seed).of_meeting(2);
            let (mut u, mut v) = (vec![[0.0; LANES]; N], vec![[0.0; LANES]; N]);
            sobol(&lanes, 0, 0, &mut u, &mut v);
            let mut cells = [0; N];
            for (i, (u, v)) in (0..).zip(u.iter().zip(&v)) {
                let [fx, fy, lx, ly] = sample(&seed, i);
                let facets = [2, 5].map(|k| sample(&seed.of_meeting(k), i));
                assert_eq!([u[0], v[0]], [facets[0][0], facets[0][1]]);
                cells[(u[0] * 16.0) as usize * 16 + (v[0] * 16.0) as usize] += 1;
                let all = [fx, fy, lx + ly, facets[0][0], facets[0][1], facets[1][0]];
                for (j, k) in (0..6).flat_map(|j| (0..j).map(move |k| (j, k))) {
                    let centre = |a: usize| f64::from(all[a]) - if a == 2 { 1.0 } else { 0.5 };
                    sums[j][k] += centre(j) * centre(k);
                }
            }
            assert_eq!(cells, [1; N]);
        }
        // Independent pairs of N points correlate by 1 / (12 sqrt N) at most, as random points do.
        let bound = 5.0 * 2f64.sqrt() / 12.0 / ((64 * N) as f64).sqrt();
        for sum in sums.as_flattened() {
            assert!((sum / (64 * N) as f64).abs() < bound, "{sums:?}");
        }
    }

    /// The Taylor shift has the direction numbers of Sobol's second dimension: 1, 11, 101, 1111, ...
    #[test]
    fn the_second_coordinate_has_the_direction_numbers_of_sobol() {
        let mut direction = 1u32 << 31;
        for bit in 0..32 {
            assert_eq!(sobol_1_reversed(1 << bit).reverse_bits(), direction);
            direction ^= direction >> 1;
        }
        let xor = |a: u32, b: u32| sobol_1_reversed(a) ^ sobol_1_reversed(b);
        assert_eq!(sobol_1_reversed(0x1234_5678 ^ 0x0f0f_3333), xor(0x1234_5678, 0x0f0f_3333));
    }
}
