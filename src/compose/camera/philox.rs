//! Random words of a sensor, as a pure function of seed and photosite: Philox4x32-7.
//!
//! Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011.

use render::trace::Isa;

const MULTIPLIERS: [u32; 2] = [0xd251_1f53, 0xcd9e_8d57];
const KEY_STEPS: [u32; 2] = [0x9e37_79b9, 0xbb67_ae85];
/// The authors recommend 10; 7 is the least number with which all tests of TestU01's BigCrush pass.
const ROUNDS: usize = 7;

/// Returns the four words of a counter, for a key.
#[inline]
pub(super) fn philox(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..ROUNDS {
        let product = |k: usize, word: u32| u64::from(MULTIPLIERS[k]) * u64::from(word);
        let [a, b] = [product(0, counter[0]), product(1, counter[2])];
        let high = |product: u64| (product >> 32) as u32;
        counter =
            [high(b) ^ counter[1] ^ key[0], b as u32, high(a) ^ counter[3] ^ key[1], a as u32];
        key = [key[0].wrapping_add(KEY_STEPS[0]), key[1].wrapping_add(KEY_STEPS[1])];
    }
    counter
}

/// Counters whose words are computed together.
const LANES: usize = 16;

/// The first three words of the counters of a row.
pub(super) struct RowWords(Vec<[[u32; LANES]; 3]>);

impl RowWords {
    /// Makes room for a row of `width` counters.
    pub(super) fn new(width: usize) -> Self {
        Self(vec![[[0; LANES]; 3]; width.div_ceil(LANES)])
    }

    /// Computes the words of the counters [x, rest] for x from 0 to the row's width - 1. All instruction sets yield the same words.
    pub(super) fn fill(&mut self, rest: [u32; 3], key: [u32; 2], isa: Isa) {
        match isa {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code, reason = "calls code of an instruction set that was detected")]
            Isa::Avx2 | Isa::Avx512 if Isa::Avx2.is_available() => {
                // SAFETY: this machine has AVX2.
                unsafe { fill_avx2(&mut self.0, rest, key) }
            }
            _ => fill(&mut self.0, rest, key),
        }
    }

    /// Returns the three words of a column.
    #[inline]
    pub(super) fn at(&self, x: usize) -> [u32; 3] {
        self.0[x / LANES].map(|words| words[x % LANES])
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn fill_avx2(row: &mut [[[u32; LANES]; 3]], rest: [u32; 3], key: [u32; 2]) {
    fill(row, rest, key);
}

#[inline(always)]
fn fill(row: &mut [[[u32; LANES]; 3]], rest: [u32; 3], key: [u32; 2]) {
    for (part, out) in row.iter_mut().enumerate() {
        let mut counters = [[0; LANES], [rest[0]; LANES], [rest[1]; LANES], [rest[2]; LANES]];
        for (k, counter) in counters[0].iter_mut().enumerate() {
            *counter = (part * LANES + k) as u32;
        }
        let mut key = key;
        for _ in 0..ROUNDS {
            let [c0, c1, c2, c3] = &mut counters;
            for k in 0..LANES {
                let a = u64::from(MULTIPLIERS[0]) * u64::from(c0[k]);
                let b = u64::from(MULTIPLIERS[1]) * u64::from(c2[k]);
                let (high_a, high_b) = ((a >> 32) as u32, (b >> 32) as u32);
                (c0[k], c1[k], c2[k], c3[k]) =
                    (high_b ^ c1[k] ^ key[0], b as u32, high_a ^ c3[k] ^ key[1], a as u32);
            }
            key = [key[0].wrapping_add(KEY_STEPS[0]), key[1].wrapping_add(KEY_STEPS[1])];
        }
        out.copy_from_slice(&counters[..3]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known answers of the authors' library Random123 (`kat_vectors`, philox4x32 7).
    #[test]
    fn words_are_those_of_the_published_test_vectors() {
        assert_eq!(philox([0; 4], [0; 2]), [0x5f6f_b709, 0x0d89_3f64, 0x4f12_1f81, 0x4f73_0a48]);
        assert_eq!(
            philox([u32::MAX; 4], [u32::MAX; 2]),
            [0x5207_ddc2, 0x4516_5e59, 0x4d8e_e751, 0x8c52_f662]
        );
        assert_eq!(
            philox(
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                [0xa409_3822, 0x299f_31d0]
            ),
            [0x4dfc_caba, 0x190a_87f0, 0xc473_62ba, 0xb6b5_242a]
        );
    }
    #[test]
    fn rows_have_the_words_of_their_counters() {
        for isa in [Isa::Baseline, Isa::detect()] {
            let mut row = RowWords::new(53);
            row.fill([7, 8, 9], [10, 11], isa);
            for x in 0..53 {
                assert_eq!(row.at(x), philox([x as u32, 7, 8, 9], [10, 11])[..3]);
            }
        }
    }
}
