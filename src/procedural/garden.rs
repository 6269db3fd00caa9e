//! Objects of outdoor places, such as cars, lamp posts, people and café tables.

use super::build::{Builder, Frame};
use super::material::{Material, color, plain};
use super::pattern::Pattern;
use super::random::Stream;
use core::f32::consts::FRAC_PI_2;
use glam::{Vec2, Vec3};

fn bright(r: &mut Stream) -> Vec3 {
    color(r.pick(&[
        0xa8322a, 0x27507a, 0xd0cfc9, 0x3a3f44, 0xc49a3a, 0x4f6f5a, 0x7d8a94, 0x5a2f3a, 0xe4e2dc,
    ]))
}

/// Builds a car, about 4.2 m long, with its front towards +z.
pub(super) fn car(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let body = Material::plain(bright(r)).glossy(0.07);
    let mut glass = plain(0x20282e).glossy(0.12);
    glass.pattern = Pattern::Pane;
    let black = plain(0x17181a);
    let tall = r.range(0.0, 0.18);
    b.block(f, [0.0, 0.58, 0.0], [1.74, 0.5, 4.1], body);
    b.block(f, [0.0, 0.4, 0.0], [1.7, 0.24, 4.2], black);
    b.rod(f, [-0.86, 0.72, 1.9], [0.86, 0.72, 1.9], [0.14, 0.14], body);
    b.rod(f, [-0.86, 0.72, -1.92], [0.86, 0.72, -1.92], [0.14, 0.14], body);
    // The cabin is a box of glass with stepped front and rear windows, pillars and a roof.
    let cabin = 0.46 + tall;
    b.block(f, [0.0, 0.83 + 0.5 * cabin, -0.35], [1.5, cabin, 1.75], glass);
    for (z, to) in [(0.98, 0.45), (-1.7, -1.15)] {
        let steps = 5;
        for k in 0..steps {
            let t = (k as f32 + 0.5) / steps as f32;
            let at = z + (to - z) * t;
            let y = 0.83 + 0.5 * cabin * t;
            b.block(f, [0.0, y, at], [1.5, cabin * t, 0.16], glass);
        }
    }
    b.block(f, [0.0, 0.85 + cabin, -0.35], [1.46, 0.06, 1.7], body);
    for x in [-0.74, 0.74] {
        for z in [0.42, -0.4, -1.2] {
            b.block(f, [x, 0.83 + 0.5 * cabin, z], [0.05, cabin, 0.07], body);
        }
    }
    for x in [-0.78, 0.78] {
        for z in [1.3, -1.3] {
            let (a, c) = ([x - 0.1, 0.32, z], [x + 0.1, 0.32, z]);
            b.rod(f, a, c, [0.32, 0.32], black);
            let rim = plain(0xa9adb1).glossy(0.1);
            b.rod(f, [x - 0.11, 0.32, z], [x + 0.11, 0.32, z], [0.19, 0.19], rim);
        }
        let lamp = plain(0xf1eee0).glossy(0.1);
        b.ball(f, [0.85 * x, 0.66, 2.03], [0.15, 0.08, 0.05], lamp);
        b.block(f, [0.9 * x, 0.7, -2.06], [0.22, 0.12, 0.04], plain(0xa5211c));
    }
    let plate =
        Material::new(Pattern::Sign(Vec2::new(0.26, 0.06)), color(0xf0efe6), color(0x202020), 5);
    b.panel(f, [0.0, 0.48, 2.105], [0.52, 0.12, 0.02], plate);
    b.panel(f, [0.0, 0.55, -2.08], [0.52, 0.12, 0.02], plate);
}

/// Builds a street lamp with its arm towards +x.
pub(super) fn lamp_post(b: &mut Builder, f: &Frame) {
    let metal = plain(0x3c4447).glossy(0.05);
    b.post(f, [0.0; 3], [0.1, 0.08], 0.7, metal);
    b.post(f, [0.0, 0.7, 0.0], [0.06, 0.045], 3.8, metal);
    b.rod(f, [0.0, 4.45, 0.0], [0.85, 4.7, 0.0], [0.035, 0.03], metal);
    b.block(f, [1.0, 4.7, 0.0], [0.5, 0.09, 0.2], metal);
    let glow = Material::lamp(color(0xffe1ad), if b.lamps_on { 2.5 } else { 0.25 });
    b.block(f, [1.0, 4.64, 0.0], [0.4, 0.04, 0.15], glow);
    b.lamp(f, [1.0, 4.55, 0.0]);
}

