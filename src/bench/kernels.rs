//! Measures rays per second on one core, for intersection alone and for the whole tracer, and the time to build grids.

use super::clock::{cpu_s, median_and_best};
use super::error::BenchError;
use super::scenes::BenchScene;
use glasshouse_line::Apex;
use glasshouse_line::layer::Layer;
use render::scene::Decoded;
use render::trace::{
    BLOCK, BundleProbe, Grid, Isa, Order, Sampling, Scene, Tile, TileResult, WalkCount, trace_tile,
};
use serde::Serialize;
use std::hint::black_box;

/// Distance between adjacent patches with measured bundles, across and down, px.
const STEP_PX: u32 = 4;

/// Number of tiles across and down, and their side, px, for [`tracer`].
const TILES: u32 = 4;
const TILE_PX: u32 = 16;

/// Speed of a kernel with one instruction set, millions of rays per second.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct KernelTiming {
    /// `avx2` or `baseline`.
    pub isa: &'static str,
    /// Median of the passes.
    pub mrays_per_s: f64,
    pub best_mrays_per_s: f64,
}

/// Speed of the intersection alone: span and walk of one order's bundles, without camera samples and lines.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KernelRow {
    pub scene: String,
    /// `t0`, `t1`, `r0`, `r1`, or `R` (the pinhole).
    pub kernel: &'static str,
    /// Camera position of the back photograph (`mirror`, `camera`); `null` for orders of the front.
    pub apex: Option<&'static str>,
    /// Number of rays in a pass.
    pub rays: u64,
    /// Mean number of cells from the start of a ray's walk to its hit.
    pub cells_per_ray: f64,
    /// Mean number of cells of the longest ray among sixteen.
    pub rounds_per_16_rays: f64,
    pub timings: Vec<KernelTiming>,
}

/// Speed of the whole tracer on some tiles: camera samples, every followed order, radiance, sums.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TracerRow {
    pub scene: String,
    /// Camera position of the back photograph.
    pub apex: &'static str,
    /// Number of camera samples in a pass.
    pub samples: u64,
    /// Number of rays in a pass: all orders, and R unless it is in closed form.
    pub rays: u64,
    pub timings: Vec<TracerTiming>,
}

/// Speed of the whole tracer with one instruction set.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TracerTiming {
    /// `avx2` or `baseline`.
    pub isa: &'static str,
    /// Millions of camera samples per second, median of the passes.
    pub msamples_per_s: f64,
    pub best_msamples_per_s: f64,
    /// Millions of rays per second, median of the passes.
    pub mrays_per_s: f64,
}

/// Size of a grid, and the time to build the grid and its pyramid.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BuildRow {
    pub scene: String,
    /// `front` or `back`.
    pub side: &'static str,
    /// Number of vertices across.
    pub nx: usize,
    /// Number of vertices down.
    pub ny: usize,
    /// Milliseconds, median of the passes.
    pub build_ms: f64,
    pub best_build_ms: f64,
}

/// Callback for each class, with its name, rays, hits (1/m), and median Mrays/s of the first instruction set.
type OnClass<'a> = dyn FnMut(&str, &BundleProbe, &[f32], f64) -> Result<(), BenchError> + 'a;

/// Assembles the scene with this apex and 256 samples per pixel.
fn scene_at(scene: &BenchScene, apex: Apex) -> Result<Scene, BenchError> {
    let mut line = scene.line.clone();
    line.back.set_apex(apex);
    line.film.spp = BLOCK as u32;
    Ok(scene.assemble(&line, Sampling::Sobol)?.scene)
}

const APEXES: [(&str, Apex); 2] = [("mirror", Apex::Mirror), ("camera", Apex::Camera)];

/// Median and minimum CPU seconds of several passes with one instruction set.
struct Timed {
    isa: &'static str,
    median_s: f64,
    best_s: f64,
}

/// Times `passes` passes of each instruction set, interleaved, after one warm-up pass. `pass` returns its CPU seconds.
fn timed(isas: &[Isa], passes: usize, mut pass: impl FnMut(Isa) -> f64) -> Vec<Timed> {
    let mut seconds = vec![Vec::with_capacity(passes); isas.len()];
    for round in 0..=passes {
        for (isa, seconds) in isas.iter().zip(&mut seconds) {
            let taken = pass(*isa).max(1e-9);
            if round > 0 {
                seconds.push(taken);
            }
        }
    }
    let timed = |(isa, seconds): (&Isa, Vec<f64>)| {
        let (median_s, best_s) = median_and_best(&seconds);
        Timed { isa: isa.name(), median_s, best_s }
    };
    isas.iter().zip(seconds).map(timed).collect()
}

