//! Compares mesh hits with f64 brute force, closed forms, the grid kernel and the hits on equivalent meshes.

#![allow(clippy::print_stdout, reason = "measured deviations, shown by --nocapture")]

use super::super::camera::CameraChunk;
use super::super::lanes::{CHUNK, LANES, Lane};
use super::super::lines::{LineMaker, Path, ViewLanes, points};
use super::super::patch::Patch;
use super::super::slab::Order;
use super::super::tests::{full_span, random, scene};
use super::super::walk::walk_lanes;
use super::super::{Pose, Surface, View};
use super::*;
use crate::trace::isa::BASELINE;
use glam::{DMat3, DVec3};

/// Hashes a key to a number in [-1, 1).
fn signed(k: u64) -> f64 {
    2.0 * random(k) - 1.0
}

/// Makes a closed surface around the origin: grids on a cube's faces, with each square cut along a random diagonal. If
/// `is_rough`, its vertices move to radii between 1 and 2 m, and the surface is rotated and shifted.
fn closed(side: usize, key: u64, is_rough: bool) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    use std::collections::BTreeMap;
    let turn = DMat3::from_rotation_y(signed(key) * 3.0) * DMat3::from_rotation_x(signed(key + 1));
    let mut index = BTreeMap::new();
    let mut vertices = vec![];
    let mut triangles = vec![];
    let n = side as i32;
    let mut vertex = |c: [i32; 3]| {
        *index.entry(c).or_insert_with(|| {
            let [x, y, z] = c.map(|v| f64::from(v) / f64::from(n) * 2.0 - 1.0);
            let v = DVec3::new(x, y, z);
            vertices.push(if is_rough {
                let q = c.iter().fold(key, |q, &v| q * 977 + v as u64);
                turn * v.normalize() * (1.0 + random(q)) + DVec3::new(0.2, -0.1, 0.15)
            } else {
                // Dyadic coordinates let rays hit edges exactly.
                v * 2.0
            });
            vertices.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        for face in [0, n] {
            for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
                let mut corner = |di: i32, dj: i32| {
                    let mut c = [0; 3];
                    c[axis] = face;
                    c[(axis + 1) % 3] = i + di;
                    c[(axis + 2) % 3] = j + dj;
                    vertex(c)
                };
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                if random((i * 31 + j) as u64 + key) < 0.5 {
                    triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
    }
    (vertices, triangles)
}

/// Returns random colours, determined by the vertex index.
fn greys(count: usize) -> Vec<[f32; 4]> {
    (0..count as u64)
        .map(|k| {
            let v = random(k + 17) as f32;
            [v, 0.5 * v, 1.0 - v, 0.0]
        })
        .collect()
}

/// Makes a group of rays from points of a wide lens to edges and corners of triangles in front of it.
fn aimed(points: &[DVec3], triangles: &[[u32; 3]], block: u64) -> [[Lane; 2]; 2] {
    let (mut d, mut p) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
    for l in 0..LANES {
        let mut key = (block * LANES as u64 + l as u64) * 64;
        let mut next = || {
            key += 1;
            random(key)
        };
        let target = loop {
            let triangle = triangles[(next() * triangles.len() as f64) as usize];
            let [a, b, _] = triangle.map(|i| points[i as usize]);
            // A corner, the middle of an edge, or a random point on an edge.
            let t = [0.0, 0.5, next()][(next() * 3.0) as usize];
            let v = a + (b - a) * t;
            if v.z > 2.0 * NEAR_M {
                break v;
            }
        };
        let w = 1.0 / target.z;
        // Half of the lens coordinates are 0 or 1/32, so that some rays hit the edges between triangles exactly.
        let lens = [next(), next()].map(|r| match (r * 4.0) as u32 {
            0 => 0.0,
            1 => 0.03125,
            _ => (r - 0.75) * 0.2,
        });
        for (k, x) in [target.x, target.y].into_iter().enumerate() {
            p[k][l] = lens[k] as f32;
            d[k][l] = (x * w - f64::from(p[k][l]) * w) as f32;
        }
    }
    [d, p]
}

/// Every ray from inside a closed surface hits the surface, even at an edge or a corner.
#[test]
fn no_ray_leaves_a_closed_mesh() {
    use obvhs::{ray::Ray, rt_triangle::RtTriangle};
    let (mut tested, mut plain, mut plain_leaks) = (0, 0, 0);
    for (side, key, is_rough) in [(1, 3, true), (4, 1, false), (8, 5, true), (16, 7, false)] {
        let (vertices, triangles) = closed(side, key, is_rough);
        let mesh = Mesh::new(&vertices, greys(vertices.len()), &triangles, 0.02);
        let packed: Vec<RtTriangle> = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| vertices[i as usize].as_vec3a());
                RtTriangle::new(a, b, c)
            })
            .collect();
        for block in 0..17_000u64 {
            let [d, p] = aimed(&vertices, &triangles, key << 40 | block);
            let seen = mesh.see(d, p, LANES);
            for l in 0..LANES {
                assert!(
                    seen.w[l] > 0.0,
                    "leak: d {:?}, p {:?}",
                    [d[0][l], d[1][l]],
                    [p[0][l], p[1][l]]
                );
                tested += 1;
            }
            // Traces the first ray of every sixteenth block with an intersection test that is not watertight. Side 16
            // has too many triangles for brute force.
            if block % 16 == 0 && side < 16 {
                let origin = glam::Vec3A::new(p[0][0], p[1][0], 0.0);
                let ray = Ray::new_inf(origin, glam::Vec3A::new(d[0][0], d[1][0], 1.0));
                let is_met = packed.iter().any(|t| t.intersect(&ray) < f32::INFINITY);
                plain += 1;
                plain_leaks += u32::from(!is_met);
            }
        }
    }
    println!(
        "{tested} rays at edges and corners: no leak; a plain test loses {plain_leaks} of {plain}"
    );
    assert!(tested >= 1_000_000 && plain_leaks > 0);
}

