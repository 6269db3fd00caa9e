//! Rooms: walls, floor, ceiling, windows and lights; `furnish.rs` adds the furniture.

use super::build::{Builder, Frame};
use super::camera::Pose;
use super::daylight::{Hole, Wall, lights, sky};
use super::fittings as fit;
use super::furnish::{Kind, Room, furnish};
use super::listing::SamplePhotograph;
use super::material::plain;
use super::model::Model;
use super::random::Stream;
use super::style::{Style, style};
use core::f32::consts::{FRAC_PI_2, PI};
use glam::Vec3;

const WALL_M: f32 = 0.24;

/// Builds the model of an indoor photograph.
pub(super) fn model(photograph: &SamplePhotograph) -> Model {
    let p = photograph;
    let (scene, scan) = (u64::from(p.scene), u64::from(p.scan));
    let style = style(&mut Stream::new(&[p.seed, 11, scene]), scene as usize / 2);
    let r = &mut Stream::new(&[p.seed, 12, scene, scan]);
    let kinds = [Kind::Living, Kind::Dining, Kind::Study, Kind::Bedroom, Kind::Kitchen];
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
    .map(|(frame, length)| Wall { frame, length, window: None });
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
        // Places the window far enough along the wall to be in view.
        let away = if lit == 1 { -d } else { d };
        let x = away * r.range(0.12, 0.22);
        hole(r, x)
    });
    if lit == 0 || r.chance(0.35) {
        // A window behind the camera lights the back wall, which may otherwise be a silhouette.
        walls[3].window = Some(hole(r, 0.2 * w));
    }
    shell(&mut b, &walls, [w, h, d], &style, r);

    // A window in the back wall leaves the other half of this wall free.
    let free = if lit == 0 { -side } else { side };
    let eye = Vec3::new(r.range(-0.12, 0.12) * w, r.range(1.25, 1.65), r.range(0.45, 0.9));
    let focus = Vec3::new(r.range(-0.25, 0.25), 0.0, eye.z + r.range(2.1, 2.8));
    let room = Room { kind, walls: &walls, size: [w, h, d], style: &style, focus, free };
    b.lamps_on = evening || r.chance(0.4);
    furnish(&mut b, &room, r);

    let view = &mut Stream::new(&[p.seed, 13, scene, scan, u64::from(p.index)]);
    let turn = if p.index.is_multiple_of(2) { 0.0 } else { 1.0 };
    let eye = eye + Vec3::new(view.range(-0.5, 0.5) * turn, view.range(-0.15, 0.15), 0.0);
    let target = focus + Vec3::new(view.range(-0.5, 0.5), view.range(0.65, 0.95), 0.0);
    let to = target - eye;
    let yaw = libm::atan2f(to.x, to.z) + turn * view.range(-0.1, 0.1);
    let pitch = libm::atan2f(to.y, to.z).clamp(-0.25, 0.05);
    b.clear_around(eye, 0.85);
    let lights = lights(&walls, lit, evening, b.lit_lamps(), r);
    Model {
        solids: b.solids,
        sky: sky(evening, r),
        lights,
        pose: Pose::new(eye, yaw, pitch),
        brightness: if evening { r.range(0.33, 0.39) } else { r.range(0.42, 0.53) },
        range_m: 15.0,
    }
}

fn shell(b: &mut Builder, walls: &[Wall], [w, h, d]: [f32; 3], style: &Style, r: &mut Stream) {
    let f = &Frame::world();
    b.start_place();
    let (wide, deep) = (w + 2.0 * WALL_M, d + 2.0 * WALL_M);
    b.block(f, [0.0, -0.1, 0.5 * d], [wide, 0.2, deep], style.floor);
    let white = plain(0xf0ede6);
    b.block(f, [0.0, h + 0.1, 0.5 * d], [wide, 0.2, deep], white);
    for wall in walls {
        let f = &wall.frame;
        let half = 0.5 * wall.length;
        // All walls extend into the corners.
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
