//! Outdoor places (streets, squares with cafés, parks) by day or in the evening.

use super::build::{Builder, Frame};
use super::camera::Pose;
use super::listing::SamplePhotograph;
use super::material::{Material, color, plain};
use super::model::{Bulb, Lights, Model};
use super::pattern::Pattern;
use super::random::Stream;
use super::sky::Sky;
use super::{garden, street, tree};
use core::f32::consts::{FRAC_PI_2, PI};
use glam::Vec3;

/// Time of day and weather.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hour {
    Noon,
    Golden,
    Overcast,
    Evening,
}

/// Positions of the camera and of its target.
struct Outlook {
    eye: Vec3,
    target: Vec3,
}

/// Builds the model of an outdoor photograph.
pub(super) fn model(photograph: &SamplePhotograph) -> Model {
    let p = photograph;
    let (scene, scan) = (u64::from(p.scene), u64::from(p.scan));
    let r = &mut Stream::new(&[p.seed, 21, scene, scan]);
    let hour = match r.index(10) {
        0..=4 => Hour::Noon,
        5 | 6 => Hour::Golden,
        7 | 8 => Hour::Overcast,
        _ => Hour::Evening,
    };
    let night = if hour == Hour::Evening { 0.9 } else { 0.0 };
    let mut b = Builder::default();
    b.lamps_on = hour == Hour::Evening;
    let of_scan = p.scan as usize + p.scene as usize / 2 + p.seed as usize % 3;
    let place = match of_scan % 3 {
        0 => street_place(&mut b, night, r),
        1 => square(&mut b, night, r),
        _ => park(&mut b, night, r),
    };
    let view = &mut Stream::new(&[p.seed, 23, scene, scan, u64::from(p.index)]);
    let shift = if p.index.is_multiple_of(2) { 0.0 } else { 1.0 };
    let eye = place.eye + Vec3::new(view.range(-0.7, 0.7), view.range(-0.2, 0.2), 0.0) * shift;
    let to = place.target - eye;
    let yaw = libm::atan2f(to.x, to.z) + view.range(-0.06, 0.06);
    let pitch = libm::atan2f(to.y, (to.x * to.x + to.z * to.z).sqrt()) + 0.02;
    b.clear_around(eye, 1.0);
    let sky = sky(hour, r);
    let lights = lights(hour, &sky, b.lit_lamps(), r);
    Model {
        solids: b.solids,
        lights,
        sky,
        pose: Pose::new(eye, yaw, pitch),
        brightness: match hour {
            Hour::Evening => r.range(0.31, 0.37),
            Hour::Golden => r.range(0.42, 0.48),
            _ => r.range(0.45, 0.54),
        },
        range_m: 60.0,
    }
}

fn street_place(b: &mut Builder, night: f32, r: &mut Stream) -> Outlook {
    let half_m = r.range(3.2, 4.2);
    let pavement_m = r.range(2.8, 3.8);
    b.start_place();
    street::road(b, half_m, pavement_m, r);
    for side in [-1.0, 1.0] {
        let begin = r.range(-9.0, -3.0);
        street::row(b, side, half_m + pavement_m, [begin, 52.0], night, r);
    }
    // A house at the end of the street closes the view.
    let end = Frame::new(Vec3::new(r.range(-4.0, 4.0), 0.1, r.range(54.0, 58.0)), PI);
    street::building(b, &end, [16.0, r.range(11.0, 16.0), 8.0], false, night, r);
    for k in 0..5 {
        for side in [-1.0, 1.0] {
            let z = 5.0 + 10.5 * k as f32 + r.range(0.0, 4.0);
            let x = side * (half_m + 0.45);
            b.start_piece();
            let at = Vec3::new(x, 0.12, z);
            match (k + usize::from(side > 0.0)) % 2 {
                0 => {
                    let f = Frame::new(at, if side > 0.0 { PI } else { 0.0 });
                    garden::lamp_post(b, &f);
                }
                _ => tree::broadleaf(b, &Frame::new(at, r.unit()), r.range(4.5, 6.5), r),
            }
            if r.chance(0.7) {
                b.start_piece();
                let turn = if side > 0.0 { 0.0 } else { PI };
                let at = Vec3::new(side * (half_m - 1.05), 0.0, z + r.range(3.0, 6.5));
                garden::car(b, &Frame::new(at, turn + r.range(-0.03, 0.03)), r);
            }
        }
    }
    for _ in 0..7 {
        let side = if r.chance(0.5) { 1.0 } else { -1.0 };
        b.start_piece();
        let at =
            Vec3::new(side * (half_m + r.range(0.8, pavement_m - 0.4)), 0.12, r.range(3.0, 26.0));
        let turn = if r.chance(0.5) { 0.0 } else { PI };
        garden::person(b, &Frame::new(at, turn + r.range(-0.3, 0.3)), r);
    }
    let side = if r.chance(0.5) { 1.0 } else { -1.0 };
    let eye = Vec3::new(side * r.range(0.3, half_m + 1.3), r.range(1.5, 1.9), 0.0);
    let target = Vec3::new(-side * r.range(0.0, half_m + 1.0), r.range(1.5, 2.3), 14.0);
    let things = &[Thing::Bollard, Thing::Sign, Thing::Bicycle, Thing::Person];
    foreground(b, eye, target, things, r);
    Outlook { eye, target }
}

