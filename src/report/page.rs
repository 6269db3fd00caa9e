//! Joins all sections into one self-contained page, `report/index.html`.

use super::errors::errors;
use super::evaluation::evaluation;
use super::glance::glance;
use super::parameters::{parameters, rejections};
use super::quarantine::{damaged, quarantine};
use super::seconds::seconds_of;
use super::sheet::sheet;
use super::survey::Survey;
use super::training::training;
use crate::run::{Run, keys};
use crate::store::{Store, StoreError};
use crate::text::{cut, printable};
use glasshouse_line::ids::SceneId;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use plan::read_rejected;
use render::atomic_file::{self, WriteError};
use std::path::{Path, PathBuf};

const STYLE: &str = concat!(include_str!("../serve/look.css"), include_str!("report.css"));

/// Content security policy that forbids all requests and scripts.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    Store(#[from] StoreError),
}

#[derive(Debug)]
pub struct Report {
    pub path: PathBuf,
    pub bytes: u64,
    /// Number of scenes in the run.
    pub scenes: u64,
    /// Number of scenes with a tuple.
    pub tuples: u64,
    /// Number of tuples with pictures on the page.
    pub shown: u64,
    /// Number of noise maps on the page.
    pub noise_maps: u64,
    /// Number of workers' logs that the page sums up.
    pub logs: u64,
    /// Scenes with unusable tuples, and the reasons.
    pub damaged: Vec<(SceneId, String)>,
}

/// True if the bytes start like a report page.
pub(crate) fn is_report(bytes: &[u8]) -> bool {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]);
    let doctype = head.trim_start().get(..9).is_some_and(|s| s.eq_ignore_ascii_case("<!doctype"));
    doctype && head.contains(" - Glasshouse</title>")
}

/// Reads a run's objects from `store` and writes its page to `path`, or into the run's folder if `path` is `None`. The
/// page and the result name damaged tuples.
pub fn write_report(run: &Run, store: &Store, path: Option<&Path>) -> Result<Report, ReportError> {
    let mut survey = Survey::of(run, store)?;
    let sheet = sheet(run, store, &survey)?;
    survey.damaged.extend(sheet.damaged);
    let tuples = html! { (damaged(&survey.damaged)) (sheet.html) };
    let page = printable(page(run, &survey, tuples).into_string());
    let path = path.map_or_else(|| run.path(keys::REPORT), Path::to_owned);
    if let Some(folder) = path.parent() {
        atomic_file::create_dir(folder)?;
    }
    atomic_file::write_whole(&path, page.as_bytes())?;
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

fn page(run: &Run, survey: &Survey, tuples: Markup) -> Markup {
    let folder = run.root();
    let parameters = html! { (parameters(&run.lines)) (rejected(run)) };
    let sections = [
        ("glance", "The run at a glance", glance(run, survey)),
        ("tuples", "Tuples", tuples),
        ("errors", "Stated errors and their cost", errors(run, survey)),
        ("seconds", "Where the seconds went", seconds_of(survey)),
        ("parameters", "Parameters", parameters),
        ("quarantine", "Quarantine", quarantine(&survey.status.counts.quarantined)),
        ("training", "Training", training(folder)),
        ("evaluation", "Evaluation", evaluation(folder)),
        ("again", "How to make the run again", again(run)),
    ];
    let state = survey.status.state.name();
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (run.spec.name) " - Glasshouse" }
                style { (PreEscaped(STYLE)) }
            }
            body { main {
                header { h1 { (run.spec.name) } span.state.(state) { (state) } }
                nav aria-label="Sections" { ul {
                    @for (id, title, _) in &sections { li { a href={ "#" (id) } { (title) } } }
                } }
                @for (id, title, content) in &sections {
                    section.card id=(id) aria-labelledby={ (id) "-title" } {
                        h2 id={ (id) "-title" } { (title) }
                        (content)
                    }
                }
                footer {
                    span { "glasshouse " (env!("CARGO_PKG_VERSION")) }
                    span { "tracer version " (run.spec.tracer_version) }
                }
            } }
        }
    }
}

/// Draws the table of rejected draws, or the error of reading them.
fn rejected(run: &Run) -> Markup {
    match read_rejected(run.path(keys::REJECTED)) {
        Ok(rejected) => rejections(run.lines.len(), &rejected),
        Err((_, reason)) => html! {
            p.bad { code { "rejected.jsonl" } " cannot be read: " (cut(&reason, 500)) }
        },
    }
}

/// Lists the commands that make the same tuples again and check them.
fn again(run: &Run) -> Markup {
    let scene = run.lines.first().map_or("SCENE", |line| line.id.as_str());
    html! {
        p {
            "The manifest holds every number of every scene. The same manifest, the same input files and tracer version "
            (run.spec.tracer_version)
            " make the same tuples, bit for bit, on any machine. The digest above identifies the manifest."
        }
        pre tabindex="0" {
            "glasshouse plan RUN/manifest.jsonl --out AGAIN    # or the run's recipe; --root NAME=DIR for each source\n"
            "glasshouse work AGAIN\n"
            "glasshouse report AGAIN\n"
            "glasshouse render RUN/tuples/" (scene) "/tuple.json --out ONE    # one tuple\n"
            "glasshouse audit RUN    # traces some scenes again and compares bit for bit"
        }
    }
}