/// Finds the inverse depth of the nearest hit by brute force in f64.
fn brute(vertices: &[DVec3], triangles: &[[u32; 3]], d: [f64; 2], p: [f64; 2]) -> Option<f64> {
    let (origin, direction) = (DVec3::new(p[0], p[1], 0.0), DVec3::new(d[0], d[1], 1.0));
    let mut nearest: Option<f64> = None;
    for t in triangles {
        let [a, b, c] = t.map(|i| vertices[i as usize] - origin);
        let (e, f) = (b - a, c - a);
        let q = direction.cross(f);
        let inverse = 1.0 / e.dot(q);
        let u = -a.dot(q) * inverse;
        let r = (-a).cross(e);
        let v = direction.dot(r) * inverse;
        let z = f.dot(r) * inverse;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && z >= NEAR_M && nearest.is_none_or(|n| z < n) {
            nearest = Some(z);
        }
    }
    nearest.map(f64::recip)
}

/// Makes unconnected triangles around the lens; some cross the lens plane.
fn soup(count: usize, key: u64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let vertices = (0..3 * count as u64)
        .map(|k| {
            let at = |n: u64| signed(key + (k / 3) * 64 + n);
            let by = |n: u64| signed(key + k * 64 + 16 + n);
            DVec3::new(2.0 * at(0) + by(0), 2.0 * at(1) + by(1), 2.0 + 3.0 * at(2) + by(2))
        })
        .collect();
    let triangles = (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    (vertices, triangles)
}

#[test]
fn hits_are_those_of_brute_force() {
    let (mut tested, mut flips, mut worst, mut missed) = (0, 0, 0f64, 0);
    for key in [1u64, 2, 3] {
        let (vertices, triangles) = soup(150, key << 32);
        let mesh = Mesh::new(&vertices, greys(vertices.len()), &triangles, 0.02);
        assert_eq!(mesh.counts().degenerate, 0);
        assert!(mesh.counts().behind > 0);
        for block in 0..150u64 {
            let lane = |n: u64, scale: f64| -> Lane {
                std::array::from_fn(|l| {
                    (scale * signed(key << 50 | (block * 64 + n * 16 + l as u64))) as f32
                })
            };
            let (d, p) = ([lane(0, 1.0), lane(1, 1.0)], [lane(2, 0.05), lane(3, 0.05)]);
            let w = mesh.see(d, p, LANES).w;
            for l in 0..LANES {
                let [d, p] = [d, p].map(|v| [0, 1].map(|k| f64::from(v[k][l])));
                let expected = brute(&vertices, &triangles, d, p).unwrap_or(0.0);
                let found = f64::from(w[l]);
                tested += 1;
                missed += u32::from(expected == 0.0);
                if (found - expected).abs() > 1e-4 * expected {
                    // A ray may hit another triangle only if rounding moves it across an edge.
                    let near: Vec<f64> = [(1.0, 0.3), (-1.0, 0.3), (0.3, 1.0), (0.3, -1.0)]
                        .iter()
                        .map(|(x, y)| {
                            let d = [d[0] + x * 1e-6, d[1] + y * 1e-6];
                            brute(&vertices, &triangles, d, p).unwrap_or(0.0)
                        })
                        .collect();
                    assert!(
                        near.iter().any(|w| (w - found).abs() <= 1e-3 * w),
                        "{d:?} {p:?}: {found}, not {expected}"
                    );
                    flips += 1;
                } else {
                    worst = worst.max((found - expected).abs() / expected.max(1e-9));
                }
            }
        }
    }
    println!("{tested} rays, {missed} misses: relative error {worst:.1e}, {flips} flips");
    assert!(missed * 20 > tested && missed * 2 < tested && flips * 1000 < tested);
}

/// A hit does not depend on the shape of the tree or on the other rays of the group.
#[test]
fn hits_depend_on_ray_and_triangles_alone() {
    let (vertices, triangles) = soup(400, 99);
    let colors = greys(vertices.len());
    let meshes = [1e-4, 0.02, 1.0].map(|m| Mesh::new(&vertices, colors.clone(), &triangles, m));
    // Every triangle occurs twice: at equal w, the hit takes the colour of the first.
    let twice: Vec<[u32; 3]> = triangles
        .iter()
        .chain(&triangles)
        .enumerate()
        .map(|(n, t)| if n < triangles.len() { *t } else { t.map(|i| i + vertices.len() as u32) })
        .collect();
    let all: Vec<DVec3> = vertices.iter().chain(&vertices).copied().collect();
    let mut both = colors.clone();
    both.extend(vec![[9.0; 4]; colors.len()]);
    let doubled = Mesh::new(&all, both, &twice, 0.02);
    for block in 0..300u64 {
        let [d, p] = aimed(&vertices, &triangles, block);
        let first = meshes[0].see(d, p, LANES);
        for other in [&meshes[1], &meshes[2], &doubled] {
            let seen = other.see(d, p, LANES);
            assert_eq!((first.w, first.radiance), (seen.w, seen.radiance));
        }
        for l in [0, 7, 15] {
            let one = |v: [Lane; 2]| v.map(|v| [v[l]; LANES]);
            let alone = meshes[1].see(one(d), one(p), 1);
            assert_eq!((first.w[l], first.radiance[l]), (alone.w[0], alone.radiance[0]));
            assert_eq!(alone.w[1..], [0.0; LANES - 1]);
        }
    }
}

/// Colours are linear in space, not in the picture. Clipping at the near plane changes neither the colours nor w.
#[test]
fn colours_are_linear_on_the_triangle_in_space() {
    let vertices =
        [DVec3::new(-1.0, 1.0, -3.0), DVec3::new(-1.5, 1.0, 9.0), DVec3::new(4.0, 1.0, 5.0)];
    let color = |v: DVec3| [0.1 + 0.05 * (v.z + 3.0), 0.3 + 0.1 * v.x, 0.7];
    let colors = vertices.map(|v| color(v).map(|v| v as f32)).map(|[r, g, b]| [r, g, b, 0.0]);
    let mesh = Mesh::new(&vertices, colors.to_vec(), &[[0, 1, 2]], 0.02);
    assert_eq!(mesh.counts().traced, 1);
    let (mut worst, mut hits) = (0f64, 0);
    for k in 0..2000u64 {
        let d = [signed(2 * k) * 0.5, random(2 * k + 1)].map(|v| v as f32);
        let p = [0.01f32, -0.02];
        let seen = mesh.see(d.map(|v| [v; LANES]), p.map(|v| [v; LANES]), 1);
        // The ray reaches the triangle's plane y = 1 at z = (1 - p_y) / d_y.
        let z = (1.0 - f64::from(p[1])) / f64::from(d[1]);
        let point = DVec3::new(f64::from(p[0]) + z * f64::from(d[0]), 1.0, z);
        if seen.w[0] > 0.0 {
            hits += 1;
            worst = worst.max((f64::from(seen.w[0]) * z - 1.0).abs());
            for (value, expected) in seen.radiance[0].into_iter().zip(color(point)) {
                worst = worst.max((f64::from(value) - expected).abs());
            }
            assert_eq!(seen.radiance[0][2], 0.7);
        } else {
            assert_eq!(seen.radiance[0], [0.0; 4]);
        }
    }
    println!("{hits} hits, worst deviation {worst:.1e}");
    assert!(hits > 500 && hits < 1900 && worst < 2e-6);
}

#[test]
fn triangles_are_counted() {
    let v = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let vertices = [
        v(0.0, 0.0, 1.0),
        v(1.0, 0.0, 1.0),
        v(0.0, 1.0, 1.0),
        v(0.0, 0.0, -1.0),
        v(1.0, 1.0, -1.0),
        v(0.0, 1.0, -2.0),
        v(1.0, 0.0, 1.0),
    ];
    let triangles = [[0, 1, 2], [0, 1, 3], [3, 4, 5], [0, 0, 1], [1, 6, 2], [0, 3, 4]];
    let mesh = Mesh::new(&vertices, greys(7), &triangles, 0.01);
    let counts = mesh.counts();
    assert_eq!((counts.traced, counts.behind, counts.degenerate), (3, 1, 2));
    let nothing = Mesh::new(&vertices, greys(7), &[[3, 4, 5]], 0.01);
    assert_eq!(nothing.axis_depth_m(), None);
    assert_eq!(nothing.see([[0.1; LANES]; 2], [[0.0; LANES]; 2], LANES).w, [0.0; LANES]);
}

/// Returns the vertices and triangles of a view's sheet, in the lens's coordinates.
fn sheet_of(view: &View) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (nx, ny) = (view.grid.nx(), view.grid.ny());
    let vertices = view
        .grid
        .inverse_depths_per_m()
        .iter()
        .enumerate()
        .map(|(q, &w)| from_capture(view, [(q % nx) as f64, (q / nx) as f64], f64::from(w)))
        .collect();
    let triangles = (0..(nx - 1) * (ny - 1))
        .flat_map(|q| {
            let a = (q / (nx - 1) * nx + q % (nx - 1)) as u32;
            let [b, c, d] = [a + 1, a + nx as u32, a + nx as u32 + 1];
            [[a, b, c], [d, c, b]]
        })
        .collect();
    (vertices, triangles)
}

