//! Mean luminance of a photograph.

use crate::light::luminance;
use render::scene::Decoded;

/// Least luminance of a pixel, since black has no logarithm: about a quarter of an 8-bit step.
const FLOOR: f64 = 7.6e-5;

/// Geometric mean of the luminance of one side's pixels (of a mesh, its vertices), as a light meter averages it.
pub(crate) fn mean_luminance(side: &Decoded) -> f64 {
    let radiance = match side {
        Decoded::Sheet(sheet) => &sheet.radiance,
        Decoded::Mesh(mesh) => &mesh.radiance,
    };
    let log = |&[r, g, b, _]: &[f32; 4]| libm::log2(luminance([r, g, b].map(f64::from)).max(FLOOR));
    let sum: f64 = radiance.iter().map(log).sum();
    libm::exp2(sum / radiance.len().max(1) as f64)
}
