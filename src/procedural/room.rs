//! Rooms: four walls, a floor, windows, and furniture set out by the kind of room.

use super::build::{Builder, Frame};
use super::camera::Pose;
use super::daylight::{Hole, Wall, lights, sky};
use super::fittings as fit;
use super::furniture as piece;
use super::listing::SamplePhotograph;
use super::material::{Material, color};
use super::model::Model;
use super::pattern::Pattern;
use super::random::Stream;
use super::style::{Style, seed, style};
use core::f32::consts::{FRAC_PI_2, PI};
use glam::{Vec2, Vec3};

const WALL_M: f32 = 0.24;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Living,
    Dining,
    Study,
    Bedroom,
    Kitchen,
}

/// The model of an indoor photograph.
pub(super) fn model(photograph: &SamplePhotograph) -> Model {
    let p = photograph;
    let (scene, scan) = (u64::from(p.scene), u64::from(p.scan));
    let style = style(&mut Stream::new(&[p.seed, 11, scene]), scene as usize / 2);
    let r = &mut Stream::new(&[p.seed, 12, scene, scan]);
    let kinds = [
        Kind::Living,
        Kind::Dining,
        Kind::Study,
        Kind::Bedroom,
        Kind::Kitchen,
    ];
    let kind = kinds[(p.scan as usize + p.seed as usize % 5 + p.scene as usize / 2) % 5];
    let (w, h, d) = (r.range(4.2, 6.2), r.range(2.45, 3.0), r.range(5.0, 7.5));
    let evening = r.chance(0.22);

    let mut b = Builder::default();
    let mut walls = [
        (Frame::new(Vec3::new(0.0, 0.0, d), PI), w),
        (Frame::new(Vec3::new(-0.5 * w, 0.0, 0.5 * d), FRAC_PI_2), d),
        (Frame::new(Vec3::new(0.5 * w, 0.0, 0.5 * d), -FRAC_PI_2), d),
        (Frame::new(Vec3::ZERO, 0.0), w),
    ]
    .map(|(frame, length)| Wall {
        frame,
        length,
        window: None,
    });
    let lit = r.pick(&[0, 0, 0, 1, 1, 2, 2]);
    let side = if r.chance(0.5) { 1.0 } else { -1.0 };
    let tall = r.chance(0.25);
    let hole = |r: &mut Stream, x: f32| Hole {
        x,
        sill: if tall { 0.12 } else { r.range(0.8, 0.95) },
        w: r.range(1.2, 2.1),
        h: if tall { 2.0 } else { r.range(1.2, 1.45) },
    };
    walls[lit].window = Some(if lit == 0 {
        hole(r, side * 0.22 * w)
    } else {
        // Far enough along the wall to be in view.
        let away = if lit == 1 { -d } else { d };
        let x = away * r.range(0.12, 0.22);
        hole(r, x)
    });
    if lit == 0 || r.chance(0.35) {
        // Light from behind the camera keeps the back wall from being a silhouette.
        walls[3].window = Some(hole(r, 0.2 * w));
    }
    shell(&mut b, &walls, [w, h, d], &style, r);

    // The wall's own x of the lit back wall runs the other way round: the free half is known.
    let free = if lit == 0 { -side } else { side };
    let eye = Vec3::new(
        r.range(-0.12, 0.12) * w,
        r.range(1.25, 1.65),
        r.range(0.45, 0.9),
    );
    let focus = Vec3::new(r.range(-0.25, 0.25), 0.0, eye.z + r.range(2.1, 2.8));
    let mut lamps = Vec::new();
    let room = Room {
        kind,
        walls: &walls,
        size: [w, h, d],
        style: &style,
        focus,
        free,
        lamps_on: evening || r.chance(0.4),
    };
    furnish(&mut b, &room, r, &mut lamps);

    let view = &mut Stream::new(&[p.seed, 13, scene, scan, u64::from(p.index)]);
    let turn = if p.index.is_multiple_of(2) { 0.0 } else { 1.0 };
    let eye = eye + Vec3::new(view.range(-0.5, 0.5) * turn, view.range(-0.15, 0.15), 0.0);
    let target = focus + Vec3::new(view.range(-0.5, 0.5), view.range(0.65, 0.95), 0.0);
    let to = target - eye;
    let yaw = libm::atan2f(to.x, to.z) + turn * view.range(-0.1, 0.1);
    let pitch = libm::atan2f(to.y, to.z).clamp(-0.25, 0.05);
    b.clear_around(eye, 0.85);
    let lights = lights(&walls, lit, evening, room.lamps_on, &lamps, r);
    Model {
        solids: b.solids,
        sky: sky(evening, r),
        lights,
        pose: Pose::new(eye, yaw, pitch),
        brightness: if evening {
            r.range(0.33, 0.39)
        } else {
            r.range(0.42, 0.53)
        },
        range_m: 15.0,
    }
}

