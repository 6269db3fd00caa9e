//! Aims millions of rays at the edges of indoor, outdoor, real and rough depth meshes: no ray leaks through.
//!
//! A *leak* is a ray that the kernel lets pass, although it hits the mesh in f64: f64 finds hits for the ray and for
//! its neighbours at a distance of [`NEAR_PX`], in the 3 x 3 quads around the target of the ray, and the kernel's hit
//! lies behind all of these hits. f32 cannot distinguish rays at smaller distances, so both sides of a rim are correct
//! for such rays. A *stray* is a hit that does not lie on the mesh.

use super::{LANES, full_span, random};
use crate::formats::{NamedBytes, PhotographFiles};
use crate::scene::decode_photograph;
use crate::trace::isa::{AVX2, AVX512, BASELINE};
use crate::trace::lanes::Lane;
use crate::trace::walk::{Lines, Span, walk};
use crate::trace::{Grid, Isa};
use glasshouse_line::{Photograph, Transfer};
use procedural::{listing, render};
use std::path::Path;

/// Distance of a ray's neighbours, px. Relative coordinates have errors of 1e-6 px, which grow in a few operations.
const NEAR_PX: f64 = 2e-5;
/// Largest allowed distance of a hit from the mesh, 1/m. The bound covers f32 rounding for rays of 90 px per 1/m on
/// skirts of 1/m per px.
const STRAY: f64 = 5e-5;
/// Tolerance at the edges of a triangle, px.
const EDGE: f64 = 1e-10;

/// A depth mesh, and the largest slope of its rays, px per 1/m of inverse depth.
struct Terrain {
    name: &'static str,
    grid: Grid,
    slope_px: f64,
}

/// Makes a sheet from a depth image (0 marks a hole) with the program's own decoder and hole filler.
fn sheet(width: usize, height: usize, depth: Vec<u8>, unit_m: f64) -> Grid {
    let line = Photograph {
        sketch: None,
        color: "edges.png".to_owned(),
        depth: "edges.npy".to_owned(),
        mask: None,
        orientation: glasshouse_line::Orientation::Upright,
        transfer: Transfer::Linear,
        depth_unit_m: unit_m,
        depth_none_code: None,
        depth_kind: glasshouse_line::DepthKind::Z,
        depth_range: None,
        intrinsics: glasshouse_line::Intrinsics {
            fx: 500.0,
            fy: 500.0,
            cx: width as f64 / 2.0,
            cy: height as f64 / 2.0,
            size: None,
        },
        exposure: 1.0,
        illuminant: [1.0; 3],
        highlights: None,
        fill: glasshouse_line::Fill::Smooth,
        apex: None,
        cards: vec![],
    };
    let named = |bytes: Vec<u8>| NamedBytes { path: "edges".into(), bytes };
    let files = PhotographFiles {
        color: named(b"P5 1 1 255 \x80".to_vec()),
        depth: named(depth),
        mask: None,
    };
    Grid::clone(&decode_photograph(&line, &files).unwrap().grid)
}

/// Makes the sheet of a procedural photograph.
fn procedural(index: usize) -> Grid {
    let photograph = &listing(8, 11)[index];
    let rgbd = render(photograph, 320, 240);
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    npy.extend(
        format!("{:117}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (240, 320), }")
            .bytes(),
    );
    npy.extend(rgbd.depth_m.iter().flat_map(|z| z.to_le_bytes()));
    sheet(320, 240, npy, 1.0)
}

fn rough_terrain() -> Terrain {
    Terrain { name: "rough", grid: super::rough(61, 47, 9), slope_px: 5.0 }
}

