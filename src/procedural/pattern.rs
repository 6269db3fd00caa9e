//! Procedural textures, such as boards, tiles, bricks and pictures, filtered over the pixel's footprint.

use super::material::{Material, color};
use super::noise::{band, cloudy, floor, stripe};
use super::random::{lattice, unit};
use glam::{Vec2, Vec3};

/// Layout of the two colours of a material. Lengths are in metres.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pattern {
    /// One colour, faintly mottled.
    Plain,
    /// Mottling between the two colours, with features of this size.
    Mottled(f32),
    /// Wood grain, along v if true, otherwise along u.
    Grain(bool),
    /// Floor boards of this width; `second` is the colour of the joints.
    Boards(f32),
    /// Tiles of this size; `second` is the colour of the joints.
    Tiles(f32),
    /// Checks of this size.
    Checks(f32),
    /// Brickwork; `second` is the colour of the mortar.
    Bricks,
    /// Upright stripes with this period.
    Stripes(f32),
    /// A picture with these half sizes of the canvas.
    Picture(Vec2),
    /// A rug with borders and these half sizes.
    Rug(Vec2),
    /// Woven cloth.
    Cloth,
    /// A facade with bays and storeys of this size, each with a window; `second` is the colour of the frames.
    Facade(Vec2),
    /// A shop front: glass between posts with this period.
    Shop(f32),
    /// A road along z with markings and this half width.
    Road(f32),
    /// A row of letters on a coloured ground with these half sizes.
    Sign(Vec2),
    /// A pane of glass or a surface of water.
    Pane,
}

/// Optical properties at a point of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    pub(super) albedo: Vec3,
    pub(super) glow: Vec3,
    pub(super) gloss: f32,
    /// True for glass, which is a hole in the scanner's depth.
    pub(super) glass: bool,
}

fn dice(i: i32, j: i32, seed: i32) -> f32 {
    unit(lattice(i, j, seed))
}

impl Material {
    /// Returns the surface at texture point `p` with flattened coordinates `uv`.
    pub(super) fn surface(&self, p: Vec3, uv: Vec2, footprint_m: f32) -> Surface {
        let f = footprint_m;
        let (u, v) = (uv.x, uv.y);
        let (main, second, seed) = (self.main, self.second, self.seed);
        let mut found =
            Surface { albedo: main, glow: main * self.glow, gloss: self.gloss, glass: false };
        found.albedo = match self.pattern {
            Pattern::Plain => main * (0.95 + 0.1 * cloudy(u * 2.0, v * 2.0, f * 2.0, seed)),
            Pattern::Mottled(size) => {
                let n = cloudy(u / size, v / size, f / size, seed);
                main.lerp(second, (n * 2.0 - 0.5).clamp(0.0, 1.0))
            }
            Pattern::Grain(upright) => {
                let (along, across) = if upright { (v, u) } else { (u, v) };
                main.lerp(second, grain(along, across, f, seed))
            }
            Pattern::Boards(width) => {
                let row = floor(v / width);
                let length = width * 9.0;
                let shifted = u + length * dice(row, 3, seed);
                let plank = dice(row, floor(shifted / length), seed);
                let tone = 0.78 + 0.4 * plank;
                let wood = main * tone * (0.86 + 0.28 * grain(u + 7.0 * plank, v, f, seed));
                let joint = stripe(v, width, 0.006, f).max(stripe(shifted, length, 0.005, f));
                wood.lerp(second, joint * 0.8)
            }
            Pattern::Tiles(size) => {
                let tone = dice(floor(u / size), floor(v / size), seed);
                let mottle = cloudy(u * 3.0 / size, v * 3.0 / size, f * 3.0 / size, seed);
                let joint = stripe(u, size, 0.03 * size, f).max(stripe(v, size, 0.03 * size, f));
                (main * (0.85 + 0.15 * tone + 0.15 * mottle)).lerp(second, joint)
            }
            Pattern::Checks(size) => {
                let a = stripe(u, 2.0 * size, size, f);
                let b = stripe(v, 2.0 * size, size, f);
                main.lerp(second, a + b - 2.0 * a * b)
            }
            Pattern::Bricks => {
                let row = floor(v / 0.075);
                let shifted = u + 0.125 * (row & 1) as f32;
                let tone = dice(row, floor(shifted / 0.25), seed);
                let joint = stripe(v, 0.075, 0.011, f).max(stripe(shifted, 0.25, 0.011, f));
                let weather = cloudy(u * 0.4, v * 0.4, f * 0.4, seed);
                let fade = (1.0 - f / 0.15).clamp(0.0, 1.0);
                (main * (1.0 + fade * (0.5 * tone - 0.25)) * (0.8 + 0.4 * weather))
                    .lerp(second, joint * 0.8)
            }
            Pattern::Stripes(period) => {
                let s = stripe(u, period, 0.5 * period, f);
                let thin = stripe(u + 0.1 * period, period, 0.05 * period, f);
                main.lerp(second, (s + 0.6 * thin).min(1.0))
            }
            Pattern::Picture(half) => picture(uv / half, f / half.x, self),
            Pattern::Rug(half) => rug(uv, half, f, self),
            Pattern::Cloth => {
                let weave = 0.5 * stripe(u, 0.02, 0.01, f) + 0.5 * stripe(v, 0.02, 0.01, f);
                let worn = cloudy(p.x * 5.0, (p.y + p.z) * 5.0, f * 5.0, seed);
                main.lerp(second, (0.25 * weave + 0.5 * worn).clamp(0.0, 1.0))
            }
            Pattern::Facade(cell) => facade(uv, cell, f, self, &mut found),
            Pattern::Shop(period) => {
                let post = stripe(u + 0.05, period, 0.1, f).max(band(v, -9.0, 0.35, f));
                let shelf = stripe(v - 0.2, 0.7, 0.06, f);
                let ware = dice(floor(u / 0.22), floor((v - 0.2) / 0.7), seed);
                let hue = color([0x9a4a3a, 0x4a6a8a, 0xb09a5a, 0x5a7a52][(ware * 4.0) as usize]);
                let inside = (hue * (0.25 + 0.5 * dice(floor(u / 0.22), 9, seed)))
                    .lerp(Vec3::splat(0.3), shelf);
                found.glass = post < 0.5 && dice(floor(u / period), 5, seed) < 0.6;
                found.gloss = 0.05 * (1.0 - post);
                found.glow = inside * (1.0 - post) * (0.45 * self.glow);
                (inside * 0.6).lerp(second, post)
            }
            Pattern::Road(half_width) => road(u, v, half_width, f, self),
            Pattern::Sign(half) => sign(uv, half, f, self),
            Pattern::Pane => {
                found.glass = true;
                main
            }
        };
        found
    }
}

