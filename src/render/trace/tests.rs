//! Compares the grid kernel, its bounds and its probe with brute force in f64 and with another ray tracer.

#![allow(clippy::print_stdout, reason = "measured deviations, shown by --nocapture")]

use super::camera::CameraChunk;
use super::footprint::{Footprint, span};
use super::isa::BASELINE;
use super::lanes::{CHUNK, LANES};
use super::lines::{
    LineMaker, Path, ViewLanes, closed_form, footprint_of_lines, span_of_area, span_of_lines,
};
use super::patch::{Area, Patch};
use super::walk::{Lines, Span, walk, walk_lanes};
use super::zones::Zones;
use super::*;
use glam::{DMat3, DVec3, Vec3A};

mod edges;
mod probe;

/// Hashes a counter to a number in [0, 1), for rough surfaces and rays.
pub(super) fn random(k: u64) -> f64 {
    let mut x = k.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678;
    for _ in 0..2 {
        x = (x ^ (x >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (x >> 40) as f64 / f64::from(1 << 24)
}

/// Makes a surface of flat plates, steep cells between them (skirts), and noise.
pub(super) fn rough(nx: usize, ny: usize, key: u64) -> Grid {
    let w = (0..nx * ny)
        .map(|q| {
            let (i, j) = ((q % nx) as u64, (q / nx) as u64);
            let plate = random(key + (i / 4) * 131 + (j / 3) * 17);
            (0.15 + 0.8 * (plate * 3.0).floor() / 3.0 + 0.05 * random(key + q as u64 * 7)) as f32
        })
        .collect();
    Grid::new(nx, ny, w)
}

/// Tolerance at the edges of a triangle in [`brute`], px.
const EDGE: f64 = 1e-10;

/// Returns the largest w at which the line hits a triangle of the continued sheet, in f64; `None` if it hits none.
fn brute(grid: &Grid, [x, y, sx, sy]: [f64; 4]) -> Option<f64> {
    let w = grid.inverse_depths_per_m();
    let (nx, ny) = (grid.nx() as i64, grid.ny() as i64);
    let at = |i: i64, j: i64| f64::from(w[(j.clamp(0, ny - 1) * nx + i.clamp(0, nx - 1)) as usize]);
    let [bottom, top] = grid.extremes().map(f64::from);
    let range = |x: f64, s: f64| {
        let (a, b) = (x + s * bottom, x + s * top);
        (a.min(b).floor() as i64 - 1, a.max(b).floor() as i64 + 1)
    };
    let ((i0, i1), (j0, j1)) = (range(x, sx), range(y, sy));
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
                if hit.is_finite()
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

/// Aims ray `k` at an edge, a diagonal, a vertex or any point. Some rays run along an axis or a diagonal; with
/// `exotic`, some targets lie outside the grid.
fn aimed(grid: &Grid, k: u64, base: [i32; 2], exotic: bool) -> [f32; 4] {
    let r = |n: u64| random(k * 16 + n);
    let [bottom, top] = grid.extremes().map(f64::from);
    let reach = if exotic { 8.0 } else { 0.0 };
    let pick = |r: f64, n: usize| {
        let (lo, hi) = if exotic { (-reach, n as f64 + reach) } else { (7.0, n as f64 - 8.0) };
        lo + r * (hi - lo)
    };
    let (mut u, mut v) = (pick(r(0), grid.nx()), pick(r(1), grid.ny()));
    match k % 5 {
        0 => u = u.round(),
        1 => v = v.round(),
        2 => (u, v) = (u.round(), v.round()),
        3 => v = (u + v).round() - u,
        _ => {}
    }
    let w = bottom + r(2) * (top - bottom);
    let scale = if exotic { 60.0 } else { 5.0 };
    let (mut sx, mut sy) = ((r(3) - 0.5) * scale, (r(4) - 0.5) * scale);
    match (k / 5) % 6 {
        0 => sx = 0.0,
        1 => sy = 0.0,
        2 => sy = -sx,
        3 => sy = sx,
        _ => {}
    }
    [
        (u - f64::from(base[0]) - sx * w) as f32,
        (v - f64::from(base[1]) - sy * w) as f32,
        sx as f32,
        sy as f32,
    ]
}

fn group(rays: &[[f32; 4]]) -> Lines {
    let mut lines = Lines::ZERO;
    for (l, ray) in rays.iter().enumerate() {
        [lines.x[l], lines.y[l], lines.sx[l], lines.sy[l]] = *ray;
    }
    lines
}

pub(super) fn full_span(grid: &Grid, inside: bool) -> Span {
    let [bottom, top] = grid.extremes();
    Span { hi: top * 1.000_001, lo: bottom * 0.999_999, inside }
}

/// True if `w` lies between the f64 hits of the ray and its neighbours at 2e-5 px, which f32 cannot distinguish.
fn agrees(grid: &Grid, absolute: [f64; 4], w: f64) -> bool {
    const NEAR_PX: f64 = 2e-5;
    let close = |a: f64| (a - w).abs() <= 1e-4 * a;
    let hits: Vec<f64> =
        [(0.0, 0.0), (1.0, 0.3), (-1.0, 0.3), (0.3, 1.0), (0.3, -1.0), (-0.3, -1.0)]
            .iter()
            .filter_map(|(dx, dy)| {
                let [x, y, sx, sy] = absolute;
                brute(grid, [x + dx * NEAR_PX, y + dy * NEAR_PX, sx, sy])
            })
            .collect();
    let lo = hits.iter().copied().fold(f64::INFINITY, f64::min);
    let hi = hits.iter().copied().fold(0.0, f64::max);
    // On a skirt at a grazing angle, any w between the values of the neighbouring rays is correct.
    hits.first().is_some_and(|&w| close(w)) || (w >= lo * 0.9999 && w <= hi * 1.0001)
}

#[test]
fn walks_end_where_brute_force_does() {
    let (mut worst, mut edge_flips, mut tested) = (0f64, 0, 0);
    for (nx, ny, key, exotic) in
        [(31, 23, 1, false), (31, 23, 2, true), (9, 40, 3, true), (2, 2, 4, true)]
    {
        let grid = rough(nx, ny, key);
        for base in [[0, 0], [11, 7], [-5, 30]] {
            for block in 0..400u64 {
                let rays: Vec<_> = (0..LANES as u64)
                    .map(|l| aimed(&grid, key << 32 | (block * LANES as u64 + l), base, exotic))
                    .collect();
                let hits = walk::<BASELINE>(&grid, base, &group(&rays), full_span(&grid, !exotic));
                for (ray, w) in rays.iter().zip(hits) {
                    let [x, y, sx, sy] = ray.map(f64::from);
                    let absolute = [x + f64::from(base[0]), y + f64::from(base[1]), sx, sy];
                    let expected = brute(&grid, absolute).expect("the sheet has no holes");
                    let w = f64::from(w);
                    tested += 1;
                    if (w - expected).abs() <= 1e-4 * expected {
                        worst = worst.max((w - expected).abs() / expected);
                    } else {
                        edge_flips += 1;
                        assert!(agrees(&grid, absolute, w), "{absolute:?}: {w}, not {expected}");
                    }
                }
            }
        }
    }
    println!(
        "{tested} rays: relative error {worst:.1e}, {edge_flips} on the other side of an edge"
    );
    assert!(edge_flips * 50 < tested);
}

/// Every hit lies on the sheet: a ray that leaks between two cells ends above or below the sheet.
#[test]
fn no_ray_leaks_between_cells() {
    let (mut tested, mut outside_gap) = (0, 0f64);
    let grid = rough(61, 47, 9);
    let w = grid.inverse_depths_per_m();
    let span = full_span(&grid, true);
    for block in 0..40_000u64 {
        let base = [17, 13];
        let rays: Vec<_> = (0..LANES as u64)
            .map(|l| aimed(&grid, block * LANES as u64 + l, base, false))
            .collect();
        let lines = group(&rays);
        let inside = walk::<BASELINE>(&grid, base, &lines, span);
        let clamped = walk::<BASELINE>(&grid, base, &lines, full_span(&grid, false));
        assert_eq!(inside, clamped, "clamped indices change hits");
        for (ray, hit) in rays.iter().zip(inside) {
            let [x, y, sx, sy] = ray.map(f64::from);
            let hit = f64::from(hit);
            let (u, v) = (x + 17.0 + sx * hit, y + 13.0 + sy * hit);
            // Least distance in w between hit and sheet, over the cells that may contain the point.
            let mut gap = f64::INFINITY;
            for (du, dv) in [(0.0, 0.0), (1e-5, 1e-5), (-1e-5, -1e-5), (1e-5, -1e-5), (-1e-5, 1e-5)]
            {
                let (i, j) = ((u + du).floor(), (v + dv).floor());
                let at = |a: usize, b: usize| f64::from(w[(j as usize + b) * 61 + i as usize + a]);
                let (fu, fv) = (u - i, v - j);
                let lower = at(0, 0) + (at(1, 0) - at(0, 0)) * fu + (at(0, 1) - at(0, 0)) * fv;
                let upper = at(1, 1)
                    + (at(1, 1) - at(0, 1)) * (fu - 1.0)
                    + (at(1, 1) - at(1, 0)) * (fv - 1.0);
                let sheets: &[f64] = if (fu + fv - 1.0).abs() < 1e-5 {
                    &[lower, upper]
                } else if fu + fv < 1.0 {
                    &[lower]
                } else {
                    &[upper]
                };
                for sheet in sheets {
                    gap = gap.min((sheet - hit).abs());
                }
            }
            outside_gap = outside_gap.max(gap);
            tested += 1;
        }
    }
    println!("{tested} rays: largest distance from the sheet {outside_gap:.1e} 1/m");
    assert!(outside_gap < 2e-5);
}

/// Another ray tracer finds the same hits on a triangle mesh of the same sheet in projective space.
#[test]
fn another_ray_tracer_finds_the_same_hits() {
    use obvhs::{
        BvhBuildParams,
        bvh2::builder::build_bvh2_from_tris,
        ray::{Ray, RayHit},
        rt_triangle::RtTriangle,
        triangle::Triangle,
    };
    const SCALE: f32 = 100.0;
    let grid = rough(61, 47, 5);
    let w = grid.inverse_depths_per_m();
    let vertex = |i: usize, j: usize| Vec3A::new(i as f32, j as f32, SCALE * w[j * 61 + i]);
    let mut triangles = vec![];
    for (i, j) in (0..46).flat_map(|j| (0..60).map(move |i| (i, j))) {
        let [a, b] = [vertex(i, j), vertex(i + 1, j)];
        let [c, d] = [vertex(i, j + 1), vertex(i + 1, j + 1)];
        triangles.push(Triangle { v0: a, v1: b, v2: c });
        triangles.push(Triangle { v0: d, v1: c, v2: b });
    }
    let mut time = std::time::Duration::ZERO;
    let bvh = build_bvh2_from_tris(&triangles, BvhBuildParams::medium_build(), &mut time);
    let packed: Vec<RtTriangle> =
        bvh.primitive_indices.iter().map(|&i| (&triangles[i as usize]).into()).collect();
    let top = grid.extremes()[1] * 1.01;
    let (mut tested, mut differing) = (0, 0);
    for block in 0..4000u64 {
        // Aims no ray at an edge, because the two ray tracers round differently there.
        let rays: Vec<_> = (0..LANES as u64)
            .map(|l| aimed(&grid, (block * LANES as u64 + l) * 30 + 29, [0, 0], false))
            .collect();
        for ([x, y, sx, sy], hit) in rays.iter().copied().zip(walk::<BASELINE>(
            &grid,
            [0, 0],
            &group(&rays),
            full_span(&grid, true),
        )) {
            let origin = Vec3A::new(x + sx * top, y + sy * top, SCALE * top);
            let ray = Ray::new_inf(origin, Vec3A::new(-sx, -sy, -SCALE));
            let mut found = RayHit::none();
            let met = bvh.ray_traverse(ray, &mut found, |ray, id| packed[id].intersect(ray));
            tested += 1;
            differing += u32::from(!met || (top - found.t - hit).abs() > 1e-3 * hit);
        }
    }
    println!("{tested} rays, {differing} differ");
    assert!(differing * 2000 <= tested);
}

/// Makes a scene with two rough sheets and a pane, tilted or not.
pub(super) fn scene(tilt_deg: [f64; 2], general: bool, gaussian: bool, focus_m: f64) -> Scene {
    let normal = Slab::tilted_normal(tilt_deg);
    let slab = Slab {
        normal,
        plane_distance_m: 0.3 * normal.z,
        thickness_m: 0.03,
        ior: 1.6,
        absorption_per_m: [0.0; 3],
    };
    let pose = if general {
        let mirror = DMat3::IDENTITY
            - DMat3::from_cols(
                2.0 * normal.x * normal,
                2.0 * normal.y * normal,
                2.0 * normal.z * normal,
            );
        let flip = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        Pose::General { rotation: flip * mirror, translation_m: flip * (0.6 * normal.z * normal) }
    } else {
        let extra_m = if normal == DVec3::Z { 0.6 } else { 0.0 };
        Pose::Aligned { extra_m }
    };
    let view = |key, pose, sign: f64| View {
        grid: rough(90, 70, key).into(),
        texture: Texture::new(1, 1, &[[1.0; 4]]).into(),
        focal_px: [sign * 150.0, 140.0],
        principal: [44.5, 34.5],
        pose,
        photograph_size: (90, 70),
    };
    Scene {
        seed: 3,
        sampling: Sampling::Sobol,
        spp: 256,
        target_error: None,
        layers: glasshouse_line::layer::PerLayer([true; 4]),
        labels: glasshouse_line::label::LabelSet::default(),
        first_reflection_alone: false,
        film: FilmPlane {
            width: 120,
            height: 80,
            tan_half_fov: FilmPlane::tan_half_fov(120, 80, 50.0),
            filter: gaussian.then(FilterTable::gaussian),
        },
        lens: Lens { aperture_radius_m: 0.008, inverse_focus_per_m: 1.0 / focus_m },
        orders: OrderPlan::new(&slab, &[normal.z], [1.0; 2], 1e-5),
        zones: Zones::default(),
        slab,
        stack: None,
        bow: None,
        wave: None,
        rough: None,
        smeared: None,
        cover: Cover::default(),
        front: view(1, Pose::Aligned { extra_m: 0.0 }, 1.0).into(),
        back: view(2, pose, -1.0).into(),
    }
}

/// Returns the largest distance of the rays outside the footprint's box at w, px; negative if all are inside. The rays are
/// relative to the grid points of `lanes`, and the footprint to `base`.
fn escape(
    (footprint, base): (&dyn Footprint, [i32; 2]),
    lanes: &ViewLanes,
    lines: &[Lines],
    w: f32,
) -> f32 {
    let [u0, v0, u1, v1] = footprint.at(w);
    let from = |k: usize, l: usize| (lanes.grid.base[k][l] - base[k]) as f32;
    let mut farthest = f32::NEG_INFINITY;
    for group in lines {
        for l in 0..LANES {
            let u = group.x[l] + w * group.sx[l] + from(0, l);
            let v = group.y[l] + w * group.sy[l] + from(1, l);
            for out in [u0 - u, u - u1, v0 - v, v - v1] {
                farthest = farthest.max(out);
            }
        }
    }
    farthest
}

/// Footprints contain every ray of their square or bundle, and the spans from footprints change no hit.
#[test]
fn footprints_and_spans_are_conservative() {
    let (mut bundles, mut closest, mut share) = (0u32, f32::NEG_INFINITY, 0.0);
    let mut camera = CameraChunk::new();
    for (n, (tilt_deg, general)) in
        [([0.0, 0.0], false), ([12.0, -25.0], false), ([-10.0, 15.0], true), ([40.0, 0.0], false)]
            .into_iter()
            .enumerate()
    {
        for focus_m in [1.1, 4.0, f64::INFINITY] {
            let scene = scene(tilt_deg, general, n % 2 == 1, focus_m);
            for (x, y) in
                (0..80).step_by(20).flat_map(|y| (0..120).step_by(20).map(move |x| (x, y)))
            {
                let patch = Patch::new(&scene, x, y);
                // The square of 8 px around a patch, as in a trace, and the patch alone.
                let side_px = [8, 4][n % 2];
                let square = [x, y].map(|v| v / side_px * side_px);
                let area = Area::new(&scene, square[0], square[1], side_px);
                camera.fill(&scene, &patch, 16, CHUNK);
                for order in [
                    Order::Transmitted(0),
                    Order::Transmitted(1),
                    Order::Reflected(0),
                    Order::Reflected(2),
                ] {
                    let side = match order {
                        Order::Transmitted(_) => &scene.front,
                        Order::Reflected(_) => &scene.back,
                    };
                    let Surface::Sheet(view) = side else { panic!("the surface must be a sheet") };
                    let constant = scene.slab.kappa_m(order, 0.0);
                    let slope = scene.slab.kappa_m(order, 1.0) - constant;
                    let path = Path::Lens { constant, slope };
                    let lanes = ViewLanes::new(view, &patch);
                    let maker = LineMaker::new(&scene, view, &patch, &lanes);
                    let lines: Vec<Lines> =
                        (0..CHUNK).map(|s| maker.lines(&camera, path, s)).collect();
                    let out_at = |w: f32| match &view.pose {
                        Pose::Aligned { extra_m } => {
                            let (form, base) =
                                closed_form(&scene, view, &[path], &area, *extra_m, false);
                            escape((&form, base), &lanes, &lines, w)
                        }
                        Pose::General { .. } => {
                            let (form, base) = footprint_of_lines(&lanes.grid, &lines);
                            escape((&form, base), &lanes, &lines, w)
                        }
                    };
                    for step in 0..40 {
                        let w = 1.2 * (step as f32 / 40.0);
                        let out = out_at(w);
                        assert!(out < 0.0, "{order:?} at {w} 1/m, tilt {tilt_deg:?}: {out} px");
                        closest = closest.max(out);
                    }
                    let found = match &view.pose {
                        Pose::Aligned { extra_m } => {
                            span_of_area(&scene, view, &[path], &area, *extra_m, false).0
                        }
                        Pose::General { .. } => span_of_lines(view, &lanes.grid, &lines).0,
                    };
                    let all = full_span(&view.grid, false);
                    for group in &lines {
                        let narrow = walk_lanes::<BASELINE>(&view.grid, &lanes.grid, group, found);
                        let wide = walk_lanes::<BASELINE>(&view.grid, &lanes.grid, group, all);
                        for l in 0..LANES {
                            if (narrow[l] - wide[l]).abs() > 2e-6 * wide[l] {
                                let absolute = [
                                    f64::from(group.x[l]) + f64::from(lanes.grid.base[0][l]),
                                    f64::from(group.y[l]) + f64::from(lanes.grid.base[1][l]),
                                    f64::from(group.sx[l]),
                                    f64::from(group.sy[l]),
                                ];
                                assert!(
                                    agrees(&view.grid, absolute, f64::from(narrow[l])),
                                    "span {found:?} changes {} to {}",
                                    wide[l],
                                    narrow[l]
                                );
                            }
                        }
                    }
                    bundles += 1;
                    share += f64::from((found.hi - found.lo) / (all.hi - all.lo));
                }
            }
        }
    }
    println!(
        "{bundles} bundles: closest ray {:.4} px inside its box; spans {:.2} of the whole range",
        -closest,
        share / f64::from(bundles)
    );
}

/// With a constant footprint on a flat part, the span contains the w of this part in spite of extremes elsewhere.
#[test]
fn spans_contain_a_flat_sheet() {
    struct Everywhere;
    impl Footprint for Everywhere {
        fn at(&self, _: f32) -> [f32; 4] {
            [3.0, 3.0, 3.5, 3.5]
        }
    }
    let mut w = vec![0.5f32; 64];
    w[63] = 0.1;
    w[0] = 2.0;
    let found = span(&Grid::new(8, 8, w), [0, 0], &Everywhere);
    assert!(found.lo <= 0.5 && found.hi >= 0.5);
}