/// Makes all available terrains, with slopes of a lens and a pane (5 px per 1/m) or of apex `camera` (90 px per 1/m).
fn terrains() -> Vec<Terrain> {
    let places = listing(8, 11);
    let find = |place| places.iter().position(|p| p.place == place).unwrap();
    let (indoors, outdoors) = (find(procedural::Place::Indoors), find(procedural::Place::Outdoor));
    let mut terrains = vec![
        Terrain { name: "indoors", grid: procedural(indoors), slope_px: 5.0 },
        Terrain { name: "outdoors", grid: procedural(outdoors), slope_px: 90.0 },
        rough_terrain(),
    ];
    let sets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/rgbd");
    for (name, path, unit_m, slope_px) in [
        ("real kitchen", "sevenscenes_kitchen/frame-000000.depth.png", 0.001, 90.0),
        ("real road", "kitti_road/depth/0000000050.png", 1.0 / 256.0, 5.0),
        ("real office", "hololens_office/depth/00050.png", 0.001, 5.0),
    ] {
        let Ok(bytes) = std::fs::read(sets.join(path)) else {
            println!("skipped: no {} in {}", path, sets.display());
            continue;
        };
        let size = image::load_from_memory(&bytes).unwrap();
        let grid = sheet(size.width() as usize, size.height() as usize, bytes, unit_m);
        terrains.push(Terrain { name, grid, slope_px });
    }
    terrains
}

/// A ray in the kernel's coordinates, relative to `base`, and its target quad.
#[derive(Clone, Copy)]
struct Aimed {
    ray: [f32; 4],
    quad: [i64; 2],
}

impl Aimed {
    /// Returns the ray in grid coordinates; the conversion is exact.
    fn absolute(&self, base: [i32; 2]) -> [f64; 4] {
        let [x, y, sx, sy] = self.ray.map(f64::from);
        [x + f64::from(base[0]), y + f64::from(base[1]), sx, sy]
    }
}

/// Target of a ray.
#[derive(Clone, Copy, PartialEq)]
enum Target {
    /// A vertex, or a point on an edge along a row, a column or a diagonal.
    Edge,
    /// Any point of the mesh.
    Anywhere,
}

/// Aims ray `k` at a point of the mesh within a few pixels of `corner`.
fn aim(terrain: &Terrain, target: Target, k: u64, corner: [i64; 2], base: [i32; 2]) -> Aimed {
    let r = |n: u64| random(k * 8 + n);
    let grid = &terrain.grid;
    let quad = [
        (corner[0] + (r(0) * 6.0) as i64).min(grid.nx() as i64 - 2),
        (corner[1] + (r(1) * 6.0) as i64).min(grid.ny() as i64 - 2),
    ];
    let t = r(2);
    let (fu, fv) = match (target, k % 4) {
        (Target::Anywhere, _) => (t, r(5)),
        (_, 0) => (t, 0.0),
        (_, 1) => (0.0, t),
        (_, 2) => (t, 1.0 - t),
        _ => (0.0, 0.0),
    };
    let w = |a: i64, b: i64| {
        let q = (quad[1] + b) * grid.nx() as i64 + quad[0] + a;
        f64::from(grid.inverse_depths_per_m()[q as usize])
    };
    let height = if fu + fv <= 1.0 {
        w(0, 0) + (w(1, 0) - w(0, 0)) * fu + (w(0, 1) - w(0, 0)) * fv
    } else {
        w(1, 1) + (w(1, 1) - w(0, 1)) * (fu - 1.0) + (w(1, 1) - w(1, 0)) * (fv - 1.0)
    };
    let (mut sx, mut sy) =
        ((r(3) * 2.0 - 1.0) * terrain.slope_px, (r(4) * 2.0 - 1.0) * terrain.slope_px);
    // Some rays run along rows, columns and diagonals; some are nearly rays of a pinhole.
    match (k / 4) % 8 {
        0 => sx = 0.0,
        1 => sy = 0.0,
        2 => sy = -sx,
        3 => (sx, sy) = (sx * 1e-4, sy * 1e-4),
        _ => {}
    }
    let from = |axis: usize, f: f64, s: f64| {
        (quad[axis] as f64 + f - f64::from(base[axis]) - s * height) as f32
    };
    Aimed { ray: [from(0, fu, sx), from(1, fv, sy), sx as f32, sy as f32], quad }
}

