//! Where the seconds went, as workers wrote it down when they ended.

use super::stages::{BEFORE, STAGES, Stage, bar};
use super::survey::Survey;
use super::text::{counted, seconds, table};
use crate::html::{Html, cut};
use crate::run::WorkLog;
use crate::serve::text::grouped;
use std::fmt::Write;

/// Workers on the page.
const WORKERS_SHOWN: usize = 50;

/// A bar, a table of stages and one of workers.
pub(super) fn seconds_of(survey: &Survey) -> String {
    let logs = &survey.logs;
    let mut html = String::new();
    if !survey.damaged_logs.is_empty() {
        let names: Vec<&str> = survey.damaged_logs.iter().map(String::as_str).collect();
        let _ = writeln!(
            html,
            "<p class=\"bad\">{} cannot be read and left out: {}</p>",
            counted(names.len() as u64, "log"),
            Html(&cut(&names.join(", "), 500))
        );
    }
    if logs.is_empty() {
        return html
            + "<p class=\"dim\">No worker has left its log yet. One leaves it when it ends; one that is killed \
               leaves none.</p>\n";
    }
    let sum = |of: fn(&WorkLog) -> u64| logs.iter().map(of).sum::<u64>();
    let tuples = sum(|log| log.merged);
    let stages = stages(logs);
    let total: f64 = stages.iter().map(|stage| stage.cpu_s).sum();
    let threads: f64 = stages.iter().map(|stage| stage.thread_s).sum();
    let before = logs.iter().filter_map(|log| log.cpu_seconds.get(BEFORE));
    let before: f64 = before.sum();
    let wall: f64 = logs.iter().map(|log| log.wall_s).sum();
    let a_tuple = if tuples > 0 {
        format!(
            ": <b id=\"cpu-per-tuple\">{}</b> CPU seconds a tuple",
            seconds(total / tuples as f64)
        )
    } else {
        String::new()
    };
    let missing = (survey.done.len() as u64).saturating_sub(tuples);
    let missing = match missing {
        0 => String::new(),
        n => format!(
            " Of {} tuples nobody has left a log: their worker was killed, is still at work, or was of an older version.",
            grouped(n)
        ),
    };
    let _ = writeln!(
        html,
        "<p>{} wrote {} and traced {} in {} CPU seconds{a_tuple}. Before they began to work (planning, and the golden shard \
         that every machine traces first) they took {} more. Their wall seconds add up to {}; thread seconds of the stages, \
         waiting included, to {}.{missing}</p>",
        counted(logs.len() as u64, "worker"),
        counted(tuples, "tuple"),
        counted(sum(|log| log.shards_traced), "shard"),
        seconds(total),
        seconds(before),
        seconds(wall),
        seconds(threads),
    );
    html += &bar(&stages, total);
    html += &stage_table(&stages, total, tuples);
    html += "<h3>Workers</h3>\n";
    html += &workers(logs);
    html
}

/// What each stage took in all logs; stages of later versions come last.
fn stages(logs: &[WorkLog]) -> Vec<Stage> {
    let mut stages: Vec<Stage> = STAGES.iter().map(|known| Stage::known(*known)).collect();
    for log in logs {
        let at_work = log.cpu_seconds.iter().filter(|(name, _)| *name != BEFORE);
        for (name, s) in at_work {
            Stage::named(&mut stages, name).cpu_s += s;
        }
        for (name, s) in &log.thread_seconds {
            Stage::named(&mut stages, name).thread_s += s;
        }
    }
    stages
}

fn stage_table(stages: &[Stage], total: f64, tuples: u64) -> String {
    let mut rows = String::new();
    for stage in stages {
        let thread_s = if stage.thread_s > 0.0 {
            seconds(stage.thread_s).to_string()
        } else {
            String::new()
        };
        let a_tuple = if tuples > 0 {
            format!("{:.1}", 1e3 * stage.cpu_s / tuples as f64)
        } else {
            String::new()
        };
        let _ = writeln!(
            rows,
            "<tr id=\"stage-{0}\"><td><b style=\"color:{1}\">&#9632;</b> {0} <small>{2}</small></td><td class=\"n\">{3}</td>\
             <td class=\"n\">{4:.1} %</td><td class=\"n\">{a_tuple}</td><td class=\"n\">{thread_s}</td></tr>",
            Html(&stage.name),
            stage.colour,
            stage.what,
            seconds(stage.cpu_s),
            100.0 * stage.cpu_s / total.max(f64::MIN_POSITIVE),
        );
    }
    table(
        "Seconds by stage",
        &[
            "stage",
            "#CPU s",
            "#share",
            "#CPU ms a tuple",
            "#thread s, waiting included",
        ],
        &rows,
    )
}

fn workers(logs: &[WorkLog]) -> String {
    let mut rows = String::new();
    for log in logs.iter().take(WORKERS_SHOWN) {
        let child = if log.is_child {
            "a process for one scene"
        } else {
            ""
        };
        let cpu = log.cpu_seconds.iter().filter(|(name, _)| *name != BEFORE);
        let cpu: f64 = cpu.map(|(_, s)| s).sum();
        let end = match log.stopped.as_deref() {
            None => "at the end",
            Some("signal") => "by a signal",
            Some("time_limit") => "time was up",
            Some("drained") => "too many scenes failed",
            Some("cancelled") => "the run was cancelled",
            Some(other) => other,
        };
        let _ = writeln!(
            rows,
            "<tr><td>{}<small>{child}</small></td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td><td>{}</td></tr>",
            Html(&cut(&log.worker, 100)),
            log.threads,
            seconds(log.wall_s),
            seconds(cpu),
            grouped(log.merged),
            grouped(log.shards_traced),
            Html(&cut(&log.version, 40)),
            Html(&cut(end, 100)),
        );
    }
    let mut html = table(
        "Workers",
        &[
            "worker", "#threads", "#wall s", "#CPU s", "#tuples", "#shards", "version", "ended",
        ],
        &rows,
    );
    if let Some(more @ 1..) = logs.len().checked_sub(WORKERS_SHOWN) {
        let _ = writeln!(
            html,
            "<p class=\"dim\">and {more} more, see <code>RUN/logs/</code></p>"
        );
    }
    html
}
