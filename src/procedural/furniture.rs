//! Pieces of furniture, which stand on the floor at the frame's origin and face +z.

use super::build::{Builder, Frame};
use super::material::{Material, color, plain};
use super::pattern::Pattern;
use super::random::Stream;
use super::style::{Style, accent};
use glam::Vec2;

/// Builds a table with four legs.
pub(super) fn table(b: &mut Builder, f: &Frame, size: [f32; 3], top: Material, legs: Material) {
    let [w, h, d] = size;
    b.block(f, [0.0, h - 0.02, 0.0], [w, 0.04, d], top.glossy(0.03));
    b.block(f, [0.0, h - 0.08, 0.0], [w - 0.16, 0.08, d - 0.16], legs);
    let (x, z) = (0.5 * w - 0.07, 0.5 * d - 0.07);
    for (sx, sz) in [(-x, -z), (x, -z), (-x, z), (x, z)] {
        b.post(f, [sx, 0.0, sz], [0.022, 0.032], h - 0.04, legs);
    }
}

/// Spreads small objects over `w` by `d` of a table top at height `h`.
pub(super) fn things(
    b: &mut Builder,
    f: &Frame,
    [w, h, d]: [f32; 3],
    count: usize,
    r: &mut Stream,
) {
    for k in 0..count {
        let x = w * ((k as f32 + r.range(0.3, 0.7)) / count as f32 - 0.5) * 0.85;
        let at = f.at(x, h, d * r.range(-0.25, 0.25), r.range(-0.6, 0.6));
        match r.index(6) {
            0 => vase(b, &at, r),
            1 => {
                let mut y = 0.0;
                for _ in 0..2 + r.index(4) {
                    let thick = r.range(0.015, 0.04);
                    let book = at.at(0.0, y, 0.0, r.range(-0.4, 0.4));
                    let cover = Material::plain(accent(r));
                    b.block(&book, [0.0, 0.5 * thick, 0.0], [0.23, thick, 0.16], cover);
                    y += thick;
                }
            }
            2 => {
                let bowl = Material::plain(accent(r)).glossy(0.05);
                b.post(&at, [0.0; 3], [0.06, 0.15], 0.07, bowl);
                let fruit = plain(r.pick(&[0xc8452f, 0xe0902c, 0x8fae3c]));
                for (x, z) in [(0.0, 0.0), (0.07, 0.02), (-0.07, 0.03), (0.01, -0.07), (0.0, 0.07)]
                {
                    b.ball(&at, [x, 0.09, z], [0.04; 3], fruit.glossy(0.04));
                }
            }
            3 => {
                let cup = Material::plain(accent(r)).glossy(0.05);
                b.post(&at, [0.0; 3], [0.032, 0.04], 0.095, cup);
                let saucer = plain(0xece7dc).glossy(0.05);
                b.post(&at, [0.12, 0.0, 0.05], [0.08, 0.1], 0.012, saucer);
            }
            4 => {
                let glass = plain(0x2f4a38).glossy(0.08);
                b.post(&at, [0.0; 3], [0.037, 0.037], 0.2, glass);
                b.post(&at, [0.0, 0.2, 0.0], [0.034, 0.014], 0.05, glass);
                b.post(&at, [0.0, 0.25, 0.0], [0.014, 0.014], 0.06, glass);
            }
            _ => {
                let ball = Material::new(Pattern::Stripes(0.09), accent(r), color(0xf0ead8), 1);
                b.ball(&at, [0.0, 0.1, 0.0], [0.1; 3], ball.glossy(0.04));
            }
        }
    }
}

/// Builds a vase with twigs.
fn vase(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let clay = Material::plain(accent(r)).glossy(0.05);
    b.post(f, [0.0; 3], [0.045, 0.075], 0.12, clay);
    b.post(f, [0.0, 0.12, 0.0], [0.075, 0.035], 0.1, clay);
    let (stem, bloom) = (plain(0x5f7a3d), Material::plain(accent(r)));
    for k in 0..6 {
        let (s, c) = libm::sincosf(k as f32 * 1.05 + r.unit());
        let reach = r.range(0.06, 0.18);
        let tip = [reach * c, r.range(0.38, 0.55), reach * s];
        b.rod(f, [0.0, 0.2, 0.0], tip, [0.004, 0.004], stem);
        b.ball(f, tip, [0.035, 0.03, 0.035], bloom);
    }
}

pub(super) fn chair(b: &mut Builder, f: &Frame, wood: Material, seat: Material) {
    for (x, z, h) in
        [(-0.19, 0.19, 0.44), (0.19, 0.19, 0.44), (-0.19, -0.2, 0.92), (0.19, -0.2, 0.92)]
    {
        b.post(f, [x, 0.0, z], [0.016, 0.02], h, wood);
    }
    b.block(f, [0.0, 0.455, 0.0], [0.44, 0.045, 0.44], seat);
    for y in [0.62, 0.74, 0.87] {
        b.block(f, [0.0, y, -0.2], [0.4, 0.06, 0.02], wood);
    }
}

