//! Buildings and roads.

use super::build::{Builder, Frame};
use super::material::{Material, color, plain};
use super::pattern::Pattern;
use super::random::Stream;
use glam::{Vec2, Vec3};

const COATS: [(u32, u32); 9] = [
    (0xb5654a, 0xd9d0bd),
    (0xd8c7a3, 0xf0eadc),
    (0xa9b3b5, 0xe6e4de),
    (0xc98f6a, 0xeee2cf),
    (0x8f9c86, 0xdfdccb),
    (0xd9b36a, 0xf1e9d6),
    (0x9a5a48, 0xcfc5b2),
    (0xbcc4cc, 0xf2f2ee),
    (0xc7a89a, 0xefe6dc),
];

/// A building with its front at z = 0, facing +z. Lengths are in metres.
#[derive(Clone, Copy)]
struct Building {
    width: f32,
    /// Height of the ground floor.
    base: f32,
    storeys: usize,
    bays: usize,
    /// Width of a bay and height of a storey.
    cell: Vec2,
    stone: Material,
}

/// Builds a building of this width, height and depth; the height is rounded down to whole storeys, but at least two.
///
/// A `near` building also gets sills, lintels, jambs, a drainpipe and perhaps balconies.
pub(super) fn building(
    b: &mut Builder,
    f: &Frame,
    [w, h, d]: [f32; 3],
    near: bool,
    night: f32,
    r: &mut Stream,
) {
    let (coat, trim) = r.pick(&COATS);
    let (coat, trim) = (color(coat), color(trim));
    let base = 3.3;
    let storey = r.range(2.9, 3.3);
    let storeys = (((h - base) / storey) as usize).max(1);
    let h = base + storey * storeys as f32;
    let bays = ((w / r.range(1.9, 2.7)) as usize).max(2);
    let cell = Vec2::new(w / bays as f32, storey);
    let mut front = Material::new(Pattern::Facade(cell), coat, trim, r.seed());
    front.glow = night;
    // The texture counts bays from the end at -x and storeys from the first floor.
    let corner = f.at(-0.5 * w, base, 0.0, 0.0);
    let upper = h - base;
    b.block(&corner, [0.5 * w, 0.5 * upper, -0.5 * d], [w, upper, d], front);
    let shop = r.chance(0.6);
    let post = w / ((w / 1.6) as usize).max(1) as f32;
    let mut ground = if shop {
        Material::new(Pattern::Shop(post), trim, coat * 0.6, r.seed())
    } else {
        Material::new(Pattern::Tiles(0.8), coat * 0.8, trim * 0.6, r.seed())
    };
    ground.glow = night;
    let foot = f.at(-0.5 * w, 0.0, 0.0, 0.0);
    b.block(&foot, [0.5 * w, 0.5 * base, -0.5 * d - 0.05], [w, base, d], ground);
    let stone = Material::plain(trim);
    b.block(f, [0.0, base, -0.5 * d + 0.06], [w, 0.28, d], stone);
    b.block(f, [0.0, h + 0.1, -0.5 * d + 0.15], [w + 0.2, 0.35, d + 0.2], stone);
    roof(b, f, [w, h, d], r);
    let house = Building { width: w, base, storeys, bays, cell, stone };
    door(b, f, &house, r);
    if shop {
        shop_front(b, f, &house, r);
    }
    if near {
        windows(b, f, &house, r);
        let pipe = plain(0x6a6e70);
        b.post(f, [0.5 * w - 0.15, 0.0, 0.08], [0.05, 0.05], h, pipe);
    }
}

/// Builds a door in one of the bays, with a frame and a step.
fn door(b: &mut Builder, f: &Frame, house: &Building, r: &mut Stream) {
    let stone = house.stone;
    let x = (r.index(house.bays) as f32 + 0.5) * house.cell.x - 0.5 * house.width;
    let paint = plain(r.pick(&[0x2f4a3c, 0x5a2a24, 0x2a3a55, 0x6a4a2a]));
    b.block(f, [x, 1.1, 0.0], [1.2, 2.2, 0.12], stone);
    b.block(f, [x, 1.05, 0.04], [0.96, 2.05, 0.12], paint.glossy(0.03));
    b.block(f, [x, 0.08, 0.3], [1.4, 0.16, 0.6], stone);
}

/// Builds a sign at the top of the ground floor, usually with an awning.
fn shop_front(b: &mut Builder, f: &Frame, house: &Building, r: &mut Stream) {
    let (w, base) = (house.width, house.base);
    let colour = color(r.pick(&[0x27483f, 0x7a2a26, 0x283a5c, 0x2a2a2c, 0xb08a3a]));
    let half = Vec2::new(0.35 * w, 0.22);
    let board = Material::new(Pattern::Sign(half), colour, color(0xf0e6cc), r.seed());
    b.panel(f, [0.0, base - 0.38, 0.05], [0.7 * w, 0.44, 0.1], board);
    if r.chance(0.7) {
        let cloth = Material::new(Pattern::Stripes(0.6), colour * 1.6, color(0xe8e2d4), 1);
        let (z0, z1) = (0.05, 1.1);
        for k in 0..6 {
            let t = (k as f32 + 0.5) / 6.0;
            let at = [0.0, base - 0.72 - 0.42 * t, z0 + (z1 - z0) * t];
            b.block(f, at, [0.8 * w, 0.08, 0.19], cloth);
        }
    }
}

