//! Random numbers of procedural photographs: integer hashes of a key and a counter.

pub(super) use glasshouse_line::hash::splitmix64 as mix;

/// Hashes a lattice point, for textures and holes.
pub(super) fn lattice(x: i32, y: i32, z: i32) -> u32 {
    let mut h = (x as u32)
        .wrapping_mul(0x9E37_79B1)
        .wrapping_add((y as u32).wrapping_mul(0x85EB_CA77))
        .wrapping_add((z as u32).wrapping_mul(0xC2B2_AE3D));
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}

/// Converts a hash to a number in 0..1.
pub(super) fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A stream of random numbers, determined by its key.
#[derive(Clone, Debug)]
pub(super) struct Stream {
    key: u64,
    drawn: u64,
}

impl Stream {
    /// Creates the stream of a list of keys.
    pub(super) fn new(keys: &[u64]) -> Self {
        let key = keys.iter().fold(0, |key, &next| mix(key ^ mix(next)));
        Self { key, drawn: 0 }
    }

    /// Returns the next 64 bits.
    pub(super) fn bits(&mut self) -> u64 {
        self.drawn += 1;
        mix(self.key ^ self.drawn.wrapping_mul(0xD6E8_FEB8_6659_FD93))
    }

    /// Returns a seed for a texture.
    pub(super) fn seed(&mut self) -> i32 {
        (self.bits() >> 40) as i32
    }

    /// Returns a uniform number in 0..1.
    pub(super) fn unit(&mut self) -> f32 {
        unit((self.bits() >> 32) as u32)
    }

    /// Returns a uniform number in `low..high`.
    pub(super) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// True with probability `p`.
    pub(super) fn chance(&mut self, p: f32) -> bool {
        self.unit() < p
    }

    /// Returns a uniform integer in `0..count`.
    pub(super) fn index(&mut self, count: usize) -> usize {
        (((self.bits() >> 32) * count as u64) >> 32) as usize
    }

    /// Returns one of `choices`, each with equal probability.
    pub(super) fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.index(choices.len())]
    }
}
