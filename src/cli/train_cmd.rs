//! `train RUN --stage STAGE --steps S`

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::plan_cmd::TRAIN_RECIPE;
use super::progress::Progress;
use super::signals::Signals;
use super::target;
use super::train_args::{TrainArgs, use_threads};
use super::train_vgg::{Features, features};
use crate::run::{Run, keys};
use crate::store::Store;
use anyhow::anyhow;
use compose::find_pairs;
use crossbeam::channel::bounded;
use plan::{ExampleKind, Stage, TrainRecipe, TrainSettings};
use render::line::{Roots, SceneLine, Split};
use render::shard::scene_digest;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use train::{
    Base, Checkpoint, Example, ExampleSampler, Learner, Loader, Origin, PairSource,
    PhotographSource, SceneSource, Schedule, Session, StepLosses, TrainError, Trained, TupleSource,
    Watcher, clear, code_path,
};

const SCHEMA: &str = "glasshouse.train/1";

/// Threads that read examples: networks leave them little to do.
const READERS: usize = 1;

pub(super) fn run(args: &TrainArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let (run, store) = target::open(&args.run, args.store.as_deref(), &roots)?;
    let (trained, object, exit) = train(args, &run, &store, global, output)?;
    let Some(trained) = trained else {
        output.result(SCHEMA, object, "would train; nothing is written");
        return Ok(exit);
    };
    let loss = trained
        .loss
        .map_or(String::new(), |loss| format!(", loss {loss:.4}"));
    let psnr = trained.validation_psnr_db.map_or(String::new(), |db| {
        format!(", {db:.2} dB on validation scenes")
    });
    let verb = match trained.taken {
        0 => "was at".to_owned(),
        taken => format!("took {taken} steps to"),
    };
    let checkpoint = trained
        .checkpoint
        .map_or(String::new(), |path| format!("\n{}", path.display()));
    output.result(
        SCHEMA,
        object,
        &format!("{verb} step {}{loss}{psnr}{checkpoint}", trained.step),
    );
    Ok(exit)
}

/// Folder of a stage's checkpoints.
pub(super) fn stage_folder(run: &Path, stage: Stage) -> PathBuf {
    run.join("train").join(stage.name())
}

/// The recipe's `[train]`, if the run was planned with one.
pub(super) fn train_recipe(run: &Path) -> Result<Option<TrainRecipe>, Failure> {
    let path = run.join(TRAIN_RECIPE);
    let Ok(bytes) = std::fs::read(&path) else {
        return Ok(None);
    };
    let recipe = serde_json::from_slice(&bytes).map_err(|e| {
        let error = anyhow!("{} is damaged: {e}; plan the run again", path.display());
        Failure::new(Exit::Disagrees, error)
    })?;
    Ok(Some(recipe))
}

