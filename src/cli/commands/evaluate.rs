//! `evaluate RUN|DIR`: scores networks and unchanged pictures.

use crate::cli::args::{Global, SplitName};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::{Network, NetworkArgs, TILE_PX, use_threads};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::target;
use crate::outputs::Outputs;
use crate::run::keys;
use clap::{Args as ClapArgs, ValueEnum};
use compose::{Gain, LeftOut, Method, Pair, Protocol, Subject, find_pairs, fit_gain};
use plan::{PixelSource, Stage};
use render::line::Roots;
use serde::Serialize;
use serde_json::json;
use std::borrow::Cow;
use std::ffi::OsStr;
use std::fmt;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use train::{EVALUATION_SCHEMA, Evaluation, ScoredNetwork, Tiled, TupleSource};
use train::{shrunk, stage_folder, steps};

#[derive(Debug, ClapArgs)]
pub(super) struct EvaluateArgs {
    /// Folder of a run, or of pairs in blended/ and transmission_layer/, or in the folders of SIR2 or CEILNet
    #[arg(value_name = "RUN|DIR")]
    place: PathBuf,
    /// Network to score: folder of a checkpoint, or of a stage or run (for its best checkpoint or, without validation, its newest), after an optional
    /// row name [default: stage and step]; repeatable [default: the SP-net of the run]
    #[arg(long = "checkpoint", value_name = "[NAME=]FOLDER")]
    checkpoints: Vec<PathBuf>,
    /// Scenes of a run to score
    #[arg(long, value_enum, default_value = "test")]
    split: SplitName,
    /// Scores in the table; the files contain the scores of both protocols
    #[arg(long, value_enum, default_value = "both")]
    protocol: ProtocolName,
    /// Folder for evaluation.md, .csv, .png (some pictures) and .json [default: RUN/train/evaluation; for pairs: none]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Fit the input's gain to pairs of this folder, or to this run's train scenes [default: the run's; for pairs: no gain]
    #[arg(long, value_name = "RUN|DIR")]
    fit_gain: Option<PathBuf>,
    /// Score only the first N pairs or scenes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    limit: Option<u32>,
    #[command(flatten)]
    network: NetworkArgs,
    /// Store of the run's tuples, if they are not in its folder
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE")]
    store: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ProtocolName {
    /// Kim et al.: PSNR over all channels, SSIM of the grey pictures.
    Paper,
    /// ERRNet and its successors: means over the channels.
    Errnet,
    /// Both protocols, side by side.
    Both,
}

impl From<ProtocolName> for Protocol {
    fn from(name: ProtocolName) -> Self {
        match name {
            ProtocolName::Paper => Self::Paper,
            ProtocolName::Errnet => Self::Errnet,
            ProtocolName::Both => Self::Both,
        }
    }
}

impl EvaluateArgs {
    /// Returns the arguments that score the SP-net of a run on its test scenes.
    pub(super) fn of_run(run: &Path) -> Self {
        Self {
            place: run.to_owned(),
            checkpoints: Vec::new(),
            split: SplitName::Test,
            protocol: ProtocolName::Both,
            out: None,
            fit_gain: None,
            limit: None,
            network: NetworkArgs { features: None, tile_px: TILE_PX },
            store: None,
        }
    }
}

/// Largest number of printed warnings; the evaluation lists all pictures that are left out.
const WARNINGS: usize = 8;

pub(super) fn run(args: &EvaluateArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let task = Task::new(args, global, output)?;
    if global.dry_run {
        output.show(EVALUATION_SCHEMA, &task.planned());
        return Ok(Exit::Done);
    }
    let (evaluation, exit) = task.score(global, output)?;
    output.show(EVALUATION_SCHEMA, &evaluation);
    Ok(exit)
}

/// Scores the SP-net of a run on its test scenes.
pub(super) fn evaluate_run(
    run: &Path,
    global: &Global,
    output: &Output,
) -> Result<(Evaluation, Exit), Failure> {
    Task::new(&EvaluateArgs::of_run(run), global, output)?.score(global, output)
}

/// Checked inputs of an evaluation.
struct Task<'a> {
    args: &'a EvaluateArgs,
    place: Place<'a>,
    pictures: Pictures,
    networks: Vec<(String, Network)>,
    threads: usize,
}

