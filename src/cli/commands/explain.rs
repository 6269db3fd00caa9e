//! `explain RUN SHARD`: describes the state of a scene or shard.

use crate::cli::args::{StoreArgs, parse_scene_id};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::status_text::{attempt, row};
use crate::cli::target;
use crate::run::{Explanation, SceneState, explain};
use crate::text::grouped;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use glasshouse_line::ids::SceneId;
use serde::ser::Error;
use serde::{Serialize, Serializer};
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

#[derive(Debug, ClapArgs)]
pub(super) struct ExplainArgs {
    /// Folder of the run
    run: PathBuf,
    /// A scene, or one of its shards: SCENE or SCENE:NUMBER
    #[arg(value_name = "SHARD", value_parser = parse_shard)]
    shard: (SceneId, Option<u32>),
    #[command(flatten)]
    store: StoreArgs,
}

/// Largest number of printed ranges of shards.
const ROWS: usize = 8;

pub(super) fn run(args: &ExplainArgs, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    let (scene, shard) = &args.shard;
    let known = explain(&run, &store, scene, *shard)?;
    output.show("glasshouse.explain/1", &Explained { run: &args.run, known });
    Ok(Exit::Done)
}

/// An explanation with the run's folder. In JSON `run` is the folder, and the explanation's `run` becomes `run_state`.
struct Explained<'a> {
    run: &'a Path,
    known: Explanation,
}

impl Serialize for Explained<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serde_json::to_value(&self.known).map_err(S::Error::custom)?;
        object["run_state"] = object["run"].take();
        object["run"] = self.run.to_string_lossy().into();
        object.serialize(serializer)
    }
}

impl fmt::Display for Explained<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let folder = format!(" {}", self.run.display());
        f.write_str(&text(&self.known).replace(" RUN", &folder))
    }
}

fn text(known: &Explanation) -> String {
    let film = &known.line.film;
    let state = match known.state {
        SceneState::Done => "done",
        SceneState::Quarantined => "in quarantine",
        SceneState::Complete => "traced, not merged",
        SceneState::Begun => "begun",
        SceneState::Waiting => "waiting",
    };
    let mut text = format!(
        "{}: {state}; scene {} of the manifest\n  film        {} x {} px, {} samples per pixel",
        known.scene,
        known.index,
        film.width,
        film.height,
        grouped(film.spp.into())
    );
    if let Some(target) = film.target_error {
        let _ = write!(text, " at most, target error {target:.1e}");
    }
    row(&mut text, "front", known.line.front.name());
    row(&mut text, "back", known.line.back.name());
    let tiles = known.shards / known.ranges.max(1);
    row(
        &mut text,
        "shards",
        &format!(
            "{} ({tiles} tiles of {} px, {} sample ranges each)",
            known.shards, known.tile_px, known.ranges
        ),
    );
    if known.state != SceneState::Done {
        row(&mut text, "partials", &rows(&known.there));
        row(&mut text, "missing", &rows(&known.missing));
    }
    if let Some(shard) = &known.shard {
        let t = shard.tile;
        let pixels = format!("x {}-{}, y {}-{}", t.x, t.x + t.width - 1, t.y, t.y + t.height - 1);
        let samples = format!("samples {}-{}", shard.samples[0], shard.samples[1] - 1);
        row(
            &mut text,
            &format!("shard {}", shard.index),
            &format!("{pixels}, {samples}; {}", shard.result),
        );
    }
    if let Some(receipt) = &known.receipt {
        let version = receipt.version.as_deref().unwrap_or("unknown");
        row(&mut text, "made by", &format!("{}, version {version}", receipt.makers()));
    }
    for (at, standing) in known.attempts.iter().enumerate() {
        row(&mut text, if at == 0 { "attempts" } else { "" }, &attempt(standing));
        let end = standing.note.ended.as_ref();
        log(&mut text, end.map(|end| end.log_tail.as_str()));
    }
    if let Some(record) = &known.quarantine {
        let reason = record["reason"].as_str().unwrap_or("the record has no reason");
        row(&mut text, "reason", reason);
        log(&mut text, record["log_tail"].as_str());
    }
    for line in &known.next {
        let _ = write!(text, "\n{line}");
    }
    text
}

fn log(text: &mut String, tail: Option<&str>) {
    for line in tail.unwrap_or_default().trim_end().lines() {
        let line = line.replace(|c: char| c.is_control(), " ");
        let _ = write!(text, "\n              | {line}");
    }
}

fn rows(rows: &[[u32; 2]]) -> String {
    let count: u32 = rows.iter().map(|[start, end]| end - start).sum();
    let shown = rows.iter().take(ROWS).map(|[start, end]| {
        if end - start == 1 { start.to_string() } else { format!("{start}-{}", end - 1) }
    });
    let mut shown: Vec<String> = shown.collect();
    if rows.len() > ROWS {
        shown.push("…".to_owned());
    }
    match count {
        0 => "none".to_owned(),
        _ => format!("{count}: {}", shown.join(" ")),
    }
}

fn parse_shard(text: &str) -> Result<(SceneId, Option<u32>), String> {
    let (scene, shard) = match text.split_once(':') {
        Some((scene, shard)) => {
            let number = shard.parse().map_err(|_| {
                format!("{shard:?} is not a shard number: write SCENE or SCENE:NUMBER")
            })?;
            (scene, Some(number))
        }
        None => (text, None),
    };
    Ok((parse_scene_id(scene)?, shard))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shard_argument_is_a_scene_and_an_optional_number() {
        let scene = SceneId::new("train-1").unwrap();
        assert_eq!(parse_shard("train-1"), Ok((scene.clone(), None)));
        assert_eq!(parse_shard("train-1:12"), Ok((scene, Some(12))));
        for bad in ["", ":1", "train-1:", "train-1:x", "train-1:-1", "a b"] {
            assert!(parse_shard(bad).is_err(), "{bad}");
        }
    }
}
