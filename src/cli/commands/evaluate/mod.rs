//! `evaluate RUN|DIR`: scores networks, outputs of other programs and simple rules.

mod baselines;
mod methods;
mod place;

use crate::cli::args::{Global, SplitName};
use crate::cli::commands::train::PixelName;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::use_threads;
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::outputs::Outputs;
use crate::text::many;
use baselines::{parse_factor, parse_veil, rules};
use clap::{Args as ClapArgs, ValueEnum};
use compose::{Factor, LeftOut, Method, Protocol, Setting, VeilRule};
use methods::{Methods, NamedNetwork};
use place::{Pictures, Place};
use serde::Serialize;
use serde_json::json;
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};
use train::{Conditions, EVALUATION_SCHEMA, Evaluation, ScoredNetwork, Tiled, first_names, shrunk};

pub(super) use place::evaluation_folder;

#[derive(Debug, ClapArgs)]
pub(super) struct EvaluateArgs {
    /// Folder of a run, or of pairs in blended/ and transmission_layer/, or in the folders of SIR2 or CEILNet
    #[arg(value_name = "RUN|DIR", required_unless_present = "index")]
    place: Option<PathBuf>,
    /// Score the pairs of this index: columns id, group, kind, blended, transmission, aligned; only rows with kind
    /// "real" and aligned "yes". Paths start from its folder, or from DIR
    #[arg(long, value_name = "FILE.csv")]
    index: Option<PathBuf>,
    /// Network to score: folder of a checkpoint, or of a stage, training or run (for the best checkpoint or, without
    /// validation, the newest of each training), after an optional row name; repeatable. Seeds of one training, or of one
    /// name, get a row of means [default: all trainings of the run]
    #[arg(long = "checkpoint", value_name = "[NAME=]FOLDER")]
    checkpoints: Vec<PathBuf>,
    /// Outputs of any program to score, in a row NAME: DIR/STEM.png for the blended picture STEM.jpg or scene STEM;
    /// repeatable
    #[arg(long, value_name = "NAME=DIR")]
    outputs: Vec<PathBuf>,
    /// Scenes of a run to score
    #[arg(long, value_enum, default_value = "test")]
    split: SplitName,
    /// Files of a run's tuples to score
    #[arg(long, value_enum, default_value = "png")]
    pixels: PixelName,
    /// Scores in the table; the files contain the scores of both protocols
    #[arg(long, value_enum, default_value = "paper")]
    protocol: ProtocolName,
    /// Scale pictures and truths down to this longest side first, with Lanczos' filter as in Pillow; never up
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(16..=65535))]
    longest: Option<u32>,
    /// Fit the baselines, a factor and a veil rule, to pairs of this folder or to this run's train scenes [default: the
    /// run's own]
    #[arg(long, alias = "fit-gain", value_name = "RUN|DIR")]
    fit_to: Option<PathBuf>,
    /// Factor of linear light for a row of the table, in place of the fitted one
    #[arg(long, value_name = "G", value_parser = parse_factor)]
    factor: Option<Factor>,
    /// Veil rule g (I - k b) for a row of the table, in place of the fitted one
    #[arg(long, value_name = "G,K", value_parser = parse_veil)]
    veil: Option<VeilRule>,
    /// Folder for evaluation.md, .csv, .png (some pictures) and .json [default: RUN/train/evaluation; for pairs: none]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Score only the first N pairs or scenes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    limit: Option<u32>,
    /// File of VGG-19 weights, required by networks that were trained with such a file; must be the same file
    #[arg(long, value_name = "FILE")]
    features: Option<String>,
    /// Give larger pictures to networks in overlapping tiles of this side, px, to save memory; each is normalised alone
    /// [default: whole pictures]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=16384))]
    tile_px: Option<u32>,
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
            pixels: PixelName::Png,
            place: Some(run.to_owned()),
            index: None,
            checkpoints: Vec::new(),
            outputs: Vec::new(),
            split: SplitName::Test,
            protocol: ProtocolName::Paper,
            longest: None,
            fit_to: None,
            factor: None,
            veil: None,
            out: None,
            limit: None,
            features: None,
            tile_px: None,
            store: None,
        }
    }

    /// True if the scenes of a run are scored.
    fn is_of_run(&self) -> bool {
        self.index.is_none() && Place::of_args(self).is_some_and(|place| place.is_run)
    }

    /// Returns the files in `--out`, if it is given.
    fn out_files(&self) -> Option<Outputs<'_>> {
        let folder = self.out.as_deref()?;
        let files = Evaluation::FILES.map(PathBuf::from).into();
        Some(Outputs { command: "evaluate", folder, files, inputs: Vec::new() })
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
    pictures: Pictures,
    methods: Methods,
    threads: usize,
}

impl<'a> Task<'a> {
    fn new(args: &'a EvaluateArgs, global: &Global, output: &Output) -> Result<Self, Failure> {
        let threads = use_threads(global);
        let pictures = place::pictures(args, output)?;
        let methods = Methods::open(args, pictures.subject(), output)?;
        if let Some(run) = &args.place {
            let paths: Vec<&Path> =
                methods.networks.iter().map(|named| named.network.path.as_path()).collect();
            pictures.check_trainings(run, &paths)?;
        }
        if let Some(outputs) = args.out_files() {
            outputs.check()?;
        }
        Ok(Self { args, pictures, methods, threads })
    }

