//! Seconds by stage and worker, from the logs that workers write when they end.

use super::stages::{BEFORE, STAGES, Stage, bar};
use super::survey::Survey;
use super::text::{seconds, table};
use crate::run::WorkLog;
use crate::text::{cut, grouped, many};
use maud::{Markup, html};

/// Maximum number of workers on the page.
const WORKERS_SHOWN: usize = 50;

/// Draws the section: a bar, a table of stages and a table of workers.
pub(super) fn seconds_of(survey: &Survey) -> Markup {
    let logs = &survey.logs;
    let damaged = &survey.damaged_logs;
    html! {
        @if !damaged.is_empty() {
            @let names: Vec<&str> = damaged.iter().map(String::as_str).collect();
            p.bad {
                (many(names.len() as u64, "log")) " cannot be read: " (cut(&names.join(", "), 500))
            }
        }
        @if logs.is_empty() {
            p.dim {
                "No worker has left its log yet. A worker leaves its log when it ends; a worker that is killed leaves none."
            }
        } @else {
            (all_seconds(survey))
        }
    }
}

fn all_seconds(survey: &Survey) -> Markup {
    let logs = &survey.logs;
    let sum = |of: fn(&WorkLog) -> u64| logs.iter().map(of).sum::<u64>();
    let tuples = sum(|log| log.merged);
    let stages = stages(logs);
    let total: f64 = stages.iter().map(|stage| stage.cpu_s).sum();
    let threads: f64 = stages.iter().map(|stage| stage.thread_s).sum();
    let before = logs.iter().filter_map(|log| log.cpu_seconds.get(BEFORE));
    let before: f64 = before.sum();
    let wall: f64 = logs.iter().map(|log| log.wall_s).sum();
    let missing = (survey.done.len() as u64).saturating_sub(tuples);
    html! {
        p {
            (many(logs.len() as u64, "worker")) " wrote " (many(tuples, "tuple")) " and traced "
            (many(sum(|log| log.shards_traced), "shard")) " in " (seconds(total)) " CPU seconds"
            @if tuples > 0 {
                ": " b #cpu-per-tuple { (seconds(total / tuples as f64)) } " CPU seconds a tuple"
            }
            ". Before the work, planning and the golden shard, which every machine traces first, took "
            (seconds(before)) " more CPU seconds. The workers' wall seconds add up to " (seconds(wall))
            ", the thread seconds of the stages, waiting included, to " (seconds(threads)) "."
            @if missing > 0 {
                " No log has the cost of " (many(missing, "tuple")) ": their workers were killed, are still running, \
                or have an older version."
            }
        }
        (bar(&stages, total))
        (stage_table(&stages, total, tuples))
        h3 { "Workers" }
        (workers(logs))
    }
}

/// Sums all logs by stage; stages of later versions come last.
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

fn stage_table(stages: &[Stage], total: f64, tuples: u64) -> Markup {
    let rows = html! {
        @for stage in stages {
            tr id={ "stage-" (stage.name) } {
                td { b style={ "color:" (stage.colour) } { "\u{25a0}" } " " (stage.name) " " small { (stage.what) } }
                td.n { (seconds(stage.cpu_s)) }
                td.n { (format_args!("{:.1} %", 100.0 * stage.cpu_s / total.max(f64::MIN_POSITIVE))) }
                td.n { @if tuples > 0 { (format_args!("{:.1}", 1e3 * stage.cpu_s / tuples as f64)) } }
                td.n { @if stage.thread_s > 0.0 { (seconds(stage.thread_s)) } }
            }
        }
    };
    let heads = ["stage", "#CPU s", "#share", "#CPU ms a tuple", "#thread s, waiting included"];
    table("Seconds by stage", &heads, &rows)
}

fn workers(logs: &[WorkLog]) -> Markup {
    let cpu_s = |log: &WorkLog| -> f64 {
        let cpu = log.cpu_seconds.iter().filter(|(name, _)| *name != BEFORE);
        cpu.map(|(_, s)| s).sum()
    };
    let end = |log: &WorkLog| match log.stopped.as_deref() {
        None => "no work left".to_owned(),
        Some("signal") => "signal".to_owned(),
        Some("time_limit") => "time limit".to_owned(),
        Some("drained") => "too many failed scenes".to_owned(),
        Some("cancelled") => "cancelled run".to_owned(),
        Some(other) => cut(other, 100),
    };
    let rows = html! {
        @for log in logs.iter().take(WORKERS_SHOWN) {
            tr {
                td { (cut(&log.worker, 100)) small { @if log.is_child { "sandbox of one scene" } } }
                td.n { (log.threads) }
                td.n { (seconds(log.wall_s)) }
                td.n { (seconds(cpu_s(log))) }
                td.n { (grouped(log.merged)) }
                td.n { (grouped(log.shards_traced)) }
                td { (cut(&log.version, 40)) }
                td { (end(log)) }
            }
        }
    };
    let heads = ["worker", "#threads", "#wall s", "#CPU s", "#tuples", "#shards", "version", "end"];
    let rest = logs.len().saturating_sub(WORKERS_SHOWN);
    html! {
        (table("Workers", &heads, &rows))
        @if rest > 0 { p.dim { "and " (rest) " more, see " code { "RUN/logs/" } } }
    }
}