/// Builds a sofa of this width, with cushions.
pub(super) fn sofa(b: &mut Builder, f: &Frame, width: f32, cloth: Material, r: &mut Stream) {
    let w = width;
    b.block(f, [0.0, 0.22, 0.0], [w, 0.24, 0.85], cloth);
    b.block(f, [0.0, 0.56, -0.34], [w, 0.5, 0.18], cloth);
    for side in [-1.0, 1.0] {
        let x = side * (0.5 * w - 0.09);
        b.block(f, [x, 0.42, 0.02], [0.18, 0.4, 0.86], cloth);
        b.rod(f, [x, 0.62, -0.42], [x, 0.62, 0.44], [0.095, 0.095], cloth);
        b.post(f, [x, 0.0, 0.36], [0.02, 0.025], 0.1, plain(0x3a2a1e));
    }
    let seats = if w > 1.5 { 3 } else { 1 };
    let seat_w = (w - 0.38) / seats as f32;
    for k in 0..seats {
        let x = (k as f32 + 0.5) * seat_w - 0.5 * (w - 0.38);
        b.block(f, [x, 0.4, 0.06], [seat_w - 0.015, 0.13, 0.7], cloth);
        b.ball(f, [x, 0.47, 0.06], [0.46 * seat_w, 0.03, 0.32], cloth);
    }
    for side in [-1.0, 1.0] {
        if r.chance(0.8) {
            let pattern = r.pick(&[Pattern::Cloth, Pattern::Stripes(0.06), Pattern::Checks(0.05)]);
            let cover = Material::new(pattern, accent(r), accent(r), r.seed());
            let at = f.at(side * (0.5 * w - 0.42), 0.62, -0.16, side * -0.3);
            b.ball(&at, [0.0; 3], [0.21, 0.2, 0.08], cover);
        }
    }
}

/// Builds a bookcase with its back at z = 0.
pub(super) fn bookcase(
    b: &mut Builder,
    f: &Frame,
    [w, h]: [f32; 2],
    wood: Material,
    r: &mut Stream,
) {
    let d = 0.3;
    for x in [-0.5 * w, 0.5 * w] {
        b.block(f, [x, 0.5 * h, 0.5 * d], [0.03, h, d], wood);
    }
    b.block(f, [0.0, 0.5 * h, 0.01], [w, h, 0.02], wood);
    let shelves = (h / 0.36) as usize;
    let pitch = (h - 0.1) / shelves as f32;
    for k in 0..=shelves {
        let y = 0.06 + k as f32 * pitch;
        b.block(f, [0.0, y, 0.5 * d], [w, 0.025, d], wood);
        if k == shelves {
            break;
        }
        let mut x = -0.5 * w + 0.03;
        let books_to = if r.chance(0.65) { 0.5 * w - 0.06 } else { r.range(-0.1, 0.3) * w };
        while x < books_to {
            let thick = r.range(0.022, 0.058);
            let tall = (pitch - 0.05) * r.range(0.68, 0.97);
            let deep = r.range(0.15, 0.21);
            let cover = Material::plain(accent(r) * r.range(0.55, 1.0));
            b.block(
                f,
                [x + 0.5 * thick, y + 0.0125 + 0.5 * tall, 0.05 + 0.5 * deep],
                [thick - 0.003, tall, deep],
                cover,
            );
            x += thick;
        }
        if x < 0.3 * w {
            let at = f.at(0.5 * (x + 0.5 * w), y + 0.0125, 0.17, 0.0);
            match r.index(3) {
                0 => b.ball(
                    &at,
                    [0.0, 0.09, 0.0],
                    [0.09; 3],
                    Material::plain(accent(r)).glossy(0.05),
                ),
                1 => b.block(&at, [0.0, 0.09, 0.0], [0.2, 0.18, 0.2], plain(0xb08a5a)),
                _ => b.post(
                    &at,
                    [0.0; 3],
                    [0.06, 0.04],
                    0.2,
                    Material::plain(accent(r)).glossy(0.05),
                ),
            }
        }
    }
}

