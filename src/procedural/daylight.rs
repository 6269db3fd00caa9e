//! Light of rooms: windows, sun, lamps, ambient light and the sky outside.

use super::build::Frame;
use super::material::color;
use super::model::{Bulb, Lights, Opening};
use super::random::Stream;
use super::sky::Sky;
use glam::Vec3;

/// A wall. Its frame has the origin in the middle of the wall's foot, x along the wall and z into the room.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    pub(super) frame: Frame,
    pub(super) length: f32,
    pub(super) window: Option<Hole>,
}

/// An opening in a wall: centre along the wall, height of the sill, width and height, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hole {
    pub(super) x: f32,
    pub(super) sill: f32,
    pub(super) w: f32,
    pub(super) h: f32,
}

/// Returns daylight through the windows of `walls`, perhaps sunlight through wall `lit`, lamplight and ambient light.
pub(super) fn lights(
    walls: &[Wall],
    lit: usize,
    evening: bool,
    lamps: &[Vec3],
    r: &mut Stream,
) -> Lights {
    let daylight = if evening { Vec3::new(0.16, 0.2, 0.32) } else { Vec3::new(3.4, 3.6, 3.8) };
    let openings = walls
        .iter()
        .filter_map(|wall| {
            let o = wall.window?;
            let axes = &wall.frame.axes;
            Some(Opening {
                // The opening is outside the frame and the bars, so that these cast shadows.
                centre: wall.frame.point(Vec3::new(o.x, o.sill + 0.5 * o.h, -0.14)),
                half_u: axes.x_axis * (0.5 * o.w),
                half_v: axes.y_axis * (0.5 * o.h),
                normal: axes.z_axis,
                radiance: daylight,
            })
        })
        .collect();
    let sunny = !evening && lit != 0 && r.chance(0.65);
    let axes = &walls[lit].frame.axes;
    let (elevation, side) = (r.range(0.45, 0.9), r.range(-0.7, 0.7));
    let sun_direction = (-axes.z_axis + axes.x_axis * side + Vec3::Y * elevation).normalize();
    let warm = Vec3::new(1.0, 0.74, 0.46);
    Lights {
        sun_direction,
        sun: if sunny { Vec3::new(3.6, 3.2, 2.6) } else { Vec3::ZERO },
        openings,
        bulbs: lamps
            .iter()
            .map(|&centre| Bulb {
                centre,
                radius_m: 0.07,
                intensity: warm * if evening { 0.85 } else { 0.45 },
            })
            .collect(),
        ambient_up: if evening {
            Vec3::new(0.075, 0.062, 0.05)
        } else {
            Vec3::new(0.2, 0.205, 0.21)
        },
        ambient_down: if evening {
            Vec3::new(0.05, 0.04, 0.03)
        } else {
            Vec3::new(0.16, 0.145, 0.125)
        },
        ambient_reach_m: 1.6,
    }
}

/// Returns the sky outside the windows.
pub(super) fn sky(evening: bool, r: &mut Stream) -> Sky {
    let dim = if evening { 0.1 } else { 1.6 };
    Sky {
        zenith: color(if evening { 0x3a4a78 } else { 0x5f93cc }) * dim,
        horizon: color(if evening { 0x8a6f80 } else { 0xcfdde6 }) * dim,
        cloud: color(0xf4f4f2) * dim,
        cover: r.range(0.2, 0.9),
        seed: r.seed(),
    }
}
