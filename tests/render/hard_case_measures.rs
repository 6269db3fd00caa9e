//! Measures the layers of hard cases, and computes expected values that differ from pixel to pixel.

use glasshouse_line::SceneLine;
use render::trace::FilmPlane;

/// Number of steps per axis in the mean of a formula over a pixel.
const STEPS: u32 = 8;
/// Number of texels per axis of the spot's plane; the middle texel is bright.
const SPOT_TEXELS: f64 = 3.0;
/// Tangent of half the field of view of the spot's plane; a texel is two pixels wide.
const SPOT_TAN: f64 = 0.006_518_632_900_899_868;
/// Depth of the ramps, m.
const RAMP_DEPTH_M: f64 = 2.2;

/// A measured quantity; for several pixels, at the pixel with the largest error.
pub(crate) struct Measured {
    pub(crate) expected: f64,
    pub(crate) got: f64,
    pub(crate) error: f64,
}

impl Measured {
    pub(crate) fn new(expected: f64, got: f64) -> Self {
        Self { expected, got, error: (got - expected).abs() }
    }
}

/// Returns the value with the largest error. `expected` returns the expected value of a pixel and colour, if any.
pub(crate) fn farthest(
    layer: &[[f32; 3]],
    expected: impl Fn(usize, usize) -> Option<f64>,
) -> Measured {
    let mut worst: Option<Measured> = None;
    for (q, pixel) in layer.iter().enumerate() {
        for (c, value) in pixel.iter().enumerate() {
            let Some(expected) = expected(q, c) else {
                continue;
            };
            let found = Measured::new(expected, f64::from(*value));
            // NaN counts as the largest error, because every comparison with NaN is false.
            if found.error.is_nan() {
                return found;
            }
            if worst.as_ref().is_none_or(|w| found.error > w.error) {
                worst = Some(found);
            }
        }
    }
    worst.expect("some pixel has an expected value")
}

/// Returns the largest value, compared with `most`, or the first negative or NaN value if the layer has one.
pub(crate) fn at_most(layer: &[[f32; 3]], most: f64) -> Measured {
    let values = layer.as_flattened().iter().map(|&v| f64::from(v));
    if let Some(bad) = values.clone().find(|v| v.is_nan() || *v < 0.0) {
        return Measured::new(0.0, bad);
    }
    let got = values.fold(0.0, f64::max);
    Measured { expected: most, got, error: (got - most).max(0.0) }
}

fn film(line: &SceneLine) -> FilmPlane {
    let (film, camera) = (&line.film, &line.camera);
    FilmPlane {
        width: film.width,
        height: film.height,
        tan_half_fov: FilmPlane::tan_half_fov(film.width, film.height, camera.focal_length_mm),
        filter: None,
    }
}

/// Returns the mean over pixel `q` of a ramp at X = p (Z - kappa) for T, or at mirrored X = p Z for R, with any lens.
pub(crate) fn ramp(line: &SceneLine, is_reflected: bool, terms: [f64; 3], q: usize) -> f64 {
    let [middle, across_per_m, down_per_m] = terms;
    let (film, glass) = (film(line), &line.glass);
    let (x, y) = (q as u32 % film.width, q as u32 / film.width);
    let mut sum = 0.0;
    for step in 0..STEPS * STEPS {
        let at = |k: u32, step: u32| f64::from(k) + (f64::from(step) + 0.5) / f64::from(STEPS);
        let [px, py] = film.tangent(at(x, step % STEPS), at(y, step / STEPS));
        let square = glass.first_glass().0.powi(2);
        let gamma = 1.0 / (square + (square - 1.0) * (px * px + py * py)).sqrt();
        let (side, kappa) = if is_reflected {
            (-1.0, 0.0)
        } else {
            (1.0, glass.total_thickness_m() * (1.0 - gamma))
        };
        let reach = RAMP_DEPTH_M - kappa;
        sum += middle + across_per_m * side * px * reach + down_per_m * py * reach;
    }
    sum / f64::from(STEPS * STEPS)
}

/// Returns the mean of the mirrored checkerboard over pixel `q`; `None` if `q` is within half a texel of the border.
pub(crate) fn checker(line: &SceneLine, texels: usize, q: usize) -> Option<f64> {
    let film = &line.film;
    let (x, y) = (q as u32 % film.width, q as u32 / film.width);
    let axis = |k: u32, pixels: u32| {
        let m = texels as f64 / f64::from(pixels);
        let center = (f64::from(k) + 0.5) * m - 0.5;
        let inside = center - m / 2.0 >= 0.0 && center + m / 2.0 <= texels as f64 - 1.0;
        inside.then(|| (wave(center + m / 2.0) - wave(center - m / 2.0)) / m)
    };
    let (u, v) = (axis(film.width - 1 - x, film.width)?, axis(y, film.height)?);
    Some(0.5 + 0.5 * u * v)
}

/// Integrates the triangle wave of period 2, which is 1 at even and -1 at odd integers, from 0 to `x`.
fn wave(x: f64) -> f64 {
    let r = x.abs() % 2.0;
    let value = if r <= 1.0 { r - r * r } else { (r - 1.0) * (r - 2.0) };
    value * x.signum()
}

pub(crate) fn red_sum(layer: &[[f32; 3]]) -> f64 {
    layer.iter().map(|p| f64::from(p[0])).sum()
}

/// Returns the radius, px, of a uniform disc with the layer's second moment minus those of pixel and texel.
pub(crate) fn radius_px(line: &SceneLine, depth_m: f64, layer: &[[f32; 3]]) -> f64 {
    let (film, glass) = (film(line), &line.glass);
    let center = [film.width, film.height].map(|n| f64::from(n) / 2.0 - 0.5);
    let moments = layer.iter().enumerate().map(|(q, pixel)| {
        let dx = f64::from(q as u32 % film.width) - center[0];
        let dy = f64::from(q as u32 / film.width) - center[1];
        f64::from(pixel[0]) * 0.5 * (dx * dx + dy * dy)
    });
    let second = moments.sum::<f64>() / red_sum(layer);
    let kappa = glass.total_thickness_m() * (1.0 - 1.0 / glass.first_glass().0);
    let texel = 2.0 * SPOT_TAN / SPOT_TEXELS;
    let texel_px = texel / film.pixel_tangent()[0] * depth_m / (depth_m - kappa);
    let blur = second - 1.0 / 12.0 - texel_px * texel_px / 6.0;
    2.0 * blur.max(0.0).sqrt()
}
