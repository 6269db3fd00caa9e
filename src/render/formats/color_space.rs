//! Colour spaces of RGB and grey codes: a curve per channel and a matrix to linear Rec.709.
//!
//! White maps to white (relative colorimetry with Bradford's adaptation), as with ICC profiles. All arithmetic is in
//! `f64` with `libm`, so the results do not depend on the machine.

use glasshouse_line::color::decode_srgb;

/// Rows of a 3 x 3 matrix.
pub(crate) type Matrix = [[f64; 3]; 3];

/// White of the profile connection space: D50 as ICC profiles define it.
pub(crate) const D50: [f64; 3] = [0.9642, 1.0, 0.8249];

/// Chromaticities (x, y) of white, red, green and blue.
pub(crate) const REC709: [[f64; 2]; 4] =
    [[0.3127, 0.3290], [0.64, 0.33], [0.30, 0.60], [0.15, 0.06]];

/// Adapts XYZ between whites in the space of the cones, by Bradford (Lam 1985), as ICC profiles do.
const BRADFORD: Matrix =
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];

/// Meaning of RGB or grey codes; grey stands for three equal codes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ColorSpace {
    /// Curves of red, green and blue.
    curves: [Curve; 3],
    /// From the linear values of the three curves to linear Rec.709.
    to_rec709: Matrix,
}

/// A curve from a code in [0, 1] to a linear value in [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Curve {
    /// IEC 61966-2-1.
    Srgb,
    /// The code to this power.
    Power(f64),
    /// (a x + b)^g + e from x = d on, and c x + f below.
    Parametric { g: f64, a: f64, b: f64, c: f64, d: f64, e: f64, f: f64 },
    /// Values in equal steps of the code, at least two, interpolated linearly.
    Sampled(Vec<f64>),
    /// The luminance of a lightness (CIE L* / 100), which this curve gives.
    Lightness(Box<Curve>),
}

impl Curve {
    /// Returns the linear value of a code in [0, 1], limited to [0, 1]; NaN becomes 0.
    fn value(&self, code: f64) -> f64 {
        let value = match self {
            Self::Srgb => decode_srgb(code),
            Self::Power(exponent) => libm::pow(code, *exponent),
            &Self::Parametric { g, a, b, c, d, e, f } => {
                if code >= d {
                    libm::pow((a * code + b).max(0.0), g) + e
                } else {
                    c * code + f
                }
            }
            Self::Sampled(values) => {
                let at = code * (values.len() - 1) as f64;
                let first = (at as usize).min(values.len() - 2);
                let share = at - first as f64;
                values[first] * (1.0 - share) + values[first + 1] * share
            }
            Self::Lightness(curve) => {
                let lightness = 100.0 * curve.value(code);
                // CIE 15: linear up to L* 8, where both parts meet.
                if lightness > 8.0 {
                    libm::pow((lightness + 16.0) / 116.0, 3.0)
                } else {
                    lightness * 27.0 / 24389.0
                }
            }
        };
        if value > 0.0 { value.min(1.0) } else { 0.0 }
    }
}

impl ColorSpace {
    /// Makes a space whose linear primaries have these XYZ values (columns) relative to D50. Returns `None` for sRGB: if
    /// no colour moves by more than half a step of an 8-bit sRGB code.
    pub(crate) fn of_d50(curves: [Curve; 3], xyz: Matrix) -> Option<Self> {
        let space = Self { curves, to_rec709: product(inverse(rec709_to_d50()), xyz) };
        (!space.is_srgb()).then_some(space)
    }

    /// Makes a space with these chromaticities of white, red, green and blue. Returns `None` for sRGB, as [`Self::of_d50`]
    /// does.
    pub(crate) fn of_primaries(curve: Curve, chromaticities: [[f64; 2]; 4]) -> Option<Self> {
        Self::of_d50([curve.clone(), curve.clone(), curve], to_d50(chromaticities))
    }

    /// Makes a neutral space: the curve of a grey image.
    pub(crate) fn of_grey(curve: Curve) -> Option<Self> {
        Self::of_d50([curve.clone(), curve.clone(), curve], rec709_to_d50())
    }

