//! The status page: one HTML file that needs nothing else, drawn from a view.
//!
//! It is whole without a script. The script fetches what changes every two seconds, drawn by the same code, and puts it
//! into place. Lists are cut: a page of 500 workers is read by nobody.

use super::text::{duration, grouped, percent, rate};
use super::view::{FarmState, FarmView, QuarantinedScene, RecentTuple, WorkerState, WorkerView};
use crate::html::{self, Html};
use render::trace::LAYERS;
use std::fmt::Write;

/// Workers on the page, those first that a person should look at.
const WORKERS_SHOWN: usize = 100;
/// Scenes in quarantine on the page.
const QUARANTINED_SHOWN: usize = 50;
/// Tuples on the page.
const TUPLES_SHOWN: usize = 6;
/// Characters of a reason and of a log's end on the page.
const TEXT_SHOWN: usize = 2000;

const STYLE: &str = concat!(include_str!("look.css"), include_str!("page.css"));
const SCRIPT: &str = include_str!("page.js");
/// The layers' symbols in the paper, in the order of [`LAYERS`].
const SYMBOLS: [&str; 4] = ["I", "T", "R&#771;", "R"];

/// The page. `nonce` marks its own style and script; `can_act` shows buttons, which ask for the token.
pub(super) fn page(view: &FarmView, nonce: &str, can_act: bool) -> String {
    let dialog = if can_act { DIALOG } else { "" };
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <link rel=\"icon\" href=\"data:,\">{}\
         <noscript><meta http-equiv=\"refresh\" content=\"10\"></noscript>\
         <style nonce=\"{nonce}\">\n{STYLE}</style></head>\n<body><main>\n\
         <div id=\"note\" class=\"card\" role=\"status\" hidden></div>\n{}\
         <footer><span>glasshouse {}</span><a href=\"/api/view\">JSON</a><a href=\"/metrics\">metrics</a></footer>\n\
         {dialog}</main><script nonce=\"{nonce}\">\n{SCRIPT}</script></body></html>\n",
        title(view),
        changing(view, can_act),
        Html(&view.version),
    )
}

/// What changes of a page: its title, and the element that is everything but frame and dialog.
pub(super) fn live(view: &FarmView, can_act: bool) -> String {
    title(view) + &changing(view, can_act)
}

fn title(view: &FarmView) -> String {
    format!(
        "<title>{:.1} % of {} &middot; {}</title>",
        percent(view.scenes.done, view.scenes.total),
        Html(&view.name),
        view.state.name(),
    )
}

fn changing(view: &FarmView, can_act: bool) -> String {
    let mut html = "<div id=\"live\">\n".to_owned();
    head(&mut html, view, can_act);
    alerts(&mut html, view);
    progress(&mut html, view);
    recent(&mut html, view);
    let class = if view.quarantined == 0 { "one" } else { "two" };
    let _ = writeln!(html, "<div class=\"{class}\">");
    workers(&mut html, view);
    quarantine(&mut html, view, can_act);
    html += "</div></div>\n";
    html
}

/// What a button asks before it acts. The token stays in its field, in memory, until the page is left.
const DIALOG: &str = "<dialog id=\"ask\"><p><b id=\"question\"></b></p><p><label for=\"token\">The coordinator's token</label>\
    <input id=\"token\" type=\"password\" autocomplete=\"off\" spellcheck=\"false\"></p>\
    <p class=\"bad\" id=\"refusal\" role=\"alert\"></p>\
    <p><button id=\"go\">Yes</button> <button id=\"leave\">No</button></p></dialog>\n\
    <noscript>The buttons need a script; <code>glasshouse pause RUN</code> does not.</noscript>\n";