impl<'a> Task<'a> {
    fn new(args: &'a EvaluateArgs, global: &Global, output: &Output) -> Result<Self, Failure> {
        let threads = use_threads(global);
        let place = Place::new(args);
        let mut pictures = place.pictures(args.split, output)?;
        if let Some(limit) = args.limit {
            pictures.keep_first(limit as usize);
        }
        if pictures.subject().count() == 0 {
            return Err(failure!(
                Exit::InvalidInput,
                "{} has no scenes of the split {:?}; give another --split",
                args.place.display(),
                args.split.name()
            ));
        }
        let networks = networks(args, place.is_run, output)?;
        if let Some(outputs) = outputs(args) {
            outputs.check()?;
        }
        Ok(Self { args, place, pictures, networks, threads })
    }

    fn planned(&self) -> Planned<'_> {
        let names = self.networks.iter().map(|(name, _)| name.as_str());
        Planned {
            place: self.args.place.to_string_lossy(),
            dry_run: true,
            images: self.pictures.subject().count(),
            methods: std::iter::once("input").chain(names).collect(),
            out: self.place.out(self.args).map(|out| out.to_string_lossy().into_owned()),
        }
    }

    /// Scores the pictures and writes the scores.
    fn score(&self, global: &Global, output: &Output) -> Result<(Evaluation, Exit), Failure> {
        let Self { args, place, networks, .. } = self;
        let subject = self.pictures.subject();
        let signals = Signals::catch();
        let (gain, of_gain) = gain(args, place, output, &signals)?;
        let tile_px = args.network.tile_px;
        let separators = networks.iter().map(|(_, network)| &network.separator);
        let tiled: Vec<Tiled> = separators.map(|separator| Tiled { separator, tile_px }).collect();
        let names = networks.iter().map(|(name, _)| name.clone());
        let methods = tiled.iter().map(|tiled| tiled as &dyn Method);
        let methods: Vec<(String, &dyn Method)> = names.zip(methods).collect();
        let progress = Progress::new(global, "pictures", subject.count() as u64);
        let on_picture = || progress.add(1, false);
        let scored =
            compose::run(subject, gain.as_ref(), &methods, &shrunk, &on_picture, signals.stop());
        progress.finish();
        let scored = scored?;
        if scored.stopped {
            let (done, all) = (scored.done, subject.count());
            return Err(failure!(
                signals.exit(),
                "stopped after {done} of {all} pictures: nothing was written"
            ));
        }
        let incomplete: Vec<LeftOut> = of_gain.into_iter().chain(scored.left_out).collect();
        warn(&incomplete, output);
        let exit = if incomplete.is_empty() { Exit::Done } else { Exit::Incomplete };
        let left_out: Vec<LeftOut> =
            self.pictures.left_out.iter().cloned().chain(incomplete).collect();
        let name = args.place.display().to_string();
        if scored.rows.is_empty() {
            return Err(nothing(&name, place.is_run, &left_out));
        }
        let protocol = args.protocol.into();
        let mut evaluation = Evaluation::new(name, &scored.methods, scored.rows, protocol);
        evaluation.split = place.is_run.then(|| args.split.name());
        evaluation.tile_px = tile_px;
        evaluation.gain = gain;
        evaluation.left_out = left_out;
        let network = |(name, network): &(String, Network)| {
            ScoredNetwork::new(name.clone(), network.path.clone(), &network.state)
        };
        evaluation.networks = networks.iter().map(network).collect();
        if let Some(outputs) = outputs(args) {
            outputs.claim()?;
        }
        if let Some(folder) = place.out(args) {
            let _lock = match &args.out {
                None => Some(Evaluation::claim(&folder)?),
                Some(_) => None,
            };
            evaluation.write(&folder, &scored.kept).map_err(|e| Failure::new(Exit::Failed, e))?;
        }
        evaluation.threads = Some(self.threads);
        Ok((evaluation, exit))
    }
}

