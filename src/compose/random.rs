//! Random numbers of training: functions of the seed, a name and a position, so checkpoints need no generator state.

/// A stream of random numbers. Streams of one seed with different names are independent.
#[derive(Clone, Debug)]
pub struct Stream {
    reader: blake3::OutputReader,
}

impl Stream {
    pub fn new(seed: u64, name: &str) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"glasshouse.train.random/1");
        hasher.update(&seed.to_le_bytes());
        hasher.update(name.as_bytes());
        Self { reader: hasher.finalize_xof() }
    }

    /// Returns 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let mut bytes = [0; 8];
        self.reader.fill(&mut bytes);
        u64::from_le_bytes(bytes)
    }

    /// Fills a slice with random bytes.
    pub fn fill(&mut self, bytes: &mut [u8]) {
        self.reader.fill(bytes);
    }

    /// Returns a uniform number above 0 and up to 1.
    pub fn unit(&mut self) -> f64 {
        ((self.bits() >> 11) as f64 + 0.5) / 9_007_199_254_740_992.0
    }

    /// Returns a uniform number in a range of finite ends.
    pub fn uniform(&mut self, [low, high]: [f64; 2]) -> f64 {
        (low + (high - low) * self.unit()).clamp(low, high)
    }

    /// Returns a number in a range of positive ends, whose logarithm is uniform.
    pub fn log_uniform(&mut self, [low, high]: [f64; 2]) -> f64 {
        libm::exp(self.uniform([libm::log(low), libm::log(high)])).clamp(low, high)
    }

    /// Returns a uniform integer from 0 to `count - 1`; `count` must be positive.
    pub fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.bits()) * count as u128) >> 64) as usize
    }

    /// Returns a standard normal number (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(self.unit())).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }

    /// Returns 0 to `count - 1` in random order (Fisher and Yates).
    pub fn permutation(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for place in (1..count).rev() {
            order.swap(place, self.below(place + 1));
        }
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ_by_name_and_seed() {
        let mut stream = Stream::new(7, "init");
        assert_eq!(stream.clone().bits(), stream.bits());
        assert_ne!(Stream::new(7, "init").bits(), Stream::new(7, "order").bits());
        assert_ne!(Stream::new(7, "init").bits(), Stream::new(8, "init").bits());
        let mut bytes = [0; 16];
        Stream::new(7, "init").fill(&mut bytes);
        assert_eq!(bytes[..8], Stream::new(7, "init").bits().to_le_bytes());
    }

    #[test]
    fn numbers_have_the_documented_distributions() {
        let mut stream = Stream::new(1, "moments");
        let values: Vec<f64> = (0..40_000).map(|_| stream.normal()).collect();
        let mean = values.iter().sum::<f64>() / 40_000.0;
        let square = values.iter().map(|v| v * v).sum::<f64>() / 40_000.0;
        assert!(mean.abs() < 0.02 && (square - 1.0).abs() < 0.03, "{mean} {square}");
        let mut counts = [0; 6];
        (0..6000).for_each(|_| counts[stream.below(6)] += 1);
        assert!(counts.iter().all(|c| (880..1120).contains(c)), "{counts:?}");
        let mut order = stream.permutation(50);
        assert_ne!(order, (0..50).collect::<Vec<_>>());
        order.sort_unstable();
        assert_eq!(order, (0..50).collect::<Vec<_>>());
        // Quarters of a range, and of its logarithm, are equally likely.
        let (mut even, mut log) = ([0; 4], [0; 4]);
        for _ in 0..8000 {
            even[(stream.uniform([2.0, 6.0]) - 2.0).min(3.9) as usize] += 1;
            log[(libm::log2(stream.log_uniform([0.5, 8.0])) + 1.0).min(3.9) as usize] += 1;
        }
        assert!(even.iter().chain(&log).all(|c| (1840..2160).contains(c)), "{even:?} {log:?}");
        assert_eq!((stream.uniform([3.0, 3.0]), stream.log_uniform([3.0, 3.0])), (3.0, 3.0));
    }
}