/// Trains; nothing is trained in a dry run.
pub(super) fn train(
    args: &TrainArgs,
    run: &Run,
    store: &Store,
    global: &Global,
    output: &Output,
) -> Result<(Option<Trained>, Value, Exit), Failure> {
    let stage = Stage::from(args.stage);
    let device = args.device.open()?;
    let folder = stage_folder(run.dir.root(), stage);
    let _lock = if global.dry_run {
        None
    } else {
        Some(lock(&folder)?)
    };
    let newest = |folder: &Path| {
        let (checkpoint, refused) = Checkpoint::newest(folder, &device);
        for error in refused {
            let older = match &checkpoint {
                Some(c) => format!("the one of step {} is taken", c.state.step),
                None => "there is no other".to_owned(),
            };
            output.warning(&format!("{error}; {older}"));
        }
        checkpoint
    };
    let own = newest(&folder);
    let before = match stage {
        Stage::Separation if own.is_none() => {
            newest(&stage_folder(run.dir.root(), Stage::Backtrack))
        }
        _ => None,
    };
    let settings = settings(args, run, own.as_ref().or(before.as_ref()), output)?;
    if stage == Stage::Separation && own.is_none() && before.is_none() && settings.a_priori {
        let error = anyhow!(
            "the separation stage begins with a BT-net, and {} has none: train it first with `glasshouse train {} --stage backtrack --steps S`, or leave it out with --no-a-priori",
            run.dir.root().display(),
            run.dir.root().display()
        );
        return Err(Failure::new(Exit::InvalidInput, error));
    }
    let threads = use_threads(global);
    let Features { vgg, blake3 } = features(
        &settings,
        args.settings.features.as_deref(),
        &device,
        output,
    )?;

    let lines_of = |split| -> Vec<SceneLine> {
        let lines = run.lines.iter().filter(|line| line.split == split);
        lines.cloned().collect()
    };
    let lines = lines_of(Split::Train);
    let pairs = match &args.real {
        Some(folder) => {
            let found = find_pairs(folder).map_err(|e| Failure::new(Exit::InvalidInput, e))?;
            for (path, reason) in &found.left_out {
                output.warning(&format!("{} is left out: {reason}", path.display()));
            }
            found.pairs
        }
        None => Vec::new(),
    };
    let origin = Origin {
        vgg_blake3: blake3,
        scenes_blake3: digest_of(lines.iter().map(scene_digest)),
        real_blake3: (!pairs.is_empty())
            .then(|| digest_of(pairs.iter().map(|pair| pair.name.clone()))),
        backtrack: match (&own, &before) {
            (Some(own), _) => own.state.origin.backtrack.clone(),
            (None, Some(before)) => {
                let digest = before.state.files.get("model.safetensors");
                Some((before.state.step, digest.cloned().unwrap_or_default()))
            }
            _ => None,
        },
    };
    if let Some(own) = &own {
        check_origin(own, &origin)?;
        if own.state.code_path != code_path() {
            output.warning(&format!(
                "the checkpoint was computed with {} instructions, this machine has {}: the last bits will differ from here on",
                own.state.code_path,
                code_path()
            ));
        }
    }
    // BT-net knows the features of its own weights alone.
    if let Some(before) = before
        .as_ref()
        .filter(|before| before.state.origin.vgg_blake3 != origin.vgg_blake3)
    {
        return Err(other_origin("VGG-19's weights", before));
    }
    if settings.examples == ExampleKind::Rendered {
        note_missing(&lines, store, &settings, output)?;
    }
    let failed = |e: train::candle_core::Error| Failure::new(Exit::Failed, e);
    let mut learner = Learner::new(stage, &settings, vgg, &device).map_err(failed)?;
    if let Some(before) = &before {
        learner
            .set_model(&before.model, "backtrack.")
            .map_err(failed)?;
    }
    let from = own.as_ref().map_or(0, |own| own.state.step);
    let mut object = json!({
        "run": args.run, "stage": stage.name(), "dry_run": global.dry_run, "from_step": from,
        "parameters": learner.parameters(), "scenes": lines.len(), "real_pairs": pairs.len(),
        "settings": settings, "threads": threads, "code_path": code_path(),
    });
    if global.dry_run {
        return Ok((None, object, Exit::Done));
    }
    if let Some(own) = own.as_ref().filter(|own| own.state.step >= args.steps) {
        let trained = Trained {
            step: own.state.step,
            taken: 0,
            checkpoint: Some(own.path.clone()),
            validation_psnr_db: own.state.validation_psnr_db,
            loss: None,
            stopped: false,
        };
        tell(&mut object, &trained);
        return Ok((Some(trained), object, Exit::Done));
    }
    clear(&folder).map_err(|e| Failure::new(Exit::Failed, e))?;

    let validation = validation(args, store, lines_of(Split::Test), &settings)?;
    let every = (args.steps / 20).clamp(10, 1000);
    let checkpoint_every = args.checkpoint_every.unwrap_or(every);
    let schedule = Schedule {
        until: args.steps.max(from),
        checkpoint_every,
        keep: args.keep,
        pictures_every: args.pictures_every.unwrap_or(checkpoint_every),
    };
    let (stop_sender, stopped) = bounded(0);
    let scenes = match settings.examples {
        ExampleKind::Rendered => SceneSource::Tuples(TupleSource {
            files: Box::new(store.clone()),
            lines,
            pixels: settings.pixels,
        }),
        _ => SceneSource::Photographs(PhotographSource {
            lines,
            roots: run.roots.clone(),
            base: run.dir.root().to_owned(),
            inputs: Box::new(super::store_env::inputs()),
        }),
    };
    let memory = (args.memory_gb.max(0.0) * 1e9) as usize;
    let sampler = ExampleSampler::new(&settings, scenes, PairSource { pairs }, memory, stopped)
        .map_err(|e| train_failure(e.into()))?;
    let mut loader = Loader::start(sampler, from..schedule.until, READERS, stop_sender);
    let mut session = Session::new(&folder, learner, settings, origin, validation, own.as_ref())
        .map_err(train_failure)?;
    let signals = Signals::catch();
    let progress = Progress::new(global, "steps", schedule.until - from);
    let mut watch = Watch {
        progress: &progress,
        output,
        verbose: global.verbose,
        images: 0.0,
        busy_s: 0.0,
        batch: object["settings"]["batch"].as_f64().unwrap_or(1.0),
    };
    let clock = Instant::now();
    let trained = session.run(&mut loader, &schedule, &mut watch, signals.stop());
    let images_per_s = watch.images / watch.busy_s.max(1e-9);
    progress.finish();
    let trained = trained.map_err(train_failure)?;
    tell(&mut object, &trained);
    object["wall_s"] = json!(clock.elapsed().as_secs_f64());
    object["images_per_s"] = json!((trained.taken > 0).then_some(images_per_s));
    let exit = if trained.stopped {
        signals.exit()
    } else {
        Exit::Done
    };
    Ok((Some(trained), object, exit))
}