fn head(html: &mut String, view: &FarmView, can_act: bool) {
    let state = view.state.name();
    let _ = write!(
        html,
        "<header><h1>{}</h1><span class=\"dim mono\" title=\"run\">{}</span>\
         <span class=\"state {state}\">{state}</span><span class=\"push\">",
        Html(&view.name),
        Html(&view.run),
    );
    if can_act {
        match view.state {
            FarmState::Running => button(
                html,
                "/api/pause",
                "Pause",
                "Begin nothing new? What is open is finished.",
            ),
            FarmState::Paused => button(html, "/api/resume", "Resume", "Go on?"),
            FarmState::Cancelled | FarmState::Finished => {}
        }
        if matches!(view.state, FarmState::Running | FarmState::Paused) {
            html.push(' ');
            button(
                html,
                "/api/cancel",
                "Cancel",
                "Give up what is left of this run? Its workers and its coordinator end.",
            );
        }
    }
    *html += "</span></header>\n";
}

fn button(html: &mut String, target: &str, text: &str, question: &str) {
    let _ = write!(
        html,
        "<button data-post=\"{target}\" data-ask=\"{question}\">{text}</button>"
    );
}

/// What cannot wait until someone reads the tables.
fn alerts(html: &mut String, view: &FarmView) {
    if !view.queue.connected {
        let reason = view.queue.reason.as_deref().unwrap_or("it does not answer");
        let _ = writeln!(
            html,
            "<div class=\"card alert\" data-key=\"queue\"><b class=\"bad\">No queue.</b> {} Workers finish what they hold; \
             the coordinator keeps trying.</div>",
            Html(&sentence(reason)),
        );
    }
    let unfinished = matches!(view.state, FarmState::Running);
    if unfinished && view.workers.iter().all(|w| w.state == WorkerState::Silent) {
        *html += "<div class=\"card alert\" data-key=\"workers\"><b class=\"bad\">No worker.</b> Nothing is traced until one \
                  starts: <code>glasshouse work RUN --queue URL</code></div>\n";
    }
}

/// A reason as a sentence: with a full stop.
fn sentence(reason: &str) -> String {
    let reason = cut(reason, TEXT_SHOWN, false);
    if reason.ends_with(['.', '!', '?']) {
        reason
    } else {
        reason + "."
    }
}

fn progress(html: &mut String, view: &FarmView) {
    let scenes = view.scenes;
    let done = percent(scenes.done, scenes.total);
    // Wide enough to be seen, however few they are.
    let lost = match (view.quarantined, scenes.total) {
        (0, _) | (_, 0) => 0.0,
        (lost, total) => (lost as f64 / total as f64 * 100.0).clamp(0.3, 100.0),
    };
    let lost_x = done.min(100.0 - lost);
    let _ = write!(
        html,
        "<section class=\"card\"><div class=\"big\"><b id=\"done\">{}</b><span>of {} scenes</span>\
         <span class=\"push dim\">{done:.1} %</span></div>\
         <svg class=\"bar\" role=\"img\" aria-label=\"{done:.1} % of the scenes are done\" viewBox=\"0 0 100 1\" \
         preserveAspectRatio=\"none\"><rect class=\"done\" width=\"{done}\" height=\"1\"/>\
         <rect class=\"out\" x=\"{lost_x:.2}\" width=\"{lost:.2}\" height=\"1\"/></svg><dl class=\"facts\">",
        grouped(scenes.done),
        grouped(scenes.total),
    );
    let (eta, eta_note) = match (view.state, view.eta_s) {
        (FarmState::Finished, _) => ("none".to_owned(), ""),
        (FarmState::Paused | FarmState::Cancelled, _) | (_, None) => ("unknown".to_owned(), ""),
        (FarmState::Running, Some(s)) => (duration(s), "at this rate"),
    };
    fact(html, "Time left", &eta, eta_note, "");
    let (rate, unit) = view
        .rate_scenes_per_s
        .map_or(("unknown".to_owned(), ""), rate);
    fact(html, "Rate", &rate, unit, "");
    let shards = format!("of {}", grouped(view.shards.total));
    fact(html, "Shards", &grouped(view.shards.done), &shards, "");
    let count = |state| view.workers.iter().filter(|w| w.state == state).count() as u64;
    let silent = count(WorkerState::Silent);
    let (note, class) = match silent {
        0 => (
            format!("working, of {}", grouped(view.workers.len() as u64)),
            "",
        ),
        n => (format!("working, {} silent", grouped(n)), "bad"),
    };
    let working = grouped(count(WorkerState::Working));
    fact(html, "Workers", &working, &note, class);
    if view.queue.connected {
        let number = |n: Option<u64>| n.map_or("unknown".to_owned(), grouped);
        let note = format!("waiting, {} held", number(view.queue.spans_held));
        fact(html, "Queue", &number(view.queue.spans_waiting), &note, "");
    } else {
        fact(html, "Queue", "lost", "", "bad");
    }
    let class = if view.quarantined == 0 { "" } else { "bad" };
    fact(
        html,
        "Quarantine",
        &grouped(view.quarantined),
        "scenes",
        class,
    );
    *html += "</dl></section>\n";
}