struct Place<'a> {
    folder: &'a Path,
    store: Option<&'a str>,
    is_run: bool,
}

struct Pictures {
    of: Source,
    /// Files and folders that belong to no pair.
    left_out: Vec<LeftOut>,
}

enum Source {
    Run(TupleSource),
    Pairs(Vec<Pair>),
}

impl Pictures {
    fn subject(&self) -> &dyn Subject {
        match &self.of {
            Source::Run(source) => source,
            Source::Pairs(pairs) => pairs,
        }
    }

    fn keep_first(&mut self, count: usize) {
        match &mut self.of {
            Source::Run(source) => source.lines.truncate(count),
            Source::Pairs(pairs) => pairs.truncate(count),
        }
    }
}

impl<'a> Place<'a> {
    fn new(args: &'a EvaluateArgs) -> Self {
        let (folder, store) = (args.place.as_path(), args.store.as_deref());
        Self {
            folder,
            store,
            // The spec and manifest of a run that exists only in the store are copied later.
            is_run: is_run(folder) || (store.is_some() && !folder.exists()),
        }
    }

    /// Returns the folder for the scores; `None` if they are only printed.
    fn out(&self, args: &EvaluateArgs) -> Option<PathBuf> {
        let own = || self.is_run.then(|| evaluation_folder(self.folder));
        args.out.clone().or_else(own)
    }

    fn pictures(&self, split: SplitName, output: &Output) -> Result<Pictures, Failure> {
        if self.is_run {
            let (run, store) = target::open(self.folder, self.store, &Roots::default())?;
            let lines = run.lines.iter().filter(|line| split.has(line.split));
            let source = TupleSource {
                files: Arc::new(store),
                lines: lines.cloned().collect(),
                pixels: PixelSource::Png,
            };
            return Ok(Pictures { of: Source::Run(source), left_out: Vec::new() });
        }
        let found = find_pairs(self.folder).map_err(|e| Failure::new(Exit::InvalidInput, e))?;
        let left_out = found.left_out.into_iter().map(|(path, reason)| {
            let path = path.strip_prefix(self.folder).unwrap_or(&path);
            let image = path.display().to_string();
            LeftOut { image, reason }
        });
        let left_out: Vec<LeftOut> = left_out.collect();
        if !left_out.is_empty() {
            output.note(&format!(
                "{} pictures belong to no pair{}",
                left_out.len(),
                if output.verbose { ":" } else { "; -v prints why" }
            ));
        }
        if output.verbose {
            for LeftOut { image, reason } in &left_out {
                output.note(&format!("{image}: {reason}"));
            }
        }
        Ok(Pictures { of: Source::Pairs(found.pairs), left_out })
    }
}

pub(super) fn evaluation_folder(run: &Path) -> PathBuf {
    run.join("train").join("evaluation")
}

fn is_run(place: &Path) -> bool {
    place.join(keys::SPEC).is_file()
}

/// Returns the files in `--out`, if it is given.
fn outputs(args: &EvaluateArgs) -> Option<Outputs<'_>> {
    let folder = args.out.as_deref()?;
    let files = Evaluation::FILES.map(PathBuf::from).into();
    Some(Outputs { command: "evaluate", folder, files, inputs: Vec::new() })
}

/// Splits `NAME=FOLDER`. The folder may have any name.
fn named(typed: &Path) -> Option<(&str, &Path)> {
    let bytes = typed.as_os_str().as_bytes();
    let (name, folder) = bytes.split_at(bytes.iter().position(|&byte| byte == b'=')?);
    Some((std::str::from_utf8(name).ok()?, Path::new(OsStr::from_bytes(&folder[1..]))))
}

