//! The run in a dozen numbers.

use super::survey::Survey;
use super::text::table;
use crate::html::Html;
use crate::plot::number;
use crate::run::Run;
use crate::serve::text::grouped;
use render::line::{SceneLine, Split};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Facts, splits and sources.
pub(super) fn glance(run: &Run, survey: &Survey) -> String {
    let counts = &survey.overview.counts;
    let mut html = "<dl class=\"facts\">".to_owned();
    let mut fact = |id: &str, name: &str, value: &str, note: &str| {
        let _ = writeln!(
            html,
            "<div id=\"fact-{id}\"><dt>{name}</dt><dd>{value} <small>{note}</small></dd></div>"
        );
    };
    let done = survey.done.len() as u64;
    let of_scenes = format!("of {} scenes", grouped(counts.scenes));
    fact("tuples", "Tuples", &grouped(done), &of_scenes);
    let lost = counts.quarantined.len() as u64;
    fact("quarantine", "Quarantine", &grouped(lost), "scenes");
    let of_shards = format!("of {}", grouped(counts.shards));
    fact("shards", "Shards", &grouped(counts.shards_done), &of_shards);
    let (film, film_note) = film(&run.lines);
    fact("film", "Film", &film, film_note);
    let (samples, samples_note) = samples(&run.lines);
    fact("samples", "Samples", &samples, &samples_note);
    let tile = format!("tiles of {} px", run.spec.tile_px);
    let version = run.spec.tracer_version.to_string();
    fact("tracer", "Tracer version", &version, &tile);
    html += "</dl>\n";
    html += &identity(run);
    html += "<div class=\"pair\">";
    html += &splits(run, survey);
    html += &sources(&run.lines);
    html += "</div>\n";
    html
}

/// The size that all films have, or the range of their sizes.
fn film(lines: &[SceneLine]) -> (String, &'static str) {
    let sizes: BTreeSet<[u32; 2]> = lines
        .iter()
        .map(|l| [l.film.width, l.film.height])
        .collect();
    let text = |size: Option<&[u32; 2]>| {
        size.map_or("none".to_owned(), |[w, h]| format!("{w} &times; {h}"))
    };
    match sizes.len() {
        0 | 1 => (text(sizes.first()), "px"),
        _ => (
            format!("{} to {}", text(sizes.first()), text(sizes.last())),
            "px",
        ),
    }
}

/// Samples a pixel that were asked for.
fn samples(lines: &[SceneLine]) -> (String, String) {
    let counts: BTreeSet<u32> = lines.iter().map(|l| l.film.spp).collect();
    let text = |count: Option<&u32>| count.map_or("none".to_owned(), u32::to_string);
    let count = if counts.len() > 1 {
        format!("{} to {}", text(counts.first()), text(counts.last()))
    } else {
        text(counts.first())
    };
    let errors: Vec<f64> = lines.iter().filter_map(|l| l.film.target_error).collect();
    let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let note = match errors.len() {
        0 => "a pixel".to_owned(),
        n if n == lines.len() => {
            format!("a pixel at most, until its error is {}", number(least))
        }
        n => format!("a pixel; {n} scenes until their error is small enough"),
    };
    (count, note)
}

/// What tells this run from others.
fn identity(run: &Run) -> String {
    let seeds: BTreeSet<u64> = run.lines.iter().map(|line| line.seed).collect();
    let seeds = match (seeds.first(), seeds.last()) {
        (Some(first), Some(last)) if first != last => {
            format!("{} different ones, {first} to {last}", seeds.len())
        }
        (Some(only), _) => only.to_string(),
        _ => "none".to_owned(),
    };
    let mut rows = String::new();
    for (name, value) in [
        ("recipe", run.spec.name.clone()),
        ("manifest, BLAKE3", run.spec.manifest_blake3.clone()),
        (
            "golden shard",
            format!("{} {}", run.spec.golden.scene, run.spec.golden.blake3),
        ),
        ("seeds of the scenes", seeds),
    ] {
        let _ = writeln!(
            rows,
            "<tr><th scope=\"row\">{name}</th><td class=\"mono\">{}</td></tr>",
            Html(&value)
        );
    }
    if !run.spec.left_out.is_empty() {
        let _ = writeln!(
            rows,
            "<tr><th scope=\"row\">left out when planned</th><td>{} whose files could not be used</td></tr>",
            run.spec.left_out.len()
        );
    }
    format!("<div class=\"box\"><table class=\"rows\"><tbody>\n{rows}</tbody></table></div>\n")
}

fn splits(run: &Run, survey: &Survey) -> String {
    let mut counts: BTreeMap<Split, [u64; 3]> = BTreeMap::new();
    let mut split_of: BTreeMap<&str, Split> = BTreeMap::new();
    for line in &run.lines {
        counts.entry(line.split).or_default()[0] += 1;
        split_of.insert(line.id.as_str(), line.split);
    }
    for scene in &survey.done {
        counts.entry(run.lines[scene.index].split).or_default()[1] += 1;
    }
    for scene in &survey.overview.counts.quarantined {
        if let Some(split) = split_of.get(scene.scene.as_str()) {
            counts.entry(*split).or_default()[2] += 1;
        }
    }
    let mut rows = String::new();
    for (split, [scenes, done, lost]) in counts {
        let _ = writeln!(
            rows,
            "<tr><td>{split}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            grouped(scenes),
            grouped(done),
            grouped(lost)
        );
    }
    table(
        "Splits",
        &["split", "#scenes", "#tuples", "#quarantine"],
        &rows,
    )
}

/// How often each source is used.
fn sources(lines: &[SceneLine]) -> String {
    #[derive(Default)]
    struct Use<'a> {
        fronts: u64,
        backs: u64,
        files: BTreeSet<&'a str>,
    }
    let mut sources: BTreeMap<&str, Use> = BTreeMap::new();
    for line in lines {
        for (side, is_front) in [(&line.front, true), (&line.back, false)] {
            let source = sources.entry(source_of(side.name())).or_default();
            source.fronts += u64::from(is_front);
            source.backs += u64::from(!is_front);
            source.files.insert(side.name());
        }
    }
    let mut rows = String::new();
    for (name, source) in sources {
        let _ = writeln!(
            rows,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            Html(name),
            grouped(source.files.len() as u64),
            grouped(source.fronts),
            grouped(source.backs)
        );
    }
    table(
        "Sources",
        &["source", "#files", "#in front", "#reflected"],
        &rows,
    )
}

/// The named root of a path.
fn source_of(path: &str) -> &str {
    match path.split_once(':') {
        Some((root, _)) => root,
        None if path.starts_with('/') => "absolute paths",
        None => "beside the manifest",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_named_by_their_roots() {
        assert_eq!(source_of("diode:train/a.png"), "diode");
        assert_eq!(source_of("a.png"), "beside the manifest");
        assert_eq!(source_of("/data/a.png"), "absolute paths");
    }
}
