//! Value noise and filtered stripes for textures.

use super::random::{lattice, unit};
use glam::Vec3;

/// Rounds down without the library call that `f32::floor` needs on baseline x86-64.
#[inline]
pub(super) fn floor(x: f32) -> i32 {
    let truncated = x as i32;
    truncated - i32::from(x < truncated as f32)
}

fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Returns value noise in the plane, 0..1, on a lattice with spacing 1.
pub(super) fn noise2(x: f32, y: f32, seed: i32) -> f32 {
    let (i, j) = (floor(x), floor(y));
    let (u, v) = (smooth(x - i as f32), smooth(y - j as f32));
    let at = |di, dj| unit(lattice(i + di, j + dj, seed));
    mix(mix(at(0, 0), at(1, 0), u), mix(at(0, 1), at(1, 1), u), v)
}

/// Returns value noise in space, 0..1, on a lattice with spacing 1.
pub(super) fn noise3(p: Vec3, seed: i32) -> f32 {
    let k = floor(p.z);
    let w = smooth(p.z - k as f32);
    let layer = |k: i32| noise2(p.x, p.y, seed.wrapping_add(k.wrapping_mul(7919)));
    mix(layer(k), layer(k + 1), w)
}

/// Sums up to four octaves of noise around 0.5. Fades out octaves finer than `footprint`, because they alias.
pub(super) fn cloudy(x: f32, y: f32, footprint: f32, seed: i32) -> f32 {
    let (mut sum, mut weight, mut scale) = (0.5, 0.5, 1.0);
    for octave in 0..4 {
        let fade = (1.2 - footprint * scale).clamp(0.0, 1.0);
        if fade == 0.0 {
            break;
        }
        sum += fade * weight * (noise2(x * scale, y * scale, seed + octave) - 0.5);
        weight *= 0.5;
        scale *= 2.0;
    }
    sum
}

/// Returns the share of a footprint around `x` on stripes, 0..1; every period starts with a stripe of `width`.
pub(super) fn stripe(x: f32, period: f32, width: f32, footprint: f32) -> f32 {
    let covered = |x: f32| {
        let cell = floor(x / period) as f32;
        cell * width + (x - cell * period).min(width)
    };
    let f = footprint.max(1e-4);
    ((covered(x + 0.5 * f) - covered(x - 0.5 * f)) / f).clamp(0.0, 1.0)
}

/// Returns the share of a footprint around `x` in `low..high`, 0..1.
pub(super) fn band(x: f32, low: f32, high: f32, footprint: f32) -> f32 {
    let f = footprint.max(1e-4);
    (((x + 0.5 * f).min(high) - (x - 0.5 * f).max(low)) / f).clamp(0.0, 1.0)
}
