//! Fittings of rooms, such as lamps, pictures, doors, windows and plants.

use super::build::{Builder, Frame};
use super::material::{Material, color, plain};
use super::pattern::Pattern;
use super::random::Stream;
use super::style::{Style, accent};
use glam::{Vec2, Vec3};

pub(super) fn floor_lamp(b: &mut Builder, f: &Frame, style: &Style) {
    b.post(f, [0.0; 3], [0.15, 0.14], 0.025, style.metal);
    b.post(f, [0.0; 3], [0.012, 0.012], 1.45, style.metal);
    shade(b, f, [0.0, 1.38, 0.0], [0.23, 0.14], 0.28);
    b.lamp(f, [0.0, 1.5, 0.0]);
}

pub(super) fn table_lamp(b: &mut Builder, f: &Frame, style: &Style) {
    b.post(f, [0.0; 3], [0.08, 0.05], 0.05, style.accent);
    b.ball(f, [0.0, 0.12, 0.0], [0.07, 0.09, 0.07], style.accent.glossy(0.05));
    b.post(f, [0.0, 0.18, 0.0], [0.01, 0.01], 0.14, style.metal);
    shade(b, f, [0.0, 0.28, 0.0], [0.16, 0.1], 0.18);
    b.lamp(f, [0.0, 0.36, 0.0]);
}

/// Builds a lamp that hangs from a ceiling at height `ceiling` down to height `y`.
pub(super) fn pendant(b: &mut Builder, f: &Frame, y: f32, ceiling: f32, style: &Style) {
    b.post(f, [0.0, y, 0.0], [0.006, 0.006], ceiling - y, style.metal);
    shade(b, f, [0.0, y - 0.1, 0.0], [0.24, 0.07], 0.2);
    b.lamp(f, [0.0, y - 0.12, 0.0]);
}

fn shade(b: &mut Builder, f: &Frame, foot: [f32; 3], radii: [f32; 2], h: f32) {
    let mut cloth = Material::lamp(color(0xffe2b4), if b.lamps_on { 1.1 } else { 0.0 });
    if !b.lamps_on {
        cloth.main = color(0xe8dcc4);
        cloth.second = cloth.main;
    }
    b.post(f, foot, radii, h, cloth);
}

/// Builds a potted plant of this height.
pub(super) fn plant(b: &mut Builder, f: &Frame, height: f32, r: &mut Stream) {
    let clay = plain(r.pick(&[0xb5673f, 0xd8d3c6, 0x4a5258, 0x7d8f8a]));
    let pot = 0.26 * height.min(1.1);
    b.post(f, [0.0; 3], [0.09 + 0.05 * height, 0.12 + 0.06 * height], pot, clay);
    b.post(f, [0.0, pot - 0.01, 0.0], [0.1 + 0.05 * height; 2], 0.02, plain(0x3a2c20));
    let green = color(r.pick(&[0x3f6b35, 0x567d3a, 0x2f5d46]));
    let stem = Material::plain(green * 0.8);
    for k in 0..22 {
        let rise = (k as f32 + 0.5) / 22.0;
        let (s, c) = libm::sincosf(k as f32 * 2.4 + r.range(0.0, 0.5));
        let reach = height * r.range(0.14, 0.34) * (1.15 - 0.5 * rise);
        let y = pot + (height - pot) * (0.25 + 0.75 * rise);
        let knee = [0.35 * reach * c, y - 0.08 * height, 0.35 * reach * s];
        b.rod(f, [0.0, pot, 0.0], knee, [0.007, 0.004], stem);
        let tip = [reach * c, y - 0.12 * height * (1.0 - rise), reach * s];
        let leaf = Material::new(Pattern::Mottled(0.05), green, green * 1.4, k);
        b.leaf(f, knee, tip, 0.05 + 0.055 * height, leaf.glossy(0.02));
    }
}

/// Builds a framed picture on a wall, with its centre at the origin of `f`.
pub(super) fn picture(b: &mut Builder, f: &Frame, [w, h]: [f32; 2], style: &Style, r: &mut Stream) {
    let canvas = Pattern::Picture(Vec2::new(0.5 * w, 0.5 * h));
    let paint = Material::new(canvas, accent(r), accent(r), r.seed());
    b.panel(f, [0.0, 0.0, 0.012], [w, h, 0.016], paint);
    let wood = r.pick(&[style.wood, style.metal, style.paint]);
    for side in [-0.5, 0.5] {
        b.block(f, [side * w, 0.0, 0.018], [0.035, h + 0.035, 0.036], wood);
        b.block(f, [0.0, side * h, 0.018], [w + 0.035, 0.035, 0.036], wood);
    }
}

