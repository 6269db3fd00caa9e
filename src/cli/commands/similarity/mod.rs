//! `similarity DIR`: compares renderings and image-space mixtures with a camera's pictures of the same scenes.

mod answer;
mod capture;

use crate::cli::args::{Global, RootArgs, isa, parse_spp, threads};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::use_threads;
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::watchdog;
use answer::{LeftOut, Means, MethodRow, SceneRows, Similarities};
use capture::{Capture, Unusable};
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::layer::Layer;
use image::RgbImage;
use render::merge::Tuple;
use render::trace::Isa;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use train::mixture::MixtureRecipe;
use train::{Picture, SimilarityError, best_mixture, planes_of_linear, similarity};

/// Side of a tile, px; does not change the result.
const TILE_PX: u32 = 32;

#[derive(Debug, ClapArgs)]
pub(super) struct SimilarityArgs {
    /// Folder of folders, each with scene.json and captured.png (sRGB) or captured.exr (linear light)
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Samples per pixel, a power of two from 1 to 65536 [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse_spp)]
    spp: Option<u32>,
    /// Parameter sets of each mixture, of which the best counts
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    draws: u32,
    /// Seed of the parameter sets
    #[arg(long, value_name = "N", default_value_t = 2020)]
    seed: u64,
    #[command(flatten)]
    roots: RootArgs,
}

pub(super) fn run(
    args: &SimilarityArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    use_threads(global);
    let roots = Roots::parse(&args.roots.roots)?;
    let folders = folders(&args.folder)?;
    let signals = Signals::catch();
    let by = By { args, threads: threads(global), isa: isa(global)?, stop: signals.stop() };
    let progress = Progress::new(global, "scenes", folders.len() as u64);
    let clock = Instant::now();
    let (mut scenes, mut left_out) = (Vec::new(), Vec::new());
    for folder in &folders {
        let read = Capture::read(folder, args.spp, &roots);
        let scene = read.and_then(|capture| {
            let rows = if global.dry_run { Vec::new() } else { by.rows(&capture)? };
            Ok(SceneRows::new(&capture, rows))
        });
        match scene {
            Ok(scene) => scenes.push(scene),
            Err(Unusable::Stopped) => {
                return Err(failure!(signals.exit(), "stopped by a signal; nothing was written"));
            }
            Err(Unusable::Scene(reason)) => {
                let scene = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
                progress.suspend(|| output.warning(&format!("{reason}; continuing without it")));
                left_out.push(LeftOut { scene, reason });
            }
        }
        progress.add(1, false);
    }
    progress.finish();
    if scenes.is_empty() {
        let reasons = left_out.first().map(|first| format!(" ({})", first.reason));
        return Err(failure!(
            Exit::InvalidInput,
            "{} has no scene with a camera's picture{}: put scene.json and captured.png or captured.exr into one folder per scene",
            args.folder.display(),
            reasons.unwrap_or_default()
        ));
    }
    let exit = if left_out.is_empty() { Exit::Done } else { Exit::Incomplete };
    let answer = Similarities {
        dir: args.folder.to_string_lossy(),
        dry_run: global.dry_run,
        draws: args.draws,
        seed: args.seed,
        rows: Means::of(&scenes),
        scenes,
        left_out,
        wall_s: clock.elapsed().as_secs_f64(),
    };
    output.show("glasshouse.similarity/1", &answer);
    Ok(exit)
}

/// Lists the folders in `parent` in the order of their names, without hidden ones.
fn folders(parent: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable = |e: std::io::Error| {
        failure!(Exit::InvalidInput, "cannot read {}: {e}; check the path", parent.display())
    };
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(parent).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let is_hidden = entry.file_name().as_encoded_bytes().starts_with(b".");
        if !is_hidden && entry.path().is_dir() {
            folders.push(entry.path());
        }
    }
    folders.sort();
    Ok(folders)
}

/// What renders and mixes a scene.
struct By<'a> {
    args: &'a SimilarityArgs,
    threads: usize,
    isa: Isa,
    stop: &'a AtomicBool,
}

impl By<'_> {
    /// Renders a scene and scores its input, its transmission alone, and the best mixtures of its transmission (the front)
    /// and clean reflection (the back).
    fn rows(&self, capture: &Capture) -> Result<Vec<MethodRow>, Unusable> {
        let mut loaded = capture.load()?;
        loaded.threads = self.threads;
        let tuple = loaded.tuple(TILE_PX, self.isa, self.stop, &|| {}).ok_or(Unusable::Stopped)?;
        let tuple = tuple.map_err(|e| capture.unusable(&e))?;
        // Mixing cannot be interrupted, and nothing is written.
        watchdog::end_promptly();
        let mut rows = Vec::new();
        for (method, layer) in [("ours", Layer::Input), ("transmission alone", Layer::Transmission)]
        {
            let found = similarity(&coded(&tuple, layer), &capture.captured);
            rows.push(MethodRow::new(method, Some(found.map_err(|e| capture.unusable(&e))?), 0));
        }
        let of = |layer| Picture {
            rows: tuple.height as usize,
            columns: tuple.width as usize,
            planes: planes_of_linear(&tuple.layers[layer]),
        };
        let sides = [of(Layer::Transmission), of(Layer::CleanReflection)];
        for (method, recipe) in
            [("CEILNet", MixtureRecipe::Ceilnet), ("Zhang et al.", MixtureRecipe::Zhang)]
        {
            let SimilarityArgs { draws, seed, .. } = *self.args;
            let found = best_mixture(recipe, sides.each_ref(), &capture.captured, draws, seed);
            let found = found.map_err(|e: SimilarityError| capture.unusable(&e))?;
            rows.push(MethodRow::new(method, found.best, found.rejected));
        }
        Ok(rows)
    }
}

/// Codes a layer as in its PNG.
fn coded(tuple: &Tuple, layer: Layer) -> RgbImage {
    let encoder = SrgbEncoder::new();
    let codes = tuple.layers[layer].iter().flat_map(|pixel| pixel.map(|v| encoder.encode(v)));
    let image = RgbImage::from_raw(tuple.width, tuple.height, codes.collect());
    image.expect("a layer has all pixels")
}