fn square(b: &mut Builder, night: f32, r: &mut Stream) -> Outlook {
    let f = &Frame::world();
    b.start_place();
    let (slab, joint) = r.pick(&[(0xb0a594, 0x8a8072), (0xa5a5a0, 0x7f807c), (0xb89a80, 0x927a64)]);
    let size = r.pick(&[0.35, 0.6, 0.9]);
    let paving = Material::new(Pattern::Tiles(size), color(slab), color(joint), 41);
    b.block(f, [0.0, -0.2, 30.0], [90.0, 0.4, 120.0], paving);
    let depth_m = r.range(18.0, 30.0);
    let half_m = r.range(9.0, 13.0);
    let mut x = -24.0;
    while x < 24.0 {
        let w = r.range(7.0, 12.0);
        let at = Frame::new(Vec3::new(x + 0.5 * w, 0.0, depth_m), PI);
        street::building(b, &at, [w, r.range(8.0, 15.0), 8.0], true, night, r);
        x += w + 0.02;
    }
    for side in [-1.0, 1.0] {
        street::row(b, side, half_m, [-4.0, depth_m - 4.0], night, r);
    }
    b.start_piece();
    let middle = Frame::new(Vec3::new(r.range(-1.5, 1.5), 0.0, r.range(9.0, 12.0)), r.unit());
    monument(b, &middle, r);
    let eye = Vec3::new(r.range(-2.0, 2.0), r.range(1.45, 1.8), 0.0);
    let target = middle.origin + Vec3::Y * r.range(1.2, 1.8);
    for k in 0..6 {
        b.start_piece();
        let x = r.range(-5.0, 5.0);
        let z = 3.4 + 2.0 * k as f32 + r.range(-0.5, 0.5);
        let at = Frame::new(Vec3::new(x, 0.0, z), r.range(0.0, 6.0));
        match r.index(4) {
            0 => garden::person(b, &at, r),
            1 => garden::planter(b, &at, r),
            _ => garden::cafe(b, &at, r),
        }
    }
    for _ in 0..6 {
        b.start_piece();
        let at = Vec3::new(r.range(-7.0, 7.0), 0.0, r.range(5.0, depth_m - 3.0));
        garden::person(b, &Frame::new(at, r.range(0.0, 6.0)), r);
    }
    for side in [-1.0, 1.0] {
        for k in 0..3 {
            b.start_piece();
            let at = Vec3::new(side * (half_m - 3.0), 0.0, 5.0 + 6.0 * k as f32);
            let f = Frame::new(at, if side > 0.0 { PI } else { 0.0 });
            if k % 2 == 0 {
                garden::lamp_post(b, &f);
            } else {
                tree::broadleaf(b, &f, r.range(4.0, 6.0), r);
            }
        }
    }
    let things = &[Thing::Bollard, Thing::Bicycle, Thing::Planter, Thing::Bench, Thing::Person];
    foreground(b, eye, target, things, r);
    Outlook { eye, target }
}

