//! Compares triangle meshes with closed forms, and with the depth images from which they are made.

use crate::case::{Apex, CLEAN, Case, GLASS, I, Photo, T, noise, whole_film};
use glam::{DMat3, DVec3};
use render::trace::{Isa, Mesh, Scene};
use std::f64::consts::PI;

/// Names of the layers, for messages.
const NAMES: [&str; 4] = ["I", "T", "R~", "R"];

/// Makes a sphere with `steps` bands of latitude and twice as many of longitude.
fn sphere(center: DVec3, radius_m: f64, steps: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let vertices = (0..=steps)
        .flat_map(|j| (0..2 * steps).map(move |i| (i, j)))
        .map(|(i, j)| {
            let (sin, cos) = (PI * j as f64 / steps as f64).sin_cos();
            // In f64, sin(pi) is not exactly 0, which would leave a hole around the pole.
            let sin = if j == steps { 0.0 } else { sin };
            let (y, x) = (PI * i as f64 / steps as f64).sin_cos();
            center + radius_m * DVec3::new(sin * x, sin * y, cos)
        })
        .collect();
    let triangles = (0..2 * steps * steps)
        .flat_map(|q| {
            let (i, j) = (q % (2 * steps), q / (2 * steps) * 2 * steps);
            let next = (i + 1) % (2 * steps);
            let [a, b] = [i + j, next + j].map(|v| v as u32);
            let [c, d] = [a, b].map(|v| v + 2 * steps as u32);
            [[a, b, d], [a, d, c]]
        })
        .collect();
    (vertices, triangles)
}

/// Makes a room with uneven walls around the lens: a rotated sphere with noise.
fn room(key: u64, white: bool) -> Mesh {
    let (mut vertices, triangles) = sphere(DVec3::ZERO, 1.0, 12);
    let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_y(key as f64);
    for (q, v) in vertices.iter_mut().enumerate() {
        // The vertices of a pole are at one place and need the same noise.
        let [i, j] = [q % 24, q / 24];
        let i = if j == 0 || j == 12 { 0 } else { i };
        *v = turn * *v * (1.0 + 2.0 * noise(i, j, key)) + DVec3::new(0.1, -0.2, 0.3);
    }
    let color = |q: usize| {
        let c = [0, 1, 2].map(|c| if white { 1.0 } else { noise(q, 1, key + c) as f32 });
        [c[0], c[1], c[2], 0.0]
    };
    let colors = (0..vertices.len()).map(color).collect();
    Mesh::new(&vertices, colors, &triangles, 0.02)
}

fn case_without_photographs() -> Case {
    Case::new(Photo::flat(2.0, [1.0; 3]), Photo::flat(2.0, [1.0; 3]))
}

/// Makes a scene with colourful rooms on both sides.
pub(crate) fn rooms(case: &Case) -> Scene {
    let mut scene = case.scene();
    scene.front = room(5, false).into();
    scene.back = room(6, false).into();
    scene
}

#[test]
fn white_rooms_stay_white() {
    let mut case = case_without_photographs();
    case.film = [13, 9];
    for (tilt, gaussian, aperture_m, alpha) in [
        ([0.0, 0.0], false, 0.00893, None),
        ([20.0, -35.0], true, 0.05, None),
        ([-10.0, 8.0], false, 0.0, None),
        ([-10.0, 8.0], false, 0.0, Some(0.01)),
    ] {
        (case.tilt_deg, case.gaussian, case.aperture_m) = (tilt, gaussian, aperture_m);
        case.roughness = alpha.map(|alpha| vec![alpha; 2]);
        let mut scene = case.scene();
        scene.front = room(1, true).into();
        scene.back = room(2, true).into();
        let result = whole_film(&scene, Isa::detect());
        assert_eq!(result.misses.0, [0; 4], "a ray left a closed room");
        let mut worst = 0f64;
        for pixel in &result.pixels {
            assert_eq!(pixel.mean[T], [1.0; 3]);
            assert_eq!(pixel.mean[CLEAN], [1.0; 3]);
            for v in pixel.mean[I] {
                worst = worst.max((f64::from(v) - 1.0).abs());
            }
        }
        println!("tilt {tilt:?}: |I - 1| <= {worst:.1e}");
        // Thinned orders take their weights at fewer points of a pixel.
        assert!(worst <= 1e-4);
    }
}