fn shell(b: &mut Builder, walls: &[Wall], [w, h, d]: [f32; 3], style: &Style, r: &mut Stream) {
    let f = &Frame::world();
    b.start_place();
    let (wide, deep) = (w + 2.0 * WALL_M, d + 2.0 * WALL_M);
    b.block(f, [0.0, -0.1, 0.5 * d], [wide, 0.2, deep], style.floor);
    let white = Material::plain(color(0xf0ede6));
    b.block(f, [0.0, h + 0.1, 0.5 * d], [wide, 0.2, deep], white);
    for wall in walls {
        let f = &wall.frame;
        let half = 0.5 * wall.length;
        // The long walls close the corners.
        let end = half + WALL_M;
        let mut part = |x0: f32, x1: f32, y0: f32, y1: f32| {
            let centre = [0.5 * (x0 + x1), 0.5 * (y0 + y1), -0.5 * WALL_M];
            b.block(f, centre, [x1 - x0, y1 - y0, WALL_M], style.wall);
        };
        if let Some(o) = wall.window {
            let (x0, x1) = (o.x - 0.5 * o.w, o.x + 0.5 * o.w);
            part(-end, x0, 0.0, h);
            part(x1, end, 0.0, h);
            part(x0, x1, 0.0, o.sill);
            part(x0, x1, o.sill + o.h, h);
            let at = f.at(o.x, o.sill + 0.5 * o.h, 0.0, 0.0);
            fit::window(b, &at, [o.w, o.h], style, r);
        } else {
            part(-end, end, 0.0, h);
        }
        b.block(f, [0.0, 0.05, 0.008], [wall.length, 0.1, 0.016], white);
        b.block(f, [0.0, h - 0.03, 0.015], [wall.length, 0.06, 0.03], white);
    }
}

struct Room<'a> {
    kind: Kind,
    walls: &'a [Wall],
    size: [f32; 3],
    style: &'a Style,
    /// Where the camera looks, on the floor.
    focus: Vec3,
    /// Half of the back wall without a window: sign of the wall's x.
    free: f32,
    lamps_on: bool,
}

