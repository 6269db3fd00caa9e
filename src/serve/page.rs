//! Draws the status page from a view, as one HTML file with its style and script.
//!
//! The page is complete without its script. Every two seconds, the script fetches the changing part, which the same
//! code draws, and updates the elements that differ. The page shortens long lists.

use super::view::{FarmView, QuarantinedScene, RecentTuple, WorkerState, WorkerView};
use crate::plot::PAPER_SYMBOLS;
use crate::run::RunState;
use crate::text::{cut, duration, grouped, percent, printable, rate};
use glasshouse_line::layer::Layer;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Maximum number of workers on the page; the most urgent come first.
const WORKERS_SHOWN: usize = 100;
/// Maximum number of scenes in quarantine on the page.
const QUARANTINED_SHOWN: usize = 50;
/// Maximum number of tuples on the page.
const TUPLES_SHOWN: usize = 6;
/// Maximum length of a reason and of a log's end on the page, in characters.
const TEXT_SHOWN: usize = 2000;

const STYLE: &str = concat!(include_str!("look.css"), include_str!("page.css"));
const SCRIPT: &str = include_str!("page.js");

/// Draws the page. `nonce` marks style and script; `can_act` adds buttons, which ask for the token.
pub(super) fn page(view: &FarmView, nonce: &str, can_act: bool) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                link rel="icon" href="data:,";
                (title(view))
                noscript { meta http-equiv="refresh" content="10"; }
                style nonce=(nonce) { (PreEscaped(STYLE)) }
            }
            body {
                main {
                    div #note.card role="status" hidden {}
                    (changing(view, can_act))
                    footer {
                        span { "glasshouse " (view.version) }
                        a href="/api/view" { "JSON" }
                        a href="/metrics" { "metrics" }
                    }
                    @if can_act { (dialog()) }
                }
                script nonce=(nonce) { (PreEscaped(SCRIPT)) }
            }
        }
    };
    printable(page.into_string()).into_owned()
}

/// Draws the changing parts of a page: the title, and the element with all content except note, footer and dialog.
pub(super) fn live(view: &FarmView, can_act: bool) -> String {
    let parts = html! { (title(view)) (changing(view, can_act)) };
    printable(parts.into_string()).into_owned()
}

fn title(view: &FarmView) -> Markup {
    let done = percent(view.scenes.done, view.scenes.total);
    html! { title { (format_args!("{done:.1}")) " % of " (view.name) " \u{b7} " (view.state.name()) } }
}

fn changing(view: &FarmView, can_act: bool) -> Markup {
    let columns = if view.quarantined == 0 { "one" } else { "two" };
    html! {
        div #live {
            (head(view, can_act))
            (alerts(view))
            (progress(view))
            (recent(view))
            div.(columns) { (workers(view)) (quarantine(view, can_act)) }
        }
    }
}