    fn planned(&self) -> Planned<'_> {
        Planned {
            place: place::name(self.args),
            dry_run: true,
            images: self.pictures.subject().count(),
            methods: std::iter::once("input").chain(self.methods.names()).collect(),
            out: place::out(self.args).map(|out| out.to_string_lossy().into_owned()),
        }
    }

    /// Scores the pictures and writes the scores.
    fn score(&self, global: &Global, output: &Output) -> Result<(Evaluation, Exit), Failure> {
        let args = self.args;
        let Methods { networks, outputs } = &self.methods;
        let subject = self.pictures.subject();
        let signals = Signals::catch();
        let of_networks = networks.iter().find_map(|named| named.network.state.baselines.as_ref());
        let (rules, of_fit) = rules(args, of_networks, output, &signals)?;
        self.methods.check_names(&rules)?;
        let tile_px = args.tile_px;
        let separators = networks.iter().map(|named| &named.network.separator);
        let tiled: Vec<Tiled> = separators.map(|separator| Tiled { separator, tile_px }).collect();
        let makers = tiled.iter().map(|tiled| tiled as &dyn Method);
        let makers = makers.chain(outputs.iter().map(|(_, outputs)| outputs as &dyn Method));
        let names = self.methods.names().map(str::to_owned);
        let methods: Vec<(String, &dyn Method)> = names.zip(makers).collect();
        let setting =
            Setting { subject, longest_px: args.longest, rules: &rules, methods: &methods };
        let progress = Progress::new(global, "pictures", subject.count() as u64);
        let on_picture = || progress.add(1, false);
        let scored = compose::run(&setting, &shrunk, &on_picture, signals.stop());
        progress.finish();
        let mut scored = scored?;
        if scored.stopped {
            let (done, all) = (scored.done, subject.count());
            return Err(failure!(
                signals.exit(),
                "stopped after {done} of {all} pictures: nothing was written"
            ));
        }
        let missing = std::mem::take(&mut scored.left_out);
        let incomplete: Vec<LeftOut> = of_fit.into_iter().chain(missing).collect();
        let damaged = incomplete.iter().filter(|left_out| left_out.is_damaged);
        let damaged: BTreeSet<&str> = damaged.map(|left_out| left_out.image.as_str()).collect();
        if !damaged.is_empty() {
            return Err(of_damaged(&damaged, args, &incomplete));
        }
        warn(&incomplete, output);
        let exit = if incomplete.is_empty() { Exit::Done } else { Exit::Incomplete };
        let left_out: Vec<LeftOut> =
            self.pictures.left_out.iter().cloned().chain(incomplete).collect();
        if scored.rows.is_empty() {
            return Err(nothing(args, &left_out));
        }
        let network = |NamedNetwork { row, network, .. }: &NamedNetwork| {
            ScoredNetwork::new(row.clone(), network.path.clone(), &network.state)
        };
        let conditions = Conditions {
            place: place::name(args),
            split: args.is_of_run().then(|| args.split.name()),
            longest_px: args.longest,
            tile_px,
            networks: networks.iter().map(network).collect(),
            outputs: outputs.iter().map(|(outputs, _)| outputs.clone()).collect(),
            seeds: self.methods.seeds(),
            protocol: args.protocol.into(),
            baselines: rules,
        };
        let mut evaluation = Evaluation::new(conditions, scored, left_out);
        self.write(&mut evaluation)?;
        evaluation.threads = Some(self.threads);
        Ok((evaluation, exit))
    }

    fn write(&self, evaluation: &mut Evaluation) -> Result<(), Failure> {
        if let Some(outputs) = self.args.out_files() {
            outputs.claim()?;
        }
        if let Some(folder) = place::out(self.args) {
            let _lock = match &self.args.out {
                None => Some(Evaluation::claim(&folder)?),
                Some(_) => None,
            };
            evaluation.write(&folder).map_err(|e| Failure::new(Exit::Failed, e))?;
        }
        Ok(())
    }
}

#[derive(Serialize)]
struct Planned<'a> {
    #[serde(rename = "where")]
    place: String,
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
    for LeftOut { image, reason, .. } in incomplete.iter().take(WARNINGS) {
        output.warning(&format!("{image} is left out: {reason}"));
    }
    if let Some(more @ 1..) = incomplete.len().checked_sub(WARNINGS) {
        output.warning(&format!("{more} more pictures are left out"));
    }
}

/// Returns the error of tuples that are not those of their records.
fn of_damaged(damaged: &BTreeSet<&str>, args: &EvaluateArgs, left_out: &[LeftOut]) -> Failure {
    let place = place::name(args);
    let scenes: Vec<&str> = damaged.iter().copied().collect();
    let mut failure = failure!(
        Exit::Disagrees,
        "{} of {place} damaged: {}; `glasshouse retry {place} SCENE --anew`, then `glasshouse work {place}` make them again",
        many(scenes.len() as u64, "tuple"),
        first_names(&scenes)
    );
    failure.details.insert("left_out".to_owned(), json!(left_out));
    failure
}

fn nothing(args: &EvaluateArgs, left_out: &[LeftOut]) -> Failure {
    let place = place::name(args);
    let to_do = if args.is_of_run() {
        format!("run `glasshouse work {place}` and check `glasshouse status {place}`")
    } else {
        "see the messages about its pairs above".to_owned()
    };
    let mut failure = failure!(Exit::InvalidInput, "{place} has nothing to score: {to_do}");
    failure.details.insert("left_out".to_owned(), json!(left_out));
    failure
}