/// Returns the largest w in [`lo`, `hi`] at which a line hits a triangle of the quads `[i0, j0, i1, j1]`, in f64.
fn hit_in(
    grid: &Grid,
    [x, y, sx, sy]: [f64; 4],
    [i0, j0, i1, j1]: [i64; 4],
    [lo, hi]: [f64; 2],
) -> Option<f64> {
    let w = grid.inverse_depths_per_m();
    let (nx, ny) = (grid.nx() as i64, grid.ny() as i64);
    let at = |i: i64, j: i64| f64::from(w[(j.clamp(0, ny - 1) * nx + i.clamp(0, nx - 1)) as usize]);
    let mut best: Option<f64> = None;
    for j in j0..=j1 {
        for i in i0..=i1 {
            let (w00, w10, w01, w11) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
            let (x, y) = (x - i as f64, y - j as f64);
            for (b, c, height, sum_sign) in
                [(w10 - w00, w01 - w00, w00, 1.0), (w11 - w01, w11 - w10, w10 + w01 - w11, -1.0)]
            {
                let hit = (height + b * x + c * y) / (1.0 - b * sx - c * sy);
                let (u, v) = (x + sx * hit, y + sy * hit);
                let inside = |t: f64| (-EDGE..=1.0 + EDGE).contains(&t);
                if (lo..=hi).contains(&hit)
                    && inside(u)
                    && inside(v)
                    && (1.0 - u - v) * sum_sign >= -EDGE
                    && best.is_none_or(|w| hit > w)
                {
                    best = Some(hit);
                }
            }
        }
    }
    best
}

/// Finds the first hit of the whole line, in f64. Searches slices of w from near to far; the line travels at most two
/// pixels in a slice.
fn first_hit(grid: &Grid, ray: [f64; 4]) -> Option<f64> {
    let [bottom, top] = grid.extremes().map(f64::from);
    let [x, y, sx, sy] = ray;
    let step = (2.0 / sx.abs().max(sy.abs()).max(1e-3)).min(top - bottom + 1e-9);
    let mut hi = top + 1e-9;
    while hi > bottom - 1e-9 {
        let lo = hi - step;
        let range = |x: f64, s: f64| {
            let (a, b) = (x + s * lo, x + s * hi);
            ((a.min(b) - 1e-6).floor() as i64, (a.max(b) + 1e-6).floor() as i64)
        };
        let ((i0, i1), (j0, j1)) = (range(x, sx), range(y, sy));
        let hit = hit_in(grid, ray, [i0, j0, i1, j1], [lo - 1e-12, hi]);
        if hit.is_some() {
            return hit;
        }
        hi = lo;
    }
    None
}

/// Returns the ray and eight neighbours at a distance of about [`NEAR_PX`]: on all sides, and along its direction on
/// the grid. The latter matter for a ray that touches the floor of a notch, because the sides of the notch stop all
/// others.
fn neighbours([x, y, sx, sy]: [f64; 4]) -> [[f64; 4]; 9] {
    let length = (sx * sx + sy * sy).sqrt().max(1e-9);
    let (ax, ay) = (sx / length, sy / length);
    [
        (0.0, 0.0),
        (ax, ay),
        (-ax, -ay),
        (1.0, 0.3),
        (-1.0, 0.3),
        (0.3, 1.0),
        (0.3, -1.0),
        (-0.3, -1.0),
        (-0.3, 1.0),
    ]
    .map(|(dx, dy)| [x + dx * NEAR_PX, y + dy * NEAR_PX, sx, sy])
}

fn is_leak(grid: &Grid, aimed: &Aimed, absolute: [f64; 4], w: f64) -> bool {
    let [i, j] = aimed.quad;
    let around = [i - 1, j - 1, i + 1, j + 1];
    let [bottom, top] = grid.extremes().map(f64::from);
    let stops = |ray: [f64; 4]| {
        hit_in(grid, ray, around, [bottom * 0.999, top * 1.001]).is_some_and(|hit| hit > w * 1.0001)
    };
    stops(absolute) && neighbours(absolute).into_iter().all(stops)
}