/// Times the span and the walk of a scene's kernels: t0 and t1 of the front; r0, r1 (both apexes) and R (`camera`) of
/// the back.
pub fn kernels(
    scene: &BenchScene,
    isas: &[Isa],
    passes: usize,
    on_class: &mut OnClass,
) -> Result<Vec<KernelRow>, BenchError> {
    let mut rows = Vec::new();
    for (apex_name, apex) in APEXES {
        let assembled = scene_at(scene, apex)?;
        for (kernel, order) in [
            ("t0", Some(Order::Transmitted(0))),
            ("t1", Some(Order::Transmitted(1))),
            ("r0", Some(Order::Reflected(0))),
            ("r1", Some(Order::Reflected(1))),
            ("R", None),
        ] {
            let is_front = matches!(order, Some(Order::Transmitted(_)));
            if is_front && apex != Apex::Mirror {
                continue;
            }
            let Some(probe) = BundleProbe::new(&assembled, order, STEP_PX) else {
                continue;
            };
            let mut hits = vec![0f32; probe.len()];
            let timed = timed(isas, passes, |isa| {
                let taken = cpu_s(|| probe.intersect(isa, &mut hits)).1;
                black_box(&mut hits);
                taken
            });
            let mrays = probe.len() as f64 * 1e-6;
            let timings = timed.iter().map(|Timed { isa, median_s, best_s }| KernelTiming {
                isa,
                mrays_per_s: mrays / median_s,
                best_mrays_per_s: mrays / best_s,
            });
            let timings: Vec<KernelTiming> = timings.collect();
            let WalkCount { rays, cells, groups, rounds } = probe.count(&hits);
            let apex = (!is_front).then_some(apex_name);
            let class = apex.map_or_else(
                || format!("{}.{kernel}", scene.name),
                |apex| format!("{}.{kernel}.{apex}", scene.name),
            );
            on_class(&class, &probe, &hits, timings[0].mrays_per_s)?;
            rows.push(KernelRow {
                scene: scene.name.clone(),
                kernel,
                apex,
                rays,
                cells_per_ray: cells as f64 / rays as f64,
                rounds_per_16_rays: rounds as f64 / groups as f64,
                timings,
            });
        }
    }
    Ok(rows)
}

/// Times the whole tracer with both apexes and 256 samples per pixel, on sixteen tiles of 16 x 16 px or a small film.
pub fn tracer(
    scene: &BenchScene,
    isas: &[Isa],
    passes: usize,
) -> Result<Vec<TracerRow>, BenchError> {
    let mut rows = Vec::new();
    for (apex_name, apex) in APEXES {
        let assembled = scene_at(scene, apex)?;
        let tiles = tiles(assembled.film.width, assembled.film.height);
        let samples: u64 =
            tiles.iter().map(|tile| u64::from(tile.width * tile.height) * BLOCK as u64).sum();
        let mut rays = 0;
        let timed = timed(isas, passes, |isa| {
            let trace = |tile: &Tile| trace_tile(&assembled, *tile, 0..BLOCK as u32, isa);
            let (results, taken) = cpu_s(|| tiles.iter().map(trace).collect::<Vec<_>>());
            // I counts the paths of every order, R those of the pinhole; in closed form, R has no samples.
            let of = |result: &TileResult| {
                let has_rays = result.samples[Layer::CleanReflection] > 0;
                let clean = result.paths[Layer::CleanReflection] * u64::from(has_rays);
                result.paths[Layer::Input] + clean
            };
            rays = results.iter().map(of).sum();
            taken
        });
        let timings = timed.iter().map(|Timed { isa, median_s, best_s }| TracerTiming {
            isa,
            msamples_per_s: samples as f64 * 1e-6 / median_s,
            best_msamples_per_s: samples as f64 * 1e-6 / best_s,
            mrays_per_s: rays as f64 * 1e-6 / median_s,
        });
        let timings = timings.collect();
        rows.push(TracerRow { scene: scene.name.clone(), apex: apex_name, samples, rays, timings });
    }
    Ok(rows)
}

/// Returns tiles in the centres of equal parts of the film, or one tile if the film is narrower or lower than 64 px.
fn tiles(width: u32, height: u32) -> Vec<Tile> {
    if width < TILES * TILE_PX || height < TILES * TILE_PX {
        return vec![Tile { x: 0, y: 0, width, height }];
    }
    let at = |k: u32, n: u32| (2 * k + 1) * n / (2 * TILES) - TILE_PX / 2;
    (0..TILES * TILES)
        .map(|k| Tile {
            x: at(k % TILES, width),
            y: at(k / TILES, height),
            width: TILE_PX,
            height: TILE_PX,
        })
        .collect()
}

/// Times [`Grid::new`] on a scene's photographs; a mesh has no grid.
pub fn grid_builds(scene: &BenchScene, passes: usize) -> Vec<BuildRow> {
    let sides = [("front", &scene.photographs.front), ("back", &scene.photographs.back)];
    let sheets = sides.into_iter().filter_map(|(side, decoded)| match &decoded.surface {
        Decoded::Sheet(sheet) => Some((side, sheet)),
        Decoded::Mesh(_) => None,
    });
    let rows = sheets.map(|(side, sheet)| {
        let timed = timed(&[Isa::Baseline], passes, |_| {
            let w = sheet.inverse_depths_per_m().collect();
            let (grid, taken) = cpu_s(|| black_box(Grid::new(sheet.width, sheet.height, w)));
            drop(grid);
            taken
        });
        BuildRow {
            scene: scene.name.clone(),
            side,
            nx: sheet.width,
            ny: sheet.height,
            build_ms: timed[0].median_s * 1e3,
            best_build_ms: timed[0].best_s * 1e3,
        }
    });
    rows.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_do_not_overlap_and_lie_on_the_film() {
        for (width, height) in [(256, 256), (64, 64), (1000, 70), (40, 24)] {
            let tiles = tiles(width, height);
            let mut covered = vec![false; (width * height) as usize];
            for tile in &tiles {
                for y in tile.y..tile.y + tile.height {
                    for x in tile.x..tile.x + tile.width {
                        assert!(x < width && y < height);
                        let covered = &mut covered[(y * width + x) as usize];
                        assert!(!std::mem::replace(covered, true));
                    }
                }
            }
        }
        assert_eq!(tiles(40, 24).len(), 1);
        assert_eq!(tiles(256, 256).len(), 16);
    }
}