/// Builds sills, lintels and jambs of the lower storeys' windows, and balconies on some buildings.
fn windows(b: &mut Builder, f: &Frame, house: &Building, r: &mut Stream) {
    let Building { cell, stone, .. } = *house;
    let has_balconies = r.chance(0.45);
    let (ww, hh) = (0.46 * cell.x, 0.56 * cell.y);
    for j in 0..house.storeys.min(4) {
        for i in 0..house.bays {
            let x = (i as f32 + 0.5) * cell.x - 0.5 * house.width;
            let y = house.base + (j as f32 + 0.55) * cell.y;
            let sill = [x, y - 0.5 * hh - 0.06, 0.06];
            b.block(f, sill, [1.2 * ww, 0.1, 0.2], stone);
            let lintel = [x, y + 0.5 * hh + 0.08, 0.03];
            b.block(f, lintel, [1.14 * ww, 0.15, 0.1], stone);
            for side in [-0.53, 0.53] {
                b.block(f, [x + side * ww, y, 0.02], [0.08, hh, 0.07], stone);
            }
            if has_balconies && (i + j) % 2 == 0 {
                balcony(b, f, [x, y - 0.5 * hh - 0.12], cell.x, stone);
            }
        }
    }
}

/// Builds a balcony with railings; `x` is its centre, `foot` its height and `bay` the width of the bay.
fn balcony(b: &mut Builder, f: &Frame, [x, foot]: [f32; 2], bay: f32, stone: Material) {
    let iron = plain(0x2c3033);
    b.block(f, [x, foot, 0.4], [0.85 * bay, 0.1, 0.8], stone);
    b.block(f, [x, foot + 0.95, 0.78], [0.85 * bay, 0.05, 0.04], iron);
    for k in 0..9 {
        let at = x + 0.83 * bay * (k as f32 / 8.0 - 0.5);
        b.post(f, [at, foot, 0.78], [0.014, 0.014], 0.95, iron);
    }
}

fn roof(b: &mut Builder, f: &Frame, [w, h, d]: [f32; 3], r: &mut Stream) {
    let tile = plain(r.pick(&[0x7a4436, 0x4a4e54, 0x5f4a40]));
    if r.chance(0.6) {
        let steps = 6;
        for k in 0..steps {
            let t = k as f32 / steps as f32;
            let y = h + 0.27 + (k as f32 + 0.5) * 0.36;
            let inset = 0.45 * d * t;
            b.block(f, [0.0, y, -0.5 * d], [w, 0.37, d - 2.0 * inset + 0.1], tile);
        }
    }
    for _ in 0..=r.index(2) {
        let x = r.range(-0.4, 0.4) * w;
        let brick = Material::new(Pattern::Bricks, color(0x8f5a45), color(0xb8ac9c), 8);
        b.block(f, [x, h + 1.4, -0.5 * d], [0.8, 2.8, 0.6], brick);
        b.post(f, [x, h + 2.8, -0.5 * d], [0.12, 0.1], 0.4, tile);
    }
}

/// Builds a row of buildings along one side of a street: `side` is the sign of x, `x_m` the mean |x| of the fronts.
pub(super) fn row(
    b: &mut Builder,
    side: f32,
    x_m: f32,
    from_to_m: [f32; 2],
    night: f32,
    r: &mut Stream,
) {
    let [mut z, to_m] = from_to_m;
    while z < to_m {
        let w = r.range(7.0, 13.0);
        let h = r.range(8.0, 17.0);
        let back = r.range(-0.3, 0.3);
        let at = Vec3::new(side * (x_m + back), 0.12, z + 0.5 * w);
        let f = Frame::new(at, -side * core::f32::consts::FRAC_PI_2);
        building(b, &f, [w, h, 8.0], z < 22.0, night, r);
        z += w + if r.chance(0.18) { r.range(1.5, 4.0) } else { 0.02 };
    }
}

/// Builds a road, kerbs and pavements along z: `half_m` is half the road's width, `pavement_m` a pavement's width.
pub(super) fn road(b: &mut Builder, half_m: f32, pavement_m: f32, r: &mut Stream) {
    let f = &Frame::world();
    let tar = color(r.pick(&[0x55565a, 0x4a4b4f, 0x625f5c]));
    let marked = Material::new(Pattern::Road(half_m), tar, color(0xd9d7cf), r.seed());
    b.block(f, [0.0, -0.2, 30.0], [2.0 * half_m, 0.4, 120.0], marked);
    let (slab, joint) = r.pick(&[(0xa9a49a, 0x86817a), (0xb5a594, 0x8f8272), (0x999c9e, 0x7b7d7f)]);
    let slabs = Material::new(Pattern::Tiles(0.5), color(slab), color(joint), r.seed());
    let kerb = plain(0xb4b2ac);
    for side in [-1.0, 1.0] {
        let x = side * (half_m + 0.5 * pavement_m + 10.0);
        b.block(f, [x, -0.14, 30.0], [pavement_m + 20.0, 0.52, 120.0], slabs);
        b.block(f, [side * (half_m + 0.08), -0.138, 30.0], [0.17, 0.53, 120.0], kerb);
    }
}