/// Draws the dialog that confirms an action. The token stays in its field, in memory, until the user leaves the page.
fn dialog() -> Markup {
    html! {
        dialog #ask {
            p { b #question {} }
            p {
                label for="token" { "The coordinator's token" }
                input #token type="password" autocomplete="off" spellcheck="false";
            }
            p.bad #refusal role="alert" {}
            p { button #go { "Yes" } " " button #leave { "No" } }
        }
        noscript { "The buttons need JavaScript; " code { "glasshouse pause RUN" } " works without it." }
    }
}

fn head(view: &FarmView, can_act: bool) -> Markup {
    let state = view.state.name();
    let is_open = matches!(view.state, RunState::Running | RunState::Paused);
    html! {
        header {
            h1 { (view.name) }
            span.dim.mono title="run" { (view.run) }
            span.state.(state) { (state) }
            span.push {
                @if can_act && is_open {
                    @if view.state == RunState::Running {
                        (button("/api/pause", "Pause", "Pause this run? Workers finish their open scenes."))
                    } @else {
                        (button("/api/resume", "Resume", "Resume this run?"))
                    }
                    " "
                    (button("/api/cancel", "Cancel", "Cancel the rest of this run? Its workers and its coordinator exit."))
                }
            }
        }
    }
}

fn button(target: &str, text: &str, question: &str) -> Markup {
    html! { button data-post=(target) data-ask=(question) { (text) } }
}

fn alerts(view: &FarmView) -> Markup {
    let is_lost = |worker: &WorkerView| worker.state == WorkerState::Lost;
    html! {
        @if !view.queue.connected {
            @let reason = view.queue.reason.as_deref().unwrap_or("the server does not answer");
            div.card.alert data-key="queue" {
                b.bad { "No queue:" } " " (sentence(reason))
                " Workers finish their leased tasks; the coordinator keeps trying."
            }
        }
        @if view.state == RunState::Running && view.workers.iter().all(is_lost) {
            div.card.alert data-key="workers" {
                b.bad { "No worker." } " The run continues when a worker starts: "
                code { "glasshouse work RUN --queue URL" }
            }
        }
    }
}

/// Shortens a reason, and adds a full stop unless the reason ends like a sentence.
fn sentence(reason: &str) -> String {
    let reason = cut(reason, TEXT_SHOWN);
    if reason.ends_with(['.', '!', '?']) { reason } else { reason + "." }
}

fn progress(view: &FarmView) -> Markup {
    let scenes = view.scenes;
    let done = percent(scenes.done, scenes.total);
    // The bar of scenes in quarantine is always wide enough to be visible.
    let lost = match (view.quarantined, scenes.total) {
        (0, _) | (_, 0) => 0.0,
        (lost, total) => (lost as f64 / total as f64 * 100.0).clamp(0.3, 100.0),
    };
    let lost_x = done.min(100.0 - lost);
    html! {
        section.card {
            div.big {
                b #done { (grouped(scenes.done)) }
                span { "of " (grouped(scenes.total)) " scenes" }
                span.push.dim { (format_args!("{done:.1} %")) }
            }
            svg.bar role="img" aria-label=(format_args!("{done:.1} % of the scenes are done")) viewBox="0 0 100 1"
                preserveAspectRatio="none" {
                rect.done width=(done) height="1" {}
                rect.out x=(format_args!("{lost_x:.2}")) width=(format_args!("{lost:.2}")) height="1" {}
            }
            (facts(view))
        }
    }
}

fn facts(view: &FarmView) -> Markup {
    let (eta, eta_note) = match (view.state, view.eta_s) {
        (RunState::Finished, _) => ("none".to_owned(), ""),
        (RunState::Paused | RunState::Cancelled, _) | (_, None) => ("unknown".to_owned(), ""),
        (RunState::Running, Some(s)) => (duration(s), "at this rate"),
    };
    let rate = view.rate_scenes_per_s.map(rate);
    let (rate, unit) = rate.unwrap_or(("unknown".to_owned(), ""));
    let shards = format!("of {}", grouped(view.shards.total));
    let count = |state| view.workers.iter().filter(|w| w.state == state).count() as u64;
    let (workers, workers_class) = match count(WorkerState::Lost) {
        0 => {
            let all = grouped(view.workers.len() as u64);
            (format!("working, of {all}"), "")
        }
        lost => (format!("working, {} lost", grouped(lost)), "bad"),
    };
    let number = |n: Option<u64>| n.map_or("unknown".to_owned(), grouped);
    let held = format!("waiting, {} held", number(view.queue.spans_held));
    let lost_class = if view.quarantined == 0 { "" } else { "bad" };
    html! {
        dl.facts {
            (fact("Time left", &eta, eta_note, ""))
            (fact("Rate", &rate, unit, ""))
            (fact("Shards", &grouped(view.shards.done), &shards, ""))
            (fact("Workers", &grouped(count(WorkerState::Working)), &workers, workers_class))
            @if view.queue.connected {
                (fact("Queue", &number(view.queue.spans_waiting), &held, ""))
            } @else {
                (fact("Queue", "lost", "", "bad"))
            }
            (fact("Quarantine", &grouped(view.quarantined), "scenes", lost_class))
        }
    }
}

fn fact(name: &str, value: &str, note: &str, class: &str) -> Markup {
    html! { div class=(class) { dt { (name) } dd { (value) " " small { (note) } } } }
}

fn recent(view: &FarmView) -> Markup {
    html! {
        @if !view.recent.is_empty() {
            section.card data-key="recent" {
                h2 { "Latest tuples" }
                div.tuples {
                    @for tuple in view.recent.iter().take(TUPLES_SHOWN) { (tuple_card(tuple, &view.run)) }
                }
            }
        }
    }
}

fn tuple_card(tuple: &RecentTuple, run: &str) -> Markup {
    let scene = tuple.scene.as_str();
    let has = |layer: &str| tuple.layers.iter().any(|l| l == layer);
    html! {
        div.tuple data-key=(scene) {
            p {
                b.mono { (scene) }
                span.dim {
                    (duration(tuple.age_s)) " ago"
                    @if let Some(worker) = &tuple.worker { " \u{b7} " (cut(worker, 80)) }
                    @if let Some(share) = tuple.miss_share.filter(|share| *share > 0.0) {
                        " \u{b7} " (format_args!("{:.2} % missed", share * 100.0))
                    }
                }
            }
            div.layers {
                @for (layer, symbol) in Layer::NAMES.iter().zip(PAPER_SYMBOLS.0).filter(|(layer, _)| has(layer)) {
                    figure title=(layer) {
                        // The address contains the run, because browsers cache pictures and another run may have the
                        // same scenes.
                        img loading="lazy" alt={ (layer) " of " (scene) }
                            src={ "/thumbnails/" (scene) "/" (layer) ".png?run=" (run) };
                        figcaption { (symbol) }
                    }
                }
            }
        }
    }
}

fn workers(view: &FarmView) -> Markup {
    let mut all: Vec<&WorkerView> = view.workers.iter().collect();
    let urgency = |w: &WorkerView| WorkerState::ALL.iter().position(|s| *s == w.state);
    all.sort_by(|a, b| {
        let by_age = b.last_progress_s.total_cmp(&a.last_progress_s);
        (urgency(a).cmp(&urgency(b))).then(by_age).then_with(|| a.name.cmp(&b.name))
    });
    let count = all.len() as u64;
    html! {
        section.card data-key="workers" {
            h2 { "Workers " small { (grouped(count)) } }
            @if all.is_empty() {
                span.dim { "none known" }
            } @else {
                div.scroll tabindex="0" {
                    table {
                        thead { tr {
                            th { "worker" } th { "state" } th.n { "last sign" } th { "in hand" } th.n { "shards" }
                        } }
                        tbody {
                            @for worker in all.iter().take(WORKERS_SHOWN) { (worker_row(worker, &view.version)) }
                        }
                    }
                    (more(count, WORKERS_SHOWN, "workers"))
                }
            }
        }
    }
}

fn worker_row(worker: &WorkerView, version: &str) -> Markup {
    let state = worker.state.name();
    let class = (worker.state == WorkerState::Lost).then_some("alarm");
    // The version of a worker is unknown before its first tuple.
    let is_other = !worker.version.is_empty() && worker.version != version;
    html! {
        tr class=[class] data-key=(worker.name) {
            td {
                (worker.name)
                small { (worker.host) @if is_other { " " b.bad { "version " (worker.version) } } }
            }
            td { span.state.(state) { (state) } }
            td.n { (duration(worker.last_progress_s)) " ago" }
            td.mono {
                @if let Some(scene) = &worker.scene {
                    (scene.as_str())
                    @if let Some(shard) = worker.shard { " " span.dim { "#" (shard) } }
                }
            }
            td.n { (grouped(worker.shards_done)) }
        }
    }
}

fn quarantine(view: &FarmView, can_act: bool) -> Markup {
    if view.quarantined == 0 && view.quarantine.is_empty() {
        return html! {};
    }
    let shown = &view.quarantine[..view.quarantine.len().min(QUARANTINED_SHOWN)];
    html! {
        section.card data-key="quarantine" {
            h2 { "Quarantine " small { (grouped(view.quarantined)) } }
            div.scroll tabindex="0" {
                @for scene in shown { (quarantined_scene(scene, can_act)) }
                (more(view.quarantined, shown.len(), "scenes"))
            }
        }
    }
}

fn quarantined_scene(record: &QuarantinedScene, can_act: bool) -> Markup {
    let scene = record.scene.as_str();
    html! {
        div.aside data-key=(scene) {
            header {
                b.mono { (scene) }
                span.push {
                    @if can_act { (button(&format!("/api/retry/{scene}"), "Retry", &format!("Try {scene} again?"))) }
                }
            }
            p { (cut(&record.reason, TEXT_SHOWN)) }
            @if let Some(log) = &record.log_tail {
                details { summary { "end of the log" } pre { (end(log.trim_end(), TEXT_SHOWN)) } }
            }
        }
    }
}

/// Draws the number of entries that are not shown.
fn more(all: u64, shown: usize, what: &str) -> Markup {
    let rest = all.saturating_sub(shown as u64);
    html! {
        @if rest > 0 {
            p.dim { "and " (grouped(rest)) " more " (what) "; all are in " a href="/api/view" { "JSON" } }
        }
    }
}

/// Returns the last `limit` characters of a text, after an ellipsis if the text is longer.
fn end(text: &str, limit: usize) -> String {
    match text.chars().count().saturating_sub(limit) {
        0 => text.to_owned(),
        more => format!("…{}", text.chars().skip(more).collect::<String>()),
    }
}
