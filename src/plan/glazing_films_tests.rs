//! Computes the coatings of `glazings.toml` that have films as their source.
//!
//! Films with complex index n and thickness d are added one after the other, beginning with the last, for s and p. With
//! q = sqrt(n^2 - sin^2) (sin: of the angle in air), eta = q for s and n^2 / q for p, r and t of the films behind,
//! r_01 = (eta_0 - eta_1) / (eta_0 + eta_1), t_01 = 1 + r_01 and p = exp(2 pi i q_1 d / wavelength),
//!
//! ```text
//! r' = (r_01 + r p^2) / (1 + r_01 r p^2),     t' = t_01 t p / (1 + r_01 r p^2)
//! ```
//!
//! and the shares are |r|^2 and |t|^2 eta_last / eta_first (Macleod, *Thin-Film Optical Filters*), their means over s and p.

use glasshouse_line::Shares;
use glasshouse_line::glazings;
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

    /// Returns the root with a positive imaginary, or else a positive real part.
    fn root(self) -> Self {
        let length = self.square().sqrt();
        let (re, im) = ((0.5 * (length + self.0)).sqrt(), (0.5 * (length - self.0)).sqrt());
        if self.1 < 0.0 { Self(-re, im) } else { Self(re, im) }
    }
}

const ONE: Complex = Complex(1.0, 0.0);
const WAVELENGTHS_NM: [f64; 3] = [610.0, 550.0, 460.0];
/// Angles of the rows in `glazings.toml`, in air.
const ANGLES_DEG: [f64; 8] = [0.0, 20.0, 40.0, 55.0, 65.0, 75.0, 82.0, 90.0];

/// Returns reflectance and transmittance of `films` (index and thickness, nm) between two media without absorption.
fn shares(
    first: f64,
    films: &[(Complex, f64)],
    last: f64,
    (wavelength_nm, angle_deg): (f64, f64),
) -> [f64; 2] {
    // At 90 degrees, all light is reflected.
    if angle_deg == 90.0 {
        return [1.0, 0.0];
    }
    let sin = libm::sin(angle_deg.to_radians());
    let mut mean = [0.0; 2];
    for is_p in [false, true] {
        let q = |n: Complex| (n * n - Complex(sin * sin, 0.0)).root();
        let eta = |n: Complex| if is_p { n * n / q(n) } else { q(n) };
        let (mut r, mut t) = (Complex(0.0, 0.0), ONE);
        let mut behind = (Complex(last, 0.0), 0.0);
        for &film in films.iter().rev().chain([&(Complex(first, 0.0), 0.0)]) {
            let (n, thickness_nm) = behind;
            let r_01 = (eta(film.0) - eta(n)) / (eta(film.0) + eta(n));
            let turn = 2.0 * std::f64::consts::PI * thickness_nm / wavelength_nm;
            let left = libm::exp(-q(n).1 * turn);
            let phase = q(n).0 * turn;
            let p = Complex(left * libm::cos(phase), left * libm::sin(phase));
            let rounds = ONE + r_01 * r * p * p;
            (r, t) = ((r_01 + r * p * p) / rounds, (ONE + r_01) * t * p / rounds);
            behind = film;
        }
        let [eta_last, eta_first] = [last, first].map(|n| eta(Complex(n, 0.0)).0);
        mean[0] += 0.5 * r.square();
        mean[1] += 0.5 * t.square() * eta_last / eta_first;
    }
    mean
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

/// The rows of a coating: reflectance from the air, from the glass, and transmittance, rounded to four digits.
fn rows(films: impl Fn(f64) -> Vec<(Complex, f64)>) -> [Vec<[f64; 3]>; 3] {
    let round = |share: f64| (share * 1e4).round() / 1e4;
    let mut all = [vec![], vec![], vec![]];
    for angle_deg in ANGLES_DEG {
        let mut row = [[0.0; 3]; 3];
        for (c, wavelength_nm) in WAVELENGTHS_NM.into_iter().enumerate() {
            let (mut films, glass) = (films(wavelength_nm), glass(wavelength_nm));
            let at = (wavelength_nm, angle_deg);
            let [outer, through] = shares(1.0, &films, glass, at);
            films.reverse();
            let [inner, back] = shares(glass, &films, 1.0, at);
            assert!((through - back).abs() < 1e-12);
            // Without absorption, what is not reflected passes.
            let is_clear = (outer + through - 1.0).abs() < 1e-9;
            let through = if is_clear { 1.0 - round(outer) } else { through };
            (row[0][c], row[1][c], row[2][c]) = (round(outer), round(inner), round(through));
        }
        (0..3).for_each(|k| all[k].push(row[k]));
    }
    all
}

/// Checks the coatings of a glazing. `from_air` lists its coated faces, and whether the camera's side of the face is air.
fn check(name: &str, films: impl Fn(f64) -> Vec<(Complex, f64)>, from_air: &[(u32, bool)]) {
    let [air, glass, through] = rows(films);
    for (coating, (face, is_air)) in glazings().by_name[name].coatings.iter().zip(from_air) {
        let sides = if *is_air { [&air, &glass] } else { [&glass, &air] };
        let found = coating.reflectances().map(Clone::clone);
        let wanted = sides.map(|rows| Shares::ByAngle(rows.clone()));
        let is_same = coating.face == *face
            && coating.angles_deg == ANGLES_DEG
            && found == wanted
            && coating.transmittance == Shares::ByAngle(through.clone());
        assert!(
            is_same,
            "{name} must have: face = {face}, angles_deg = {ANGLES_DEG:?}, reflectance = {:?}, reflectance_back = {:?}, \
             transmittance = {through:?}",
            sides[0], sides[1]
        );
    }
    assert_eq!(glazings().by_name[name].coatings.len(), from_air.len());
}

#[test]
fn coatings_are_those_of_their_films() {
    let quarter = |n: f64| (Complex(n, 0.0), 550.0 / 4.0 / n);
    let half = |n: f64| (Complex(n, 0.0), 550.0 / 2.0 / n);
    let both = [(0, true), (1, false)];
    check("framing-ar", |_| vec![quarter(1.38)], &both);
    check("museum-ar", |_| vec![quarter(1.38), half(2.0), quarter(1.7)], &both);
    let oxide = (Complex(2.0, 0.0), 40.0);
    let with_silver = |nm: f64| vec![oxide, (silver(nm), 14.0), oxide];
    check("double-low-e", with_silver, &[(1, false)]);
    check("triple-low-e", with_silver, &[(1, false), (4, true)]);
}

/// Without films, the shares are Fresnel's.
#[test]
fn bare_glass_has_fresnel_s_shares() {
    for angle_deg in [0.0, 56.0, 80.0f64] {
        let [reflected, transmitted] = shares(1.0, &[], 1.52, (550.0, angle_deg));
        let cos = angle_deg.to_radians().cos();
        let inside = (1.0 - (1.0 - cos * cos) / (1.52 * 1.52)).sqrt();
        let s = ((cos - 1.52 * inside) / (cos + 1.52 * inside)).powi(2);
        let p = ((1.52 * cos - inside) / (1.52 * cos + inside)).powi(2);
        assert!((reflected - 0.5 * (s + p)).abs() < 1e-14);
        assert!((reflected + transmitted - 1.0).abs() < 1e-14);
    }
}
