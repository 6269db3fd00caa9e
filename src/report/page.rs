//! `report/index.html`: all sections on one page that needs nothing else.

use super::errors::errors;
use super::evaluation::evaluation;
use super::glance::glance;
use super::parameters::{parameters, rejections};
use super::quarantine::{damaged, quarantine};
use super::seconds::seconds_of;
use super::sheet::sheet;
use super::survey::Survey;
use super::training::training;
use crate::html::{Html, cut};
use crate::run::Run;
use crate::store::{Store, StoreError};
use plan::read_rejected;
use render::atomic_file::{self, WriteError};
use render::ids::SceneId;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const STYLE: &str = concat!(
    include_str!("../serve/look.css"),
    include_str!("report.css")
);

/// Nothing is fetched and nothing runs, whatever stands in the page.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

/// The report cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The run's store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// A report that was made.
#[derive(Debug)]
pub struct Report {
    /// Where it is.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Scenes of the run.
    pub scenes: u64,
    /// Of them, those with a tuple.
    pub tuples: u64,
    /// Tuples with pictures on the page.
    pub shown: u64,
    /// Of them, those with a noise map.
    pub noise_maps: u64,
    /// Logs of workers that were added up.
    pub logs: u64,
    /// Tuples that are of no use, with the reason.
    pub damaged: Vec<(SceneId, String)>,
}

/// Writes the page of a run whose objects are in `store`, to `path` or into the run's folder. What is damaged is named on it
/// and in the answer.
pub fn write_report(run: &Run, store: &Store, path: Option<&Path>) -> Result<Report, ReportError> {
    let mut survey = Survey::of(run, store)?;
    let sheet = sheet(run, store, &survey)?;
    survey.damaged.extend(sheet.damaged);
    let mut tuples = damaged(&survey.damaged);
    tuples += &sheet.html;
    let page = page(run, &survey, &tuples);
    let path = path.map_or_else(|| run.dir.report().join("index.html"), Path::to_owned);
    if let Some(folder) = path.parent() {
        atomic_file::create_dir(folder)?;
    }
    atomic_file::write_relaxed(&path, page.as_bytes())?;
    Ok(Report {
        path,
        bytes: page.len() as u64,
        scenes: run.lines.len() as u64,
        tuples: survey.done.len() as u64,
        shown: sheet.shown as u64,
        noise_maps: sheet.noise_maps as u64,
        logs: survey.logs.len() as u64,
        damaged: survey.damaged,
    })
}

fn page(run: &Run, survey: &Survey, tuples: &str) -> String {
    let folder = run.dir.root();
    let sections = [
        ("glance", "The run at a glance", glance(run, survey)),
        ("tuples", "Tuples", tuples.to_owned()),
        (
            "errors",
            "Stated errors, and what they cost",
            errors(run, survey),
        ),
        ("seconds", "Where the seconds went", seconds_of(survey)),
        (
            "parameters",
            "Parameters",
            parameters(&run.lines) + &rejected(run),
        ),
        (
            "quarantine",
            "Quarantine",
            quarantine(&survey.overview.counts.quarantined),
        ),
        ("training", "Training", training(folder)),
        ("evaluation", "Evaluation", evaluation(folder)),
        ("again", "How to make it again", again(run)),
    ];
    let state = survey.overview.state.name();
    let name = Html(&run.spec.name);
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{name} - Glasshouse</title>\n<style>\n{STYLE}</style></head>\n<body><main>\n\
         <header><h1>{name}</h1><span class=\"state {state}\">{state}</span></header>\n\
         <nav aria-label=\"Sections\"><ul>",
    );
    for (id, title, _) in &sections {
        let _ = write!(html, "<li><a href=\"#{id}\">{title}</a></li>");
    }
    html += "</ul></nav>\n";
    for (id, title, content) in sections {
        let _ = write!(
            html,
            "<section class=\"card\" id=\"{id}\" aria-labelledby=\"{id}-title\"><h2 id=\"{id}-title\">{title}</h2>\n\
             {content}</section>\n"
        );
    }
    let _ = write!(
        html,
        "<footer><span>glasshouse {}</span><span>tracer version {}</span></footer>\n</main></body></html>\n",
        env!("CARGO_PKG_VERSION"),
        run.spec.tracer_version
    );
    html
}

/// Draws that were not kept; or why nothing is known of them.
fn rejected(run: &Run) -> String {
    match read_rejected(run.dir.rejected()) {
        Ok(rejected) => rejections(run.lines.len(), &rejected),
        Err((_, reason)) => format!(
            "<p class=\"bad\"><code>rejected.jsonl</code> cannot be read: {}</p>\n",
            Html(&cut(&reason, 500))
        ),
    }
}

/// Commands that make the same tuples.
fn again(run: &Run) -> String {
    let scene = run.lines.first().map_or("SCENE", |line| line.id.as_str());
    format!(
        "<p>The manifest holds every number of every scene. The same manifest, the same input files and tracer version {} make \
         the same tuples, bit for bit, on any machine; the manifest is that of the digest above.</p>\n\
         <pre tabindex=\"0\">glasshouse plan RUN/manifest.jsonl --out AGAIN    # or the recipe it was planned from; --root NAME=DIR for its sources\n\
         glasshouse work AGAIN\n\
         glasshouse report AGAIN\n\
         glasshouse render RUN/tuples/{scene}/tuple.json --out ONE    # one of them\n\
         glasshouse audit RUN    # some of them, compared bit for bit</pre>\n",
        run.spec.tracer_version
    )
}
