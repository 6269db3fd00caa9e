//! Traces hard cases with known results.
//!
//! | case | expected | test |
//! |---|---|---|
//! | incidence 30 to 89.9 degrees, Brewster | published weights and totals | [`weights_match_published_values`], `slab` |
//! | index 1 | I = T, R~ = 0 | `constant_depth::glass_with_the_ior_of_air_has_no_effect` |
//! | thickness 0 | I = T-total F + R-total B | `constant_depth::thin_glass_splits_light_and_bends_nothing` |
//! | aperture 0 | pixels do not depend on the focus; two sharp images in R~ | [`pinholes_ignore_the_focus`], `spot` |
//! | focus at infinity | discs of radius A P / Z px: aperture A, P px per unit of tangent | `spot::discs_have_the_expected_radii`, `constant_depth` |
//! | constant planes, constant radiance | mix by the totals; T = F, R = B exactly | `constant_depth`, `furnace` |
//! | constant planes, any radiance | sum of w_k mean L(X) | [`planes_render_as_mean_radiances`] |
//! | ramps | mean over the lens equals the value at its centre | `constant_depth` |
//! | a light of 1e6, its disc, its energy | radius and sum in closed form | `spot` |
//! | one bright texel | energy does not depend on the lens | `spot` |
//! | Nyquist checkerboard | box-filtered triangle wave | `checkerboard` |
//! | depths of 1e-3 and 1e5 m in one image | the photograph for a pinhole without glass; otherwise the f64 pixels | [`extreme_depths_do_not_change_a_pinhole_image`], [`extreme_depths_match_f64`] |
//! | NaN, infinite, 0, negative depth | filled holes | [`holes_in_a_plane_leave_no_trace`], `farm` (quarantine) |
//! | 1 x 1, 1 x N and N x 1 photographs and films | T = R = the colour for 1 x 1; otherwise the f64 pixels | [`one_row_or_column_matches_f64`], `hard_cases` |

use crate::case::{Apex, CLEAN, Case, GLASS, I, Photo, T, noise, whole_film};
use crate::pixels::compare;
use glam::DVec2;
use render::trace::{Isa, PixelMeans, Tile, trace_tile};

fn close(name: &str, value: f32, expected: f64, bound: f64) {
    let off = f64::from(value) - expected;
    assert!(off.abs() <= bound, "{name}: {value}, not {expected} (off by {off:.1e})");
}

/// Renders a pixel 0.06 arc seconds wide for flat photographs at `incidence` degrees, with the light of the orders above the
/// tolerance and, if `with_dropped`, of the others.
fn glancing(
    incidence: f64,
    [front, back]: [f64; 2],
    tolerance: f64,
    with_dropped: bool,
) -> PixelMeans {
    let mut case = Case::new(Photo::flat(2.0, [front; 3]), Photo::flat(2.0, [back; 3]));
    case.film = [1, 1];
    case.spp = 16;
    case.focal_length_mm = 1e8;
    case.aperture_m = 0.0;
    case.tilt_deg = [0.0, incidence];
    case.tolerance = tolerance;
    let mut scene = case.scene();
    for followed in scene.orders.front.iter_mut().chain(&mut scene.orders.back) {
        followed.carries_dropped &= with_dropped;
    }
    whole_film(&scene, Isa::detect()).pixels[0]
}

/// Incidence, degrees, and r_0, r_1, t_0, t_1, total T, total R at n = 1.6; NaN where there is no published value.
const PUBLISHED: [(f64, [f64; 6]); 6] = {
    const NO: f64 = f64::NAN;
    [
        (
            89.9,
            [
                0.990_109_365_7,
                1.149_381_299e-4,
                1.164_585_820e-4,
                1.134_385_318e-4,
                4.974_623_157e-3,
                0.995_025_376_8,
            ],
        ),
        (85.0, [NO, 0.086_549_225_4, NO, NO, 0.241_995_033_8, NO]),
        (80.0, [NO, 0.120_098_220_8, NO, NO, 0.448_700_977_8, NO]),
        (60.0, [NO, 0.065_819_054_67, NO, NO, 0.825_924_819_9, NO]),
        (30.0, [NO, 0.048_334_181_9, NO, NO, 0.896_511_133_4, NO]),
        (57.994_617, [0.5 * 0.192_021_209_4, NO, NO, NO, 0.838_911_247_6, NO]),
    ]
};

