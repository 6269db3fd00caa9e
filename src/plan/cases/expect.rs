//! What is expected of a layer: a number, another layer, or one of two formulas.

use super::file::Case;
use render::trace::{FilmPlane, LAYERS};
use serde::Deserialize;

/// One expectation: exactly one of the fields after `bound`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// Of which layer.
    pub layer: String,
    /// Largest deviation that is allowed, in the quantity's own unit.
    pub bound: f64,
    /// Every pixel is this colour.
    pub value: Option<[f64; 3]>,
    /// Every value lies between 0 and this.
    pub at_most: Option<f64>,
    /// Sum of red over all pixels.
    pub sum: Option<f64>,
    /// Radius of the disc that a front spot in the middle becomes, px.
    pub radius_px: Option<f64>,
    /// The ramp pictured, as the layer (T or R, untilted pane) shows it.
    #[serde(default)]
    pub ramp: bool,
    /// The checkerboard pictured, seen through the pixels' boxes (R, both over the film's field of view).
    #[serde(default)]
    pub checker: bool,
    /// `CASE` or `CASE/LAYER`: every pixel is that one's.
    pub same_as: Option<String>,
}

/// A measured quantity.
pub struct Measured {
    /// On paper; of many pixels, at the one that is farthest off.
    pub expected: f64,
    /// In the tuple.
    pub got: f64,
    /// How far it is off.
    pub error: f64,
}

impl Measured {
    fn new(expected: f64, got: f64) -> Self {
        Self {
            expected,
            got,
            error: (got - expected).abs(),
        }
    }
}

/// Steps a side over which a formula is averaged in a pixel.
const STEPS: u32 = 8;

impl Expect {
    pub(crate) fn validate(&self) -> Result<(), String> {
        let quantities = [
            self.value.is_some(),
            self.at_most.is_some(),
            self.sum.is_some(),
            self.radius_px.is_some(),
            self.ramp,
            self.checker,
            self.same_as.is_some(),
        ];
        if quantities.iter().filter(|is| **is).count() != 1 {
            return Err(
                "an expectation is one of value, at_most, sum, radius_px, ramp, checker, same_as"
                    .to_owned(),
            );
        }
        if !LAYERS.contains(&self.layer.as_str()) {
            return Err(format!(
                "layer {:?} is none of {}",
                self.layer,
                LAYERS.join(", ")
            ));
        }
        if !(self.bound >= 0.0 && self.bound < f64::INFINITY) {
            return Err("bound is finite and not negative".to_owned());
        }
        Ok(())
    }

    /// Its name in the table.
    pub fn quantity(&self) -> String {
        match self {
            Self { value: Some(_), .. } => "value".to_owned(),
            Self {
                at_most: Some(_), ..
            } => "at most".to_owned(),
            Self { sum: Some(_), .. } => "sum".to_owned(),
            Self {
                radius_px: Some(_), ..
            } => "radius, px".to_owned(),
            Self { ramp: true, .. } => "ramp".to_owned(),
            Self { checker: true, .. } => "checker".to_owned(),
            Self { same_as, .. } => format!("as {}", same_as.as_deref().unwrap_or("?")),
        }
    }

    /// Measures `layer` of the case; `other` is the layer of `same_as`.
    pub fn measure(
        &self,
        case: &Case,
        layer: &[[f32; 3]],
        other: Option<&[[f32; 3]]>,
    ) -> Option<Measured> {
        Some(if let Some(value) = self.value {
            farthest(layer, |_, c| Some(value[c]))
        } else if let Some(most) = self.at_most {
            range(layer, most)
        } else if let Some(sum) = self.sum {
            Measured::new(sum, moment(layer, |_| 1.0))
        } else if let Some(expected) = self.radius_px {
            Measured::new(expected, radius_px(case, layer))
        } else if self.ramp {
            farthest(layer, |q, _| ramp(case, &self.layer, q))
        } else if self.checker {
            farthest(layer, |q, _| checker(case, q))
        } else {
            let other = other.filter(|other| other.len() == layer.len())?;
            farthest(layer, |q, c| Some(f64::from(other[q][c])))
        })
    }
}

/// The value that is farthest from what is expected of it (where anything is).
fn farthest(layer: &[[f32; 3]], expected: impl Fn(usize, usize) -> Option<f64>) -> Measured {
    let mut worst = Measured::new(0.0, 0.0);
    let mut is_first = true;
    for (q, pixel) in layer.iter().enumerate() {
        for (c, value) in pixel.iter().enumerate() {
            let Some(expected) = expected(q, c) else {
                continue;
            };
            let found = Measured::new(expected, f64::from(*value));
            if is_first || found.error > worst.error || found.error.is_nan() {
                is_first = false;
                worst = found;
            }
            // Nothing is farther off than NaN, and nothing compares with it.
            if worst.error.is_nan() {
                return worst;
            }
        }
    }
    worst
}