/// How a training ended, for --json.
fn tell(object: &mut Value, trained: &Trained) {
    object["step"] = json!(trained.step);
    object["steps_taken"] = json!(trained.taken);
    object["checkpoint"] = json!(trained.checkpoint);
    object["loss"] = json!(trained.loss);
    object["validation_psnr_db"] = json!(trained.validation_psnr_db);
}

/// What was typed, over what the checkpoint, the recipe or the paper says.
fn settings(
    args: &TrainArgs,
    run: &Run,
    frozen: Option<&Checkpoint>,
    output: &Output,
) -> Result<TrainSettings, Failure> {
    let base = match frozen {
        Some(checkpoint) => checkpoint.state.settings.clone(),
        None => train_recipe(run.dir.root())?
            .map(|r| r.settings)
            .unwrap_or_default(),
    };
    let settings = match &args.recipe {
        Some(settings) => settings.clone(),
        None => args.settings.over(&base),
    };
    settings
        .validate()
        .map_err(|e| Failure::new(Exit::Usage, e))?;
    if let Some(checkpoint) = frozen {
        // What a stage learns by may differ from the stage before; what its networks are may not.
        let free = |name: &str| {
            let own = checkpoint.state.stage == Stage::from(args.stage);
            !own && !["features", "vgg_divisor", "width", "start"].contains(&name)
        };
        let mut differences = base.differences(&settings);
        differences.retain(|line| !line.split(':').next().is_some_and(free));
        if !differences.is_empty() {
            let error = anyhow!(
                "the settings differ from those of {}:\n  {}\n{} to go on with that training, or train in a new run",
                checkpoint.path.display(),
                differences.join("\n  "),
                match args.recipe {
                    Some(_) => "undo the change of the recipe's [train]",
                    None => "leave them out",
                },
            );
            let mut failure = Failure::new(Exit::Disagrees, error);
            failure
                .details
                .insert("differences".to_owned(), json!(differences));
            return Err(failure);
        }
    } else if args.settings.features.as_deref() == Some("random") {
        output.note(
            "features come from random weights: that is not the paper's setting, and every checkpoint says so",
        );
    }
    if settings.real_share > 0.0 && args.real.is_none() {
        let error = anyhow!(
            "a share of {} of the steps sees real pairs: give their folder with --real",
            settings.real_share
        );
        return Err(Failure::new(Exit::Usage, error));
    }
    Ok(settings)
}

/// The examples must be those that the training began with.
fn check_origin(own: &Checkpoint, origin: &Origin) -> Result<(), Failure> {
    let was = &own.state.origin;
    let changed = if was.scenes_blake3 != origin.scenes_blake3 {
        "the run's train scenes"
    } else if was.real_blake3 != origin.real_blake3 {
        "the real pairs"
    } else if was.vgg_blake3 != origin.vgg_blake3 {
        "VGG-19's weights"
    } else {
        return Ok(());
    };
    Err(other_origin(changed, own))
}

