//! Formats a run's status as text.

use crate::farm::queue::QueueState;
use crate::run::{EndKind, RunState, StandingAttempt, Status};
use crate::text::{cut as shorten, duration, grouped, many, percent, rate};
use serde::{Serialize, Serializer};
use std::fmt::Write;

/// Width of the bar, in characters.
const BAR: usize = 40;
/// Largest length of a reason, in characters.
const REASON: usize = 160;

pub(super) enum Queue {
    /// The command line names no queue, or the run is finished.
    None,
    There(QueueState),
    /// The queue does not answer, for this reason.
    Lost(String),
}

impl Serialize for Queue {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct State<'a> {
            spans_waiting: Option<u64>,
            spans_held: Option<u64>,
            reason: Option<&'a str>,
        }
        let (spans_waiting, spans_held, reason) = match self {
            Self::None => return serializer.serialize_none(),
            Self::There(state) => (Some(state.waiting), Some(state.held), None),
            Self::Lost(reason) => (None, None, Some(reason.as_str())),
        };
        State { spans_waiting, spans_held, reason }.serialize(serializer)
    }
}

/// Formats rate and time left, if they are known.
fn pace(view: &Status) -> Vec<String> {
    let mut parts = Vec::new();
    if let Some(per_s) = view.rate_scenes_per_s {
        let (number, unit) = rate(per_s);
        parts.push(format!("{number} {unit}"));
    }
    if let Some(seconds) = view.eta_s {
        parts.push(format!("{} left", duration(seconds)));
    }
    parts
}

/// Formats the status as one line, for logs.
pub(super) fn line(name: &str, view: &Status) -> String {
    let counts = &view.counts;
    let mut parts = vec![
        format!("{} of {} scenes", counts.merged, counts.scenes),
        format!("{} of {} shards", counts.shards_done, counts.shards),
    ];
    parts.extend(pace(view));
    if !counts.quarantined.is_empty() {
        parts.push(format!("{} in quarantine", counts.quarantined.len()));
    }
    format!("{name}: {}, {}", view.state.name(), parts.join(", "))
}

/// Formats the full status, with at most `shown` entries of each list.
pub(super) fn page(name: &str, view: &Status, queue: &Queue, shown: usize) -> String {
    let counts = &view.counts;
    let mut text = format!(
        "{name}: {}, {} of {} scenes ({:.1} %)",
        view.state.name(),
        grouped(counts.merged),
        grouped(counts.scenes),
        percent(counts.merged, counts.scenes),
    );
    if let Some(reason) = &view.reason {
        let _ = write!(text, "; {}", cut(reason));
    }
    let full = (counts.shards_done * BAR as u64 / counts.shards.max(1)) as usize;
    let _ = write!(text, "\n  [{:<BAR$}]  {}", "=".repeat(full), pace(view).join(", "));
    text.truncate(text.trim_end().len());
    row(
        &mut text,
        "shards",
        &format!("{} of {}", grouped(counts.shards_done), grouped(counts.shards)),
    );
    row(
        &mut text,
        "scenes",
        &format!(
            "{} begun, {} waiting, {} in quarantine",
            grouped(counts.started),
            grouped(counts.waiting),
            counts.quarantined.len()
        ),
    );
    if let Some(age) = view.last_tuple_s {
        row(&mut text, "last tuple", &format!("{} ago", duration(age)));
    }
    match queue {
        Queue::None => {}
        Queue::There(state) => row(
            &mut text,
            "queue",
            &format!("{} waiting, {} held", many(state.waiting, "task"), grouped(state.held)),
        ),
        Queue::Lost(reason) => row(&mut text, "queue", &cut(reason)),
    }
    let width = view.workers.iter().map(|w| w.worker.chars().count());
    // Names come from the store. Longer widths than 65,535 panic in `format!`.
    let width = width.max().unwrap_or(0).min(64);
    let workers = view.workers.iter().map(|w| {
        let ago = duration(w.last_tuple_s);
        let tuples = many(w.tuples, "tuple");
        format!("{:<width$}  {tuples}, the last {ago} ago", w.worker)
    });
    list(&mut text, "workers", workers, shown);
    list(&mut text, "attempts", view.attempts.iter().map(attempt), shown);
    let reasons = counts.quarantined.iter();
    let reasons = reasons.map(|q| format!("{}: {}", q.scene, cut(&q.reason)));
    list(&mut text, "quarantine", reasons, shown);
    match view.state {
        RunState::Paused => text += "\n`glasshouse resume RUN` continues the run",
        RunState::Cancelled => text += "\n`glasshouse resume RUN` undoes the cancel",
        RunState::Running | RunState::Finished => {}
    }
    if !counts.quarantined.is_empty() {
        text += "\n`glasshouse retry RUN SCENE` tries a scene in quarantine again";
    }
    text
}

/// Formats an attempt on one line.
pub(super) fn attempt(attempt: &StandingAttempt) -> String {
    let note = &attempt.note;
    let [start, end] = note.shards;
    let mut text = format!("{} shards {start}-{}", note.scene, end.saturating_sub(1));
    if note.n > 1 {
        let _ = write!(text, ", attempt {}", note.n);
    }
    let _ = write!(text, ", {}, last sign of life {} ago", note.worker, duration(attempt.age_s));
    if let Some(end) = &note.ended {
        let kind = match end.kind {
            EndKind::Lost => "lost",
            EndKind::Crashed => "crashed",
            EndKind::Hung => "hung",
            EndKind::Unreadable => "unreadable",
        };
        let _ = write!(text, ", {kind}: {}", cut(&end.reason));
    }
    text
}

/// Appends a row with a name and a value.
pub(super) fn row(text: &mut String, name: &str, value: &str) {
    let _ = write!(text, "\n  {name:<11} {value}");
}

fn list(text: &mut String, name: &str, rows: impl ExactSizeIterator<Item = String>, shown: usize) {
    let more = rows.len().saturating_sub(shown);
    for (index, value) in rows.take(shown).enumerate() {
        row(text, if index == 0 { name } else { "" }, &value);
    }
    if more > 0 {
        row(text, "", &format!("and {} more; --json lists all", grouped(more as u64)));
    }
}

/// Cuts a reason to its first characters, on one line.
fn cut(reason: &str) -> String {
    shorten(reason, REASON).replace(|c: char| c.is_control(), " ")
}
