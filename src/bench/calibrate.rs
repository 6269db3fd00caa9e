//! Estimates the duration of a run on this machine: reads, decodes and partly traces some of its scenes.
//!
//! Traced pixels get all samples of a shard, so that the fixed cost of a pixel counts as in the run. The estimate is
//! for one core; cores that share arithmetic units are slower when all are busy.

use super::clock::cpu_s;
use glasshouse_line::SceneLine;
use plan::Calibration;
use render::scene::{LoadError, SceneFiles, load};
use render::shard::samples_per_range;
use render::trace::{CELL_PX, Isa, Tile, trace_tile};

const SCENES: usize = 3;
/// Maximum number of scenes to try if some cannot be loaded.
const MOST_TRIED: usize = 8;
/// CPU time after which a scene's next piece is not traced, s.
const TRACING_S: f64 = 0.2;
/// Width of a traced piece, px. A piece is as high as a cell.
const PIECE_PX: u32 = 32;

/// Calibrates with scenes spread over `lines`; `read` reads their files. Returns `None` if no scene can be loaded.
pub fn calibrate(
    lines: &[SceneLine],
    read: &dyn Fn(&SceneLine) -> Result<SceneFiles, LoadError>,
    isa: Isa,
) -> Option<Calibration> {
    let mut scenes = Vec::new();
    let (mut sample_s, mut load_s) = (0.0, 0.0);
    for line in spread(lines) {
        let (loaded, taken) = cpu_s(|| load(line, &read(line).ok()?).ok());
        let Some(loaded) = loaded else {
            continue;
        };
        load_s += taken;
        let (mut seconds, mut pixels) = (0.0, 0u64);
        // In adaptive scenes, every cell is traced until it stops.
        let samples = match line.film.target_error {
            None => samples_per_range(line.film.spp),
            Some(_) => line.film.spp,
        };
        for tile in pieces(line) {
            let (traced, taken) = cpu_s(|| trace_tile(&loaded.scene, tile, 0..samples, isa));
            seconds += taken;
            pixels += traced.pixels.len() as u64;
            if seconds > TRACING_S {
                break;
            }
        }
        sample_s += seconds / (pixels as f64 * f64::from(samples));
        scenes.push(line.id.clone());
        if scenes.len() == SCENES {
            break;
        }
    }
    let count = scenes.len();
    (count > 0).then(|| Calibration {
        scenes,
        seconds_per_sample: sample_s / count as f64,
        seconds_per_load: load_s / count as f64,
    })
}

/// Returns scenes spread over the manifest: first at 1/6, 3/6 and 5/6, then at the start, between these, at the end.
fn spread(lines: &[SceneLine]) -> impl Iterator<Item = &SceneLine> {
    let mut at: Vec<usize> = [1, 3, 5, 0, 2, 4, 6, 7]
        .iter()
        .take(MOST_TRIED)
        .map(|k| (k * lines.len() / 6).min(lines.len().saturating_sub(1)))
        .collect();
    let mut seen = std::collections::BTreeSet::new();
    at.retain(|&index| index < lines.len() && seen.insert(index));
    at.into_iter().map(|index| &lines[index])
}

/// Returns the pieces of the film in an order that covers all regions early.
fn pieces(line: &SceneLine) -> Vec<Tile> {
    let film = &line.film;
    let columns = film.width.div_ceil(PIECE_PX);
    let count = u64::from(columns) * u64::from(film.height.div_ceil(CELL_PX));
    // A stride near the golden section of the count, and coprime to the count, visits each piece once.
    let mut stride = ((count as f64 * 0.618) as u64).max(1);
    while gcd(stride, count) != 1 {
        stride += 1;
    }
    let piece = |k: u64| {
        let index = (k * stride % count) as u32;
        let (x, y) = (index % columns * PIECE_PX, index / columns * CELL_PX);
        Tile { x, y, width: PIECE_PX.min(film.width - x), height: CELL_PX.min(film.height - y) }
    };
    (0..count).map(piece).collect()
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::super::scenes::{pair, photograph};
    use super::*;
    use glasshouse_line::ids::SceneId;
    use procedural::listing;
    use render::scene::SideFiles;

    fn line(width: u32, height: u32) -> SceneLine {
        let mut line = pair([16, 12], 16).unwrap().line;
        (line.film.width, line.film.height) = (width, height);
        line
    }

    #[test]
    fn pieces_cover_the_film_once() {
        let mut line = line(1, 1);
        for (width, height) in [(1, 1), (32, 8), (33, 9), (40, 24), (256, 256), (100, 7)] {
            (line.film.width, line.film.height) = (width, height);
            let mut covered = vec![0; (width * height) as usize];
            for tile in pieces(&line) {
                for y in tile.y..tile.y + tile.height {
                    for x in tile.x..tile.x + tile.width {
                        covered[(y * width + x) as usize] += 1;
                    }
                }
            }
            assert!(covered.iter().all(|&n| n == 1), "{width}x{height}");
        }
    }

    #[test]
    fn unreadable_scenes_are_skipped() {
        let nowhere = || LoadError::Read {
            path: "nowhere".into(),
            source: std::io::Error::other("on purpose"),
        };
        let photographs = listing(2, 1).into_iter();
        let photographs: Vec<_> = photographs.map(|p| photograph(&p, [16, 12]).unwrap()).collect();
        let read = |line: &SceneLine| {
            // The scene in the middle is missing.
            if line.seed == 6 {
                return Err(nowhere());
            }
            let side = |k: usize| SideFiles::Photograph(photographs[k].clone());
            Ok(SceneFiles::new(side(0), side(1)))
        };
        let lines: Vec<SceneLine> = (0..12u32)
            .map(|k| {
                let mut line = line(16, 16);
                line.seed = u64::from(k);
                line.id = SceneId::new(format!("s-{k}")).unwrap();
                line
            })
            .collect();
        let found = calibrate(&lines, &read, Isa::detect()).unwrap();
        let ids: Vec<&str> = found.scenes.iter().map(SceneId::as_str).collect();
        assert_eq!(ids, ["s-2", "s-10", "s-0"]);
        assert!(found.seconds_per_sample > 0.0 && found.seconds_per_load > 0.0);
        let one = calibrate(&lines[..1], &read, Isa::detect()).unwrap();
        assert_eq!(one.scenes.len(), 1);
        assert_eq!(calibrate(&lines, &|_| Err(nowhere()), Isa::detect()), None);
        assert_eq!(calibrate(&[], &read, Isa::detect()), None);
    }
}
