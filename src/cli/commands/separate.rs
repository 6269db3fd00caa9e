//! `separate CHECKPOINT IMAGES... --out DIR`: removes reflections from photographs.

use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::{Network, NetworkArgs, use_threads};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::outputs::Outputs;
use clap::Args as ClapArgs;
use compose::read_picture;
use image::{ImageFormat, RgbImage};
use plan::FeatureSource;
use render::atomic_file;
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::io::Cursor;
use std::path::{self, Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;
use train::LEAST_PX;

#[derive(Debug, ClapArgs)]
pub(super) struct SeparateArgs {
    /// Folder of a checkpoint, or of a stage or run (for its best checkpoint or, without validation, its newest)
    checkpoint: PathBuf,
    /// JPEG or PNG pictures
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Folder to write NAME.transmission.png and NAME.glass_reflection.png to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    network: NetworkArgs,
}

/// Endings of the file names of T* and R~*.
const ENDINGS: [&str; 2] = ["transmission", "glass_reflection"];

pub(super) fn run(args: &SeparateArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let targets = targets(&args.images)?;
    let outputs = Outputs {
        command: "separate",
        folder: &args.out,
        files: targets.iter().flatten().cloned().collect(),
        inputs: args.images.clone(),
    };
    outputs.check()?;
    use_threads(global);
    let network = Network::open(&args.checkpoint, args.network.features.as_deref(), output)?;
    if !global.dry_run {
        outputs.claim()?;
    }
    let signals = Signals::catch();
    let progress = Progress::new(global, "pictures", args.images.len() as u64);
    let clock = Instant::now();
    let (mut images, mut failed) = (Vec::new(), Vec::new());
    let mut stopped = false;
    for (path, targets) in args.images.iter().zip(&targets) {
        if signals.stop().load(Ordering::Relaxed) {
            stopped = true;
            break;
        }
        match readable(path) {
            Ok(picture) => {
                let targets = targets.each_ref().map(|name| args.out.join(name));
                if !global.dry_run {
                    separate(&network, &picture, args.network.tile_px, &targets)?;
                }
                let [transmission, glass_reflection] =
                    targets.map(|path| path.to_string_lossy().into_owned());
                images.push(Done {
                    image: path.to_string_lossy(),
                    width: picture.width(),
                    height: picture.height(),
                    transmission,
                    glass_reflection,
                });
            }
            Err(reason) => {
                progress.suspend(|| output.warning(&format!("{reason}; continuing without it")));
                failed.push(Failed { image: path.to_string_lossy(), reason });
            }
        }
        progress.add(1, false);
    }
    progress.finish();
    let exit = match (stopped, failed.is_empty()) {
        (true, _) => signals.exit(),
        (false, true) => Exit::Done,
        (false, false) if images.is_empty() => Exit::InvalidInput,
        (false, false) => Exit::Incomplete,
    };
    let separated = Separated {
        checkpoint: network.path.to_string_lossy(),
        step: network.state.step,
        features: network.state.settings.features,
        dry_run: global.dry_run,
        images,
        failed,
        wall_s: clock.elapsed().as_secs_f64(),
        given: args.images.len(),
        out: args.out.display(),
        by: network.row_name(None),
    };
    output.show("glasshouse.separate/1", &separated);
    Ok(exit)
}

#[derive(Serialize)]
struct Separated<'a> {
    checkpoint: Cow<'a, str>,
    step: u64,
    features: FeatureSource,
    dry_run: bool,
    images: Vec<Done<'a>>,
    failed: Vec<Failed<'a>>,
    wall_s: f64,
    /// Number of pictures on the command line.
    #[serde(skip)]
    given: usize,
    #[serde(skip)]
    out: path::Display<'a>,
    #[serde(skip)]
    by: String,
}

#[derive(Serialize)]
struct Done<'a> {
    image: Cow<'a, str>,
    width: u32,
    height: u32,
    transmission: String,
    glass_reflection: String,
}

#[derive(Serialize)]
struct Failed<'a> {
    image: Cow<'a, str>,
    reason: String,
}

impl fmt::Display for Separated<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verb = if self.dry_run { "would separate" } else { "separated" };
        let (done, given, out, by) = (self.images.len(), self.given, &self.out, &self.by);
        write!(f, "{verb} {done} of {given} pictures into {out} with {by}")
    }
}

/// Returns the names of the files to write for each image. Fails if two of them are equal.
fn targets(images: &[PathBuf]) -> Result<Vec<[PathBuf; 2]>, Failure> {
    let mut by_target: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut targets = Vec::new();
    for image in images {
        let Some(stem) = image.file_stem() else {
            return Err(failure!(Exit::Usage, "{} is not an image file", image.display()));
        };
        let of_image = ENDINGS.map(|ending| {
            let mut name = stem.to_owned();
            name.push(format!(".{ending}.png"));
            PathBuf::from(name)
        });
        for target in &of_image {
            if let Some(other) = by_target.insert(target.clone(), image) {
                return Err(failure!(
                    Exit::Usage,
                    "{} and {} would both become {}; separate them into different folders",
                    other.display(),
                    image.display(),
                    target.display()
                ));
            }
        }
        targets.push(of_image);
    }
    Ok(targets)
}

/// Reads a picture; fails if it is too small for the networks.
fn readable(path: &Path) -> Result<RgbImage, String> {
    let picture = read_picture(path).map_err(|e| e.to_string())?;
    let (width, height) = picture.dimensions();
    if (width.min(height) as usize) < LEAST_PX {
        return Err(format!(
            "{} has {width} x {height} px, but networks need at least {LEAST_PX} px on each side",
            path.display()
        ));
    }
    Ok(picture)
}

fn separate(
    network: &Network,
    picture: &RgbImage,
    tile_px: u32,
    targets: &[PathBuf; 2],
) -> Result<(), Failure> {
    let failed = |e: anyhow::Error| Failure::new(Exit::Failed, e);
    let made = network.separator.separate(picture, tile_px as usize);
    for (made, target) in made?.iter().zip(targets) {
        let mut png = Cursor::new(Vec::new());
        made.write_to(&mut png, ImageFormat::Png).map_err(|e| failed(e.into()))?;
        atomic_file::write(target, png.get_ref())?;
    }
    Ok(())
}