    /// True if a grid of colours moves by at most half of an 8-bit step against sRGB.
    fn is_srgb(&self) -> bool {
        let bound = |code: usize, half: f64| decode_srgb((code as f64 + half) / 255.0);
        let bounds: Vec<[f64; 2]> =
            (0..256).map(|code| [bound(code, -0.5), bound(code, 0.5)]).collect();
        let is_near = |code: usize, linear: f64| {
            let [low, high] = bounds[code];
            (code == 0 || low <= linear) && (code == 255 || linear <= high)
        };
        let tables = self.tables(255);
        let steps = || (0..256).step_by(15);
        let cube = |codes: [usize; 3]| {
            let linear = self.rec709([0, 1, 2].map(|c| tables[c][codes[c]]));
            (0..3).all(|c| is_near(codes[c], linear[c]))
        };
        tables.iter().all(|table| (0..256).all(|code| is_near(code, table[code])))
            && steps().all(|r| steps().all(|g| steps().all(|b| cube([r, g, b]))))
    }

    /// Returns, for each channel, the linear values of the codes 0 to `max`.
    pub(crate) fn tables(&self, max: u16) -> [Vec<f64>; 3] {
        let table = |curve: &Curve| {
            (0..=max).map(|code| curve.value(f64::from(code) / f64::from(max))).collect()
        };
        [0, 1, 2].map(|c| table(&self.curves[c]))
    }

    /// Converts linear values of this space to linear Rec.709. Colours outside of its gamut are limited to [0, 1] in each
    /// channel, as LittleCMS does for pictures.
    pub(crate) fn rec709(&self, linear: [f64; 3]) -> [f64; 3] {
        apply(&self.to_rec709, linear).map(|value| value.clamp(0.0, 1.0))
    }
}

/// The way back from sRGB to the 8-bit codes of a colour space.
pub(crate) struct Inverse {
    /// Linear values of the 8-bit sRGB codes.
    srgb: [f64; 256],
    from_rec709: Matrix,
    /// Linear values of the codes of each channel, ascending for every usable curve.
    tables: [Vec<f64>; 3],
}

impl Inverse {
    pub(crate) fn of(space: &ColorSpace) -> Self {
        Self {
            srgb: std::array::from_fn(|code| decode_srgb(code as f64 / 255.0)),
            from_rec709: inverse(space.to_rec709),
            tables: space.tables(255),
        }
    }

    /// Returns the codes whose colour is nearest in each channel; colours outside of the gamut are limited to it.
    pub(crate) fn codes(&self, srgb: &[u8]) -> [u8; 3] {
        let linear = self.linear(srgb);
        [0, 1, 2].map(|channel| self.nearest(channel, linear[channel]))
    }

    /// Returns the linear values of an sRGB colour; outside of the gamut, they are below 0 or above 1.
    pub(crate) fn linear(&self, srgb: &[u8]) -> [f64; 3] {
        apply(&self.from_rec709, [0, 1, 2].map(|c| self.srgb[usize::from(srgb[c])]))
    }

    /// Returns the linear value of a code of a channel.
    pub(crate) fn value(&self, channel: usize, code: u8) -> f64 {
        self.tables[channel][usize::from(code)]
    }

    /// Returns the code of a channel whose linear value is nearest.
    pub(crate) fn nearest(&self, channel: usize, value: f64) -> u8 {
        let table = &self.tables[channel];
        let above = table.partition_point(|v| *v < value).min(255);
        let below = above.saturating_sub(1);
        if value - table[below] < table[above] - value { below as u8 } else { above as u8 }
    }
}

fn apply(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn product(a: Matrix, b: Matrix) -> Matrix {
    a.map(|row| [0, 1, 2].map(|k| row[0] * b[0][k] + row[1] * b[1][k] + row[2] * b[2][k]))
}

fn inverse(m: Matrix) -> Matrix {
    let minor = |r: [usize; 2], c: [usize; 2]| {
        m[r[0]][c[0]] * m[r[1]][c[1]] - m[r[0]][c[1]] * m[r[1]][c[0]]
    };
    let others = [[1, 2], [2, 0], [0, 1]];
    let determinant: f64 = (0..3).map(|k| m[0][k] * minor([1, 2], others[k])).sum();
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| minor(others[column], others[row]) / determinant))
}

fn diagonal([x, y, z]: [f64; 3]) -> Matrix {
    [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]
}