/// Builds a chest of drawers, or a cupboard if it has one row, with its back at z = 0.
pub(super) fn chest(b: &mut Builder, f: &Frame, [w, h, d]: [f32; 3], rows: usize, style: &Style) {
    b.block(f, [0.0, 0.5 * h + 0.04, 0.5 * d], [w, h - 0.08, d], style.paint);
    b.block(f, [0.0, h, 0.5 * d], [w + 0.04, 0.035, d + 0.03], style.wood);
    b.block(f, [0.0, 0.05, 0.5 * d - 0.03], [w - 0.06, 0.1, d - 0.08], style.metal);
    let columns = ((w / 0.55) as usize).max(1);
    let (cell_w, cell_h) = (w / columns as f32, (h - 0.12) / rows as f32);
    for i in 0..columns {
        for j in 0..rows {
            let x = (i as f32 + 0.5) * cell_w - 0.5 * w;
            let y = 0.09 + (j as f32 + 0.5) * cell_h;
            b.block(f, [x, y, d + 0.008], [cell_w - 0.02, cell_h - 0.02, 0.02], style.paint);
            let y = if rows == 1 { y + 0.3 * cell_h } else { y };
            b.block(f, [x, y, d + 0.03], [0.13, 0.015, 0.02], style.metal);
        }
    }
}

/// Builds a bed with its head at z = 0.
pub(super) fn bed(b: &mut Builder, f: &Frame, style: &Style, r: &mut Stream) {
    b.block(f, [0.0, 0.55, 0.03], [1.7, 1.1, 0.06], style.wood);
    b.block(f, [0.0, 0.2, 1.05], [1.62, 0.22, 2.0], style.wood);
    b.block(f, [0.0, 0.41, 1.05], [1.56, 0.2, 1.96], plain(0xe9e4da));
    let pattern = r.pick(&[Pattern::Cloth, Pattern::Stripes(0.12), Pattern::Checks(0.12)]);
    let cover = Material::new(pattern, style.cloth.main, style.accent.main, r.seed());
    b.block(f, [0.0, 0.44, 1.35], [1.66, 0.2, 1.4], cover);
    b.block(f, [0.0, 0.55, 0.72], [1.66, 0.05, 0.22], plain(0xf1ede4));
    for side in [-0.4, 0.4] {
        b.ball(f, [side, 0.6, 0.32], [0.34, 0.11, 0.2], plain(0xf3efe8));
        b.ball(f, [side, 0.66, 0.46], [0.22, 0.18, 0.09], style.accent);
    }
}

/// Builds a desk with a screen that faces +z.
pub(super) fn desk(b: &mut Builder, f: &Frame, style: &Style, r: &mut Stream) {
    table(b, f, [1.4, 0.74, 0.65], style.wood, style.metal);
    let black = plain(0x1d2126).glossy(0.05);
    let shown = Pattern::Picture(Vec2::new(0.28, 0.165));
    let mut screen = Material::new(shown, accent(r), accent(r), r.seed());
    screen.glow = 0.0;
    b.block(f, [0.1, 1.02, -0.12], [0.6, 0.37, 0.03], black);
    b.panel(f, [0.1, 1.02, -0.1], [0.56, 0.33, 0.012], screen.glossy(0.05));
    b.post(f, [0.1, 0.74, -0.14], [0.09, 0.02], 0.14, black);
    b.block(f, [0.1, 0.75, 0.14], [0.42, 0.02, 0.14], plain(0xc9ccd0));
    b.ball(f, [0.42, 0.755, 0.14], [0.03, 0.018, 0.05], black);
    things(b, &f.at(-0.5, 0.0, 0.0, 0.0), [0.3, 0.74, 0.4], 2, r);
}

/// Builds kitchen units of this length along a wall, with wall cupboards.
pub(super) fn kitchen(b: &mut Builder, f: &Frame, length: f32, style: &Style, r: &mut Stream) {
    chest(b, f, [length, 0.9, 0.58], 1, style);
    let tiles = Material::new(Pattern::Tiles(0.12), color(0xe6e4dc), color(0xb9b5aa), r.seed());
    b.block(f, [0.0, 1.18, 0.006], [length, 0.5, 0.012], tiles.glossy(0.05));
    let count = (length / 0.6) as usize;
    for k in 0..count {
        let x = (k as f32 + 0.5) * 0.6 - 0.3 * count as f32;
        if r.chance(0.8) {
            b.block(f, [x, 1.78, 0.17], [0.59, 0.7, 0.34], style.paint);
            b.block(f, [x, 1.78, 0.35], [0.55, 0.66, 0.02], style.paint);
            b.block(f, [x + 0.2, 1.56, 0.37], [0.014, 0.14, 0.02], style.metal);
        }
    }
    let steel = plain(0x9da3a8).glossy(0.12);
    let x = r.range(-0.2, 0.2) * length;
    b.rod(f, [x, 0.9, 0.1], [x, 1.2, 0.1], [0.014, 0.014], steel);
    b.rod(f, [x, 1.2, 0.1], [x, 1.17, 0.28], [0.012, 0.012], steel);
    b.block(f, [x, 0.921, 0.3], [0.5, 0.004, 0.4], steel);
    b.post(f, [x + 0.6, 0.92, 0.32], [0.11, 0.12], 0.16, steel);
    things(b, &f.at(-0.3 * length, 0.0, 0.3, 0.0), [0.8, 0.918, 0.3], 3, r);
}
