//! `separate CHECKPOINT IMAGES... --out DIR`

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::network::{Network, Which};
use super::output::Output;
use super::progress::Progress;
use super::signals::Signals;
use super::train_args::{SeparateArgs, use_threads};
use anyhow::anyhow;
use compose::read_picture;
use image::{ImageFormat, RgbImage};
use render::atomic_file;
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;
use train::LEAST_PX;

const SCHEMA: &str = "glasshouse.separate/1";

/// Endings of what is written: T* and R~*.
const ENDINGS: [&str; 2] = ["transmission", "glass_reflection"];

pub(super) fn run(args: &SeparateArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let targets = targets(&args.images, &args.out)?;
    use_threads(global);
    let network = Network::open(
        &args.checkpoint,
        Which::Best,
        args.network.features.as_deref(),
        output,
    )?;
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
                let [transmission, glass_reflection] =
                    targets.each_ref().map(|path| path.display().to_string());
                images.push(json!({
                    "image": path.display().to_string(), "width": picture.width(), "height": picture.height(),
                    "transmission": transmission, "glass_reflection": glass_reflection,
                }));
            }
            Err(reason) => {
                progress.suspend(|| output.warning(&format!("{reason}; going on without it")));
                failed.push(json!({ "image": path.display().to_string(), "reason": reason }));
            }
        }
        progress.add(1, false);
    }
    progress.finish();
    let verb = if global.dry_run {
        "would separate"
    } else {
        "separated"
    };
    let text = format!(
        "{verb} {} of {} pictures into {} with {}",
        images.len(),
        args.images.len(),
        args.out.display(),
        network.row_name(None),
    );
    let exit = match (stopped, failed.is_empty()) {
        (true, _) => signals.exit(),
        (false, true) => Exit::Done,
        (false, false) => Exit::Incomplete,
    };
    output.result(
        SCHEMA,
        json!({
            "checkpoint": network.path.display().to_string(), "step": network.state.step,
            "features": network.state.settings.features, "dry_run": global.dry_run,
            "images": images, "failed": failed, "wall_s": clock.elapsed().as_secs_f64(),
        }),
        &text,
    );
    Ok(exit)
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
        made.write_to(&mut png, ImageFormat::Png)
            .map_err(|e| failed(e.into()))?;
        atomic_file::write(target, png.get_ref())?;
    }
    Ok(())
}
