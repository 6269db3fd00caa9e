//! Furnishing of a room with furniture, lamps, pictures, doors, rugs and plants, arranged by the kind of room.

use super::build::{Builder, Frame};
use super::daylight::Wall;
use super::fittings as fit;
use super::furniture as piece;
use super::material::Material;
use super::pattern::Pattern;
use super::random::Stream;
use super::style::Style;
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Living,
    Dining,
    Study,
    Bedroom,
    Kitchen,
}

/// An unfurnished room.
pub(super) struct Room<'a> {
    pub(super) kind: Kind,
    pub(super) walls: &'a [Wall],
    pub(super) size: [f32; 3],
    pub(super) style: &'a Style,
    /// The point on the floor that the camera faces.
    pub(super) focus: Vec3,
    /// Windowless half of the back wall, as the sign of the wall's x.
    pub(super) free: f32,
}

/// Furnishes a room. A change in the order of the random draws changes the photographs.
pub(super) fn furnish(b: &mut Builder, room: &Room, r: &mut Stream) {
    b.start_piece();
    match room.kind {
        Kind::Living => living(b, room, r),
        Kind::Dining => dining(b, room, r),
        Kind::Study => study(b, room, r),
        Kind::Bedroom => bedroom(b, room, r),
        Kind::Kitchen => kitchen(b, room, r),
    }
    back_wall(b, room, r);
    side_walls(b, room, r);
    plants(b, room, r);
    if room.kind != Kind::Dining && room.kind != Kind::Kitchen {
        b.start_piece();
        let [_, h, d] = room.size;
        let at = Frame::new(Vec3::new(0.0, 0.0, 0.55 * d), 0.0);
        fit::pendant(b, &at, h - 0.4, h, room.style);
    }
}

/// Places a low table with small objects, a rug, a wide and a narrow sofa, and a floor lamp.
fn living(b: &mut Builder, room: &Room, r: &mut Stream) {
    let style = room.style;
    let f = &Frame::new(room.focus, 0.0);
    let size = [r.range(0.9, 1.2), r.range(0.38, 0.46), 0.6];
    piece::table(b, &f.at(0.0, 0.0, 0.1, r.range(-0.2, 0.2)), size, style.wood, style.metal);
    piece::things(b, &f.at(0.0, 0.0, 0.1, 0.0), size, 3, r);
    rug(b, &f.at(0.0, 0.0, 0.3, 0.0), [1.3, 0.95], style, r);
    b.start_piece();
    let back_z = (room.focus.z + r.range(1.1, 1.4)).min(room.size[2] - 0.5);
    let at = Frame::new(Vec3::new(room.focus.x, 0.0, back_z), PI + r.range(-0.1, 0.1));
    piece::sofa(b, &at, r.range(1.9, 2.2), style.cloth, r);
    b.start_piece();
    let side = if r.chance(0.5) { 1.0 } else { -1.0 };
    let at = f.at(side * 1.35, 0.0, 0.2, -side * r.range(1.1, 1.6));
    piece::sofa(b, &at, 0.85, style.accent, r);
    b.start_piece();
    let at = f.at(-side * r.range(0.95, 1.3), 0.0, 0.75, 0.0);
    fit::floor_lamp(b, &at, style);
}

/// Places a table with small objects, four chairs, a rug and a pendant lamp.
fn dining(b: &mut Builder, room: &Room, r: &mut Stream) {
    let style = room.style;
    let f = &Frame::new(room.focus, 0.0);
    let size = [r.range(1.3, 1.7), 0.75, 0.85];
    let yaw = r.range(-0.35, 0.35);
    let at = f.at(0.0, 0.0, 0.2, yaw);
    piece::table(b, &at, size, style.wood, style.wood);
    piece::things(b, &at, size, 4, r);
    for (x, z, turn) in [(-0.4, -0.62, 0.0), (0.4, -0.66, 0.1), (-0.4, 0.62, PI), (0.4, 0.6, PI)] {
        b.start_piece();
        let chair = at.at(x, 0.0, z, turn + r.range(-0.2, 0.2));
        piece::chair(b, &chair, style.wood, style.accent);
    }
    b.start_piece();
    rug(b, &at, [1.3, 1.1], style, r);
    b.start_piece();
    fit::pendant(b, &f.at(0.0, 0.0, 0.2, 0.0), r.range(1.6, 1.75), room.size[1], style);
}