fn monument(b: &mut Builder, f: &Frame, r: &mut Stream) {
    let stone = Material::new(Pattern::Mottled(0.5), color(0xb5aea0), color(0x989184), 12);
    let mut water = plain(0x3f6a78).glossy(0.1);
    water.pattern = Pattern::Pane;
    b.post(f, [0.0; 3], [2.2, 2.2], 0.15, stone);
    b.post(f, [0.0, 0.15, 0.0], [1.8, 1.9], 0.45, stone);
    b.post(f, [0.0, 0.58, 0.0], [1.7, 1.7], 0.03, water);
    b.post(f, [0.0, 0.6, 0.0], [0.3, 0.2], 1.0, stone);
    b.post(f, [0.0, 1.6, 0.0], [0.15, 0.8], 0.22, stone);
    if r.chance(0.5) {
        b.post(f, [0.0, 1.8, 0.0], [0.16, 0.1], 0.8, stone);
        b.post(f, [0.0, 2.55, 0.0], [0.08, 0.4], 0.14, stone);
    } else {
        garden::person(b, &f.at(0.0, 1.82, 0.0, PI), r);
    }
}

fn park(b: &mut Builder, night: f32, r: &mut Stream) -> Outlook {
    let f = &Frame::world();
    b.start_place();
    let green = color(r.pick(&[0x5f7f3c, 0x6f8a45, 0x587a44]));
    let grass = Material::new(Pattern::Mottled(0.8), green, green * 0.7, 17);
    b.block(f, [0.0, -0.25, 30.0], [120.0, 0.5, 120.0], grass);
    let gravel = Material::new(Pattern::Mottled(0.05), color(0xb8a88c), color(0xa3937a), 18);
    let mut x = r.range(-0.5, 0.5);
    let drift = r.range(-0.3, 0.3);
    let mut path = Vec::new();
    for k in 0..44 {
        let z = -4.0 + 1.4 * k as f32;
        b.post(f, [x, -0.39, z], [1.6, 1.55], 0.4 + 0.0004 * k as f32, gravel);
        path.push(Vec3::new(x, 0.0, z));
        x += drift * (0.3 + 0.03 * k as f32) + r.range(-0.12, 0.12);
    }
    for k in 0..11 {
        let spot = path[(6 + 3 * k).min(path.len() - 1)];
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        b.start_piece();
        let at = Frame::new(spot + Vec3::X * (side * 2.1), -side * FRAC_PI_2);
        match k % 4 {
            0 | 3 => garden::bench(b, &at),
            1 => garden::lamp_post(b, &at.at(0.0, 0.0, 0.0, -FRAC_PI_2)),
            _ => tree::shrub(b, &at, r.range(0.6, 1.1), r),
        }
    }
    for k in 0..20 {
        let z = 4.0 + 2.4 * k as f32;
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        let spot = path[((z + 4.0) / 1.4) as usize % path.len()];
        b.start_piece();
        let at = Frame::new(Vec3::new(spot.x + side * r.range(3.4, 11.0), 0.0, z), r.unit());
        if r.chance(0.25) {
            tree::conifer(b, &at, r.range(5.0, 9.0), r);
        } else {
            tree::broadleaf(b, &at, r.range(4.5, 8.0), r);
        }
    }
    for _ in 0..5 {
        b.start_piece();
        let spot = path[7 + r.index(16)];
        let at = spot + Vec3::new(r.range(-1.2, 1.2), 0.0, r.range(-0.5, 0.5));
        garden::person(b, &Frame::new(at, r.pick(&[0.0, PI]) + r.range(-0.4, 0.4)), r);
    }
    b.start_place();
    let mut x = -34.0;
    while x < 34.0 {
        let w = r.range(8.0, 13.0);
        if r.chance(0.75) {
            let at = Frame::new(Vec3::new(x + 0.5 * w, 0.0, r.range(48.0, 55.0)), PI);
            street::building(b, &at, [w, r.range(9.0, 18.0), 6.0], false, night, r);
        }
        x += w;
    }
    let eye = Vec3::new(path[2].x + r.range(-1.0, 1.0), r.range(1.4, 1.8), 0.0);
    let target = Vec3::new(path[9].x, r.range(1.3, 1.9), 10.0);
    let things = &[Thing::Sign, Thing::Bicycle, Thing::Planter, Thing::Bench, Thing::Person];
    foreground(b, eye, target, things, r);
    Outlook { eye, target }
}

