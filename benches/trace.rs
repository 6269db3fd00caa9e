//! Measures tracing, decoding and encoding on built-in scenes, and the kernels with each instruction set.
//!
//!     cargo bench --bench trace
#![allow(missing_docs, clippy::unwrap_used, reason = "criterion's macros; benches may panic")]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use glasshouse::bench::{BenchScene, Work, indoor, outdoor, pair, render, stress};
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::{Apex, Fill, Focus};
use render::formats::{NamedBytes, PhotographFiles};
use render::merge::{Tuple, encode_png, encode_tuple_exr};
use render::scene::{Decoded, Polygons, decode_photograph};
use render::trace::{
    BLOCK, BundleProbe, Grid, Isa, Order, PixelSeed, Sampling, Scene, Tile, sample_patch,
    trace_tile,
};
use std::hint::black_box;
use std::sync::atomic::AtomicBool;

const SIZE: [u32; 2] = [1024, 768];
const FILM_PX: u32 = 256;

fn isas() -> [(&'static str, Isa); 2] {
    [("baseline", Isa::Baseline), ("detected", Isa::detect())]
}

fn scene(scene: &BenchScene, apex: Apex) -> Scene {
    let mut line = scene.line.clone();
    line.back.set_apex(apex);
    scene.assemble(&line, Sampling::Sobol).unwrap().scene
}

/// Converts a photograph to a mesh.
fn polygons(decoded: &Decoded) -> Decoded {
    let Decoded::Sheet(sheet) = decoded else {
        panic!("the built-in pair are photographs");
    };
    let k = &sheet.intrinsics;
    let (nx, ny) = (sheet.width, sheet.height);
    let depths = sheet.inverse_depths_per_m().enumerate();
    let mesh = Polygons {
        vertices_m: depths
            .map(|(q, w)| {
                let x = ((q % nx) as f64 + 0.5 - k.cx) / k.fx;
                let y = ((q / nx) as f64 + 0.5 - k.cy) / k.fy;
                DVec3::new(x, y, 1.0) / f64::from(w)
            })
            .collect(),
        radiance: sheet.radiance().copied().collect(),
        triangles: (0..(nx - 1) * (ny - 1))
            .flat_map(|q| {
                let a = (q / (nx - 1) * nx + q % (nx - 1)) as u32;
                let [b, c, d] = [a + 1, a + nx as u32, a + nx as u32 + 1];
                [[a, b, c], [b, d, c]]
            })
            .collect(),
        empty_faces: 0,
        max_radiance: sheet.texture.max_radiance(),
    };
    mesh.into()
}

/// Traces one tile of 32 x 32 px of the built-in pair at 256 samples, with each apex, as photographs and as meshes.
fn tiles(c: &mut Criterion) {
    let pair = pair(SIZE, FILM_PX).unwrap();
    let mut meshes = pair.clone();
    meshes.photographs.front = polygons(&pair.photographs.front.surface).into();
    meshes.photographs.back = polygons(&pair.photographs.back.surface).into();
    // Fixes the focus distance, because the centre of a mesh would yield another distance.
    let Decoded::Sheet(front) = &pair.photographs.front.surface else {
        panic!("the built-in pair are photographs");
    };
    meshes.line.camera.focus = Focus::Distance { distance_m: front.front_center_z_m };
    let tile = Tile { x: 112, y: 112, width: 32, height: 32 };
    let mut group = c.benchmark_group("trace_tile");
    group.sample_size(20).throughput(Throughput::Elements(32 * 32 * 256));
    for (apex, value) in [("mirror", Apex::Mirror), ("camera", Apex::Camera)] {
        let scene = scene(&pair, value);
        for (name, isa) in isas() {
            group.bench_function(format!("{apex}/{name}"), |b| {
                b.iter(|| trace_tile(black_box(&scene), tile, 0..256, isa));
            });
        }
        let scene = self::scene(&meshes, value);
        group.bench_function(format!("{apex}/mesh"), |b| {
            b.iter(|| trace_tile(black_box(&scene), tile, 0..256, Isa::detect()));
        });
    }
    group.finish();
}

/// Computes the spans and walks of the bundles of every sixteenth pixel across and down, in three scenes, for short
/// rays (t0) and long rays (r0 with apex `camera`).
fn walks(c: &mut Criterion) {
    let mut group = c.benchmark_group("walk");
    group.sample_size(20);
    let classes = [
        ("t0", Order::Transmitted(0), Apex::Mirror),
        ("r0_camera", Order::Reflected(0), Apex::Camera),
    ];
    for bench_scene in
        [indoor(SIZE, FILM_PX).unwrap(), outdoor(SIZE, FILM_PX).unwrap(), stress(FILM_PX)]
    {
        for (class, order, apex) in classes {
            let scene = scene(&bench_scene, apex);
            let probe = BundleProbe::new(&scene, Some(order), 16).unwrap();
            let mut hits = vec![0.0; probe.len()];
            group.throughput(Throughput::Elements(probe.len() as u64));
            for (name, isa) in isas() {
                let id = format!("{}/{class}/{name}", bench_scene.name);
                group.bench_function(id, |b| {
                    b.iter(|| probe.intersect(isa, black_box(&mut hits)));
                });
            }
        }
    }
    group.finish();
}

/// Computes sixteen samples of sixteen pixels, on the film and the lens.
fn samplers(c: &mut Criterion) {
    let seeds: [PixelSeed; 16] = std::array::from_fn(|l| PixelSeed::new(1, l as u32, 3));
    let mut group = c.benchmark_group("sampler");
    group.throughput(Throughput::Elements(BLOCK as u64));
    for (kind, sampling) in [("sobol", Sampling::Sobol), ("independent", Sampling::Independent)] {
        for (name, isa) in isas() {
            group.bench_function(format!("{kind}/{name}"), |b| {
                b.iter(|| sample_patch(sampling, black_box(&seeds), 512, isa));
            });
        }
    }
    group.finish();
}

/// Decodes the files of a photograph of 1024 x 768 px to a sheet, and builds a grid from a sheet.
fn scenes(c: &mut Criterion) {
    let bench_scene = pair(SIZE, FILM_PX).unwrap();
    let photograph = &procedural::listing(2, 2020)[1];
    let files = procedural::encode(photograph, SIZE[0], SIZE[1]).unwrap();
    let named = |bytes| NamedBytes { path: photograph.color_path(), bytes };
    let files = PhotographFiles {
        color: named(files.color),
        depth: named(files.depth),
        mask: Some(named(files.mask)),
    };
    let mut group = c.benchmark_group("scene");
    group.sample_size(20);
    for (name, fill) in [("far", Fill::Far), ("smooth", Fill::Smooth)] {
        let mut back = bench_scene.line.back.photograph().unwrap().clone();
        back.fill = fill;
        group.bench_function(BenchmarkId::new("decode", name), |b| {
            b.iter(|| decode_photograph(black_box(&back), &files).unwrap());
        });
    }
    let Decoded::Sheet(sheet) = &bench_scene.photographs.back.surface else {
        panic!("the built-in pair are photographs");
    };
    group.bench_function("grid", |b| {
        b.iter_batched(
            || sheet.inverse_depths_per_m().collect(),
            |w| Grid::new(sheet.width, sheet.height, w),
            criterion::BatchSize::LargeInput,
        );
    });
    group.finish();
}

/// Encodes the images of a tuple of 256 x 256 px.
fn tuples(c: &mut Criterion) {
    let bench_scene = pair(SIZE, FILM_PX).unwrap();
    let mut line = bench_scene.line.clone();
    line.film.spp = 16;
    let stop = AtomicBool::new(false);
    let work = Work { threads: 1, isa: Isa::detect(), stop: &stop, on_samples: &|_| {} };
    let rendering = render(&bench_scene, &line, Sampling::Sobol, &work).unwrap();
    let tuple: Tuple = rendering.unwrap().tuple;
    let encoder = SrgbEncoder::new();
    let mut group = c.benchmark_group("tuple");
    group.sample_size(20);
    group.bench_function("exr", |b| {
        b.iter(|| encode_tuple_exr(black_box(&tuple)).unwrap());
    });
    group.bench_function("pngs", |b| {
        b.iter(|| {
            tuple
                .layers
                .0
                .each_ref()
                .map(|pixels| encode_png(&encoder, pixels, tuple.width, tuple.height).unwrap())
        });
    });
    group.finish();
}

criterion_group!(benches, tiles, walks, samplers, scenes, tuples);
criterion_main!(benches);