fn furnish(b: &mut Builder, room: &Room, r: &mut Stream, lamps: &mut Vec<Vec3>) {
    let [w, h, d] = room.size;
    let style = room.style;
    let on = room.lamps_on;
    let f = &Frame::new(room.focus, 0.0);
    let back = &room.walls[0].frame;
    // The wall's x runs against the world's.
    let free_x = room.free * 0.24 * w;
    b.start_piece();
    match room.kind {
        Kind::Living => {
            let size = [r.range(0.9, 1.2), r.range(0.38, 0.46), 0.6];
            piece::table(
                b,
                &f.at(0.0, 0.0, 0.1, r.range(-0.2, 0.2)),
                size,
                style.wood,
                style.metal,
            );
            piece::things(b, &f.at(0.0, 0.0, 0.1, 0.0), size, 3, r);
            rug(b, &f.at(0.0, 0.0, 0.3, 0.0), [1.3, 0.95], style, r);
            b.start_piece();
            let back_z = (room.focus.z + r.range(1.1, 1.4)).min(d - 0.5);
            let at = Frame::new(
                Vec3::new(room.focus.x, 0.0, back_z),
                PI + r.range(-0.1, 0.1),
            );
            piece::sofa(b, &at, r.range(1.9, 2.2), style.cloth, r);
            b.start_piece();
            let side = if r.chance(0.5) { 1.0 } else { -1.0 };
            let at = f.at(side * 1.35, 0.0, 0.2, -side * r.range(1.1, 1.6));
            piece::sofa(b, &at, 0.85, style.accent, r);
            b.start_piece();
            let at = f.at(-side * r.range(0.95, 1.3), 0.0, 0.75, 0.0);
            lamps.push(fit::floor_lamp(b, &at, style, on));
        }
        Kind::Dining => {
            let size = [r.range(1.3, 1.7), 0.75, 0.85];
            let yaw = r.range(-0.35, 0.35);
            let at = f.at(0.0, 0.0, 0.2, yaw);
            piece::table(b, &at, size, style.wood, style.wood);
            piece::things(b, &at, size, 4, r);
            for (x, z, turn) in [
                (-0.4, -0.62, 0.0),
                (0.4, -0.66, 0.1),
                (-0.4, 0.62, PI),
                (0.4, 0.6, PI),
            ] {
                b.start_piece();
                let chair = at.at(x, 0.0, z, turn + r.range(-0.2, 0.2));
                piece::chair(b, &chair, style.wood, style.accent);
            }
            b.start_piece();
            rug(b, &at, [1.3, 1.1], style, r);
            b.start_piece();
            let lamp = fit::pendant(
                b,
                &f.at(0.0, 0.0, 0.2, 0.0),
                r.range(1.6, 1.75),
                h,
                style,
                on,
            );
            lamps.push(lamp);
        }
        Kind::Study => {
            let at = f.at(
                0.0,
                0.0,
                0.5,
                r.range(-0.5, 0.5) + if r.chance(0.5) { PI } else { 0.0 },
            );
            piece::desk(b, &at, style, r);
            let lamp = at.at(-0.55, 0.74, -0.18, 0.0);
            lamps.push(fit::table_lamp(b, &lamp, style, on));
            b.start_piece();
            piece::chair(
                b,
                &at.at(0.05, 0.0, 0.6, PI + r.range(-0.5, 0.5)),
                style.metal,
                style.accent,
            );
            b.start_piece();
            fit::boxes(b, &f.at(r.range(0.75, 1.0), 0.0, -0.3, 0.4), r);
        }
        Kind::Bedroom => {
            let at = back.at(-room.focus.x, 0.0, 0.03, r.range(-0.03, 0.03));
            piece::bed(b, &at, style, r);
            for side in [-1.15, 1.15] {
                b.start_piece();
                let stand = at.at(side, 0.0, 0.0, 0.0);
                piece::chest(b, &stand, [0.45, 0.5, 0.4], 2, style);
                let lamp = stand.at(0.0, 0.52, 0.2, 0.0);
                lamps.push(fit::table_lamp(b, &lamp, style, on));
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
        Kind::Kitchen => {
            let at = back.at(0.0, 0.0, 0.0, 0.0);
            if room.walls[0].window.is_none() {
                piece::kitchen(b, &at, w - 1.6, style, r);
            } else {
                piece::chest(b, &at, [w - 1.4, 0.8, 0.55], 1, style);
            }
            b.start_piece();
            let size = [r.range(0.9, 1.2), 0.9, 0.7];
            let island = f.at(0.0, 0.0, 0.3, r.range(-0.3, 0.3));
            piece::chest(
                b,
                &island.at(0.0, 0.0, -0.3, PI),
                [size[0], 0.9, 0.6],
                1,
                style,
            );
            piece::things(
                b,
                &island.at(0.0, 0.018, -0.6, 0.0),
                [size[0], 0.9, 0.4],
                4,
                r,
            );
            b.start_piece();
            lamps.push(fit::pendant(
                b,
                &island.at(0.0, 0.0, -0.5, 0.0),
                1.72,
                h,
                style,
                on,
            ));
            for side in [-0.85, 0.85] {
                b.start_piece();
                piece::chair(
                    b,
                    &island.at(side, 0.0, -0.8, -side * 1.5),
                    style.wood,
                    style.accent,
                );
            }
        }
    }
    along_walls(b, room, free_x, r, lamps);
}

/// Cupboards, doors and pictures along the walls, plants in the corners.
fn along_walls(b: &mut Builder, room: &Room, free_x: f32, r: &mut Stream, lamps: &mut Vec<Vec3>) {
    let [w, h, d] = room.size;
    let style = room.style;
    let back = &room.walls[0].frame;
    if matches!(room.kind, Kind::Living | Kind::Dining | Kind::Study) {
        let has_window = room.walls[0].window.is_some();
        let places: &[f32] = if has_window {
            &[free_x]
        } else {
            &[-0.24 * w, 0.24 * w]
        };
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
                    lamps.push(fit::table_lamp(
                        b,
                        &at.at(0.38 * width, 0.82, 0.2, 0.0),
                        style,
                        room.lamps_on,
                    ));
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
        fit::picture(
            b,
            &back.at(-room.focus.x, 1.65, 0.0, 0.0),
            [1.1, 0.65],
            style,
            r,
        );
    }
    for wall in [1, 2] {
        let f = &room.walls[wall].frame;
        // On the left wall x runs towards the camera, on the right one away from it.
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
                1 => piece::bookcase(
                    b,
                    &at,
                    [r.range(0.8, 1.2), r.range(1.2, 2.1)],
                    style.wood,
                    r,
                ),
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
        let at = Frame::new(
            room.focus + Vec3::new(x, 0.0, r.range(-0.75, -0.45)),
            r.unit(),
        );
        fit::plant(b, &at, r.range(0.75, 1.15), r);
    }
    if room.kind != Kind::Dining && room.kind != Kind::Kitchen {
        b.start_piece();
        let at = Frame::new(Vec3::new(0.0, 0.0, 0.55 * d), 0.0);
        lamps.push(fit::pendant(b, &at, h - 0.4, h, style, room.lamps_on));
    }
}

fn rug(b: &mut Builder, f: &Frame, half: [f32; 2], style: &Style, r: &mut Stream) {
    let pattern = Pattern::Rug(Vec2::from(half));
    let seed = seed(r);
    let wool = Material::new(
        pattern,
        style.accent.main * 0.8,
        style.cloth.main * 0.7,
        seed,
    );
    b.panel(
        f,
        [0.0, 0.006, 0.0],
        [2.0 * half[0], 0.012, 2.0 * half[1]],
        wool,
    );
}