/// Places a desk with a lamp, a chair, boxes and a ball.
fn study(b: &mut Builder, room: &Room, r: &mut Stream) {
    let style = room.style;
    let f = &Frame::new(room.focus, 0.0);
    let at = f.at(0.0, 0.0, 0.5, r.range(-0.5, 0.5) + if r.chance(0.5) { PI } else { 0.0 });
    piece::desk(b, &at, style, r);
    let lamp = at.at(-0.55, 0.74, -0.18, 0.0);
    fit::table_lamp(b, &lamp, style);
    b.start_piece();
    piece::chair(b, &at.at(0.05, 0.0, 0.6, PI + r.range(-0.5, 0.5)), style.metal, style.accent);
    b.start_piece();
    fit::boxes(b, &f.at(r.range(0.75, 1.0), 0.0, -0.3, 0.4), r);
}

/// Places a bed against the back wall, between bedside tables with lamps, and a rug and a chair.
fn bedroom(b: &mut Builder, room: &Room, r: &mut Stream) {
    let style = room.style;
    let f = &Frame::new(room.focus, 0.0);
    let back = &room.walls[0].frame;
    // The wall's x axis points opposite to the world's.
    let at = back.at(-room.focus.x, 0.0, 0.03, r.range(-0.03, 0.03));
    piece::bed(b, &at, style, r);
    for side in [-1.15, 1.15] {
        b.start_piece();
        let stand = at.at(side, 0.0, 0.0, 0.0);
        piece::chest(b, &stand, [0.45, 0.5, 0.4], 2, style);
        let lamp = stand.at(0.0, 0.52, 0.2, 0.0);
        fit::table_lamp(b, &lamp, style);
    }
    b.start_piece();
    rug(b, &f.at(0.1, 0.0, 0.0, 0.0), [1.2, 0.8], style, r);
    b.start_piece();
    piece::chair(
        b,
        &f.at(r.range(-0.7, 0.7), 0.0, 0.1, r.range(1.0, 5.0)),
        style.wood,
        style.cloth,
    );
}

/// Places kitchen units (a cupboard if the wall has a window) along the back wall, an island, chairs and a lamp.
fn kitchen(b: &mut Builder, room: &Room, r: &mut Stream) {
    let style = room.style;
    let f = &Frame::new(room.focus, 0.0);
    let back = &room.walls[0].frame;
    let at = back.at(0.0, 0.0, 0.0, 0.0);
    if room.walls[0].window.is_none() {
        piece::kitchen(b, &at, room.size[0] - 1.6, style, r);
    } else {
        piece::chest(b, &at, [room.size[0] - 1.4, 0.8, 0.55], 1, style);
    }
    b.start_piece();
    let size = [r.range(0.9, 1.2), 0.9, 0.7];
    let island = f.at(0.0, 0.0, 0.3, r.range(-0.3, 0.3));
    piece::chest(b, &island.at(0.0, 0.0, -0.3, PI), [size[0], 0.9, 0.6], 1, style);
    piece::things(b, &island.at(0.0, 0.018, -0.6, 0.0), [size[0], 0.9, 0.4], 4, r);
    b.start_piece();
    fit::pendant(b, &island.at(0.0, 0.0, -0.5, 0.0), 1.72, room.size[1], style);
    for side in [-0.85, 0.85] {
        b.start_piece();
        piece::chair(b, &island.at(side, 0.0, -0.8, -side * 1.5), style.wood, style.accent);
    }
}