/// The largest value against `most`, or the first that is negative or no number.
fn range(layer: &[[f32; 3]], most: f64) -> Measured {
    let values = layer.as_flattened().iter().map(|&v| f64::from(v));
    if let Some(bad) = values.clone().find(|v| v.is_nan() || *v < 0.0) {
        return Measured::new(0.0, bad);
    }
    let got = values.fold(0.0, f64::max);
    Measured {
        expected: most,
        got,
        error: (got - most).max(0.0),
    }
}

fn film(case: &Case) -> FilmPlane {
    let (film, camera) = (&case.line.film, &case.line.camera);
    FilmPlane {
        width: film.width,
        height: film.height,
        tan_half_fov: FilmPlane::tan_half_fov(film.width, film.height, camera.focal_length_mm),
        filter: None,
    }
}

/// Mean over pixel `q` of the ramp where the lines meet it, X = p (Z - kappa); the lens does not matter.
fn ramp(case: &Case, layer: &str, q: usize) -> Option<f64> {
    let film = film(case);
    let glass = &case.line.glass;
    let is_reflected = layer == "clean_reflection";
    let picture = if is_reflected {
        &case.back
    } else {
        &case.front
    };
    let (ramp, depth_m) = (picture.ramp?, f64::from(picture.depth_m));
    let (x, y) = (q as u32 % film.width, q as u32 / film.width);
    let mut sum = 0.0;
    for step in 0..STEPS * STEPS {
        let at = |k: u32, step: u32| f64::from(k) + (f64::from(step) + 0.5) / f64::from(STEPS);
        let [px, py] = film.tangent(at(x, step % STEPS), at(y, step / STEPS));
        let square = glass.ior * glass.ior;
        let gamma = 1.0 / (square + (square - 1.0) * (px * px + py * py)).sqrt();
        let (side, kappa) = if is_reflected {
            (-1.0, 0.0)
        } else {
            (1.0, glass.thickness_m * (1.0 - gamma))
        };
        let reach = depth_m - kappa;
        sum += ramp.middle + ramp.across_per_m * side * px * reach + ramp.down_per_m * py * reach;
    }
    Some(sum / f64::from(STEPS * STEPS))
}

/// Mean over pixel `q`'s box of the mirrored checkerboard; none within half a texel of the border.
fn checker(case: &Case, q: usize) -> Option<f64> {
    let film = &case.line.film;
    let (x, y) = (q as u32 % film.width, q as u32 / film.width);
    let axis = |k: u32, pixels: u32, texels: usize| {
        let m = texels as f64 / f64::from(pixels);
        let center = (f64::from(k) + 0.5) * m - 0.5;
        let inside = center - m / 2.0 >= 0.0 && center + m / 2.0 <= texels as f64 - 1.0;
        inside.then(|| (wave(center + m / 2.0) - wave(center - m / 2.0)) / m)
    };
    let [nx, ny] = case.back.texels;
    let (u, v) = (
        axis(film.width - 1 - x, film.width, nx)?,
        axis(y, film.height, ny)?,
    );
    Some(0.5 + 0.5 * u * v)
}

/// Integral from 0 of the triangle wave of period 2 that is 1 at even and -1 at odd numbers.
fn wave(x: f64) -> f64 {
    let r = x.abs() % 2.0;
    let value = if r <= 1.0 {
        r - r * r
    } else {
        (r - 1.0) * (r - 2.0)
    };
    value * x.signum()
}

/// Sum of red times a weight by pixel.
fn moment(layer: &[[f32; 3]], weight: impl Fn(usize) -> f64) -> f64 {
    let values = layer.iter().enumerate();
    values.map(|(q, p)| f64::from(p[0]) * weight(q)).sum()
}

/// Radius of the uniform disc whose second moment the layer has beyond those of pixel and texel.
fn radius_px(case: &Case, layer: &[[f32; 3]]) -> f64 {
    let film = film(case);
    let center = [film.width, film.height].map(|n| f64::from(n) / 2.0 - 0.5);
    let mass = moment(layer, |_| 1.0);
    let second = moment(layer, |q| {
        let dx = f64::from(q as u32 % film.width) - center[0];
        let dy = f64::from(q as u32 / film.width) - center[1];
        0.5 * (dx * dx + dy * dy)
    });
    let glass = &case.line.glass;
    let depth_m = f64::from(case.front.depth_m);
    let kappa = glass.thickness_m * (1.0 - 1.0 / glass.ior);
    let tan = case.front.half_fov_tan.unwrap_or(film.tan_half_fov)[0];
    let texel = 2.0 * tan / case.front.texels[0] as f64;
    let texel_px = texel / film.pixel_tangent()[0] * depth_m / (depth_m - kappa);
    let blur = second / mass - 1.0 / 12.0 - texel_px * texel_px / 6.0;
    2.0 * blur.max(0.0).sqrt()
}
