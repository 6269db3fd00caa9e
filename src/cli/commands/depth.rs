//! `depth FOLDER`: estimates the depth of a folder's pictures.

use crate::cli::args::{Global, VerifyArgs};
use crate::cli::exit_code::{Exit, Failure, exit_codes, failure};
use crate::cli::network::use_threads;
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::watchdog;
use crate::estimate::{DepthRequest, EstimateWork, Estimated, PHOTOGRAPH_LIST, estimate};
use crate::made::Remade;
use crate::outputs::check_place;
use clap::{Args as ClapArgs, ValueEnum};
use depth::{DepthNet, Model, Weights};
use plan::{FolderOptions, FolderPictures, LocalFiles, Place, folder_pictures};
use render::file_tree::FileId;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Debug, ClapArgs)]
pub(super) struct DepthArgs {
    /// Folder of JPEGs, PNGs and EXRs, in any sub-folders
    folder: PathBuf,
    /// Weights of Depth Anything V2: a .safetensors or .pth file
    #[arg(long, value_name = "FILE")]
    weights: PathBuf,
    /// Folder of the depth maps: a new one, or one of the same weights, which resumes
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Size of the network [default: that of the weights]
    #[arg(long, value_enum)]
    model: Option<ModelName>,
    /// Largest depth of metric weights, m: 20 for those of rooms, 80 for those of streets. Without it, the weights are relative
    #[arg(long, value_name = "MAX_M", value_parser = positive)]
    metric: Option<f64>,
    /// Mean depth that the list assumes for relative depth, m [default: 4 indoors, 12 outdoor]
    #[arg(long, value_name = "M", value_parser = positive)]
    mean_m: Option<f64>,
    /// Place of all pictures [default: told by folders named indoors or outdoor]
    #[arg(long, value_enum)]
    place: Option<PlaceName>,
    /// Field of view of the longer side, degrees [default: from EXIF, or 65]
    #[arg(long, value_name = "DEG", value_parser = view)]
    field_of_view: Option<f64>,
    #[command(flatten)]
    verify: VerifyArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ModelName {
    /// ViT-S, 25 million numbers.
    Vits,
    /// ViT-B, 97 million.
    Vitb,
    /// ViT-L, 335 million.
    Vitl,
}

impl From<ModelName> for Model {
    fn from(name: ModelName) -> Self {
        match name {
            ModelName::Vits => Self::Vits,
            ModelName::Vitb => Self::Vitb,
            ModelName::Vitl => Self::Vitl,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PlaceName {
    /// Rooms.
    Indoors,
    /// The open.
    Outdoor,
}

fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    if (0.01..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err("it must be 0.01 to 1e6 m".to_owned())
    }
}

fn view(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    if (1.0..=170.0).contains(&value) { Ok(value) } else { Err("it must be 1 to 170".to_owned()) }
}

exit_codes! {
    crate::estimate::EstimateError {
        (Made) => its_own,
        Foreign => Disagrees,
        Write | Read | Remove | Link => Failed,
    }
}

const SCHEMA: &str = "glasshouse.depth/1";

pub(super) fn run(args: &DepthArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    use_threads(global);
    let invalid = |e: &dyn fmt::Display| failure!(Exit::InvalidInput, "{e}");
    let (weights, model) =
        Weights::read(&args.weights, args.model.map(Model::from)).map_err(|e| invalid(&e))?;
    let found = pictures(args)?;
    for note in found.notes() {
        output.note(&note);
    }
    check_place(&args.out)?;
    let request = DepthRequest::new(&weights.blake3, model, args.metric);
    if global.dry_run {
        let estimated = Estimated { pictures: found.pictures.len() as u64, ..Estimated::default() };
        output.show(SCHEMA, &Answer::new(args, &request, estimated, None));
        return Ok(Exit::Done);
    }
    let net = DepthNet::new(&weights, &model.config(), args.metric)
        .map_err(|e| failure!(Exit::Failed, "{e}"))?;
    watchdog::end_promptly();
    let signals = Signals::catch();
    let all = found.pictures.len() as u64;
    let progress = Progress::new(global, "pictures", all);
    let clock = Instant::now();
    let work = EstimateWork {
        net: &net,
        request: &request,
        mean_m: args.mean_m,
        verify: args.verify.verify,
        stop: signals.stop(),
        on_picture: &|resumed| progress.add(1, resumed),
    };
    let ended = estimate(&args.folder, &found, &args.out, &work);
    progress.finish();
    let estimated = ended?;
    if estimated.stopped {
        let done = estimated.pictures + estimated.pictures_resumed;
        return Err(failure!(
            signals.exit(),
            "stopped after {done} of {all} pictures: run the same command to resume"
        ));
    }
    let exit = match (estimated.failed.is_empty(), estimated.pictures + estimated.pictures_resumed)
    {
        (true, _) => Exit::Done,
        (false, 0) => Exit::InvalidInput,
        (false, _) => Exit::Incomplete,
    };
    output
        .show(SCHEMA, &Answer::new(args, &request, estimated, Some(clock.elapsed().as_secs_f64())));
    Ok(exit)
}

/// Lists the pictures of the folder, without those that an earlier call linked into a folder of depth maps below it.
fn pictures(args: &DepthArgs) -> Result<FolderPictures, Failure> {
    let options = FolderOptions {
        place: args.place.map(|place| match place {
            PlaceName::Indoors => Place::Indoors,
            PlaceName::Outdoor => Place::Outdoor,
        }),
        field_of_view_deg: args.field_of_view,
        without: FileId::of(&args.out).ok(),
        ..FolderOptions::default()
    };
    folder_pictures(&args.folder, &options, &LocalFiles)
        .map_err(|e| failure!(Exit::InvalidInput, "{e}; check the path"))
}

#[derive(Serialize)]
struct Answer<'a> {
    #[serde(serialize_with = "render::path_text::one")]
    folder: &'a Path,
    #[serde(serialize_with = "render::path_text::one")]
    out: &'a Path,
    dry_run: bool,
    model: &'a str,
    metric_m: Option<f64>,
    weights_blake3: &'a str,
    pictures: u64,
    pictures_resumed: u64,
    #[serde(skip_serializing_if = "Remade::is_none")]
    remade: Remade,
    failed: Vec<Failed>,
    /// Duration, s; `None` in a dry run.
    #[serde(skip_serializing_if = "Option::is_none")]
    wall_s: Option<f64>,
}

#[derive(Serialize)]
struct Failed {
    picture: String,
    reason: String,
}

impl<'a> Answer<'a> {
    fn new(
        args: &'a DepthArgs,
        request: &'a DepthRequest,
        estimated: Estimated,
        wall_s: Option<f64>,
    ) -> Self {
        let failed = estimated.failed.into_iter();
        Self {
            folder: &args.folder,
            out: &args.out,
            dry_run: wall_s.is_none(),
            model: &request.model,
            metric_m: request.metric_m,
            weights_blake3: &request.weights_blake3,
            pictures: estimated.pictures,
            pictures_resumed: estimated.pictures_resumed,
            remade: estimated.remade,
            failed: failed.map(|(picture, reason)| Failed { picture, reason }).collect(),
            wall_s,
        }
    }
}

impl fmt::Display for Answer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (out, pictures) = (self.out.display(), self.pictures);
        let Some(wall_s) = self.wall_s else {
            return write!(f, "would estimate the depth of {pictures} pictures into {out}");
        };
        write!(f, "estimated the depth of {pictures} pictures into {out} in {wall_s:.1} s")?;
        if self.pictures_resumed > 0 {
            write!(f, "; {} were there already", self.pictures_resumed)?;
        }
        if !self.remade.is_none() {
            write!(f, "; {}", self.remade)?;
        }
        for Failed { picture, reason } in &self.failed {
            write!(f, "\nno depth of {picture}: {reason}")?;
        }
        write!(
            f,
            "\n{out}/{PHOTOGRAPH_LIST} is ready for a recipe: [sources.photos] with layout = \"list\", and --root photos={out}"
        )
    }
}