/// Returns the least distance in w between a hit and the triangles that may contain it, or one below [`STRAY`].
fn stray(grid: &Grid, [x, y, sx, sy]: [f64; 4], hit: f64) -> f64 {
    let w = grid.inverse_depths_per_m();
    let (nx, ny) = (grid.nx() as i64, grid.ny() as i64);
    let at = |i: i64, j: i64| f64::from(w[(j.clamp(0, ny - 1) * nx + i.clamp(0, nx - 1)) as usize]);
    let (u, v) = (x + sx * hit, y + sy * hit);
    let mut nearest = f64::INFINITY;
    for (du, dv) in [(0.0, 0.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)] {
        let (i, j) = ((u + du * NEAR_PX).floor() as i64, (v + dv * NEAR_PX).floor() as i64);
        let (fu, fv) = (u - i as f64, v - j as f64);
        let lower = at(i, j) + (at(i + 1, j) - at(i, j)) * fu + (at(i, j + 1) - at(i, j)) * fv;
        let upper = at(i + 1, j + 1)
            + (at(i + 1, j + 1) - at(i, j + 1)) * (fu - 1.0)
            + (at(i + 1, j + 1) - at(i + 1, j)) * (fv - 1.0);
        if fu + fv < 1.0 + NEAR_PX {
            nearest = nearest.min((lower - hit).abs());
        }
        if fu + fv > 1.0 - NEAR_PX {
            nearest = nearest.min((upper - hit).abs());
        }
        if nearest < STRAY {
            break;
        }
    }
    nearest
}

