//! `evaluate RUN|DIR`

use super::args::Global;
use super::evaluate_rows::{Gain, LeftOut, Method, Subject, fitted_gain, scored};
use super::evaluate_text::Evaluation;
use super::exit_code::{Exit, Failure};
use super::network::{Network, Which};
use super::output::Output;
use super::progress::Progress;
use super::signals::Signals;
use super::split_name::SplitName;
use super::target;
use super::train_args::{EvaluateArgs, use_threads};
use super::train_cmd::stage_folder;
use crate::run::keys;
use anyhow::anyhow;
use compose::{find_pairs, per_image_csv};
use plan::{PixelSource, Stage};
use render::atomic_file;
use render::line::Roots;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use train::{TupleSource, rgb_grid, steps};

const SCHEMA: &str = "glasshouse.evaluate/1";

/// Warnings of one kind that are printed; the files list all.
const WARNINGS: usize = 8;

pub(super) fn run(args: &EvaluateArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let evaluated = evaluate(args, global, output)?;
    output.result(SCHEMA, evaluated.object, &evaluated.text);
    Ok(evaluated.exit)
}

/// What came out.
pub(super) struct Evaluated {
    /// For --json.
    pub(super) object: Value,
    /// The tables.
    pub(super) text: String,
    pub(super) exit: Exit,
}

/// Scores, and writes what was scored.
pub(super) fn evaluate(
    args: &EvaluateArgs,
    global: &Global,
    output: &Output,
) -> Result<Evaluated, Failure> {
    let threads = use_threads(global);
    let place = args.place.display().to_string();
    // A store may bring the run to where nothing is yet.
    let is_run = is_run(&args.place) || (args.store.is_some() && !args.place.exists());
    let store = args.store.as_deref();
    let (mut subject, mut left_out) = subject(&args.place, is_run, store, args.split, output)?;
    if let Some(limit) = args.limit {
        subject.limit(limit as usize);
    }
    if subject.len() == 0 {
        let error = anyhow!(
            "{place} was planned without scenes of the split {0:?}; give another --split",
            args.split.name()
        );
        return Err(Failure::new(Exit::InvalidInput, error));
    }
    let networks = networks(args, is_run, output)?;
    let folder = match (&args.out, is_run) {
        (Some(folder), _) => Some(folder.clone()),
        (None, true) => Some(evaluation_folder(&args.place)),
        (None, false) => None,
    };
    if global.dry_run {
        return Ok(dry_run(args, &subject, &networks, folder));
    }

    let signals = Signals::catch();
    let (gain, of_gain) = gain(args, is_run, output, &signals)?;
    let mut methods = vec![("input".to_owned(), Method::Input)];
    if let Some(gain) = &gain {
        methods.push((gain.row_name(), Method::Gain(gain.factor)));
    }
    let tile_px = args.network.tile_px as usize;
    for (name, network) in &networks {
        methods.push((name.clone(), Method::Networks(&network.separator, tile_px)));
    }
    let progress = Progress::new(global, "pictures", subject.len() as u64);
    let scored = scored(&subject, &methods, &progress, signals.stop());
    let done = progress.done();
    progress.finish();
    let scored = scored?;
    if scored.stopped {
        let error = anyhow!(
            "stopped after {done} of {} pictures: nothing is written",
            subject.len()
        );
        return Err(Failure::new(signals.exit(), error));
    }
    let incomplete: Vec<LeftOut> = of_gain.into_iter().chain(scored.left_out).collect();
    warn(&incomplete, output);
    let exit = if incomplete.is_empty() {
        Exit::Done
    } else {
        Exit::Incomplete
    };
    left_out.extend(incomplete);
    if scored.rows.is_empty() {
        return Err(nothing(&place, is_run, &left_out));
    }

    let names: Vec<String> = methods.into_iter().map(|(name, _)| name).collect();
    let evaluation = Evaluation {
        place,
        split: is_run.then(|| args.split.name()),
        methods: &names,
        rows: &scored.rows,
        gain: gain.as_ref(),
        networks: &networks,
        tile_px: args.network.tile_px,
        left_out: &left_out,
    };
    let protocol = args.protocol.into();
    let mut object = evaluation.json();
    object["files"] = json!([]);
    let mut text = format!("{}\n\n{}", evaluation.what(), evaluation.text(protocol));
    if let Some(folder) = folder {
        let [markdown, csv, png, json_file] =
            ["md", "csv", "png", "json"].map(|ending| folder.join(format!("evaluation.{ending}")));
        let files = [&markdown, &csv, &png, &json_file].map(|path| path.display().to_string());
        let grid = rgb_grid(&scored.kept).map_err(|e| Failure::new(Exit::Failed, e))?;
        object["files"] = json!(files);
        let mut full = json!({ "schema": SCHEMA });
        if let (Value::Object(full), Value::Object(object)) = (&mut full, object.clone()) {
            full.extend(object);
        }
        let mut pretty =
            serde_json::to_string_pretty(&full).map_err(|e| Failure::new(Exit::Failed, e))?;
        pretty.push('\n');
        atomic_file::create_dir(&folder)?;
        atomic_file::write(&markdown, evaluation.markdown(protocol).as_bytes())?;
        atomic_file::write(&csv, per_image_csv(&scored.rows).as_bytes())?;
        atomic_file::write_relaxed(&png, &grid.png)?;
        atomic_file::write(&json_file, pretty.as_bytes())?;
        text.push('\n');
        text += &files.join("\n");
    }
    object["threads"] = json!(threads);
    Ok(Evaluated {
        object,
        text: text.trim_end().to_owned(),
        exit,
    })
}