fn rec709_to_d50() -> Matrix {
    to_d50(REC709)
}

/// Returns the matrix from linear RGB of these chromaticities to XYZ relative to D50.
fn to_d50(chromaticities: [[f64; 2]; 4]) -> Matrix {
    let [white, red, green, blue] = chromaticities.map(|[x, y]| [x / y, 1.0, (1.0 - x - y) / y]);
    let columns = [0, 1, 2].map(|k| [red[k], green[k], blue[k]]);
    let weights = apply(&inverse(columns), white);
    let (from, to) = (apply(&BRADFORD, white), apply(&BRADFORD, D50));
    let ratio = [0, 1, 2].map(|k| to[k] / from[k]);
    let adapt = product(inverse(BRADFORD), product(diagonal(ratio), BRADFORD));
    product(adapt, product(columns, diagonal(weights)))
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) const P3: [[f64; 2]; 4] =
        [[0.3127, 0.3290], [0.680, 0.320], [0.265, 0.690], [0.150, 0.060]];

    #[test]
    fn the_matrix_of_srgb_is_that_of_its_profile() {
        // Red, green and blue of the sRGB profile, as most programs embed it, to 4 digits.
        let icc = [[0.4361, 0.3851, 0.1431], [0.2225, 0.7169, 0.0606], [0.0139, 0.0971, 0.7141]];
        let found = rec709_to_d50();
        for (a, b) in found.as_flattened().iter().zip(icc.as_flattened()) {
            assert!((a - b).abs() < 2e-4, "{a} {b}");
        }
        let one = product(found, inverse(found));
        for (k, value) in one.as_flattened().iter().enumerate() {
            assert!((value - f64::from(u8::from(k % 4 == 0))).abs() < 1e-15);
        }
    }

    /// The matrix of Display P3 to sRGB, as published with CSS Color 4 (to 4 digits).
    #[test]
    fn display_p3_is_converted() {
        let css = [[1.2249, -0.2249, 0.0], [-0.0420, 1.0420, 0.0], [-0.0196, -0.0786, 1.0983]];
        let space = ColorSpace::of_primaries(Curve::Srgb, P3).unwrap();
        for (a, b) in space.to_rec709.as_flattened().iter().zip(css.as_flattened()) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
        // A saturated red is outside of Rec.709.
        assert_eq!(space.rec709([1.0, 0.0, 0.0]), [1.0, 0.0, 0.0]);
        let white = space.rec709([1.0; 3]);
        assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-12), "{white:?}");
    }

    #[test]
    fn srgb_needs_no_conversion() {
        assert_eq!(ColorSpace::of_primaries(Curve::Srgb, REC709), None);
        // The parametric curve of sRGB profiles, with the precision of 16.16 numbers.
        let parametric = Curve::Parametric {
            g: 2.4,
            a: 0.94786,
            b: 0.05214,
            c: 0.07739,
            d: 0.04045,
            e: 0.0,
            f: 0.0,
        };
        assert_eq!(ColorSpace::of_grey(parametric), None);
        let sampled = (0..1024).map(|k| decode_srgb(f64::from(k) / 1023.0)).collect();
        assert_eq!(ColorSpace::of_grey(Curve::Sampled(sampled)), None);
        assert!(ColorSpace::of_grey(Curve::Power(2.2)).is_some());
    }

    #[test]
    fn curves_match_their_closed_forms() {
        let ramp = Curve::Sampled(vec![0.0, 0.25, 1.0]);
        assert_eq!(
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|x| ramp.value(x)),
            [0.0, 0.125, 0.25, 0.625, 1.0]
        );
        assert_eq!(Curve::Power(2.0).value(0.5), 0.25);
        let cut = Curve::Parametric { g: 1.0, a: 2.0, b: 0.0, c: 0.0, d: 0.25, e: 0.1, f: -1.0 };
        assert_eq!([0.0, 0.25, 1.0].map(|x| cut.value(x)), [0.0, 0.6, 1.0]);
        assert_eq!(Curve::Power(f64::NAN).value(0.5), 0.0);
        let [red, _, blue] = ColorSpace::of_grey(Curve::Power(2.0)).unwrap().tables(255);
        assert_eq!((red.len(), red[0], red[255]), (256, 0.0, 1.0));
        assert_eq!(red, blue);
    }
}