fn grain(along: f32, across: f32, f: f32, seed: i32) -> f32 {
    let wave = cloudy(along * 0.9, across * 4.0, f * 4.0, seed);
    let rings = across * 26.0 + wave * 9.0;
    let fade = (1.0 - f * 40.0).clamp(0.0, 1.0);
    let ring = (rings - floor(rings) as f32 - 0.5).abs() * 2.0;
    0.5 + (ring - 0.5) * 0.5 * fade + (wave - 0.5) * 0.7
}

/// Returns the colour of a landscape or of abstract shapes. `q` runs from -1 to 1 over the canvas.
fn picture(q: Vec2, f: f32, m: &Material) -> Vec3 {
    let mat = 1.0 - band(q.x, -0.78, 0.78, f) * band(q.y, -0.78, 0.78, f);
    let seed = m.seed;
    let inner = if seed & 1 == 0 {
        let hill = 0.5 * cloudy(q.x * 1.6 + 9.0, 0.0, f, seed) - 0.35;
        let near = 0.5 * cloudy(q.x * 2.3, 5.0, f, seed) - 0.75;
        let sky = color(0xf2d7b0).lerp(color(0x6f9fc8), (q.y * 0.6 + 0.4).clamp(0.0, 1.0));
        let sun_at = Vec2::new(dice(seed, 1, 0) - 0.5, 0.35);
        let sun = band((q - sun_at).length(), -1.0, 0.16, f);
        let far = sky.lerp(color(0xfff3d0), sun).lerp(m.main, band(q.y, -2.0, hill, f));
        far.lerp(m.second, band(q.y, -2.0, near, f))
    } else {
        let mut c = color(0xe9e2d2);
        for k in 0..6 {
            let at = |n| dice(k, n, seed) * 1.5 - 0.75;
            let (x, y) = (at(0), at(1));
            let (w, h) = (0.1 + 0.4 * dice(k, 2, seed), 0.1 + 0.4 * dice(k, 3, seed));
            let ink = [m.main, m.second, color(0x22272e), color(0xd8a13a)][(k & 3) as usize];
            let shape = if dice(k, 4, seed) < 0.5 {
                band(q.x, x - w, x + w, f) * band(q.y, y - h, y + h, f)
            } else {
                band((q - Vec2::new(x, y)).length(), -1.0, w, f)
            };
            c = c.lerp(ink, shape);
        }
        c
    };
    inner.lerp(color(0xeeeae0), mat)
}

fn rug(uv: Vec2, half: Vec2, f: f32, m: &Material) -> Vec3 {
    let edge = (half.x - uv.x.abs()).min(half.y - uv.y.abs());
    let border = band(edge, 0.08, 0.24, f) * 0.8;
    let line = stripe(edge, 0.08, 0.015, f) * band(edge, -1.0, 0.34, f);
    let diamond = stripe(uv.x.abs() + uv.y.abs(), 0.36, 0.09, f) * band(edge, 0.32, 9.0, f);
    let star = stripe(uv.x.abs().max(uv.y.abs()), 0.24, 0.05, f) * band(edge, 0.32, 9.0, f);
    let pile = 0.9 + 0.2 * cloudy(uv.x * 20.0, uv.y * 20.0, f * 20.0, m.seed);
    let ground = m.main.lerp(m.second, border.max(0.8 * diamond));
    ground.lerp(color(0xd9cba8), line.max(0.5 * star)) * pile
}

