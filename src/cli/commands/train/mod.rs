//! `train RUN --stage STAGE --steps S`: trains BT-net, SP-net or a U-Net.

mod settings;

pub(super) use settings::{NetworkName, PixelName};

use crate::cli::args::{Global, RootArgs, bytes_of_gb};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::{checkpoint, use_threads, weights_file};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::{store_env, target};
use crate::run::{Run, keys};
use crate::store::Store;
use clap::{Args as ClapArgs, ValueEnum};
use compose::{Pair, find_pairs};
use glasshouse_line::Roots;
use plan::{SeededTraining, Stage, TrainSettings, Trainings, check_training_name};
use settings::SettingArgs;
use std::num::NonZeroU64;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use train::{self, StepLosses, TrainSummary, Training, Validated, Watcher};

/// Default number of checkpoints to keep.
const KEEP: usize = 3;
/// Default number of validation scenes.
const VALIDATE: usize = 8;
/// Default memory for cached examples, GB.
const MEMORY_GB: f64 = 2.0;

#[derive(Debug, ClapArgs)]
pub(super) struct TrainArgs {
    /// Folder of the run
    run: PathBuf,
    /// Name of the training, so that a run can have several: its checkpoints are in train/NAME, and its settings begin with
    /// those of the recipe's [[train]] of this name [default: none, in train]
    #[arg(long, value_name = "NAME", value_parser = training_name)]
    name: Option<String>,
    /// Networks to train; separation starts from the newest checkpoint of backtrack [default: separation, if the recipe
    /// has this training]
    #[arg(long, value_enum)]
    stage: Option<StageName>,
    /// Total number of steps; an earlier training with fewer steps resumes [default: those of the recipe's training]
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Begin a new training with the weights and settings of this checkpoint, stage or run
    #[arg(long, value_name = "FOLDER")]
    from: Option<PathBuf>,
    /// Folder of real pairs that choose the best checkpoint, in place of the split "validation"; scaled down to 640 px
    #[arg(long, value_name = "DIR")]
    select: Option<PathBuf>,
    /// Folder of real pairs in blended/ and transmission_layer/, or in the folders of SIR2 or CEILNet
    #[arg(long, value_name = "DIR", requires = "real_share")]
    real: Option<PathBuf>,
    /// Write a checkpoint every K steps [default: a twentieth of --steps, 10 to 1000]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..))]
    checkpoint_every: Option<u64>,
    /// Number of newest checkpoints to keep; the best is also kept
    #[arg(long, value_name = "N", default_value_t = KEEP)]
    keep: usize,
    /// Number of scenes or pairs that validate every checkpoint: the first ones of the split "validation" or of --select
    #[arg(long, value_name = "N", default_value_t = VALIDATE)]
    validate: usize,
    /// Write a grid of pictures every K steps; 0 for none [default: the value of --checkpoint-every]
    #[arg(long, value_name = "K")]
    pictures_every: Option<u64>,
    /// Memory for cached examples, GB; a data set that fits is read once
    #[arg(long, value_name = "GB", default_value_t = MEMORY_GB)]
    memory_gb: f64,
    /// Store of the run's tuples, if they are not in its folder
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE")]
    store: Option<String>,
    #[command(flatten)]
    roots: RootArgs,
    #[command(flatten)]
    settings: SettingArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum StageName {
    /// Only BT-net, R~ -> R.
    Backtrack,
    /// SP-net, I -> T and R~, with BT-net behind it.
    Separation,
}

impl From<StageName> for Stage {
    fn from(name: StageName) -> Self {
        match name {
            StageName::Backtrack => Self::Backtrack,
            StageName::Separation => Self::Separation,
        }
    }
}

pub(super) fn run(args: &TrainArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let (run, store) = target::open(&args.run, args.store.as_deref(), &roots)?;
    let recipe = train_recipe(run.root())?;
    let recipe = recipe.and_then(|trainings| trainings.find(args.name.as_deref()));
    let (stage, steps) = stage_and_steps(args, recipe.as_ref())?;
    let checkpoint_every = recipe.as_ref().and_then(|recipe| recipe.checkpoint_every);
    let from = args.from.as_deref().map(|folder| checkpoint(folder, output)).transpose()?;
    let of_from = from.as_ref().map(|from| from.state.settings.clone());
    let settings = |frozen: Option<&TrainSettings>| {
        let typed = args.settings.features.as_deref();
        if frozen.is_none() && typed == Some("random") {
            output.note(
                "the features have random weights, unlike the paper's; every checkpoint records this setting",
            );
        }
        if let (None, None, None, Some(name)) = (frozen, &recipe, &of_from, &args.name) {
            output.note(&format!(
                "the recipe has no training {name:?}: this one begins with the default settings"
            ));
        }
        let of_recipe = || recipe.as_ref().map(|recipe| recipe.settings.clone());
        let base = frozen.cloned().or_else(of_recipe).or(of_from.clone()).unwrap_or_default();
        args.settings.over(&base)
    };
    let real = args.real.as_deref();
    let select = |folder: &PathBuf| Ok::<_, Failure>((folder.clone(), real_pairs(folder, output)?));
    let training = Training {
        name: args.name.clone(),
        from,
        select: args.select.as_ref().map(select).transpose()?,
        pairs: real.map(|folder| real_pairs(folder, output)).transpose()?,
        features: match args.settings.features.as_deref() {
            None => recipe.as_ref().and_then(|recipe| recipe.features.clone()),
            typed => weights_file(typed).map(Path::to_owned),
        },
        checkpoint_every: args.checkpoint_every.or(checkpoint_every.map(NonZeroU64::get)),
        keep: args.keep,
        validate: args.validate,
        pictures_every: args.pictures_every,
        memory_bytes: bytes_of_gb(args.memory_gb),
        dry_run: global.dry_run,
        ..training_of(&run, &store, stage, steps, &settings)
    };
    let (summary, exit) = train(training, global, output)?;
    output.show("glasshouse.train/1", &summary);
    Ok(exit)
}

fn training_name(typed: &str) -> Result<String, String> {
    check_training_name(typed).map(|()| typed.to_owned())
}

/// Returns the stage and its last step: those on the command line, or else those of the recipe.
fn stage_and_steps(
    args: &TrainArgs,
    recipe: Option<&SeededTraining>,
) -> Result<(Stage, u64), Failure> {
    let missing = |what: &str| {
        failure!(
            Exit::Usage,
            "give {what}: the run's recipe has no training of this name and stage"
        )
    };
    let stage = args.stage.map(Stage::from).or(recipe.map(|_| Stage::Separation));
    let stage = stage.ok_or_else(|| missing("--stage and --steps"))?;
    let of_recipe = recipe.map(|recipe| match stage {
        Stage::Backtrack => recipe.backtrack_steps,
        Stage::Separation => recipe.separation_steps,
    });
    let steps = args.steps.or(of_recipe.filter(|steps| *steps > 0));
    Ok((stage, steps.ok_or_else(|| missing("--steps"))?))
}

/// Returns the training of a stage with the defaults of the command line.
pub(super) fn training_of<'a>(
    run: &'a Run,
    store: &Store,
    stage: Stage,
    steps: u64,
    settings: &'a dyn Fn(Option<&TrainSettings>) -> TrainSettings,
) -> Training<'a> {
    Training {
        run: run.root().to_owned(),
        name: None,
        stage,
        steps,
        scenes: &run.lines,
        tuples: Arc::new(store.clone()),
        roots: run.roots.clone(),
        inputs: Box::new(store_env::inputs()),
        pairs: None,
        from: None,
        select: None,
        settings,
        features: None,
        checkpoint_every: None,
        keep: KEEP,
        validate: VALIDATE,
        pictures_every: None,
        memory_bytes: bytes_of_gb(MEMORY_GB),
        dry_run: false,
    }
}

