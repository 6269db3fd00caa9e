//! `separate CHECKPOINT IMAGES... --out DIR`

use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::network::NetworkArgs;
use crate::cli::network::{Network, Which, use_threads};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use anyhow::anyhow;
use clap::Args as ClapArgs;
use compose::read_picture;
use image::{ImageFormat, RgbImage};
use plan::FeatureSource;
use render::atomic_file;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;
use train::LEAST_PX;

#[derive(Debug, ClapArgs)]
pub(super) struct SeparateArgs {
    /// A checkpoint's folder; or a stage's or a run's, for its best checkpoint, or its newest where none was measured
    checkpoint: PathBuf,
    /// Pictures, JPEG or PNG
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Folder to write NAME.transmission.png and NAME.glass_reflection.png to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    network: NetworkArgs,
}

/// Endings of what is written: T* and R~*.
const ENDINGS: [&str; 2] = ["transmission", "glass_reflection"];

pub(super) fn run(args: &SeparateArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let targets = targets(&args.images, &args.out)?;
    use_threads(global);
    let network =
        Network::open(&args.checkpoint, Which::Best, args.network.features.as_deref(), output)?;
    if !global.dry_run {
        atomic_file::create_dir(&args.out)?;
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
                if !global.dry_run {
                    separate(&network, &picture, args.network.tile_px, targets)?;
                }
                let [transmission, glass_reflection] = targets.clone();
                images.push(Done {
                    image: path.clone(),
                    width: picture.width(),
                    height: picture.height(),
                    transmission,
                    glass_reflection,
                });
            }
            Err(reason) => {
                progress.suspend(|| output.warning(&format!("{reason}; going on without it")));
                let image = path.clone();
                failed.push(Failed { image, reason });
            }
        }
        progress.add(1, false);
    }
    progress.finish();
    let exit = match (stopped, failed.is_empty()) {
        (true, _) => signals.exit(),
        (false, true) => Exit::Done,
        (false, false) => Exit::Incomplete,
    };
    let separated = Separated {
        checkpoint: network.path.clone(),
        step: network.state.step,
        features: network.state.settings.features,
        dry_run: global.dry_run,
        images,
        failed,
        wall_s: clock.elapsed().as_secs_f64(),
        given: args.images.len(),
        out: args.out.clone(),
        by: network.row_name(None),
    };
    output.show("glasshouse.separate/1", &separated);
    Ok(exit)
}

#[derive(Serialize)]
struct Separated {
    checkpoint: PathBuf,
    step: u64,
    features: FeatureSource,
    dry_run: bool,
    images: Vec<Done>,
    failed: Vec<Failed>,
    wall_s: f64,
    /// Pictures that were to be separated.
    #[serde(skip)]
    given: usize,
    #[serde(skip)]
    out: PathBuf,
    #[serde(skip)]
    by: String,
}

#[derive(Serialize)]
struct Done {
    image: PathBuf,
    width: u32,
    height: u32,
    transmission: PathBuf,
    glass_reflection: PathBuf,
}

#[derive(Serialize)]
struct Failed {
    image: PathBuf,
    reason: String,
}

impl fmt::Display for Separated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let would = if self.dry_run { "would separate" } else { "separated" };
        let (done, given) = (self.images.len(), self.given);
        let (out, by) = (self.out.display(), &self.by);
        write!(f, "{would} {done} of {given} pictures into {out} with {by}")
    }
}

/// What is written for each image. No file may stand for two, and none for an image itself.
fn targets(images: &[PathBuf], out: &Path) -> Result<Vec<[PathBuf; 2]>, Failure> {
    let usage = |error| Err(Failure::new(Exit::Usage, error));
    let real = |path: &Path| path.canonicalize().ok();
    let given: BTreeSet<PathBuf> = images.iter().filter_map(|path| real(path)).collect();
    let mut by_target: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut targets = Vec::new();
    for image in images {
        let Some(stem) = image.file_stem() else {
            return usage(anyhow!("{} is no file of a picture", image.display()));
        };
        let of_image = ENDINGS.map(|ending| {
            let mut name = stem.to_owned();
            name.push(format!(".{ending}.png"));
            out.join(name)
        });
        for target in &of_image {
            if let Some(other) = by_target.insert(target.clone(), image) {
                return usage(anyhow!(
                    "{} and {} would both become {}; separate them into different folders",
                    other.display(),
                    image.display(),
                    target.display()
                ));
            }
            if real(target).is_some_and(|path| given.contains(&path)) {
                return usage(anyhow!(
                    "{} would be written over, and it is one of the pictures to separate; give another --out",
                    target.display()
                ));
            }
        }
        targets.push(of_image);
    }
    Ok(targets)
}

/// A picture that networks can see, or why it is none.
fn readable(path: &Path) -> Result<RgbImage, String> {
    let picture = read_picture(path).map_err(|e| e.to_string())?;
    let (width, height) = picture.dimensions();
    if (width.min(height) as usize) < LEAST_PX {
        return Err(format!(
            "{} has {width} x {height} px, and networks see nothing smaller than {LEAST_PX} px a side",
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
    for (made, target) in made.map_err(|e| failed(e.into()))?.iter().zip(targets) {
        let mut png = Cursor::new(Vec::new());
        made.write_to(&mut png, ImageFormat::Png).map_err(|e| failed(e.into()))?;
        atomic_file::write(target, png.get_ref())?;
    }
    Ok(())
}