/// Builds a standing or walking person.
pub(super) fn person(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let coat = Material::plain(bright(r));
    let trousers = plain(r.pick(&[0x2a3140, 0x4a4438, 0x22242a, 0x5f6a78]));
    let skin = plain(r.pick(&[0xd9a582, 0x8d5a3c, 0xe8bd9a, 0xb57f5a]));
    let stride = r.range(0.05, 0.22);
    for (x, z) in [(-0.09, stride), (0.09, -stride)] {
        b.rod(f, [x, 0.05, z], [x, 0.85, 0.0], [0.055, 0.085], trousers);
        b.ball(f, [x, 0.045, z + 0.06], [0.05, 0.05, 0.13], plain(0x2a2320));
    }
    b.ball(f, [0.0, 1.1, 0.0], [0.185, 0.36, 0.125], coat);
    b.ball(f, [0.0, 1.33, 0.0], [0.21, 0.13, 0.12], coat);
    b.ball(f, [0.0, 0.86, 0.0], [0.165, 0.16, 0.125], coat);
    for side in [-1.0, 1.0] {
        let hand = [side * 0.27, 0.8, -side * stride];
        b.rod(f, [side * 0.2, 1.36, 0.0], hand, [0.055, 0.04], coat);
        b.ball(f, hand, [0.05; 3], skin);
    }
    b.post(f, [0.0, 1.4, 0.0], [0.055, 0.055], 0.12, skin);
    b.ball(f, [0.0, 1.58, 0.0], [0.095, 0.125, 0.11], skin);
    let hair = plain(r.pick(&[0x2a1d14, 0x5a3d22, 0x8a6a3a, 0x1a1a1c, 0x9a948a]));
    b.ball(f, [0.0, 1.625, -0.025], [0.103, 0.105, 0.11], hair);
    if r.chance(0.4) {
        b.block(f, [0.32, 0.66, 0.0], [0.1, 0.28, 0.3], Material::plain(bright(r)));
    }
}

/// Builds a bench that faces +z.
pub(super) fn bench(b: &mut Builder, f: &Frame) {
    let wood = Material::new(Pattern::Grain(false), color(0x8a5f38), color(0x6e4829), 4);
    let iron = plain(0x2b2f31);
    for k in 0..4 {
        b.block(f, [0.0, 0.45, 0.2 - 0.12 * k as f32], [1.7, 0.035, 0.09], wood);
    }
    for k in 0..3 {
        b.block(f, [0.0, 0.58 + 0.13 * k as f32, -0.24 - 0.03 * k as f32], [1.7, 0.09, 0.03], wood);
    }
    for x in [-0.7, 0.7] {
        b.rod(f, [x, 0.0, 0.22], [x, 0.46, 0.2], [0.025, 0.025], iron);
        b.rod(f, [x, 0.0, -0.26], [x, 0.88, -0.32], [0.025, 0.025], iron);
    }
}

/// Builds a road sign on a pole.
pub(super) fn road_sign(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let pole = plain(0x9a9d9f).glossy(0.06);
    b.post(f, [0.0; 3], [0.03, 0.03], 2.6, pole);
    let ground = color(r.pick(&[0x1f4f92, 0xb22a24, 0xe8e4d8, 0xd8a822]));
    if r.chance(0.5) {
        b.rod(f, [0.0, 2.3, -0.035], [0.0, 2.3, -0.05], [0.3, 0.3], Material::plain(ground));
        b.block(f, [0.0, 2.3, -0.055], [0.36, 0.09, 0.012], plain(0xf4f2ea));
    } else {
        let face = Pattern::Sign(Vec2::new(0.45, 0.2));
        let face = Material::new(face, ground, color(0xf7f4ec), r.seed());
        b.panel(f, [0.0, 2.3, -0.04], [0.9, 0.4, 0.02], face);
    }
}