/// Where a run's scores are kept.
pub(super) fn evaluation_folder(run: &Path) -> PathBuf {
    run.join("train").join("evaluation")
}

fn is_run(place: &Path) -> bool {
    place.join(keys::SPEC).is_file()
}

/// The pairs of a folder or the scenes of a run, and the pictures that are in no pair.
fn subject(
    place: &Path,
    is_run: bool,
    store: Option<&str>,
    split: SplitName,
    output: &Output,
) -> Result<(Subject, Vec<LeftOut>), Failure> {
    if is_run {
        let (run, store) = target::open(place, store, &Roots::default())?;
        let lines = run.lines.iter().filter(|line| split.has(line.split));
        let source = TupleSource {
            files: Box::new(store),
            lines: lines.cloned().collect(),
            pixels: PixelSource::Png,
        };
        return Ok((Subject::Run(source), Vec::new()));
    }
    let found = find_pairs(place).map_err(|e| Failure::new(Exit::InvalidInput, e))?;
    let left_out: Vec<LeftOut> = found
        .left_out
        .into_iter()
        .map(|(path, reason)| LeftOut {
            image: path
                .strip_prefix(place)
                .unwrap_or(&path)
                .display()
                .to_string(),
            reason,
        })
        .collect();
    if !left_out.is_empty() {
        output.note(&format!(
            "{} pictures are in no pair{}",
            left_out.len(),
            if output.verbose { ":" } else { "; -v says why" }
        ));
    }
    if output.verbose {
        for LeftOut { image, reason } in &left_out {
            output.note(&format!("{image}: {reason}"));
        }
    }
    Ok((Subject::Pairs(found.pairs), left_out))
}

