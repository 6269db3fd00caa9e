//! Summarises the run: counts, settings, digests, splits and sources.

use super::survey::Survey;
use super::text::table;
use crate::plot::number;
use crate::run::Run;
use crate::text::grouped;
use glasshouse_line::{SceneLine, Split};
use maud::{Markup, html};
use std::collections::{BTreeMap, BTreeSet};

/// Draws the section: facts, digests and seeds, splits and sources.
pub(super) fn glance(run: &Run, survey: &Survey) -> Markup {
    let counts = &survey.status.counts;
    let fact = |id: &str, name: &str, value: &str, note: &str| {
        html! { div id={ "fact-" (id) } { dt { (name) } dd { (value) " " small { (note) } } } }
    };
    let of_scenes = format!("of {} scenes", grouped(counts.scenes));
    let of_shards = format!("of {}", grouped(counts.shards));
    let (film, film_note) = film(&run.lines);
    let (samples, samples_note) = samples(&run.lines);
    let tile = format!("tiles of {} px", run.spec.tile_px);
    html! {
        dl.facts {
            (fact("tuples", "Tuples", &grouped(survey.done.len() as u64), &of_scenes))
            (fact("quarantine", "Quarantine", &grouped(counts.quarantined.len() as u64), "scenes"))
            (fact("shards", "Shards", &grouped(counts.shards_done), &of_shards))
            (fact("film", "Film", &film, film_note))
            (fact("samples", "Samples", &samples, &samples_note))
            (fact("tracer", "Tracer version", &run.spec.tracer_version.to_string(), &tile))
        }
        (identity(run))
        div.pair { (splits(run, survey)) (sources(&run.lines)) }
    }
}

/// Formats the size that all films have, or the range of their sizes, and the unit.
fn film(lines: &[SceneLine]) -> (String, &'static str) {
    let sizes: BTreeSet<[u32; 2]> = lines.iter().map(|l| [l.film.width, l.film.height]).collect();
    let text = |size: Option<&[u32; 2]>| {
        size.map_or("none".to_owned(), |[w, h]| format!("{w} \u{d7} {h}"))
    };
    match sizes.len() {
        0 | 1 => (text(sizes.first()), "px"),
        _ => (format!("{} to {}", text(sizes.first()), text(sizes.last())), "px"),
    }
}

/// Formats the samples per pixel that the recipe sets, and their unit or limit.
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
            format!("a pixel at most; a cell stops at an error of {}", number(least))
        }
        n => format!("a pixel; cells of {n} scenes stop at a target error"),
    };
    (count, note)
}

fn identity(run: &Run) -> Markup {
    let seeds: BTreeSet<u64> = run.lines.iter().map(|line| line.seed).collect();
    let seeds = match (seeds.first(), seeds.last()) {
        (Some(first), Some(last)) if first != last => {
            format!("{} different seeds, {first} to {last}", seeds.len())
        }
        (Some(only), _) => only.to_string(),
        _ => "none".to_owned(),
    };
    let golden = format!("{} {}", run.spec.golden.scene, run.spec.golden.blake3);
    let rows = [
        ("recipe", &run.spec.name),
        ("manifest, BLAKE3", &run.spec.manifest_blake3),
        ("golden shard", &golden),
        ("seeds of the scenes", &seeds),
    ];
    html! {
        div.box { table.rows { tbody {
            @for (name, value) in rows {
                tr { th scope="row" { (name) } td.mono { (value) } }
            }
            @if !run.spec.left_out.is_empty() {
                tr {
                    th scope="row" { "left out by the planner" }
                    td { (run.spec.left_out.len()) " with unusable files" }
                }
            }
        } } }
    }
}

fn splits(run: &Run, survey: &Survey) -> Markup {
    let mut counts: BTreeMap<Split, [u64; 3]> = BTreeMap::new();
    let mut split_of: BTreeMap<&str, Split> = BTreeMap::new();
    for line in &run.lines {
        counts.entry(line.split).or_default()[0] += 1;
        split_of.insert(line.id.as_str(), line.split);
    }
    for scene in &survey.done {
        counts.entry(run.lines[scene.index].split).or_default()[1] += 1;
    }
    for scene in &survey.status.counts.quarantined {
        if let Some(split) = split_of.get(scene.scene.as_str()) {
            counts.entry(*split).or_default()[2] += 1;
        }
    }
    let rows = html! {
        @for (split, counts) in counts {
            tr { td { (split) } @for count in counts { td.n { (grouped(count)) } } }
        }
    };
    table("Splits", &["split", "#scenes", "#tuples", "#quarantine"], &rows)
}

/// Draws a table of the sources and their uses.
fn sources(lines: &[SceneLine]) -> Markup {
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
    let rows = html! {
        @for (name, source) in sources {
            tr {
                td { (name) }
                td.n { (grouped(source.files.len() as u64)) }
                td.n { (grouped(source.fronts)) }
                td.n { (grouped(source.backs)) }
            }
        }
    };
    table("Sources", &["source", "#files", "#in front", "#reflected"], &rows)
}

/// Returns the named root of a path, or a description of paths without one.
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