/// Trains a stage; shows its progress and stops on a signal.
pub(super) fn train(
    training: Training,
    global: &Global,
    output: &Output,
) -> Result<(TrainSummary, Exit), Failure> {
    use_threads(global);
    let signals = Signals::catch();
    let mut watch = Watch { global, output, progress: None, batch: 1, images: 0, busy_s: 0.0 };
    let summary = train::run(training, &mut watch, signals.stop());
    if let Some(progress) = &watch.progress {
        progress.finish();
    }
    let summary = summary?;
    let is_stopped = summary.trained.as_ref().is_some_and(|t| t.stopped);
    let exit = if is_stopped { signals.exit() } else { Exit::Done };
    Ok((summary, exit))
}

/// Reads the recipe's trainings from the run's folder, if the recipe has any.
pub(super) fn train_recipe(run: &Path) -> Result<Option<Trainings>, Failure> {
    let path = run.join(keys::TRAIN);
    let bytes = render::input_file::read_if_there(&path)
        .map_err(|e| failure!(Exit::Failed, "cannot read {}: {e}", path.display()))?;
    let Some(bytes) = bytes else { return Ok(None) };
    let recipe = serde_json::from_slice(&bytes).map_err(|e| {
        failure!(Exit::Disagrees, "{} is damaged: {e}; plan the run again", path.display())
    })?;
    Ok(Some(recipe))
}

fn real_pairs(folder: &Path, output: &Output) -> Result<Vec<Pair>, Failure> {
    let found = find_pairs(folder).map_err(|e| Failure::new(Exit::InvalidInput, e))?;
    for (path, reason) in &found.left_out {
        output.warning(&format!("{} is left out: {reason}", path.display()));
    }
    Ok(found.pairs)
}

/// Watcher that prints the progress of training.
struct Watch<'a> {
    global: &'a Global,
    output: &'a Output,
    progress: Option<Progress>,
    batch: usize,
    images: usize,
    busy_s: f64,
}

impl Watch<'_> {
    fn suspend(&self, print: impl FnOnce()) {
        match &self.progress {
            Some(progress) => progress.suspend(print),
            None => print(),
        }
    }
}

impl Watcher for Watch<'_> {
    fn begins(&mut self, steps: Range<u64>, batch: usize) {
        self.batch = batch;
        self.progress = Some(Progress::new(self.global, "steps", steps.end - steps.start));
    }

    fn step(&mut self, _step: u64, losses: &StepLosses, wall_s: f64) {
        self.images += self.batch;
        self.busy_s += wall_s;
        let rate = self.images as f64 / self.busy_s.max(1e-9);
        if let Some(progress) = &self.progress {
            progress.message(format!("loss {:.4}, {rate:.1} images/s", losses.total));
            progress.add(1, false);
        }
    }

    fn validated(&mut self, step: u64, validated: &Validated) {
        let Some(db) = validated.psnr_db else {
            return;
        };
        let Some(ratio) = validated.light_ratio else {
            self.note(&format!("step {step}: {db:.2} dB on validation scenes"));
            return;
        };
        self.note(&format!(
            "step {step}: {db:.2} dB on validation scenes, light out over light in {ratio:.3}"
        ));
        if ratio > 1.0 {
            self.warning(&format!(
                "step {step}: T* has {ratio:.3} times the light of I, but a reflection only adds light: the network brightens; --bound 1 prevents it in a new training"
            ));
        }
    }

    fn note(&mut self, text: &str) {
        self.suspend(|| self.output.note(text));
    }

    fn warning(&mut self, text: &str) {
        self.suspend(|| self.output.warning(text));
    }
}