/// Builds a closed door in a wall, with its foot at the origin of `f`.
pub(super) fn door(b: &mut Builder, f: &Frame, style: &Style) {
    let (w, h) = (0.88, 2.05);
    b.block(f, [0.0, 0.5 * h, 0.015], [w, h, 0.03], style.paint);
    for (y, tall) in [(0.55, 0.7), (1.48, 0.9)] {
        b.block(f, [0.0, y, 0.03], [w - 0.26, tall, 0.025], style.paint);
        b.block(f, [0.0, y, 0.034], [w - 0.34, tall - 0.08, 0.03], style.wood);
    }
    for side in [-1.0, 1.0] {
        b.block(f, [side * (0.5 * w + 0.04), 0.5 * h, 0.02], [0.08, h, 0.05], style.wood);
    }
    b.block(f, [0.0, h + 0.04, 0.02], [w + 0.2, 0.08, 0.05], style.wood);
    b.ball(f, [0.36, 1.02, 0.09], [0.06, 0.015, 0.015], style.metal);
    b.rod(f, [0.4, 1.02, 0.03], [0.4, 1.02, 0.09], [0.012, 0.012], style.metal);
}

/// Builds a window's frame, bars, sill and perhaps curtains. The opening is `w` by `h`, centred at the origin of `f`.
pub(super) fn window(b: &mut Builder, f: &Frame, [w, h]: [f32; 2], style: &Style, r: &mut Stream) {
    let white = plain(0xece9e2);
    for side in [-0.5, 0.5] {
        b.block(f, [side * w, 0.0, -0.08], [0.08, h + 0.06, 0.1], white);
        b.block(f, [0.0, side * h, -0.08], [w, 0.08, 0.1], white);
    }
    let bars = 1 + usize::from(w > 1.5);
    for k in 1..=bars {
        let x = w * (k as f32 / (bars + 1) as f32 - 0.5);
        b.block(f, [x, 0.0, -0.08], [0.06, h, 0.06], white);
    }
    if r.chance(0.5) {
        b.block(f, [0.0, 0.18 * h, -0.08], [w, 0.035, 0.04], white);
    }
    b.block(f, [0.0, -0.5 * h - 0.03, 0.04], [w + 0.16, 0.035, 0.28], style.wood);
    if r.chance(0.75) {
        let cloth =
            Material::new(Pattern::Cloth, accent(r).lerp(Vec3::ONE, 0.45), accent(r), r.seed());
        let drop = 0.5 * h + 0.25;
        b.rod(
            f,
            [-0.5 * w - 0.35, drop, 0.12],
            [0.5 * w + 0.35, drop, 0.12],
            [0.014, 0.014],
            style.metal,
        );
        for side in [-1.0, 1.0] {
            for k in 0..5 {
                let x = side * (0.5 * w + 0.3 - 0.085 * k as f32);
                let z = 0.12 + 0.02 * (k % 2) as f32;
                b.post(f, [x, -0.5 * h - 0.5, z], [0.055, 0.045], h + 0.74, cloth);
            }
        }
    }
}

/// Builds a stack of cardboard boxes and a ball beside the stack.
pub(super) fn boxes(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let mut y = 0.0;
    for _ in 0..=r.index(3) {
        let (w, h) = (r.range(0.35, 0.55), r.range(0.25, 0.4));
        let at = f.at(r.range(-0.03, 0.03), y, 0.0, r.range(-0.3, 0.3));
        let card = Material::new(Pattern::Mottled(0.4), color(0xb58d5c), color(0xa67e50), r.seed());
        b.block(&at, [0.0, 0.5 * h, 0.0], [w, h, 0.36], card);
        b.block(&at, [0.0, 0.5 * h, 0.0], [0.05, h + 0.004, 0.364], plain(0xd2b488));
        y += h;
    }
    let stripes = Material::new(Pattern::Stripes(0.16), accent(r), color(0xf2efe6), 1);
    b.ball(f, [0.48, 0.14, 0.2], [0.14; 3], stripes.glossy(0.04));
}