fn facade(uv: Vec2, cell: Vec2, f: f32, m: &Material, found: &mut Surface) -> Vec3 {
    let (i, j) = (floor(uv.x / cell.x), floor(uv.y / cell.y));
    let q = uv - Vec2::new(i as f32, j as f32) * cell;
    let (w, h) = (0.46 * cell.x, 0.56 * cell.y);
    let (x, y) = (q.x - 0.5 * cell.x, q.y - 0.55 * cell.y);
    let opening = band(x, -0.5 * w, 0.5 * w, f) * band(y, -0.5 * h, 0.5 * h, f);
    let pane = band(x.abs(), 0.03, 0.5 * w - 0.06, f)
        * band(y, -0.5 * h + 0.07, 0.5 * h - 0.06, f)
        * (1.0 - band(y - 0.16 * h, -0.025, 0.025, f));
    let sill = band(x, -0.6 * w, 0.6 * w, f) * band(y, -0.5 * h - 0.12, -0.5 * h, f);
    let lintel = band(x, -0.57 * w, 0.57 * w, f) * band(y, 0.5 * h, 0.5 * h + 0.15, f);
    let weather = 0.82 + 0.36 * cloudy(uv.x * 0.5, uv.y * 0.3, f * 0.5, m.seed);
    let coat = if m.seed % 4 == 0 {
        let joint = stripe(uv.y, 0.075, 0.011, f).max(stripe(
            uv.x + 0.125 * (floor(uv.y / 0.075) & 1) as f32,
            0.25,
            0.011,
            f,
        ));
        m.main.lerp(m.second, 0.5 * joint)
    } else {
        m.main.lerp(m.second, 0.5 * stripe(uv.y + 0.2, cell.y, 0.2, f))
    };
    let room = dice(i, j, m.seed);
    let blind = band(y, 0.5 * h - h * 0.9 * (room - 0.4).max(0.0), 9.0, f);
    let curtain = band(x.abs(), 0.5 * w * (0.55 + 0.4 * dice(j, i, m.seed)), 9.0, f) * 0.7;
    let dark = color(0x1c2329).lerp(color(0x39434a), (y / h + 0.5).clamp(0.0, 1.0));
    let inside = dark.lerp(color(0xb9b2a2) * 0.6, blind.max(curtain));
    let lit = dice(i.wrapping_add(51), j, m.seed) < 0.45;
    if lit {
        let warm = color(0xffcf87).lerp(color(0xffe9c8), room);
        found.glow = warm * (m.glow * pane * (0.35 + 0.65 * (1.0 - blind.max(curtain))));
    } else {
        found.glow = Vec3::ZERO;
    }
    found.glass = pane > 0.5 && dice(j.wrapping_add(17), i, m.seed) < 0.55;
    found.gloss = 0.09 * pane * (1.0 - 0.6 * blind);
    let trim = m.second;
    (coat * weather).lerp(trim, sill.max(lintel)).lerp(trim * 0.9, opening).lerp(inside, pane)
}

fn road(u: f32, v: f32, half_width: f32, f: f32, m: &Material) -> Vec3 {
    let worn = cloudy(u * 0.8, v * 0.25, f * 0.8, m.seed);
    let grit = cloudy(u * 30.0, v * 30.0, f * 30.0, m.seed);
    let tar = m.main * (0.8 + 0.3 * worn + 0.2 * grit);
    let dashes = band(u, -0.07, 0.07, f) * stripe(v, 4.5, 2.2, f);
    let edges = band(u.abs(), half_width - 0.35, half_width - 0.23, f);
    let crossing = stripe(u + half_width, 1.0, 0.5, f)
        * band(u.abs(), -1.0, half_width - 0.5, f)
        * band(v, 8.5, 11.5, f);
    let drain = band(u.abs(), half_width - 0.2, half_width, f);
    let paint = dashes * (1.0 - band(v, 7.0, 13.0, f));
    let paint = paint.max(edges).max(crossing) * (0.7 + 0.3 * worn);
    tar.lerp(tar * 0.7, drain).lerp(m.second, paint)
}

fn sign(uv: Vec2, half: Vec2, f: f32, m: &Material) -> Vec3 {
    let letter_m = half.y * 0.8;
    let i = floor(uv.x / letter_m);
    let x = uv.x / letter_m - i as f32;
    let y = uv.y / half.y;
    let f = f / letter_m;
    let written = band(uv.x.abs(), -1.0, half.x * 0.75, f) * band(y, -0.5, 0.5, f);
    let letter = lattice(i, m.seed, 77);
    let bar = |bit: u32, low: f32, high: f32, at: f32| {
        band(at, low, high, f) * ((letter >> bit) & 1) as f32
    };
    let upright = (band(x, 0.15, 0.33, f)).max(bar(1, 0.62, 0.8, x));
    let level = bar(2, 0.32, 0.5, y).max(bar(3, -0.09, 0.09, y)).max(bar(4, -0.5, -0.32, y));
    let strokes = upright.max(level * band(x, 0.15, 0.8, f));
    m.main.lerp(m.second, written * strokes * band(x, 0.0, 0.86, f))
}