/// Places furniture, doors and pictures along the back wall; in a bedroom at most a picture, in a kitchen nothing.
fn back_wall(b: &mut Builder, room: &Room, r: &mut Stream) {
    let w = room.size[0];
    let style = room.style;
    let back = &room.walls[0].frame;
    let free_x = room.free * 0.24 * w;
    if matches!(room.kind, Kind::Living | Kind::Dining | Kind::Study) {
        let has_window = room.walls[0].window.is_some();
        let places: &[f32] = if has_window { &[free_x] } else { &[-0.24 * w, 0.24 * w] };
        for &x in places {
            b.start_piece();
            let at = back.at(x, 0.0, 0.01, 0.0);
            match r.index(4) {
                0 | 1 => {
                    let size = [r.range(0.9, 1.5), r.range(1.7, 2.15)];
                    piece::bookcase(b, &at, size, style.wood, r);
                }
                2 => {
                    let width = r.range(1.1, 1.6);
                    piece::chest(b, &at, [width, 0.8, 0.42], 2, style);
                    piece::things(b, &at.at(0.0, 0.018, 0.2, 0.0), [width, 0.8, 0.3], 3, r);
                    fit::table_lamp(b, &at.at(0.38 * width, 0.82, 0.2, 0.0), style);
                    fit::picture(b, &at.at(0.0, 1.62, 0.0, 0.0), [0.9, 0.62], style, r);
                }
                _ => {
                    fit::door(b, &at, style);
                    fit::picture(b, &at.at(-0.85, 1.55, 0.0, 0.0), [0.45, 0.6], style, r);
                }
            }
        }
    } else if room.kind == Kind::Bedroom && room.walls[0].window.is_none() {
        b.start_piece();
        fit::picture(b, &back.at(-room.focus.x, 1.65, 0.0, 0.0), [1.1, 0.65], style, r);
    }
}

/// Places furniture, doors and pictures along the two side walls.
fn side_walls(b: &mut Builder, room: &Room, r: &mut Stream) {
    let d = room.size[2];
    let style = room.style;
    for wall in [1, 2] {
        let f = &room.walls[wall].frame;
        // The x axis of the left wall points towards the camera, and that of the right wall away from the camera.
        let away = if wall == 1 { -1.0 } else { 1.0 };
        let mut places = vec![0.33 * d, -0.02 * d];
        if let Some(o) = room.walls[wall].window {
            places.retain(|x| (away * x - o.x).abs() > 0.5 * o.w + 0.95);
        }
        for x in places {
            b.start_piece();
            let at = f.at(away * x, 0.0, 0.01, 0.0);
            match r.index(5) {
                0 => fit::door(b, &at, style),
                1 => piece::bookcase(b, &at, [r.range(0.8, 1.2), r.range(1.2, 2.1)], style.wood, r),
                2 => {
                    piece::chest(b, &at, [1.1, 0.75, 0.42], 3, style);
                    piece::things(b, &at.at(0.0, 0.018, 0.2, 0.0), [1.1, 0.75, 0.3], 3, r);
                    fit::picture(b, &at.at(0.0, 1.55, 0.0, 0.0), [0.8, 0.6], style, r);
                }
                3 => {
                    for k in 0..3 {
                        let at = at.at(0.62 * (k as f32 - 1.0), 1.55, 0.0, 0.0);
                        fit::picture(b, &at, [0.42, 0.55], style, r);
                    }
                }
                _ => fit::picture(b, &at.at(0.0, 1.5, 0.0, 0.0), [1.2, 0.8], style, r),
            }
        }
    }
}

/// Places plants in some of the far corners, and perhaps a plant near the middle of the view.
fn plants(b: &mut Builder, room: &Room, r: &mut Stream) {
    let [w, _, d] = room.size;
    for side in [-1.0, 1.0] {
        if r.chance(0.7) {
            b.start_piece();
            let at = Frame::new(Vec3::new(side * (0.5 * w - 0.42), 0.0, d - 0.45), r.unit());
            fit::plant(b, &at, r.range(0.9, 1.6), r);
        }
    }
    if r.chance(0.6) {
        b.start_piece();
        let x = if r.chance(0.5) { -1.0 } else { 1.0 } * r.range(0.55, 0.8);
        let at = Frame::new(room.focus + Vec3::new(x, 0.0, r.range(-0.75, -0.45)), r.unit());
        fit::plant(b, &at, r.range(0.75, 1.15), r);
    }
}

fn rug(b: &mut Builder, f: &Frame, half: [f32; 2], style: &Style, r: &mut Stream) {
    let pattern = Pattern::Rug(Vec2::from(half));
    let seed = r.seed();
    let wool = Material::new(pattern, style.accent.main * 0.8, style.cloth.main * 0.7, seed);
    b.panel(f, [0.0, 0.006, 0.0], [2.0 * half[0], 0.012, 2.0 * half[1]], wool);
}
