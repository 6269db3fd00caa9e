//! SplitMix64 (Steele, Lea and Flood 2014), the 64-bit hash that generates the seeds of samples and the random numbers
//! of procedural pictures and simulations.

/// 2^64 / golden ratio, odd: the increment of SplitMix64's state.
pub const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// Mixes all bits: SplitMix64's finaliser, a bijection with `mix64(0) == 0`.
#[inline]
pub const fn mix64(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Returns the output of one SplitMix64 step from the state `key`: a hash that does not map 0 to 0.
#[inline]
pub const fn splitmix64(key: u64) -> u64 {
    mix64(key.wrapping_add(GOLDEN_GAMMA))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expected numbers are the first outputs of the reference, prng.di.unimi.it/splitmix64.c, from state 1234567.
    #[test]
    fn numbers_match_the_reference() {
        let drawn = [0u64, 1, 2]
            .map(|k| splitmix64(1_234_567u64.wrapping_add(k.wrapping_mul(GOLDEN_GAMMA))));
        assert_eq!(
            drawn,
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
    }
}
