//! Sums and means of a pixel's samples: of all, of the first half, of the first quarter.
//!
//! The three say how far a mean still is from its limit (see [`square_error`]): a variance would not, for Sobol points are
//! better than independent ones by an amount that depends on the picture.

/// Linear radiance of a pixel in the four layers: I, T, R~, R.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelMeans {
    /// Mean over all of the range's samples.
    pub mean: [[f32; 3]; 4],
    /// Mean over the first half of them (of a single one, the same).
    pub half: [[f32; 3]; 4],
    /// Mean over the first quarter (of fewer than four, of the first half).
    pub quarter: [[f32; 3]; 4],
}

impl PixelMeans {
    /// All numbers, in the order in which digests take them.
    pub fn values(&self) -> impl Iterator<Item = f32> {
        let parts = [self.mean, self.half, self.quarter];
        parts.into_iter().flatten().flatten()
    }
}

/// Radiance summed over the first quarter, the second quarter and the second half of a pixel's samples.
pub(super) type Sums = [[f64; 3]; 3];

/// Means over all samples, the first half and the first quarter.
pub(super) type Means = [[f64; 3]; 3];

/// Sums or means of nothing.
pub(super) const NOTHING: [[f64; 3]; 3] = [[0.0; 3]; 3];

/// Parts that the layers are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Wanted {
    /// The front through the real glass, for I.
    pub(super) front: bool,
    /// T.
    pub(super) bare: bool,
    /// R~, also for I.
    pub(super) back: bool,
    /// R.
    pub(super) clean: bool,
}

impl Wanted {
    /// What the layers I, T, R~, R need.
    pub(super) fn of([input, transmission, glass_reflection, clean_reflection]: [bool; 4]) -> Self {
        Self {
            front: input,
            bare: transmission,
            back: input || glass_reflection,
            clean: clean_reflection,
        }
    }
}

/// The parts of a pixel; those that were not wanted are 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Components {
    pub(super) front: Means,
    pub(super) bare: Means,
    pub(super) back: Means,
    pub(super) clean: Means,
}

impl Components {
    /// I, T, R~, R. I is the sum of its parts whatever samples each took.
    pub(super) fn layers(&self) -> [Means; 4] {
        let mut input = self.front;
        add_means(&mut input, &self.back);
        [input, self.bare, self.back, self.clean]
    }

    /// As stored, for the layers that are asked for.
    pub(super) fn pixel(&self, layers: [bool; 4]) -> PixelMeans {
        let mut means = self.layers();
        for (means, _) in means.iter_mut().zip(layers).filter(|(_, asked)| !asked) {
            *means = NOTHING;
        }
        let part = |part: usize| means.map(|layer| layer[part].map(|v| v as f32));
        PixelMeans {
            mean: part(0),
            half: part(1),
            quarter: part(2),
        }
    }
}

/// `total += means`.
pub(super) fn add_means(total: &mut Means, means: &Means) {
    for (total, mean) in total.iter_mut().flatten().zip(means.iter().flatten()) {
        *total += mean;
    }
}

/// Of block `b` of `blocks`, each with `count` samples: how many belong to the first quarter of all samples, to the
/// first half, and to all.
pub(super) fn ends_in_block(count: u32, b: u32, blocks: u32) -> [u32; 3] {
    let all = count * blocks;
    [all / 4, all / 2, all].map(|end| end.saturating_sub(b * count).min(count))
}

/// Means from the sums of `count` samples.
pub(super) fn means_of(sums: &Sums, count: u32) -> Means {
    let [first, second, rest] = sums;
    let upper = [0, 1, 2].map(|c| first[c] + second[c]);
    let mean = [0, 1, 2].map(|c| (upper[c] + rest[c]) / f64::from(count));
    let half = match count / 2 {
        0 => mean,
        half => upper.map(|v| v / f64::from(half)),
    };
    let quarter = match count / 4 {
        0 => half,
        quarter => first.map(|v| v / f64::from(quarter)),
    };
    [mean, half, quarter]
}

/// Mean square error of means, from the mean squares of their last two moves: `last` of (first half - all), `before` of
/// (first quarter - first half), 0 if there is none.
///
/// Doubling the samples moves a mean; what is still missing is the sum of all moves to come. Owen scrambling makes
/// moves at different doublings uncorrelated (Owen 1997, the nested decomposition behind scrambled nets), so the mean
/// square error is the sum of their mean squares: `m (r + r^2 + ...) = m r / (1 - r)` for moves whose mean square falls
/// by r at each doubling. Two kinds come together in a picture: edges seen through the lens, for which r is 1/2 as
/// for independent samples, and what is smooth over a pixel, for which r lies between 2/11 and 1/7 (error ~
/// samples^-1.2 to -1.4; measured for R of seven photographs). Their shares a and b of the last move follow from
/// `last = a + b` and `before = 2 a + 11/2 b`; the error is `a + tail b`, with `tail` 1/6 for r = 1/7.
/// (Telling the shares apart by 7 in place of 11/2 takes a layer of r = 2/11 for a mixed one and states 1.4 times its error.)
pub fn square_error(last: f64, before: f64, tail: f64) -> f64 {
    if before == 0.0 {
        return last;
    }
    let smooth = ((before - 2.0 * last) / 3.5).clamp(0.0, last);
    (last - smooth) + smooth * tail
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_cover_blocks() {
        assert_eq!(ends_in_block(256, 0, 1), [64, 128, 256]);
        assert_eq!(ends_in_block(256, 0, 2), [128, 256, 256]);
        assert_eq!(ends_in_block(256, 1, 2), [0, 0, 256]);
        assert_eq!(ends_in_block(16, 1, 4), [0, 16, 16]);
        assert_eq!(ends_in_block(1, 0, 1), [0, 0, 1]);
    }

    #[test]
    fn means_of_few_samples() {
        let sums = [[1.0; 3], [3.0; 3], [4.0; 3]];
        assert_eq!(means_of(&sums, 4), [[2.0; 3], [2.0; 3], [1.0; 3]]);
        assert_eq!(
            means_of(&[[0.0; 3], [2.0; 3], [4.0; 3]], 2),
            [[3.0; 3], [2.0; 3], [2.0; 3]]
        );
        assert_eq!(means_of(&[[0.0; 3], [0.0; 3], [4.0; 3]], 1), [[4.0; 3]; 3]);
    }

    #[test]
    fn an_error_is_the_sum_of_the_moves_to_come() {
        let series = |r: f64| (1..200).map(|k| r.powi(k)).sum::<f64>();
        for (r, last) in [(0.5, 1.0), (1.0 / 7.0, 3.0)] {
            let error = square_error(last, last / r, 1.0 / 6.0);
            assert!((error - last * series(r)).abs() < 1e-12);
        }
        // Smooth at the slower rate: within a seventh.
        let slower = (square_error(1.0, 5.5, 1.0 / 6.0) / series(2.0 / 11.0)).sqrt();
        assert!((0.86..1.0).contains(&slower), "{slower}");
        // Both kinds at once, and moves that do not shrink: as of independent samples.
        let mixed = square_error(1.0 + 2.0, 2.0 + 11.0, 1.0 / 6.0);
        assert!((mixed - (series(0.5) + 2.0 * series(1.0 / 7.0))).abs() < 1e-12);
        assert_eq!(square_error(1.0, 0.5, 0.2), 1.0);
        assert_eq!(square_error(4.0, 0.0, 0.2), 4.0);
        assert_eq!(square_error(0.0, 0.0, 0.2), 0.0);
    }
}