fn fact(html: &mut String, name: &str, value: &str, note: &str, class: &str) {
    let _ = write!(
        html,
        "<div class=\"{class}\"><dt>{name}</dt><dd>{value} <small>{note}</small></dd></div>"
    );
}

fn recent(html: &mut String, view: &FarmView) {
    if view.recent.is_empty() {
        return;
    }
    *html += "<section class=\"card\" data-key=\"recent\"><h2>Latest tuples</h2><div class=\"tuples\">\n";
    for tuple in view.recent.iter().take(TUPLES_SHOWN) {
        tuple_card(html, tuple, &view.run);
    }
    *html += "</div></section>\n";
}

fn tuple_card(html: &mut String, tuple: &RecentTuple, run: &str) {
    let scene = tuple.scene.as_str();
    let _ = write!(
        html,
        "<div class=\"tuple\" data-key=\"{scene}\"><p><b class=\"mono\">{scene}</b><span class=\"dim\">{} ago",
        duration(tuple.age_s)
    );
    if let Some(worker) = &tuple.worker {
        let _ = write!(html, " &middot; {}", Html(&cut(worker, 80, false)));
    }
    if let Some(share) = tuple.miss_share.filter(|share| *share > 0.0) {
        let _ = write!(html, " &middot; {:.2} % missed", share * 100.0);
    }
    *html += "</span></p><div class=\"layers\">";
    for (layer, symbol) in LAYERS.iter().zip(SYMBOLS) {
        if tuple.layers.iter().any(|l| l == layer) {
            // The run is in the address because a browser keeps pictures, and the next run may have the same scenes.
            let _ = write!(
                html,
                "<figure title=\"{layer}\"><img loading=\"lazy\" alt=\"{layer} of {scene}\" \
                 src=\"/thumbnails/{scene}/{layer}.png?run={}\"><figcaption>{symbol}</figcaption></figure>",
                Html(run),
            );
        }
    }
    *html += "</div></div>\n";
}

fn workers(html: &mut String, view: &FarmView) {
    let mut all: Vec<&WorkerView> = view.workers.iter().collect();
    let urgency = |w: &WorkerView| WorkerState::ALL.iter().position(|s| *s == w.state);
    all.sort_by(|a, b| {
        let by_age = b.last_progress_s.total_cmp(&a.last_progress_s);
        (urgency(a).cmp(&urgency(b)))
            .then(by_age)
            .then_with(|| a.name.cmp(&b.name))
    });
    let _ = write!(
        html,
        "<section class=\"card\" data-key=\"workers\"><h2>Workers <small>{}</small></h2>",
        grouped(all.len() as u64)
    );
    if all.is_empty() {
        *html += "<span class=\"dim\">none has been heard of</span></section>\n";
        return;
    }
    *html += "<div class=\"scroll\" tabindex=\"0\"><table><thead><tr><th>worker</th><th>state</th><th class=\"n\">progress</th>\
              <th>in hand</th><th class=\"n\">shards</th></tr></thead><tbody>\n";
    for worker in all.iter().take(WORKERS_SHOWN) {
        worker_row(html, worker, &view.version);
    }
    *html += "</tbody></table>";
    more(html, all.len() as u64, WORKERS_SHOWN, "workers");
    *html += "</div></section>\n";
}

