//! `develop RUN`: photographs a run's tuples by another camera.

use crate::cli::args::{Global, SplitName, StoreArgs, VerifyArgs, threads};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::{Output, reasons};
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::target;
use crate::develop::{DevelopWork, Developed, develop, scenes_of};
use crate::made::Remade;
use crate::outputs::check_place;
use crate::text::many;
use clap::Args as ClapArgs;
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Roots, Split, is_url};
use plan::SensorFile;
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Debug, ClapArgs)]
pub(super) struct DevelopArgs {
    /// Folder of the run
    run: PathBuf,
    /// TOML file with a [sensor] table, as in a recipe, and `seed`
    #[arg(long, value_name = "FILE")]
    sensor: PathBuf,
    /// Folder of the photographs: a new or empty one, or one of the same run and sensor, which resumes
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Scenes to photograph
    #[arg(long, value_enum, default_value = "all")]
    split: SplitName,
    #[command(flatten)]
    verify: VerifyArgs,
    #[command(flatten)]
    store: StoreArgs,
}

const SCHEMA: &str = "glasshouse.develop/1";

pub(super) fn run(args: &DevelopArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    if is_url(&args.out) {
        return Err(failure!(
            Exit::Usage,
            "--out {} is a URL: develop into a folder, then copy the folder there",
            args.out.display()
        ));
    }
    let file = args.sensor.display();
    let text = render::input_file::read_to_string(&args.sensor)
        .map_err(|e| failure!(Exit::InvalidInput, "cannot read {file}: {e}; check the path"))?;
    let sensor = SensorFile::parse(&text)
        .map_err(|e| failure!(Exit::InvalidInput, "{file}: {e}; docs/camera.md lists the keys"))?;
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    let splits: BTreeSet<Split> =
        Split::ALL.into_iter().filter(|split| args.split.has(*split)).collect();
    let scenes = scenes_of(&run, &splits).len() as u64;
    check_place(&args.out)?;
    if global.dry_run {
        let developed = Developed { scenes, ..Developed::default() };
        output.show(SCHEMA, &Answer::new(args, developed, None));
        return Ok(Exit::Done);
    }
    let signals = Signals::catch();
    let progress = Progress::new(global, "scenes", scenes);
    let start = Instant::now();
    let work = DevelopWork {
        sensor_text: &text,
        sensor: &sensor,
        splits: &splits,
        threads: threads(global),
        verify: args.verify.verify,
        stop: signals.stop(),
        on_scene: &|found| progress.add(1, found),
    };
    let ended = develop(&run, &store, &args.out, &work);
    progress.finish();
    let developed = ended?;
    let done = developed.scenes + developed.scenes_resumed;
    if developed.stopped {
        return Err(failure!(
            signals.exit(),
            "stopped after {done} of {scenes} scenes: run the same command to resume"
        ));
    }
    let exit = if done == scenes { Exit::Done } else { Exit::Incomplete };
    output.show(SCHEMA, &Answer::new(args, developed, Some(start.elapsed().as_secs_f64())));
    Ok(exit)
}

#[derive(Serialize)]
struct Answer<'a> {
    #[serde(serialize_with = "render::path_text::one")]
    run: &'a Path,
    #[serde(serialize_with = "render::path_text::one")]
    sensor: &'a Path,
    #[serde(serialize_with = "render::path_text::one")]
    out: &'a Path,
    dry_run: bool,
    scenes: u64,
    scenes_resumed: u64,
    #[serde(skip_serializing_if = "Remade::is_none")]
    remade: Remade,
    missing: Vec<SceneId>,
    #[serde(serialize_with = "reasons")]
    failed: Vec<(SceneId, String)>,
    /// Duration, s; `None` in a dry run.
    #[serde(skip_serializing_if = "Option::is_none")]
    wall_s: Option<f64>,
}

impl<'a> Answer<'a> {
    fn new(args: &'a DevelopArgs, developed: Developed, wall_s: Option<f64>) -> Self {
        let Developed { scenes, scenes_resumed, remade, missing, failed, .. } = developed;
        Self {
            run: &args.run,
            sensor: &args.sensor,
            out: &args.out,
            dry_run: wall_s.is_none(),
            scenes,
            scenes_resumed,
            remade,
            missing,
            failed,
            wall_s,
        }
    }
}

impl fmt::Display for Answer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (out, scenes) = (self.out.display(), self.scenes);
        match self.wall_s {
            None => return write!(f, "would photograph {scenes} scenes into {out}"),
            Some(wall_s) => {
                write!(f, "photographed {} into {out} in {wall_s:.1} s", many(scenes, "scene"))?;
            }
        }
        if self.scenes_resumed > 0 {
            write!(f, "; {} were there already", self.scenes_resumed)?;
        }
        if !self.remade.is_none() {
            write!(f, "; {}", self.remade)?;
        }
        if !self.missing.is_empty() {
            let missing = many(self.missing.len() as u64, "scene");
            write!(f, "; {missing} without a tuple yet")?;
        }
        for (scene, reason) in &self.failed {
            write!(f, "\nno photograph of {scene}: {reason}")?;
        }
        Ok(())
    }
}