/// The networks to score, with the names of their rows; no two have the same.
fn networks(
    args: &EvaluateArgs,
    is_run: bool,
    output: &Output,
) -> Result<Vec<(String, Network)>, Failure> {
    let mut places: Vec<(Option<&str>, PathBuf)> = Vec::new();
    for typed in &args.checkpoints {
        // A path may have an equals sign in it, too.
        places.push(match typed.split_once('=') {
            Some((name, path)) if !Path::new(typed).exists() => (Some(name), PathBuf::from(path)),
            _ => (None, PathBuf::from(typed)),
        });
    }
    if places.is_empty() && is_run {
        if steps(&stage_folder(&args.place, Stage::Separation)).is_empty() {
            output.note(&format!(
                "no SP-net was trained here, so that the input alone is scored; `glasshouse train {} --stage separation --steps S` trains one",
                args.place.display()
            ));
        } else {
            places.push((None, args.place.clone()));
        }
    }
    let mut networks: Vec<(String, Network)> = Vec::new();
    for (name, path) in places {
        let network = Network::open(
            &path,
            Which::Newest,
            args.network.features.as_deref(),
            output,
        )?;
        let name = network.row_name(name);
        if name == "input" || networks.iter().any(|(other, _)| *other == name) {
            let error = anyhow!(
                "two rows would be called {name:?}; name them with --checkpoint NAME={}",
                path.display()
            );
            return Err(Failure::new(Exit::Usage, error));
        }
        networks.push((name, network));
    }
    Ok(networks)
}

/// Fits the gain to what the user says, else to the run's own train scenes.
fn gain(
    args: &EvaluateArgs,
    is_run: bool,
    output: &Output,
    signals: &Signals,
) -> Result<(Option<Gain>, Vec<LeftOut>), Failure> {
    let (place, of_run) = match &args.fit_gain {
        Some(place) => (place, self::is_run(place)),
        None if is_run => (&args.place, true),
        None => return Ok((None, Vec::new())),
    };
    let is_own = *place == args.place;
    let store = args.store.as_deref().filter(|_| is_own);
    let (subject, _) = subject(place, of_run, store, SplitName::Train, output)?;
    let (gain, left_out) = fitted_gain(&subject, place.display().to_string(), signals.stop())?;
    if gain.is_none() {
        let reason = format!(
            "no gain can be fitted to {}: nothing there",
            place.display()
        );
        if args.fit_gain.is_some() {
            let error = anyhow!("{reason} can be read; `glasshouse work RUN` makes tuples");
            return Err(Failure::new(Exit::InvalidInput, error));
        }
        output.note(&format!("{reason} can be read, so its row is left out"));
    }
    Ok((gain, left_out))
}

/// Says what would be scored.
fn dry_run(
    args: &EvaluateArgs,
    subject: &Subject,
    networks: &[(String, Network)],
    folder: Option<PathBuf>,
) -> Evaluated {
    let mut methods = vec!["input"];
    methods.extend(networks.iter().map(|(name, _)| name.as_str()));
    let text = format!(
        "would score {} pictures by {}; nothing is written",
        subject.len(),
        methods.join(", ")
    );
    let object = json!({
        "where": args.place.display().to_string(), "dry_run": true, "images": subject.len(), "methods": methods,
        "out": folder.map(|folder| folder.display().to_string()),
    });
    Evaluated {
        object,
        text,
        exit: Exit::Done,
    }
}

fn warn(incomplete: &[LeftOut], output: &Output) {
    for LeftOut { image, reason } in incomplete.iter().take(WARNINGS) {
        output.warning(&format!("{image} is left out: {reason}"));
    }
    if let Some(more @ 1..) = incomplete.len().checked_sub(WARNINGS) {
        output.warning(&format!("{more} more are left out"));
    }
}

fn nothing(place: &str, is_run: bool, left_out: &[LeftOut]) -> Failure {
    let what = if is_run {
        format!("run `glasshouse work {place}`, and see `glasshouse status {place}`")
    } else {
        "see above what is wrong with its pairs".to_owned()
    };
    let error = anyhow!("there is nothing to score in {place}: {what}");
    let mut failure = Failure::new(Exit::InvalidInput, error);
    let list = left_out
        .iter()
        .map(|l| json!({ "image": l.image, "reason": l.reason }));
    failure
        .details
        .insert("left_out".to_owned(), list.collect());
    failure
}
