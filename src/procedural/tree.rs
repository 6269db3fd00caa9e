//! Trees and shrubs: trunks, branches, ragged crowns.

use super::build::{Builder, Frame};
use super::material::{Material, color, plain};
use super::pattern::Pattern;
use super::random::Stream;

const GREENS: [u32; 6] = [0x4f7a35, 0x5f8a3c, 0x3f6b34, 0x6f8f45, 0x8a8a3a, 0x54743f];

fn leaves(r: &mut Stream) -> Material {
    let green = color(r.pick(&GREENS));
    let seed = r.seed();
    Material::new(Pattern::Mottled(0.25), green * 0.75, green * 1.35, seed)
}

/// Builds a broad-leaved tree of this height.
pub(super) fn broadleaf(b: &mut Builder, f: &Frame, height: f32, r: &mut Stream) {
    let bark = Material::new(Pattern::Mottled(0.12), color(0x5b4636), color(0x7a6350), 3);
    let trunk = 0.36 * height;
    let thick = 0.022 * height;
    b.post(f, [0.0; 3], [thick, 0.7 * thick], trunk + 0.2, bark);
    let crown = leaves(r);
    let (middle, reach) = (0.66 * height, 0.24 * height);
    for k in 0..9 {
        let (s, c) = libm::sincosf(k as f32 * 2.4 + r.range(0.0, 0.6));
        let out = reach * if k == 0 { 0.0 } else { r.range(0.5, 1.0) };
        let y = middle + height * r.range(-0.16, 0.17);
        let at = [out * c, y, out * s];
        let size = height * r.range(0.13, 0.19);
        if k < 6 {
            b.rod(f, [0.0, trunk, 0.0], at, [0.55 * thick, 0.15 * thick], bark);
        }
        let mut m = crown;
        m.seed = m.seed.wrapping_add(31 * k);
        b.foliage(f, at, [size, 0.85 * size, size], m);
    }
}

/// Builds a conifer of this height.
pub(super) fn conifer(b: &mut Builder, f: &Frame, height: f32, r: &mut Stream) {
    let bark = plain(0x54402f);
    b.post(f, [0.0; 3], [0.02 * height, 0.01 * height], 0.5 * height, bark);
    let green = color(0x2f5238);
    for k in 0..5 {
        let rise = k as f32 / 5.0;
        let mut m = Material::new(Pattern::Mottled(0.2), green, green * 1.5, k);
        m.seed = m.seed.wrapping_add((r.bits() >> 44) as i32);
        let wide = height * 0.2 * (1.0 - 0.8 * rise);
        b.foliage(f, [0.0, height * (0.25 + 0.7 * rise), 0.0], [wide, 0.17 * height, wide], m);
    }
}

/// Builds a shrub of this radius.
pub(super) fn shrub(b: &mut Builder, f: &Frame, radius: f32, r: &mut Stream) {
    let m = leaves(r);
    b.ball(f, [0.0, 0.5 * radius, 0.0], [0.75 * radius, 0.75 * radius, 0.75 * radius], m);
    for k in 0..4 {
        let (s, c) = libm::sincosf(k as f32 * 1.57 + r.unit());
        let at = [0.4 * radius * c, r.range(0.5, 0.8) * radius, 0.4 * radius * s];
        let mut leaf = m;
        leaf.seed = leaf.seed.wrapping_add(k);
        b.foliage(f, at, [0.65 * radius; 3], leaf);
    }
}
