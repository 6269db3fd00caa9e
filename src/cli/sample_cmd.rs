//! `sample DIR --count N`

use super::args::{Global, SampleArgs, SampleLayout};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::work_cmd::threads;
use plan::{DepthRanges, Place};
use procedural::{SampleError, SamplePhotograph};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What the command line asks for, by layout.
struct Plan {
    size: [u32; 2],
    /// Of the colour images, relative to the folder.
    color: Vec<PathBuf>,
    /// What else each photograph has.
    with: &'static str,
    /// Named roots of a recipe that uses them.
    roots: Vec<(&'static str, PathBuf)>,
    /// Such a recipe, and its other roots.
    recipe: &'static str,
}

pub(super) fn run(args: &SampleArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (count, seed, dir) = (args.count as usize, args.seed, args.dir.as_path());
    let size = |width, height| [args.width.unwrap_or(width), args.height.unwrap_or(height)];
    let plan = match args.layout {
        SampleLayout::Diode => {
            let photographs = procedural::listing(count, seed);
            let [width, height] = size(1024, 768);
            make(&photographs, global, |p| {
                procedural::write(dir, p, width, height)
            })?;
            Plan {
                size: [width, height],
                color: photographs
                    .iter()
                    .map(SamplePhotograph::color_path)
                    .collect(),
                with: "depth and mask",
                roots: vec![("diode", dir.to_owned())],
                recipe: "my.toml",
            }
        }
        SampleLayout::Places => {
            let table = DepthRanges::shipped();
            let [indoors, outdoors] =
                [Place::Indoors, Place::Outdoor].map(|p| table.categories_of(p));
            let photographs = procedural::places_listing(count, seed, &indoors, &outdoors);
            let [width, height] = size(256, 256);
            make(&photographs, global, |p| {
                procedural::write_places(dir, p, width, height)
            })?;
            let below = Path::new(procedural::PLACES_COLOR);
            Plan {
                size: [width, height],
                color: photographs
                    .iter()
                    .map(|p| below.join(p.color_path()))
                    .collect(),
                with: "relative inverse depth",
                roots: vec![
                    ("places", dir.join(procedural::PLACES_COLOR)),
                    ("places-depth", dir.join(procedural::PLACES_DEPTH)),
                ],
                recipe: "manifests/paper.toml --root diode=DIODE",
            }
        }
    };
    let [width, height] = plan.size;
    let mut command = format!("glasshouse plan {}", plan.recipe);
    for (name, folder) in &plan.roots {
        let _ = write!(command, " --root {name}={}", folder.display());
    }
    let roots: serde_json::Map<_, _> = plan
        .roots
        .into_iter()
        .map(|(name, folder)| (name.to_owned(), json!(folder)))
        .collect();
    let verb = if global.dry_run { "would make" } else { "made" };
    output.result(
        "glasshouse.sample/1",
        json!({
            "dir": dir, "layout": args.layout.name(), "count": count, "seed": seed, "dry_run": global.dry_run,
            "width": width, "height": height, "color": plan.color, "roots": roots,
        }),
        &format!(
            "{verb} {count} photographs of {width} x {height} px with {} in {}\nplan with them: {command}",
            plan.with,
            dir.display()
        ),
    );
    Ok(Exit::Done)
}

/// Makes all `photographs` with `write`, unless this is only thought through.
fn make<P: Sync>(
    photographs: &[P],
    global: &Global,
    write: impl Fn(&P) -> Result<(), SampleError> + Sync,
) -> Result<(), Failure> {
    if global.dry_run {
        return Ok(());
    }
    let progress = Progress::new(global, "photographs", photographs.len() as u64);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads(global))
        .build()
        .map_err(|e| Failure::new(Exit::Failed, e))?;
    let written = pool.install(|| {
        photographs.par_iter().try_for_each(|photograph| {
            let result = write(photograph);
            progress.add(1, false);
            result
        })
    });
    progress.finish();
    written.map_err(|e| Failure::new(Exit::Failed, e))
}