#[test]
fn weights_match_published_values() {
    for (degrees, expected) in PUBLISHED {
        // The weight of r_1 is the difference of two renders, with tolerances below r_0 and below r_1.
        let alone = |sides: [f64; 2], tolerance: f64| glancing(degrees, sides, tolerance, false);
        let all_front = glancing(degrees, [1.0, 0.0], 1e-30, true);
        let all_back = glancing(degrees, [0.0, 1.0], 1e-30, true);
        let first = alone([1.0, 0.0], 2.0).mean[I][0];
        let r_0 = alone([0.0, 1.0], 0.98 * slab_weight(degrees, 0)).mean[GLASS][0];
        let name = |what: &str| format!("{what} at {degrees} degrees");
        let check = |what: &str, value: f32, slot: usize, bound: f64| {
            if !expected[slot].is_nan() {
                close(&name(what), value, expected[slot], bound);
            }
        };
        assert_eq!(all_front.mean[T], [1.0; 3]);
        assert_eq!(all_front.mean[GLASS], [0.0; 3]);
        assert_eq!(all_back.mean[CLEAN], [1.0; 3]);
        assert_eq!(all_back.mean[I], all_back.mean[GLASS]);
        check("r0", r_0, 0, 2e-7);
        check("t0", first, 2, 2e-10);
        let both = alone([0.0, 1.0], 0.98 * slab_weight(degrees, 1)).mean[GLASS][0];
        check("r1", both - r_0, 1, 2e-7);
        // The last orders have the light of the dropped ones, whatever the tolerance.
        for tolerance in [1e-30, 1e-3, 2.0] {
            let name = |side: &str| format!("total {side} with tolerance {tolerance}");
            let total = |sides| glancing(degrees, sides, tolerance, true).mean[I][0];
            let [t, r] = [total([1.0, 0.0]), total([0.0, 1.0])];
            check(&name("T"), t, 4, 1e-6);
            check(&name("R"), r, 5, 1e-6);
            let sum = f64::from(t) + f64::from(r);
            assert!((sum - 1.0).abs() < 2e-6, "{degrees} degrees: {sum}");
        }
    }
}

/// Returns the weight of r_k for a ray followed face by face.
fn slab_weight(degrees: f64, k: u32) -> f64 {
    use crate::optics::Pane;
    use glam::DVec3;
    let pane = Pane {
        normal: DVec3::Z,
        distance_m: 0.3,
        thickness_m: 0.01,
        ior: 1.6,
        absorption_per_m: [0.0; 3],
    };
    let angle = degrees.to_radians();
    let d = DVec3::new(angle.sin(), 0.0, angle.cos());
    pane.exit(DVec3::ZERO, d, render::trace::Order::Reflected(k)).weight()[0]
}

fn rough(size: [usize; 2], key: u64, depth_m: impl Fn(f64) -> f64) -> Photo {
    let depth = |i: usize, j: usize| depth_m(noise(i / 2, j / 2, key));
    Photo::new(size, [23, 17], [0.3; 2], depth, |i, j| [0, 1, 2].map(|c| noise(i, j, key + c)))
}

#[test]
fn pinholes_ignore_the_focus() {
    let mut case =
        Case::new(rough([12, 9], 1, |x| 0.8 + 2.0 * x), rough([12, 9], 2, |x| 0.8 + 2.0 * x));
    case.film = [9, 6];
    case.aperture_m = 0.0;
    case.tilt_deg = [8.0, -20.0];
    let mut rendered = [0.5, 3.0, f64::INFINITY].map(|focus_m| {
        case.focus_m = focus_m;
        case.render()
    });
    let [near, _, far] = &mut rendered;
    assert_eq!(near, far);
    assert_eq!(rendered[0], rendered[1]);
}