/// Returns the point at grid coordinates `uv` and inverse depth `w` of a view, in the lens's coordinates.
fn from_capture(view: &View, uv: [f64; 2], w: f64) -> DVec3 {
    let [x, y] = [0, 1].map(|k| (uv[k] - view.principal[k]) / view.focal_px[k]);
    let point = DVec3::new(x, y, 1.0) / w;
    match &view.pose {
        Pose::Aligned { extra_m } => point + DVec3::Z * *extra_m,
        Pose::General { rotation, translation_m } => rotation.inverse() * (point - *translation_m),
    }
}

/// Checks the grid kernel: rays from the lens through the glass hit a sheet and a mesh of the same triangles alike, in
/// every kind of pose.
#[test]
fn a_sheet_and_its_mesh_are_hit_alike() {
    let mut camera = CameraChunk::new();
    for (tilt_deg, general) in [([0.0, 0.0], false), ([12.0, -25.0], false), ([-4.0, 6.0], true)] {
        let scene = scene(tilt_deg, general, false, 2.0);
        for (surface, order) in
            [(&scene.front, Order::Transmitted(0)), (&scene.back, Order::Reflected(1))]
        {
            let Surface::Sheet(view) = surface else { panic!("the surface must be a sheet") };
            let (vertices, triangles) = sheet_of(view);
            let mesh = Mesh::new(&vertices, vec![[1.0; 4]; vertices.len()], &triangles, 0.03);
            let constant = scene.slab.kappa_m(order, 0.0);
            let slope = scene.slab.kappa_m(order, 1.0) - constant;
            let path = Path::Lens { constant, slope };
            let normal = scene.slab.normal.as_vec3().to_array();
            let (mut tested, mut flips, mut outside, mut worst) = (0, 0, 0, 0f64);
            for (x, y) in (4..80).step_by(8).flat_map(|y| (4..120).step_by(8).map(move |x| (x, y)))
            {
                let patch = Patch::new(&scene, x, y);
                camera.fill(&scene, &patch, 32, CHUNK);
                let lanes = ViewLanes::new(view, &patch);
                let maker = LineMaker::new(&scene, view, &patch, &lanes);
                for s in 0..CHUNK {
                    let lines = maker.lines(&camera, path, s);
                    let span = full_span(&view.grid, false);
                    let w = walk_lanes::<BASELINE>(&view.grid, &lanes.grid, &lines, span);
                    let d: [Lane; 2] = std::array::from_fn(|k| {
                        std::array::from_fn(|l| patch.center[k][l] + camera.direction[k][s][l])
                    });
                    let seen = mesh.see(d, points(path, &patch.center, normal, &camera, s), LANES);
                    for l in 0..LANES {
                        let [x, y] = &lanes.grid.base;
                        let at = [
                            lines.x[l] + lines.sx[l] * w[l] + x[l] as f32,
                            lines.y[l] + lines.sy[l] * w[l] + y[l] as f32,
                        ]
                        .map(f64::from);
                        // The sheet continues beyond its border; the mesh does not.
                        let inside = (0..2).all(|k| at[k] > 0.01 && at[k] < [88.99, 68.99][k]);
                        if !inside {
                            outside += 1;
                            continue;
                        }
                        let expected = 1.0 / from_capture(view, at, f64::from(w[l])).z;
                        let error = (f64::from(seen.w[l]) - expected).abs() / expected;
                        tested += 1;
                        if error <= 1e-4 {
                            worst = worst.max(error);
                        } else {
                            flips += 1;
                        }
                    }
                }
            }
            println!(
                "tilt {tilt_deg:?}, {order:?}: {tested} rays, relative difference of w {worst:.1e}, {flips} on the \
                 other side of an edge, {outside} beyond the border"
            );
            assert!(tested > 10_000 && flips * 2000 <= tested);
        }
    }
}
