//! Does a kernel get slower? One 32 x 32 tile of a procedural pair at 256 samples, both instruction sets.
//!
//!     cargo bench --bench trace
#![allow(
    missing_docs,
    clippy::unwrap_used,
    reason = "criterion's macros; benches may panic"
)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use glasshouse::manifest::parse_scene;
use glasshouse::sample::{Rgbd, intrinsics, listing, render};
use glasshouse::scene::{Decoded, Polygons, Sheet, assemble};
use glasshouse::trace::{Isa, PixelSeed, Scene, Tile, sample, trace_tile};
use std::hint::black_box;

const SIZE: (u32, u32) = (1024, 768);

fn sheet(picture: &Rgbd) -> Sheet {
    let pixels = (SIZE.0 * SIZE.1) as usize;
    let far_m = picture.depth_m.iter().fold(0f32, |m, &z| m.max(z));
    let depth = |q: usize| {
        if picture.valid[q] {
            picture.depth_m[q]
        } else {
            far_m
        }
    };
    let texel = |q: usize| {
        [0, 1, 2, 3].map(|c| {
            if c < 3 {
                f32::from(picture.rgb[q * 3 + c]) / 255.0
            } else {
                0.0
            }
        })
    };
    Sheet {
        width: SIZE.0 as usize,
        height: SIZE.1 as usize,
        inverse_depth_per_m: (0..pixels).map(|q| 1.0 / depth(q)).collect(),
        valid: picture.valid.clone(),
        filled_share: 0.0,
        color_width: SIZE.0 as usize,
        color_height: SIZE.1 as usize,
        radiance: (0..pixels).map(texel).collect(),
        max_radiance: 1.0,
        intrinsics: glasshouse::manifest::Intrinsics {
            size: None,
            ..intrinsics(SIZE.0, SIZE.1)
        },
        front_center_z_m: f64::from(depth(pixels / 2 + 512)),
    }
}

/// A sheet as a mesh.
fn polygons(sheet: &Sheet) -> Polygons {
    let k = &sheet.intrinsics;
    let (nx, ny) = (sheet.width, sheet.height);
    let depths = sheet.inverse_depth_per_m.iter().enumerate();
    Polygons {
        vertices_m: depths
            .map(|(q, &w)| {
                let x = ((q % nx) as f64 + 0.5 - k.cx) / k.fx;
                let y = ((q / nx) as f64 + 0.5 - k.cy) / k.fy;
                DVec3::new(x, y, 1.0) / f64::from(w)
            })
            .collect(),
        radiance: sheet.radiance.clone(),
        triangles: (0..(nx - 1) * (ny - 1))
            .flat_map(|q| {
                let a = (q / (nx - 1) * nx + q % (nx - 1)) as u32;
                let [b, c, d] = [a + 1, a + nx as u32, a + nx as u32 + 1];
                [[a, b, c], [b, d, c]]
            })
            .collect(),
        empty_faces: 0,
        max_radiance: sheet.max_radiance,
    }
}

fn scene_of<S: Clone + Into<Decoded>>(apex: &str, front: &S, back: &S) -> Scene {
    let photograph = r#"{"color":"c","depth":"d","intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}"#;
    let line = format!(
        r#"{{"schema":"glasshouse.scene/1","id":"bench","seed":1,
            "film":{{"width":256,"height":256,"spp":256}},
            "camera":{{"focal_length_mm":55.0,"aperture_radius_m":0.00893,"focus":{{"at":"front_center"}}}},
            "glass":{{"distance_m":0.3,"thickness_m":0.01,"ior":1.6}},
            "front":{photograph}}},"back":{photograph},"apex":"{apex}"}}}}"#
    );
    assemble(&parse_scene(&line).unwrap(), front.clone(), back.clone())
        .unwrap()
        .0
}

fn bench(c: &mut Criterion) {
    let pictures: Vec<Sheet> = listing(2, 2020)
        .iter()
        .map(|p| sheet(&render(p, SIZE.0, SIZE.1)))
        .collect();
    let tile = Tile {
        x: 112,
        y: 112,
        width: 32,
        height: 32,
    };
    // The same photographs as triangle meshes: 1.57 million triangles each, their texels at the corners.
    let meshes: Vec<Polygons> = pictures.iter().map(polygons).collect();
    let mut group = c.benchmark_group("trace_tile");
    group
        .sample_size(20)
        .throughput(Throughput::Elements(32 * 32 * 256));
    for apex in ["mirror", "camera"] {
        let scene = scene_of(apex, &pictures[0], &pictures[1]);
        for (name, isa) in [("baseline", Isa::Baseline), ("detected", Isa::detect())] {
            group.bench_function(format!("{apex}/{name}"), |b| {
                b.iter(|| trace_tile(black_box(&scene), tile, 0..256, isa));
            });
        }
        let scene = scene_of(apex, &meshes[0], &meshes[1]);
        group.bench_function(format!("{apex}/mesh"), |b| {
            b.iter(|| trace_tile(black_box(&scene), tile, 0..256, Isa::detect()));
        });
    }
    group.finish();
    let seed = PixelSeed::new(1, 2, 3);
    c.bench_function("sampler/definition", |b| {
        b.iter(|| sample(black_box(&seed), black_box(77)));
    });
}

criterion_group!(benches, bench);
criterion_main!(benches);