/// Compares pixels with midpoint sums of the weighted radiance at a plane, with 16 steps per axis of pixel and lens.
#[test]
fn planes_render_as_mean_radiances() {
    const DEPTH_M: f64 = 2.4;
    const TAN: f64 = 0.5;
    const SIZE: usize = 9;
    let value = |i: usize, j: usize| 0.5 + 0.5 * (1.3 * i as f64).sin() * (0.9 * j as f64).cos();
    let plane = || {
        let colour = |i: usize, j: usize| [value(i, j), noise(i, j, 3), 0.25];
        Photo::new([5, 6], [SIZE; 2], [TAN; 2], |_, _| DEPTH_M, colour)
    };
    let mut case = Case::new(plane(), plane());
    case.film = [8, 6];
    case.spp = 65_536;
    (case.aperture_m, case.focus_m, case.thickness_m) = (0.05, 0.9, 0.06);
    let scene = case.scene();
    let texels = &case.front.texels;
    let radiance = |at: DVec2, c: usize| {
        let texel = |x: f64| {
            let t = f64::midpoint(x / (TAN * DEPTH_M), 1.0) * SIZE as f64 - 0.5;
            t.clamp(0.0, SIZE as f64 - 1.0)
        };
        let (x, y) = (texel(at.x), texel(at.y));
        let (i, j) = (x as usize, y as usize);
        let (i1, j1) = ((i + 1).min(SIZE - 1), (j + 1).min(SIZE - 1));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let texel = |i: usize, j: usize| f64::from(texels[j * SIZE + i][c]);
        (texel(i, j) * (1.0 - fx) + texel(i1, j) * fx) * (1.0 - fy)
            + (texel(i, j1) * (1.0 - fx) + texel(i1, j1) * fx) * fy
    };
    let [tx, ty] = case.tan_half_fov();
    const STEPS: u32 = 16;
    let middle = |k: u32| (f64::from(k) + 0.5) / f64::from(STEPS);
    let mut worst = [0f64; 4];
    for (x, y) in [(1, 1), (4, 3), (7, 5)] {
        let mut expected = [[0.0; 3]; 4];
        let share = f64::from(STEPS).powi(-4);
        for s in 0..STEPS.pow(4) {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| middle(s / STEPS.pow(k) % STEPS));
            let p = DVec2::new(
                (2.0 * (f64::from(x) + a) / 8.0 - 1.0) * tx,
                (2.0 * (f64::from(y) + b) / 6.0 - 1.0) * ty,
            );
            // Equal steps of c cover equal areas of the disc.
            let (radius, angle) = (c.sqrt() * case.aperture_m, d * std::f64::consts::TAU);
            let lens = DVec2::new(angle.cos(), angle.sin()) * radius;
            let direction = p - lens / case.focus_m;
            let cos_i = 1.0 / (1.0 + direction.length_squared()).sqrt();
            for followed in scene.orders.front.iter().chain(&scene.orders.back) {
                use render::trace::Order;
                let weight = scene.slab.weight(followed.order, cos_i)[0];
                let kappa = scene.slab.kappa_m(followed.order, scene.slab.gamma(cos_i));
                let mut at = lens + direction * (DEPTH_M - kappa);
                let is_back = matches!(followed.order, Order::Reflected(_));
                if is_back {
                    at.x = -at.x;
                }
                for k in 0..3 {
                    let value = radiance(at, k) * share;
                    expected[I][k] += weight * value;
                    if is_back {
                        expected[GLASS][k] += weight * value;
                    } else if followed.order == Order::Transmitted(0) {
                        expected[T][k] += value;
                    }
                }
            }
            let clean = DVec2::new(-p.x, p.y) * DEPTH_M;
            for k in 0..3 {
                expected[CLEAN][k] += radiance(clean, k) * share;
            }
        }
        let tile = Tile { x, y, width: 1, height: 1 };
        let pixel = trace_tile(&scene, tile, 0..case.spp, Isa::detect()).pixels[0];
        for layer in 0..4 {
            for c in 0..3 {
                let off = f64::from(pixel.mean[layer][c]) - expected[layer][c];
                worst[layer] = worst[layer].max(off.abs());
            }
        }
    }
    println!("any radiance: I, T, R~, R off by {worst:?}");
    assert!(worst.iter().all(|d| *d < 1e-3));
}

/// Maps a uniform number to 1 mm, 1 m or 100 km.
fn extreme(x: f64) -> f64 {
    match (x * 3.0) as u32 {
        0 => 1e-3,
        1 => 1.0,
        _ => 1e5,
    }
}

/// From the capture point and without glass, the image is the photograph for all depths.
#[test]
fn extreme_depths_do_not_change_a_pinhole_image() {
    let render = |depth_m: &dyn Fn(f64) -> f64| {
        let mut case = Case::new(rough([24, 18], 1, depth_m), rough([24, 18], 2, depth_m));
        case.film = [12, 8];
        case.spp = 64;
        (case.ior, case.thickness_m, case.aperture_m) = (1.0, 0.0, 0.0);
        case.render()
    };
    let (extreme, flat) = (render(&extreme), render(&|_| 2.0));
    let mut worst = 0f32;
    for (a, b) in extreme.iter().zip(&flat) {
        for layer in 0..4 {
            for c in 0..3 {
                worst = worst.max((a.mean[layer][c] - b.mean[layer][c]).abs());
            }
        }
        assert_eq!(a.mean[I], a.mean[T]);
        assert_eq!(a.mean[CLEAN], b.mean[CLEAN]);
    }
    println!("depths 1e-3 to 1e5 m against 2 m, pinhole without glass: {worst:.1e}");
    assert!(worst <= 1e-6);
}