/// Objects of the foreground.
#[derive(Clone, Copy, Debug)]
enum Thing {
    Bollard,
    Sign,
    Bicycle,
    Planter,
    Bench,
    Person,
}

/// Places three objects close to the camera near the view's middle, so that reflections contain depth edges.
fn foreground(b: &mut Builder, eye: Vec3, target: Vec3, kinds: &[Thing], r: &mut Stream) {
    let ahead = (target - eye) * Vec3::new(1.0, 0.0, 1.0);
    let ahead = ahead.normalize();
    let right = Vec3::new(ahead.z, 0.0, -ahead.x);
    let mut place = |b: &mut Builder, distance_m: f32, across: f32| {
        b.start_piece();
        let at = eye + ahead * distance_m + right * (across * distance_m);
        Frame::new(Vec3::new(at.x, 0.0, at.z), r.range(-0.4, 0.4))
    };
    let first = place(b, 2.6, 0.2);
    let second = place(b, 4.2, -0.16);
    let third = place(b, 6.0, 0.04);
    for (k, f) in [first, second, third].into_iter().enumerate() {
        b.start_piece();
        match r.pick(kinds) {
            // At this distance, a person or a sign would hide the place.
            Thing::Person | Thing::Sign if k == 0 => garden::bollard(b, &f),
            Thing::Bollard => garden::bollard(b, &f),
            Thing::Sign => garden::road_sign(b, &f, r),
            Thing::Bicycle => garden::bicycle(b, &f.at(0.0, 0.0, 0.0, r.range(0.6, 2.4)), r),
            Thing::Planter => garden::planter(b, &f, r),
            Thing::Bench => garden::bench(b, &f.at(0.0, 0.0, 0.0, r.range(2.2, 4.0))),
            Thing::Person => garden::person(b, &f.at(0.0, 0.0, 0.0, r.range(0.0, 6.0)), r),
        }
    }
}

fn sky(hour: Hour, r: &mut Stream) -> Sky {
    let (zenith, horizon, cloud, dim) = match hour {
        Hour::Noon => (0x3f7cc4, 0xbfd6e6, 0xffffff, 1.0),
        Hour::Golden => (0x5a82b8, 0xf3cf9a, 0xffe6c8, 0.8),
        Hour::Overcast => (0x9aa7b2, 0xc9d0d4, 0xe4e7e8, 0.9),
        Hour::Evening => (0x2e3f6e, 0xa8838a, 0x8a7684, 0.3),
    };
    Sky {
        zenith: color(zenith) * dim,
        horizon: color(horizon) * dim,
        cloud: color(cloud) * dim,
        cover: match hour {
            Hour::Overcast => 1.0,
            _ => r.range(0.15, 0.75),
        },
        seed: r.seed(),
    }
}

fn lights(hour: Hour, sky: &Sky, lamps: &[Vec3], r: &mut Stream) -> Lights {
    // The sun is beside or behind the camera, so that visible surfaces are lit.
    let turn = r.range(0.5, 1.5) * PI + r.range(-0.4, 0.4);
    let (s, c) = libm::sincosf(turn);
    let elevation = match hour {
        Hour::Golden => r.range(0.3, 0.5),
        _ => r.range(0.7, 1.5),
    };
    let (sun, ambient) = match hour {
        Hour::Noon => (Vec3::new(3.0, 2.85, 2.55), 0.75),
        Hour::Golden => (Vec3::new(2.9, 2.1, 1.25), 0.65),
        Hour::Overcast => (Vec3::ZERO, 1.3),
        Hour::Evening => (Vec3::ZERO, 0.8),
    };
    let above = sky.zenith.lerp(sky.horizon, 0.5);
    let bounce = (above * 0.6 + sun / PI * 0.5) * Vec3::new(0.42, 0.38, 0.33);
    let warm = Vec3::new(1.0, 0.76, 0.46);
    Lights {
        sun_direction: Vec3::new(s, elevation, c).normalize(),
        sun,
        openings: Vec::new(),
        bulbs: lamps
            .iter()
            .map(|&centre| Bulb {
                centre: centre - Vec3::Y * 0.12,
                radius_m: 0.1,
                intensity: warm * 4.0,
            })
            .collect(),
        ambient_up: above * ambient,
        ambient_down: bounce * ambient,
        ambient_reach_m: 9.0,
    }
}