fn worker_row(html: &mut String, worker: &WorkerView, version: &str) {
    let state = worker.state.name();
    let class = match worker.state {
        WorkerState::Silent => " class=\"alarm\"",
        _ => "",
    };
    let name = Html(&worker.name);
    let _ = write!(
        html,
        "<tr{class} data-key=\"{name}\"><td>{name}<small>{}",
        Html(&worker.host)
    );
    // Of one that has made nothing yet it is not known.
    if !worker.version.is_empty() && worker.version != version {
        let _ = write!(
            html,
            " <b class=\"bad\">version {}</b>",
            Html(&worker.version)
        );
    }
    let _ = write!(
        html,
        "</small></td><td><span class=\"state {state}\">{state}</span></td><td class=\"n\">{} ago</td><td class=\"mono\">",
        duration(worker.last_progress_s),
    );
    if let Some(scene) = &worker.scene {
        *html += scene.as_str();
        if let Some(shard) = worker.shard {
            let _ = write!(html, " <span class=\"dim\">#{shard}</span>");
        }
    }
    let shards = grouped(worker.shards_done);
    let _ = writeln!(html, "</td><td class=\"n\">{shards}</td></tr>");
}

fn quarantine(html: &mut String, view: &FarmView, can_act: bool) {
    if view.quarantined == 0 && view.quarantine.is_empty() {
        return;
    }
    let _ = writeln!(
        html,
        "<section class=\"card\" data-key=\"quarantine\"><h2>Quarantine <small>{}</small></h2>\
         <div class=\"scroll\" tabindex=\"0\">",
        grouped(view.quarantined)
    );
    let shown = &view.quarantine[..view.quarantine.len().min(QUARANTINED_SHOWN)];
    for scene in shown {
        quarantined_scene(html, scene, can_act);
    }
    more(html, view.quarantined, shown.len(), "scenes");
    *html += "</div></section>\n";
}

fn quarantined_scene(html: &mut String, record: &QuarantinedScene, can_act: bool) {
    let scene = record.scene.as_str();
    let _ = write!(
        html,
        "<div class=\"lost\" data-key=\"{scene}\"><header><b class=\"mono\">{scene}</b><span class=\"push\">"
    );
    if can_act {
        let question = format!("Try {scene} again?");
        button(html, &format!("/api/retry/{scene}"), "Retry", &question);
    }
    let reason = cut(&record.reason, TEXT_SHOWN, false);
    let _ = write!(html, "</span></header><p>{}</p>", Html(&reason));
    if let Some(log) = &record.log_tail {
        let log = cut(log.trim_end(), TEXT_SHOWN, true);
        let _ = write!(
            html,
            "<details><summary>end of the log</summary><pre>{}</pre></details>",
            Html(&log)
        );
    }
    *html += "</div>\n";
}

/// How many of a list are not shown.
fn more(html: &mut String, all: u64, shown: usize, what: &str) {
    let rest = all.saturating_sub(shown as u64);
    if rest > 0 {
        let _ = write!(
            html,
            "<p class=\"dim\">and {} more {what}; all are in <a href=\"/api/view\">JSON</a></p>",
            grouped(rest)
        );
    }
}

/// At most `limit` characters of a text, its first or its last.
fn cut(text: &str, limit: usize, last: bool) -> String {
    let count = text.chars().count();
    if last && count > limit {
        let rest: String = text.chars().skip(count - limit).collect();
        format!("…{rest}")
    } else {
        html::cut(text, limit)
    }
}