#[test]
fn extreme_depths_match_f64() {
    let mut case = Case::new(rough([12, 9], 1, extreme), rough([12, 9], 2, extreme));
    case.film = [16, 10];
    case.spp = 64;
    compare("depths 1e-3 to 1e5 m, mirror", &case);
    case.focus_m = f64::INFINITY;
    case.tilt_deg = [10.0, -15.0];
    compare("depths 1e-3 to 1e5 m, mirror, tilted", &case);
}

#[test]
fn one_row_or_column_matches_f64() {
    for size in [[1, 1], [1, 9], [9, 1]] {
        for (apex, tilt_deg) in
            [(Apex::Mirror, [0.0, 0.0]), (Apex::Camera, [0.0, 0.0]), (Apex::Camera, [7.0, -11.0])]
        {
            let photo = |key| rough(size, key, |x| 0.8 + 2.0 * x);
            let mut case = Case::new(photo(1), photo(2));
            (case.apex, case.tilt_deg) = (apex, tilt_deg);
            case.film = [10, 7];
            case.spp = 64;
            compare(&format!("photograph of {size:?}, {apex:?} {tilt_deg:?}"), &case);
            case.film = [size[1] as u32, size[0] as u32];
            compare(&format!("and a film of {:?}", case.film), &case);
        }
    }
}

/// NaN, infinite, zero and negative depths in a plane do not change its image.
#[test]
fn holes_in_a_plane_leave_no_trace() {
    use glasshouse_line::parse_scene;
    use render::formats::{NamedBytes, PhotographFiles};
    use render::scene::{assemble, decode_photograph};
    const WIDTH: usize = 9;
    const HEIGHT: usize = 7;
    let line = parse_scene(
        r#"{"schema": "glasshouse.scene/1", "id": "holes", "seed": 3,
            "film": {"width": 12, "height": 8, "spp": 64},
            "camera": {"focal_length_mm": 55.0, "aperture_radius_m": 0.00893, "focus": {"at": "front_center"}},
            "glass": {"distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6, "tilt_deg": [5.0, -9.0]},
            "front": {"color": "c", "depth": "d", "intrinsics": {"fx": 15, "fy": 15, "cx": 4.5, "cy": 3.5}},
            "back": {"color": "c", "depth": "d", "intrinsics": {"fx": 15, "fy": 15, "cx": 4.5, "cy": 3.5}}}"#,
    )
    .unwrap();
    let named = |bytes: Vec<u8>| NamedBytes { path: "holes".into(), bytes };
    let depth = |hole: Option<f32>| {
        let mut npy = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        let header =
            format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({HEIGHT}, {WIDTH}), }}");
        npy.extend(format!("{header:117}\n").bytes());
        for q in 0..WIDTH * HEIGHT {
            let z = hole.filter(|_| noise(q, 1, 1) < 0.6).unwrap_or(2.5);
            npy.extend(z.to_le_bytes());
        }
        npy
    };
    let color: Vec<u8> = b"P5 9 7 255 "
        .iter()
        .copied()
        .chain((0..63).map(|q| (noise(q, 5, 5) * 255.0) as u8))
        .collect();
    let render = |hole: Option<f32>| {
        let files =
            PhotographFiles { color: named(color.clone()), depth: named(depth(hole)), mask: None };
        let sheet = || decode_photograph(line.front.photograph().unwrap(), &files);
        let (front, back) = (sheet()?, sheet()?);
        let share = front.filled_share;
        let (scene, _) = assemble(&line, front, back).unwrap();
        let pixels = crate::case::whole_film(&scene, Isa::detect()).pixels;
        Ok::<_, render::formats::SceneError>((pixels, share))
    };
    let (whole, _) = render(None).unwrap();
    for hole in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, -3.0] {
        let (filled, share) = render(Some(hole)).unwrap();
        assert!(share > 0.4);
        assert_eq!(filled, whole, "holes of {hole}");
    }
    // A depth image without any valid depth is refused; `farm` tests the quarantine of its scene.
    let nothing = |value: f32| {
        let mut bytes = depth(None);
        let data = bytes.len() - WIDTH * HEIGHT * 4;
        for at in (data..bytes.len()).step_by(4) {
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        let files =
            PhotographFiles { color: named(color.clone()), depth: named(bytes), mask: None };
        decode_photograph(line.front.photograph().unwrap(), &files)
    };
    for value in [f32::NAN, f32::INFINITY, 0.0, -1.0] {
        assert!(nothing(value).is_err(), "all depths {value}");
    }
    assert!(nothing(1.0).is_ok());
}
