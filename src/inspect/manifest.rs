//! Inspects manifests and single scenes.

use super::digests::hold_file;
use super::facts::{Inspection, Problem};
use super::input::Input;
use super::kind::Kind;
use glasshouse_line::{ManifestError, SceneLine, Side, Split, parse_jsonl, parse_scene};
use render::shard::Spec;
use serde_json::{Map, Value, json};
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
            let (ManifestError::Json { line, .. }
            | ManifestError::Scene { line, .. }
            | ManifestError::DuplicateId { line, .. }) = error;
            if kind == Kind::Manifest {
                let before = text.lines().take(line.saturating_sub(1));
                let good = before.filter(|line| !line.trim().is_empty()).count();
                let text = format!("{good} before the first bad line");
                found.facts.fact("good_lines", text, good);
            }
            let problem = Problem::new(error.to_string(), "correct that line, or plan again");
            found.wrong(problem.at(format!("line {line}")));
        }
    }
    if kind == Kind::Scene {
        found.may_be_whole("it can be read; a scene file has no digest");
    } else {
        hold_file::<Spec>(&mut found, input);
    }
    found
}

fn say(found: &mut Inspection, lines: &[SceneLine]) {
    let facts = &mut found.facts;
    if let [line] = lines {
        let text = format!("{}, split {}", line.id, line.split);
        facts.fact("scene", text, line.id.as_str());
        facts.value("front", line.front.name());
        facts.value("back", line.back.name());
    } else {
        let count = |split| lines.iter().filter(|line| line.split == split).count();
        let counts = Split::ALL.map(|split| (split.to_string(), count(split)));
        let of_splits = counts.iter().filter(|(_, count)| *count > 0);
        let of_splits: Vec<String> =
            of_splits.map(|(split, count)| format!("{count} {split}")).collect();
        let text = format!("{}: {}", lines.len(), of_splits.join(", "));
        facts.fact("scenes", text, lines.len());
        for (split, count) in counts {
            facts.put(&split, count);
        }
        if let (Some(first), Some(last)) = (lines.first(), lines.last()) {
            facts.say("ids", format!("{} to {}", first.id, last.id));
        }
        let sides = lines.iter().flat_map(|line| [&line.front, &line.back]);
        let images: BTreeSet<&str> = sides.map(Side::name).collect();
        let text = format!("{} in all, front and back", images.len());
        facts.fact("images", text, images.len());
    }
    say_ranges(found, lines);
    if lines.is_empty() {
        found.wrong(Problem::new("it has no scene", "add scenes to it"));
    }
}

/// Names of the parameters with displayed ranges, and their JSON pointers into a line.
const NUMBERS: &[(&str, &str)] = &[
    ("film.width", "/film/width"),
    ("film.height", "/film/height"),
    ("film.spp", "/film/spp"),
    ("camera.focal_length_mm", "/camera/focal_length_mm"),
    ("camera.aperture_radius_m", "/camera/aperture_radius_m"),
    ("camera.exposure", "/camera/exposure"),
    ("glass.distance_m", "/glass/distance_m"),
    ("glass.thickness_m", "/glass/thickness_m"),
    ("glass.ior", "/glass/ior"),
    ("glass.tilt_deg pitch", "/glass/tilt_deg/0"),
    ("glass.tilt_deg yaw", "/glass/tilt_deg/1"),
];

fn say_ranges(found: &mut Inspection, lines: &[SceneLine]) {
    let lines: Vec<Value> = lines.iter().map(|line| json!(line)).collect();
    let mut ranges = Map::new();
    for (name, place) in NUMBERS {
        let values = lines.iter().filter_map(|line| line.pointer(place)?.as_f64());
        let (least, most) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), value| {
            (lo.min(value), hi.max(value))
        });
        if least <= most {
            let range =
                if least == most { least.to_string() } else { format!("{least} to {most}") };
            found.facts.say(*name, range);
            ranges.insert((*name).to_owned(), json!([least, most]));
        }
    }
    found.facts.put("ranges", ranges);
}
