//! `sample DIR --count N`: makes procedural photographs.

use crate::cli::args::{Global, threads, typed};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::outputs::Outputs;
use clap::{Args as ClapArgs, ValueEnum};
use plan::{DepthRanges, Place};
use procedural::{PlacesPhotograph, SampleError, SamplePhotograph};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use render::atomic_file;
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

#[derive(Debug, ClapArgs)]
pub(super) struct SampleArgs {
    /// Folder to write to
    dir: PathBuf,
    /// Number of photographs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    count: u32,
    /// Seed of the photographs
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Width, px [default: 1024; 256 for places]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    width: Option<u32>,
    /// Height, px [default: 768; 256 for places]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    height: Option<u32>,
    /// Give surfaces the texture of stone, bark, cloth or gravel: sharper pictures, nearer to photographs
    #[arg(long)]
    textured: bool,
    /// Layout of the folder
    #[arg(long, value_enum, default_value = "diode")]
    layout: SampleLayout,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SampleLayout {
    /// DIODE: PNG, depth in metres, mask.
    Diode,
    /// PLACES365: JPEG by category, relative inverse depth in a second folder.
    Places,
}

struct Photographs {
    size: [u32; 2],
    /// Paths of the colour images, relative to the folder.
    color: Vec<PathBuf>,
    /// Description of the other images.
    with: &'static str,
    /// Named roots for a recipe that reads the photographs.
    roots: BTreeMap<&'static str, PathBuf>,
    /// Example of such a recipe, with its other roots.
    recipe: &'static str,
}

pub(super) fn run(args: &SampleArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (count, seed, dir) = (args.count as usize, args.seed, args.dir.as_path());
    let size = |width, height| [args.width.unwrap_or(width), args.height.unwrap_or(height)];
    let made = match args.layout {
        SampleLayout::Diode => {
            let mut photographs = procedural::listing(count, seed);
            for photograph in &mut photographs {
                photograph.is_textured = args.textured;
            }
            let [width, height] = size(1024, 768);
            let files: Vec<_> = photographs.iter().flat_map(SamplePhotograph::paths).collect();
            claim(dir, files.clone(), global)?;
            make(&photographs, global, |p| procedural::write(dir, p, width, height))?;
            settle(dir, files, global)?;
            Photographs {
                size: [width, height],
                color: photographs.iter().map(SamplePhotograph::color_path).collect(),
                with: "depth and mask",
                roots: [("diode", dir.to_owned())].into(),
                recipe: "my.toml",
            }
        }
        SampleLayout::Places => {
            let table = DepthRanges::shipped();
            let [indoors, outdoors] =
                [Place::Indoors, Place::Outdoor].map(|p| table.categories_of(p));
            let mut photographs = procedural::places_listing(count, seed, &indoors, &outdoors);
            for made in &mut photographs {
                made.photograph.is_textured = args.textured;
            }
            let [width, height] = size(256, 256);
            let files: Vec<_> = photographs.iter().flat_map(PlacesPhotograph::paths).collect();
            claim(dir, files.clone(), global)?;
            make(&photographs, global, |p| procedural::write_places(dir, p, width, height))?;
            settle(dir, files, global)?;
            let below = Path::new(procedural::PLACES_COLOR);
            Photographs {
                size: [width, height],
                color: photographs.iter().map(|p| below.join(p.color_path())).collect(),
                with: "relative inverse depth",
                roots: [
                    ("places", dir.join(procedural::PLACES_COLOR)),
                    ("places-depth", dir.join(procedural::PLACES_DEPTH)),
                ]
                .into(),
                recipe: "manifests/paper.toml --root diode=DIODE",
            }
        }
    };
    let Photographs { size: [width, height], color, with, roots, recipe } = made;
    let lossy = |path: &PathBuf| path.to_string_lossy().into_owned();
    let sample = Sample {
        dir: dir.to_string_lossy(),
        layout: typed(&args.layout),
        count,
        seed,
        dry_run: global.dry_run,
        width,
        height,
        color: color.iter().map(lossy).collect(),
        roots: roots.iter().map(|(name, folder)| (*name, lossy(folder))).collect(),
        with,
        recipe,
    };
    output.show("glasshouse.sample/1", &sample);
    Ok(Exit::Done)
}

/// Makes the names of the written files durable.
fn settle(dir: &Path, files: Vec<PathBuf>, global: &Global) -> Result<(), Failure> {
    if global.dry_run {
        return Ok(());
    }
    Ok(atomic_file::sync_names(files.into_iter().map(|file| dir.join(file)))?)
}

/// Records the files as this command's own; in a dry run, only checks them.
fn claim(folder: &Path, files: Vec<PathBuf>, global: &Global) -> Result<(), Failure> {
    let outputs = Outputs { command: "sample", folder, files, inputs: Vec::new() };
    if global.dry_run { outputs.check() } else { outputs.claim() }.map_err(Failure::from)
}

/// Makes all photographs with `write`; in a dry run, does nothing.
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

#[derive(Serialize)]
struct Sample<'a> {
    dir: Cow<'a, str>,
    layout: String,
    count: usize,
    seed: u64,
    dry_run: bool,
    width: u32,
    height: u32,
    color: Vec<String>,
    roots: BTreeMap<&'static str, String>,
    #[serde(skip)]
    with: &'static str,
    #[serde(skip)]
    recipe: &'static str,
}

impl fmt::Display for Sample<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dir, count, width, height, roots, with, recipe, .. } = self;
        let verb = if self.dry_run { "would make" } else { "made" };
        write!(
            f,
            "{verb} {count} photographs of {width} x {height} px with {with} in {dir}\n\
             to plan a run with them: glasshouse plan {recipe}"
        )?;
        roots.iter().try_for_each(|(name, folder)| write!(f, " --root {name}={folder}"))
    }
}