/// A sphere seen through a pinhole covers an ellipse of known area, and a sphere on the axis has a known depth there.
#[test]
fn a_sphere_has_the_expected_size_and_depth() {
    let mut case = case_without_photographs();
    (case.film, case.aperture_m, case.thickness_m, case.spp) = ([64, 64], 0.0, 0.0, 256);
    let pixel = 2.0 * case.tan_half_fov()[0] / 64.0;
    for (center, radius_m) in [
        (DVec3::new(0.0, 0.0, 3.0), 0.5),
        (DVec3::new(-0.3, 0.25, 2.5), 0.3),
        (DVec3::new(0.9, -0.4, 6.0), 0.4),
    ] {
        let (vertices, triangles) = sphere(center, radius_m, 160);
        let mesh = |vertices: &[DVec3]| {
            let white = vec![[1.0, 1.0, 1.0, 0.0]; vertices.len()];
            Mesh::new(vertices, white, &triangles, 0.02)
        };
        let mut scene = case.scene();
        scene.front = mesh(&vertices).into();
        scene.back = mesh(&vertices).into();
        let result = whole_film(&scene, Isa::detect());
        let sin2 = (radius_m / center.length()).powi(2);
        let cos2 = (center.z / center.length()).powi(2);
        let area = PI * sin2 * (1.0 - sin2).sqrt() / (cos2 - sin2).powf(1.5);
        for layer in [T, CLEAN] {
            let sum: f64 = result.pixels.iter().map(|p| f64::from(p.mean[layer][1])).sum();
            let error = sum * pixel * pixel / area - 1.0;
            println!("{center}, {}: area off by {error:.1e}", NAMES[layer]);
            assert!(error.abs() < 5e-4);
            // Each path hits white or nothing.
            let met = result.paths.0[layer] - result.misses.0[layer];
            let share = met as f64 / result.paths.0[layer] as f64;
            assert!((share * 4096.0 / sum - 1.0).abs() < 1e-6);
        }
        if center.x == 0.0 {
            let depth_m = mesh(&vertices).axis_depth_m().unwrap();
            assert!((depth_m - (3.0 - 0.5)).abs() < 1e-6, "{depth_m}");
        }
    }
}

/// Makes a wavy wall with slowly varying colour.
fn wavy(key: f64) -> Photo {
    let at = |i: usize, j: usize| (i as f64 / 159.0, j as f64 / 119.0);
    Photo::new(
        [160, 120],
        [160, 120],
        [1.0, 0.8],
        move |i, j| {
            let (x, y) = at(i, j);
            2.0 + 0.4 * (5.0 * x + key).sin() + 0.3 * (4.0 * y - key).cos()
        },
        move |i, j| {
            let (x, y) = at(i, j);
            [0.2 + 0.6 * x, 0.9 - 0.5 * y, 0.5 + 0.3 * (x - y)]
        },
    )
}

/// Converts the photograph's sheet to a mesh: quads split along (i + 1, j)-(i, j + 1), texels as vertex colours.
fn mesh_of(photo: &Photo, place: impl Fn(DVec3) -> DVec3) -> Mesh {
    let [nx, ny] = photo.size;
    let vertices: Vec<DVec3> = photo
        .w
        .iter()
        .enumerate()
        .map(|(q, &w)| {
            let x = ((q % nx) as f64 + 0.5 - photo.center_px[0]) / photo.focal_px[0];
            let y = ((q / nx) as f64 + 0.5 - photo.center_px[1]) / photo.focal_px[1];
            place(DVec3::new(x, y, 1.0) / f64::from(w))
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..(nx - 1) * (ny - 1))
        .flat_map(|q| {
            let a = (q / (nx - 1) * nx + q % (nx - 1)) as u32;
            let [b, c, d] = [a + 1, a + nx as u32, a + nx as u32 + 1];
            [[a, b, c], [b, d, c]]
        })
        .collect();
    Mesh::new(&vertices, photo.texels.clone(), &triangles, 0.02)
}

/// Compares the pixels of the grid kernel with those of a mesh. Both have the same camera samples; only their
/// colours differ: the grid interpolates colours in the picture, and the mesh interpolates them in space.
#[test]
fn a_photograph_and_its_mesh_give_the_same_pixels() {
    let mut case = Case::new(wavy(0.3), wavy(1.7));
    (case.film, case.spp) = ([24, 16], 64);
    for (tilt_deg, apex) in [
        ([0.0, 0.0], Apex::Mirror),
        ([0.0, 0.0], Apex::Camera),
        ([12.0, -20.0], Apex::Mirror),
        ([-3.0, 6.0], Apex::Camera),
    ] {
        (case.tilt_deg, case.apex) = (tilt_deg, apex);
        case.absorption_per_m = [0.0, 2.0, 8.0];
        let (normal, distance_m) = case.pane();
        // Transforms a point from the back camera's coordinates to the world mirrored in the front face.
        let into_mirror = |x: DVec3| match apex {
            Apex::Mirror => DVec3::new(-x.x, x.y, x.z),
            Apex::Camera => {
                let world = DVec3::new(-x.x, x.y, -x.z);
                world - 2.0 * (world.dot(normal) - distance_m) * normal
            }
        };
        let sheets = whole_film(&case.scene(), Isa::detect());
        let mut scene = case.scene();
        scene.front = mesh_of(&case.front, |x| x).into();
        scene.back = mesh_of(&case.back, into_mirror).into();
        let meshes = whole_film(&scene, Isa::detect());
        assert_eq!((sheets.misses.0, meshes.misses.0), ([0; 4], [0; 4]));
        let mut worst = [0f64; 4];
        for (a, b) in sheets.pixels.iter().zip(&meshes.pixels) {
            for layer in [I, T, GLASS, CLEAN] {
                for c in 0..3 {
                    let [x, y] = [a, b].map(|p| f64::from(p.mean[layer][c]));
                    worst[layer] = worst[layer].max((x - y).abs());
                    assert!(x > 1e-3 || layer == GLASS);
                }
            }
        }
        let shown: Vec<String> = (0..4).map(|k| format!("{} {:.1e}", NAMES[k], worst[k])).collect();
        println!("tilt {tilt_deg:?}, {apex:?}: largest differences {}", shown.join(", "));
        assert!(worst.iter().all(|&v| v < 1e-4));
    }
}