fn other_origin(changed: &str, checkpoint: &Checkpoint) -> Failure {
    let error = anyhow!(
        "{changed} are not those that {} was trained with; give the same, or train in a new run",
        checkpoint.path.display()
    );
    Failure::new(Exit::Disagrees, error)
}

fn digest_of(parts: impl Iterator<Item = String>) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(part.as_bytes());
        hasher.update(b"\n");
    }
    hasher.finalize().to_hex().to_string()
}

/// Says how many of the scenes cannot be learned from yet.
fn note_missing(
    lines: &[SceneLine],
    store: &Store,
    settings: &TrainSettings,
    output: &Output,
) -> Result<(), Failure> {
    let there: BTreeSet<String> = store.list(keys::TUPLES)?.into_iter().collect();
    let has = |line: &&SceneLine| there.contains(&keys::tuple(&line.id, "tuple.json"));
    let missing = lines.len() - lines.iter().filter(has).count();
    if missing == 0 {
        return Ok(());
    }
    output.warning(&if settings.follow {
        format!("{missing} of {} train scenes have no tuple yet: the training waits for them", lines.len())
    } else {
        format!(
            "{missing} of {} train scenes have no tuple: others take their place; --follow waits for the farm",
            lines.len()
        )
    });
    Ok(())
}

/// Whole images of test scenes that have a tuple.
fn validation(
    args: &TrainArgs,
    store: &Store,
    lines: Vec<SceneLine>,
    settings: &TrainSettings,
) -> Result<Vec<Example>, Failure> {
    let source = TupleSource {
        files: Box::new(store.clone()),
        lines,
        pixels: settings.pixels,
    };
    let mut examples = Vec::new();
    for index in 0..source.lines.len() {
        if examples.len() >= args.validate {
            break;
        }
        if let Some(Base::Example(example)) =
            source.read(index).map_err(|e| train_failure(e.into()))?
        {
            examples.push(example);
        }
    }
    Ok(examples)
}

/// One trainer a stage.
fn lock(folder: &Path) -> Result<File, Failure> {
    render::atomic_file::create_dir(folder)?;
    let path = folder.join("train.lock");
    let failed = |e: std::io::Error| {
        Failure::new(Exit::Failed, anyhow!("cannot lock {}: {e}", path.display()))
    };
    let file = File::options()
        .create(true)
        .append(true)
        .open(&path)
        .map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            let error = anyhow!(
                "another process is training in {}; wait for it, or stop it",
                folder.display()
            );
            Err(Failure::new(Exit::TryAgain, error))
        }
        Err(TryLockError::Error(e)) => Err(failed(e)),
    }
}

pub(super) fn train_failure(error: TrainError) -> Failure {
    use train::ExampleError as E;
    let exit = match &error {
        TrainError::Example(E::Unusable { .. } | E::None(_)) => Exit::InvalidInput,
        _ => Exit::Failed,
    };
    Failure::new(exit, error)
}

/// Shows how it goes.
struct Watch<'a> {
    progress: &'a Progress,
    output: &'a Output,
    verbose: bool,
    images: f64,
    busy_s: f64,
    batch: f64,
}

impl Watcher for Watch<'_> {
    fn step(&mut self, _step: u64, losses: &StepLosses, wall_s: f64) {
        self.images += self.batch;
        self.busy_s += wall_s;
        let rate = self.images / Duration::from_secs_f64(self.busy_s).as_secs_f64().max(1e-9);
        self.progress
            .message(format!("loss {:.4}, {rate:.1} images/s", losses.total));
        self.progress.add(1, false);
    }

    fn checkpoint(&mut self, step: u64, _path: &Path, validation_psnr_db: Option<f64>) {
        if let (true, Some(db)) = (self.verbose, validation_psnr_db) {
            self.progress.suspend(|| {
                self.output
                    .note(&format!("step {step}: {db:.2} dB on validation scenes"));
            });
        }
    }
}