/// Builds a café table with two chairs and usually a parasol.
pub(super) fn cafe(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let metal = plain(0x4a4f50).glossy(0.06);
    let top = plain(0xd6d2c8).glossy(0.05);
    b.post(f, [0.0; 3], [0.2, 0.18], 0.03, metal);
    b.post(f, [0.0; 3], [0.025, 0.025], 2.3, metal);
    b.post(f, [0.0, 0.72, 0.0], [0.36, 0.36], 0.03, top);
    b.post(f, [0.15, 0.75, 0.1], [0.03, 0.035], 0.09, plain(0xf3f0e8));
    b.post(f, [-0.14, 0.75, -0.06], [0.03, 0.026], 0.16, plain(0x3f6a4a).glossy(0.1));
    let cloth = Material::new(Pattern::Stripes(0.5), bright(r), color(0xeee8da), 2);
    if r.chance(0.75) {
        b.post(f, [0.0, 2.1, 0.0], [1.3, 0.05], 0.5, cloth);
    }
    for turn in [r.range(-0.6, 0.6), r.range(2.4, 3.8)] {
        let (s, c) = libm::sincosf(turn);
        let at = f.at(0.68 * s, 0.0, 0.68 * c, turn + 2.0 * FRAC_PI_2);
        super::furniture::chair(b, &at, metal, Material::plain(bright(r)));
    }
}

/// Builds a planter with a shrub.
pub(super) fn planter(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let stone = Material::new(Pattern::Mottled(0.2), color(0x9a948a), color(0x857f76), 6);
    b.block(f, [0.0, 0.26, 0.0], [0.9, 0.52, 0.9], stone);
    super::tree::shrub(b, &f.at(0.0, 0.45, 0.0, 0.0), r.range(0.42, 0.6), r);
}

pub(super) fn bollard(b: &mut Builder, f: &Frame) {
    let iron = plain(0x2f3436).glossy(0.05);
    b.post(f, [0.0; 3], [0.075, 0.06], 0.85, iron);
    b.ball(f, [0.0, 0.88, 0.0], [0.085, 0.07, 0.085], iron);
    b.post(f, [0.0, 0.68, 0.0], [0.068, 0.066], 0.07, plain(0xe7e4da));
}

/// Builds a parked bicycle along z.
pub(super) fn bicycle(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let tyre = plain(0x1a1a1b);
    let paint = Material::plain(bright(r)).glossy(0.06);
    let ring = |b: &mut Builder, z: f32| {
        let spot = |k: i32| {
            let (s, c) = libm::sincosf(k as f32 * core::f32::consts::TAU / 14.0);
            [0.0, 0.34 + 0.33 * s, z + 0.33 * c]
        };
        for k in 0..14 {
            b.rod(f, spot(k), spot(k + 1), [0.018, 0.018], tyre);
        }
        for k in 0..7 {
            b.rod(f, spot(k), spot(k + 7), [0.003, 0.003], plain(0xb0b3b5));
        }
    };
    ring(b, -0.52);
    ring(b, 0.52);
    for (from, to) in [
        ([0.0, 0.34, -0.52], [0.0, 0.85, -0.2]),
        ([0.0, 0.34, -0.52], [0.0, 0.32, -0.05]),
        ([0.0, 0.32, -0.05], [0.0, 0.95, -0.24]),
        ([0.0, 0.32, -0.05], [0.0, 0.78, 0.36]),
        ([0.0, 0.83, -0.2], [0.0, 0.84, 0.36]),
        ([0.0, 0.34, 0.52], [0.0, 1.0, 0.32]),
    ] {
        b.rod(f, from, to, [0.018, 0.018], paint);
    }
    b.rod(f, [-0.26, 1.02, 0.28], [0.26, 1.02, 0.28], [0.014, 0.014], tyre);
    b.ball(f, [0.0, 0.98, -0.25], [0.07, 0.035, 0.13], tyre);
}