/// Opens the networks to score; fails unless their row names are unique and differ from `input`.
fn networks(
    args: &EvaluateArgs,
    is_run: bool,
    output: &Output,
) -> Result<Vec<(String, Network)>, Failure> {
    let mut places: Vec<(Option<&str>, PathBuf)> = Vec::new();
    for typed in &args.checkpoints {
        // A path may contain an equals sign.
        places.push(match named(typed) {
            Some((name, path)) if !typed.exists() => (Some(name), path.to_owned()),
            _ => (None, typed.clone()),
        });
    }
    if places.is_empty() && is_run {
        let stage = stage_folder(&args.place, Stage::Separation);
        let trained = steps(&stage)
            .map_err(|e| failure!(Exit::Failed, "cannot list {}: {e}", stage.display()))?;
        if trained.is_empty() {
            output.note(&format!(
                "the run has no SP-net, so only the input is scored; `glasshouse train {} --stage separation --steps S` trains one",
                args.place.display()
            ));
        } else {
            places.push((None, args.place.clone()));
        }
    }
    let mut networks: Vec<(String, Network)> = Vec::new();
    for (name, path) in places {
        let network = Network::open(&path, args.network.features.as_deref(), output)?;
        let name = network.row_name(name);
        if name == "input" || networks.iter().any(|(other, _)| *other == name) {
            return Err(failure!(
                Exit::Usage,
                "two rows would be called {name:?}; name them with --checkpoint NAME={}",
                path.display()
            ));
        }
        networks.push((name, network));
    }
    Ok(networks)
}

/// Fits the gain to the pictures of `--fit-gain`, or to the run's own train scenes; pairs alone have no gain.
fn gain(
    args: &EvaluateArgs,
    own: &Place,
    output: &Output,
    signals: &Signals,
) -> Result<(Option<Gain>, Vec<LeftOut>), Failure> {
    let place = match &args.fit_gain {
        None if !own.is_run => return Ok((None, Vec::new())),
        Some(folder) if *folder != args.place => {
            Place { folder, store: None, is_run: is_run(folder) }
        }
        Some(_) | None => Place { ..*own },
    };
    let name = place.folder.display().to_string();
    let pictures = place.pictures(SplitName::Train, output)?;
    let (gain, left_out) = fit_gain(pictures.subject(), name.clone(), signals.stop())?;
    if gain.is_none() {
        let reason = format!("no gain can be fitted to {name}: it has no readable pictures");
        if args.fit_gain.is_some() {
            return Err(failure!(
                Exit::InvalidInput,
                "{reason}; `glasshouse work RUN` makes tuples"
            ));
        }
        output.note(&format!("{reason}, so the gain's row is left out"));
    }
    Ok((gain, left_out))
}

#[derive(Serialize)]
struct Planned<'a> {
    #[serde(rename = "where")]
    place: Cow<'a, str>,
    dry_run: bool,
    images: usize,
    methods: Vec<&'a str>,
    out: Option<String>,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (images, methods) = (self.images, self.methods.join(", "));
        write!(f, "would score {images} pictures by {methods}")
    }
}

fn warn(incomplete: &[LeftOut], output: &Output) {
    for LeftOut { image, reason } in incomplete.iter().take(WARNINGS) {
        output.warning(&format!("{image} is left out: {reason}"));
    }
    if let Some(more @ 1..) = incomplete.len().checked_sub(WARNINGS) {
        output.warning(&format!("{more} more pictures are left out"));
    }
}

fn nothing(place: &str, is_run: bool, left_out: &[LeftOut]) -> Failure {
    let to_do = if is_run {
        format!("run `glasshouse work {place}` and check `glasshouse status {place}`")
    } else {
        "see the messages about its pairs above".to_owned()
    };
    let mut failure = failure!(Exit::InvalidInput, "{place} has nothing to score: {to_do}");
    failure.details.insert("left_out".to_owned(), json!(left_out));
    failure
}
