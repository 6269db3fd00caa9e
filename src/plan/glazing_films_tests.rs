//! Computes the coatings of `glazings.toml` that have films as their source.
//!
//! Films at normal incidence, with complex index n and thickness d, are added one after the other, beginning with the last. With
//! r and t of the films behind, r_01 = (n_0 - n_1) / (n_0 + n_1), t_01 = 1 + r_01 and p = exp(2 pi i n_1 d / wavelength),
//!
//! ```text
//! r' = (r_01 + r p^2) / (1 + r_01 r p^2),     t' = t_01 t p / (1 + r_01 r p^2)
//! ```
//!
//! and the shares are |r|^2 and |t|^2 n_last / n_first (Macleod, *Thin-Film Optical Filters*).

use super::glazing::glazings;
use std::ops::{Add, Div, Mul, Sub};

/// A complex number.
#[derive(Clone, Copy, Debug)]
struct Complex(f64, f64);

impl Add for Complex {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self(self.0 + b.0, self.1 + b.1)
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self(self.0 - b.0, self.1 - b.1)
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self(self.0 * b.0 - self.1 * b.1, self.0 * b.1 + self.1 * b.0)
    }
}

impl Div for Complex {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let Self(re, im) = self * Self(b.0, -b.1);
        Self(re / b.square(), im / b.square())
    }
}

impl Complex {
    fn square(self) -> f64 {
        self.0 * self.0 + self.1 * self.1
    }
}

const ONE: Complex = Complex(1.0, 0.0);
const WAVELENGTHS_NM: [f64; 3] = [610.0, 550.0, 460.0];

/// Returns reflectance and transmittance of `films` (index and thickness, nm) between two media without absorption.
fn shares(first: f64, films: &[(Complex, f64)], last: f64, wavelength_nm: f64) -> [f64; 2] {
    let (mut r, mut t) = (Complex(0.0, 0.0), ONE);
    let mut behind = (Complex(last, 0.0), 0.0);
    for &film in films.iter().rev().chain([&(Complex(first, 0.0), 0.0)]) {
        let (n, thickness_nm) = behind;
        let r_01 = (film.0 - n) / (film.0 + n);
        let turn = 2.0 * std::f64::consts::PI * thickness_nm / wavelength_nm;
        let left = libm::exp(-n.1 * turn);
        let p = Complex(left * libm::cos(n.0 * turn), left * libm::sin(n.0 * turn));
        let rounds = ONE + r_01 * r * p * p;
        (r, t) = ((r_01 + r * p * p) / rounds, (ONE + r_01) * t * p / rounds);
        behind = film;
    }
    [r.square(), t.square() * last / first]
}

/// Returns the index of soda-lime glass (Rubin 1985).
fn glass(wavelength_nm: f64) -> f64 {
    let square = (wavelength_nm * 1e-3) * (wavelength_nm * 1e-3);
    1.5130 - 0.003_169 * square + 0.003_962 / square
}

/// Returns the index of silver (Johnson and Christy 1972), between their wavelengths.
fn silver(wavelength_nm: f64) -> Complex {
    const TABLE: [(f64, f64, f64); 7] = [
        (450.9, 0.04, 2.657),
        (471.4, 0.05, 2.869),
        (495.9, 0.05, 3.093),
        (520.9, 0.05, 3.324),
        (548.6, 0.06, 3.586),
        (582.1, 0.05, 3.858),
        (616.8, 0.06, 4.152),
    ];
    let next = TABLE.iter().position(|row| row.0 > wavelength_nm).unwrap();
    let (a, b) = (TABLE[next - 1], TABLE[next]);
    let part = (wavelength_nm - a.0) / (b.0 - a.0);
    Complex(a.1 + part * (b.1 - a.1), a.2 + part * (b.2 - a.2))
}

/// Checks the coating of a face against the means over both sides, rounded.
fn check(name: &str, films: impl Fn(f64) -> Vec<(Complex, f64)>, digits: i32, differs: f64) {
    let round = |share: f64| (share * 10f64.powi(digits)).round() / 10f64.powi(digits);
    for coating in &glazings().by_name[name].coatings {
        for (c, wavelength_nm) in WAVELENGTHS_NM.into_iter().enumerate() {
            let (mut films, glass) = (films(wavelength_nm), glass(wavelength_nm));
            let [outer, through] = shares(1.0, &films, glass, wavelength_nm);
            films.reverse();
            let [inner, back] = shares(glass, &films, 1.0, wavelength_nm);
            assert!((through - back).abs() < 1e-12 && (outer - inner).abs() < differs, "{name}");
            assert_eq!(coating.reflectance[c], round(0.5 * (outer + inner)), "{name} {c}");
            assert_eq!(coating.transmittance[c], round(through), "{name} {c}");
        }
    }
}

#[test]
fn coatings_are_those_of_their_films() {
    let quarter = |n: f64| (Complex(n, 0.0), 550.0 / 4.0 / n);
    let half = |n: f64| (Complex(n, 0.0), 550.0 / 2.0 / n);
    check("framing-ar", |_| vec![quarter(1.38)], 4, 1e-12);
    check("museum-ar", |_| vec![quarter(1.38), half(2.0), quarter(1.7)], 4, 1e-12);
    let oxide = (Complex(2.0, 0.0), 40.0);
    let with_silver = |nm: f64| vec![oxide, (silver(nm), 14.0), oxide];
    check("double-low-e", with_silver, 3, 0.005);
    check("triple-low-e", with_silver, 3, 0.005);
}
