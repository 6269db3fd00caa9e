//! `separate IMAGES... --out DIR`: removes reflections from photographs.

use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::{Network, is_run, use_threads};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::watchdog;
use crate::outputs::Outputs;
use clap::Args as ClapArgs;
use compose::{picture_stem, read_photo};
use image::RgbImage;
use plan::FeatureSource;
use render::atomic_file;
use render::file_tree::{FileId, Visits, file_tree};
use render::formats::Photo;
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{self, Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;
use train::{LEAST_PX, WorkSize};

/// Default size at which networks work, px: that of their training examples, and little memory.
const WORK_PX: u32 = 768;
/// Default side of tiles at the full size, px.
const TILE_PX: u32 = 768;

#[derive(Debug, ClapArgs)]
pub(super) struct SeparateArgs {
    /// JPEG or PNG pictures, or folders of them, with their sub-folders
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Folder to write NAME.transmission.png, NAME.glass_reflection.png and, with a BT-net, NAME.clean_reflection.png to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Networks: folder of a run, a training, a stage (for their best checkpoint or, without validation, their newest) or a
    /// checkpoint [default: the weights that ship with the program, trained on procedural photographs: on 21 further real pairs,
    /// scored once by others and not in this repository, they gain +0.65 dB, and -0.02 after each picture's own factor (a rule of
    /// two numbers: +1.03, +0.40), and clean pictures blurred by 2 px lose half of their light]
    #[arg(long, value_name = "RUN|FOLDER")]
    network: Option<PathBuf>,
    /// File of VGG-19 weights, required by networks that were trained with such a file; must be the same file
    #[arg(long, value_name = "FILE")]
    features: Option<String>,
    /// Longest side of the picture for the networks, px; a larger picture keeps its size and detail, and gets the enlarged
    /// change. 0 for the full size
    #[arg(long, value_name = "PX", default_value_t = WORK_PX, value_parser = clap::value_parser!(u32).range(0..=65536))]
    work_px: u32,
    /// Side of the overlapping tiles of a larger picture for the networks, px. Smaller tiles need less memory; the least
    /// side is 320 px, or 512 px for a U-Net
    #[arg(long, value_name = "PX", default_value_t = TILE_PX, value_parser = clap::value_parser!(u32).range(1..=16384))]
    tile_px: u32,
}

/// Endings of the file names of T*, R~* and R*.
const ENDINGS: [&str; 3] = ["transmission", "glass_reflection", "clean_reflection"];

pub(super) fn run(args: &SeparateArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    use_threads(global);
    let network = open(args, output)?;
    network.check_tile_px(Some(args.tile_px))?;
    let layers = if network.separator.has_backtrack() { 3 } else { 2 };
    let given = pictures(args, output)?;
    let targets = targets(&given, &ENDINGS[..layers])?;
    let outputs = Outputs {
        command: "separate",
        folder: &args.out,
        files: targets.iter().flatten().cloned().collect(),
        inputs: given.iter().map(|picture| picture.path.clone()).collect(),
    };
    outputs.check()?;
    let work = WorkSize {
        longest_px: Some(args.work_px).filter(|px| *px > 0),
        tile_px: Some(args.tile_px),
    };
    watchdog::end_promptly();
    let signals = Signals::catch();
    let progress = Progress::new(global, "pictures", given.len() as u64);
    let clock = Instant::now();
    let (mut images, mut failed) = (Vec::new(), Vec::new());
    let mut stopped = false;
    for (Given { path, .. }, targets) in given.iter().zip(&targets) {
        if signals.stop().load(Ordering::Relaxed) {
            stopped = true;
            break;
        }
        match readable(path) {
            Ok(photo) => {
                let targets: Vec<PathBuf> =
                    targets.iter().map(|name| args.out.join(name)).collect();
                if !global.dry_run {
                    // The first readable picture creates the folder, so that a call without any leaves none.
                    if images.is_empty() {
                        outputs.claim()?;
                    }
                    separate(&network, &photo, work, &targets)?;
                }
                let mut names = targets.iter().map(|path| path.to_string_lossy().into_owned());
                images.push(Done {
                    image: path.to_string_lossy(),
                    width: photo.picture.width,
                    height: photo.picture.height,
                    transmission: names.next(),
                    glass_reflection: names.next(),
                    clean_reflection: names.next(),
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
        given: given.len(),
        out: args.out.display(),
        by: match args.network {
            Some(_) => network.row_name(None),
            None => "the shipped weights".to_owned(),
        },
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
    width: usize,
    height: usize,
    transmission: Option<String>,
    glass_reflection: Option<String>,
    /// `None` without BT-net.
    clean_reflection: Option<String>,
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

/// A picture on the command line or in a folder there.
struct Given {
    path: PathBuf,
    /// Its path below that folder, or its name, whose ending the names of results replace.
    name: PathBuf,
}

/// Lists the pictures on the command line and in its folders, without those of `--out`.
fn pictures(args: &SeparateArgs, output: &Output) -> Result<Vec<Given>, Failure> {
    let out = FileId::of(&args.out).ok();
    let mut given = Vec::new();
    for typed in &args.images {
        if !typed.is_dir() {
            let name = typed.file_name().map_or_else(PathBuf::new, PathBuf::from);
            given.push(Given { path: typed.clone(), name });
            continue;
        }
        let is_out = |id: FileId| Some(&id) == out.as_ref();
        let enters = |below: &str| !FileId::of(&typed.join(below)).is_ok_and(is_out);
        let tree = file_tree(typed, Visits::Once, &enters)
            .map_err(|e| failure!(Exit::InvalidInput, "{e}; check the path"))?;
        for note in tree.notes() {
            output.note(&note);
        }
        let of_folder: Vec<Given> = tree
            .files
            .iter()
            .filter(|name| picture_stem(name).is_some())
            .map(|name| Given { path: typed.join(name), name: PathBuf::from(name) })
            .collect();
        if of_folder.is_empty() {
            return Err(failure!(
                Exit::InvalidInput,
                "{} holds no picture (.jpg, .jpeg, .jfif, .png)",
                typed.display()
            ));
        }
        given.extend(of_folder);
    }
    Ok(given)
}

/// Opens the networks. Refuses the form of the first version, with a run before the pictures.
fn open(args: &SeparateArgs, output: &Output) -> Result<Network, Failure> {
    if let Some(run) = args.images.iter().find(|path| is_run(path)) {
        let run = run.display();
        return Err(failure!(
            Exit::Usage,
            "{run} is a run, not a picture; to use its networks, give --network {run} (--network RUN)"
        ));
    }
    match &args.network {
        Some(network) => Network::open(network, args.features.as_deref(), output),
        None => Network::shipped(output),
    }
}

/// Returns the names of the files to write for each picture. Fails if two of them are equal.
fn targets(given: &[Given], endings: &[&str]) -> Result<Vec<Vec<PathBuf>>, Failure> {
    let mut by_target: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut targets = Vec::new();
    for Given { path: image, name } in given {
        let Some(stem) = name.file_stem() else {
            return Err(failure!(Exit::Usage, "{} is not an image file", image.display()));
        };
        let name = |ending: &&str| {
            let mut file = stem.to_owned();
            file.push(format!(".{ending}.png"));
            name.with_file_name(file)
        };
        let of_image: Vec<PathBuf> = endings.iter().map(name).collect();
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

/// Reads a photograph; fails if it is transparent, or too small for the networks.
fn readable(path: &Path) -> Result<Photo, String> {
    let photo = read_photo(path).map_err(|e| e.to_string())?;
    let (width, height) = (photo.picture.width, photo.picture.height);
    if width.min(height) < LEAST_PX {
        return Err(format!(
            "{} has {width} x {height} px, but networks need at least {LEAST_PX} px on each side",
            path.display()
        ));
    }
    Ok(photo)
}

fn separate(
    network: &Network,
    photo: &Photo,
    work: WorkSize,
    targets: &[PathBuf],
) -> Result<(), Failure> {
    let failed = |e: anyhow::Error| Failure::new(Exit::Failed, e);
    let (width, height) = (photo.picture.width as u32, photo.picture.height as u32);
    let picture = RgbImage::from_raw(width, height, photo.picture.rgb.clone());
    let picture = picture.expect("the reader returns all pixels");
    let made = network.separator.separate(&picture, work)?;
    let transmission = photo.png_of_changed(made.transmission.as_raw());
    let others = [Some(made.glass_reflection), made.clean_reflection];
    let others = others.iter().flatten().map(|picture| photo.png_of_other(picture.as_raw()));
    for (png, target) in std::iter::once(transmission).chain(others).zip(targets) {
        let png = png.map_err(|e| failed(e.into()))?;
        if let Some(folder) = target.parent() {
            atomic_file::create_dir(folder)?;
        }
        watchdog::undisturbed(|| atomic_file::write(target, &png))?;
    }
    Ok(())
}