/// True if the line stays inside the grid for all w, regardless of its hit.
fn stays_inside(grid: &Grid, [x, y, sx, sy]: [f64; 4]) -> bool {
    let top = f64::from(grid.extremes()[1]) * 1.001;
    let within = |x: f64, s: f64, n: usize| {
        let (a, b) = (x, x + s * top);
        a.min(b) > 1.0 && a.max(b) < n as f64 - 3.0
    };
    within(x, sx, grid.nx()) && within(y, sy, grid.ny())
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn walk_avx2(grid: &Grid, base: [i32; 2], lines: &Lines, span: Span) -> Lane {
    walk::<AVX2>(grid, base, lines, span)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq,avx512bw")]
fn walk_avx512(grid: &Grid, base: [i32; 2], lines: &Lines, span: Span) -> Lane {
    walk::<AVX512>(grid, base, lines, span)
}

/// Calls the kernel that a run uses on this machine.
fn walk_fastest(grid: &Grid, base: [i32; 2], lines: &Lines, span: Span) -> Lane {
    match Isa::detect() {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling a function compiled for AVX2")]
        // SAFETY: `detect` found AVX2 on this machine.
        Isa::Avx2 => unsafe { walk_avx2(grid, base, lines, span) },
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling a function compiled for AVX-512")]
        // SAFETY: `detect` found AVX-512 on this machine.
        Isa::Avx512 => unsafe { walk_avx512(grid, base, lines, span) },
        _ => walk::<BASELINE>(grid, base, lines, span),
    }
}

/// Calls `see` with every ray, its grid coordinates and the kernel's hit. Counts the rays of groups inside the grid.
fn shoot(
    terrain: &Terrain,
    target: Target,
    rays: u64,
    mut see: impl FnMut(&Aimed, [f64; 4], f64),
) -> u64 {
    let grid = &terrain.grid;
    let mut inside = 0;
    for group in 0..rays / LANES as u64 {
        let place = |n: u64, side: usize| (random(group * 4 + n) * (side - 1) as f64) as i64;
        let corner = [place(0, grid.nx()), place(1, grid.ny())];
        let base = [0, 1].map(|k| corner[k] as i32 - (random(group * 4 + 2) * 9.0) as i32);
        let aimed: [Aimed; LANES] = std::array::from_fn(|l| {
            aim(terrain, target, group * LANES as u64 + l as u64, corner, base)
        });
        let mut lines = Lines::ZERO;
        for (l, a) in aimed.iter().enumerate() {
            [lines.x[l], lines.y[l], lines.sx[l], lines.sy[l]] = a.ray;
        }
        let is_inside = aimed.iter().all(|a| stays_inside(grid, a.absolute(base)));
        inside += u64::from(is_inside) * LANES as u64;
        let span = full_span(grid, is_inside);
        let hits = walk_fastest(grid, base, &lines, span);
        if group % 8 == 0 {
            let baseline = walk::<BASELINE>(grid, base, &lines, span);
            assert_eq!(hits, baseline, "the kernels differ");
        }
        for (a, hit) in aimed.iter().zip(hits) {
            see(a, a.absolute(base), f64::from(hit));
        }
    }
    inside
}

/// Aims `rays` rays at the edges of a terrain, and asserts that none leaks or strays.
fn assert_tight(terrain: &Terrain, rays: u64) {
    let grid = &terrain.grid;
    let (mut leaks, mut strays, mut farthest, mut seen) = (0u64, 0u64, 0f64, 0u64);
    let inside = shoot(terrain, Target::Edge, rays, |aimed, absolute, w| {
        seen += 1;
        leaks += u64::from(is_leak(grid, aimed, absolute, w));
        let gap = stray(grid, absolute, w);
        farthest = farthest.max(gap);
        strays += u64::from(gap > STRAY);
    });
    println!(
        "{:14} {seen} rays at edges ({:.0} % inside): {leaks} leaks, {strays} strays, at most {farthest:.1e} 1/m",
        terrain.name,
        100.0 * inside as f64 / seen as f64
    );
    assert_eq!((leaks, strays), (0, 0), "{}", terrain.name);
}

/// Aims about ten million rays in all, which takes one core ten to fifteen seconds.
#[test]
fn rays_at_edges_do_not_leak() {
    let terrains = terrains();
    for terrain in &terrains {
        assert_tight(terrain, 10_000_000 / terrains.len() as u64 + LANES as u64);
    }
}

/// Command: `cargo test --release --lib ten_million -- --ignored --nocapture`. It takes one core about a minute.
#[test]
#[ignore = "ten million rays at each terrain"]
fn ten_million_rays_at_edges_of_each_terrain_do_not_leak() {
    for terrain in terrains() {
        assert_tight(&terrain, 10_000_000);
    }
}

/// Checks the checks: hits moved behind the mesh count as leaks, and hits moved off the mesh as strays.
#[test]
fn leaks_and_strays_are_recognised() {
    let terrain = rough_terrain();
    let grid = &terrain.grid;
    let bottom = f64::from(grid.extremes()[0]);
    let (mut leaks, mut strays, mut seen) = (0, 0, 0);
    shoot(&terrain, Target::Edge, 16_000, |aimed, absolute, w| {
        seen += 1;
        leaks += u32::from(is_leak(grid, aimed, absolute, bottom));
        strays += u32::from(stray(grid, absolute, w * 1.001) > STRAY);
    });
    // The other rays are aimed at a rim, or at a point with the inverse depth `bottom`.
    assert!(leaks * 3 > seen, "{leaks} of {seen}");
    assert!(strays * 10 > seen * 9, "{strays} of {seen}");
}

/// Returns the median, the 99 % and 99.9 % quantiles, and the maximum.
fn quantiles(mut errors: Vec<f64>) -> [f64; 4] {
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
    [at(0.5), at(0.99), at(0.999), at(1.0)]
}

#[test]
fn depths_are_those_of_f64() {
    for terrain in terrains() {
        let grid = &terrain.grid;
        for target in [Target::Anywhere, Target::Edge] {
            let (mut errors, mut unexplained) = (vec![], 0);
            shoot(&terrain, target, 32_000, |_, absolute, w| {
                let expected = first_hit(grid, absolute).expect("the sheet has no holes");
                let error = (expected / w - 1.0).abs();
                if error > 1e-4 {
                    // The ray meets the other side of a rim, or a skirt at a grazing angle. The hit must lie
                    // between those of the neighbours within `NEAR_PX`.
                    let (mut lo, mut hi) = (expected, expected);
                    for hit in neighbours(absolute).map(|ray| first_hit(grid, ray).unwrap()) {
                        (lo, hi) = (lo.min(hit), hi.max(hit));
                    }
                    unexplained += u32::from(w < lo * 0.9999 || w > hi * 1.0001);
                }
                errors.push(error);
            });
            let aimed = if target == Target::Edge { "edges" } else { "anywhere" };
            let flips = errors.iter().filter(|e| **e > 1e-4).count();
            let rays = errors.len();
            let [median, p99, p999, most] = quantiles(errors);
            println!(
                "{:14} {aimed:8}: relative depth error, median {median:.1e}, 99 % {p99:.1e}, 99.9 % {p999:.1e}, \
                 maximum {most:.1e}; {flips} of {rays} over 1e-4",
                terrain.name
            );
            assert_eq!(unexplained, 0, "{}", terrain.name);
            assert!(median <= 1e-7 && p99 <= 1e-5);
            if target == Target::Anywhere {
                assert!(p999 <= 1e-5 && most <= 1e-3);
            } else {
                // Rays aimed at a rim may take either side of it.
                assert!(flips * 100 <= rays);
            }
        }
    }
}
