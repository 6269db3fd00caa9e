//! Manifests and single scenes.

use super::facts::{Inspection, Problem, many};
use super::kind::Kind;
use super::look::Input;
use render::line::{ManifestError, SceneLine, Split, parse_jsonl, parse_scene};
use render::shard::{Spec, manifest_digest};
use serde_json::{Map, json};
use std::collections::BTreeSet;

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let Some(text) = input.text(&mut found) else {
        return found;
    };
    let parsed = if kind == Kind::Scene {
        parse_scene(text).map(|line| vec![line])
    } else {
        parse_jsonl(text)
    };
    match parsed {
        Ok(lines) => say(&mut found, &lines),
        Err(error) => {
            let good = good_lines(text, &error);
            if kind == Kind::Manifest {
                found.facts.fact(
                    "good_lines",
                    format!("{good} before the first bad one"),
                    good,
                );
            }
            let place = format!("line {}", line_of(&error));
            found.wrong(
                Problem::new(error.to_string(), "correct that line, or plan again").at(place),
            );
        }
    }
    hold(&mut found, input, text);
    found
}

fn line_of(error: &ManifestError) -> usize {
    match error {
        ManifestError::Json { line, .. }
        | ManifestError::Scene { line, .. }
        | ManifestError::DuplicateId { line, .. } => *line,
    }
}

/// Scenes before the line of an error.
fn good_lines(text: &str, error: &ManifestError) -> usize {
    let before = text.lines().take(line_of(error).saturating_sub(1));
    before.filter(|line| !line.trim().is_empty()).count()
}

/// A run's manifest has its digest in the run's spec.
fn hold(found: &mut Inspection, input: &Input, text: &str) {
    if found.kind == Kind::Scene {
        found.may_be_whole("it can be read; a scene file has no digest");
        return;
    }
    let spec = (input.beside)("spec.json").filter(|_| input.name == "manifest.jsonl");
    match spec.and_then(|bytes| serde_json::from_slice::<Spec>(&bytes).ok()) {
        None => {
            found.may_be_whole("every line can be read; no spec.json beside it holds its digest");
        }
        Some(spec) if spec.manifest_blake3 == manifest_digest(text) => {
            found.is_whole("its digest is that of spec.json");
        }
        Some(spec) => {
            let what = format!(
                "its digest is not that of spec.json beside it, which was made for {}",
                many(spec.scenes.into(), "scene")
            );
            found.wrong(Problem::new(what, "plan again into a new folder; or plan from this file: `glasshouse plan FILE.jsonl`"));
        }
    }
}

fn say(found: &mut Inspection, lines: &[SceneLine]) {
    let facts = &mut found.facts;
    if let [line] = lines {
        facts.fact(
            "scene",
            format!("{}, split {}", line.id, line.split),
            line.id.as_str(),
        );
        facts.fact("front", line.front.name(), line.front.name());
        facts.fact("back", line.back.name(), line.back.name());
    } else {
        let count = |split| lines.iter().filter(|line| line.split == split).count();
        let (train, test) = (count(Split::Train), count(Split::Test));
        facts.fact(
            "scenes",
            format!("{}: {train} train, {test} test", lines.len()),
            lines.len(),
        );
        facts.put("train", train);
        facts.put("test", test);
        if let (Some(first), Some(last)) = (lines.first(), lines.last()) {
            facts.say("ids", format!("{} to {}", first.id, last.id));
        }
        let images: BTreeSet<&str> = lines
            .iter()
            .flat_map(|line| [line.front.name(), line.back.name()])
            .collect();
        facts.fact(
            "images",
            format!("{} in all, front and back", images.len()),
            images.len(),
        );
    }
    say_ranges(found, lines);
    if lines.is_empty() {
        found.wrong(Problem::new("it describes no scene", "add scenes to it"));
    }
}

/// A number of each line.
type Number = (&'static str, &'static str, fn(&SceneLine) -> f64);

/// Parameters whose ranges are told.
const NUMBERS: &[Number] = &[
    ("film.width", "px", |line| line.film.width.into()),
    ("film.height", "px", |line| line.film.height.into()),
    ("film.spp", "samples a pixel", |line| line.film.spp.into()),
    ("camera.focal_length_mm", "mm", |line| {
        line.camera.focal_length_mm
    }),
    ("camera.aperture_radius_m", "m", |line| {
        line.camera.aperture_radius_m
    }),
    ("camera.exposure", "", |line| line.camera.exposure),
    ("glass.distance_m", "m", |line| line.glass.distance_m),
    ("glass.thickness_m", "m", |line| line.glass.thickness_m),
    ("glass.ior", "", |line| line.glass.ior),
    ("glass.tilt_deg pitch", "degrees", |line| {
        line.glass.tilt_deg[0]
    }),
    ("glass.tilt_deg yaw", "degrees", |line| {
        line.glass.tilt_deg[1]
    }),
];

fn say_ranges(found: &mut Inspection, lines: &[SceneLine]) {
    let mut ranges = Map::new();
    for (name, unit, of) in NUMBERS {
        let values = || lines.iter().map(of);
        let (least, most) = (
            values().fold(f64::INFINITY, f64::min),
            values().fold(f64::NEG_INFINITY, f64::max),
        );
        if !least.is_finite() {
            continue;
        }
        let text = if least == most {
            format!("{least} {unit}")
        } else {
            format!("{least} to {most} {unit}")
        };
        found.facts.say(*name, text.trim_end());
        ranges.insert((*name).to_owned(), json!([least, most]));
    }
    found.facts.put("ranges", ranges);
}
