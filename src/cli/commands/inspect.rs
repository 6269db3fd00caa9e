//! `inspect FILE...`: describes files and their damage.

use crate::cli::exit_code::Exit;
use crate::cli::output::Output;
use crate::cli::rows::{WIDTH, rows, wrapped};
use crate::doctor::bytes_text;
use crate::inspect::{Inspection, Kind, Problem, Whole, inspect_path};
use clap::Args as ClapArgs;
use serde::Serialize;
use serde_json::{Map, Value};
use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

#[derive(Debug, ClapArgs)]
pub(super) struct InspectArgs {
    /// Files that this program writes or reads, or folders of a run, a tuple or a checkpoint
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
}

pub(super) fn run(args: &InspectArgs, output: &Output) -> Exit {
    // Decoders of other crates may panic on hostile bytes; `inspect_path` catches the panic and reports a problem.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let found: Vec<(&Path, Inspection)> =
        args.files.iter().map(|path| (path.as_path(), inspect_path(path))).collect();
    std::panic::set_hook(hook);
    let sound = found.iter().filter(|(_, found)| found.is_sound()).count();
    let inspected = Inspected {
        sound,
        unsound: found.len() - sound,
        files: found.iter().map(|(path, found)| Entry::new(path, found)).collect(),
    };
    output.show("glasshouse.inspect/1", &inspected);
    if sound == found.len() { Exit::Done } else { Exit::InvalidInput }
}

/// Formats a file's inspection.
fn text(path: &str, found: &Inspection) -> String {
    let mut text = title(path, found);
    let size = found.bytes.map(|bytes| match bytes {
        bytes if bytes < 10_000 => format!("{bytes} bytes"),
        bytes => bytes_text(bytes as f64),
    });
    let mut lines: Vec<(&str, &str)> = Vec::new();
    lines.extend(size.as_deref().map(|size| ("size", size)));
    lines.extend(found.facts.rows.iter().map(|(label, value)| (label.as_str(), value.as_str())));
    let (label, whole) = match &found.whole {
        Whole::Yes(how) => ("whole", format!("yes: {how}")),
        Whole::Unknown(why) => ("whole", format!("probably: {why}")),
        Whole::No if found.kind == Kind::Unknown => ("", String::new()),
        Whole::No => ("whole", "no".to_owned()),
    };
    lines.extend((!whole.is_empty()).then_some((label, whole.as_str())));
    for Problem { what, place, to_do } in &found.problems {
        lines.push(("wrong", what));
        lines.extend(place.as_deref().map(|place| ("where", place)));
        lines.push(("to do", to_do));
    }
    lines.extend(found.next.iter().map(|next| ("next", next.as_str())));
    text += &rows(lines);
    text
}

/// Formats the path and the kind of a file.
fn title(path: &str, found: &Inspection) -> String {
    let words = match found.kind {
        Kind::Unknown => "an unknown file".to_owned(),
        kind => {
            let words = kind.words();
            let first = words.split([' ', ',']).next().unwrap_or_default();
            // File names and these words take no article.
            let is_name = first.contains('.') && !first.starts_with('.');
            let article = if is_name || ["scores", "SHA256SUMS", "JSON"].contains(&first) {
                ""
            } else if first.starts_with(['a', 'e', 'i', 'o', 'O']) {
                "an "
            } else {
                "a "
            };
            format!("{article}{words}")
        }
    };
    let line = format!("{path}: {words}");
    if line.chars().count() <= WIDTH {
        line
    } else {
        format!("{path}:\n  {}", wrapped(&words, WIDTH - 2).join("\n  "))
    }
}

#[derive(Serialize)]
struct Inspected<'a> {
    sound: usize,
    unsound: usize,
    files: Vec<Entry<'a>>,
}

#[derive(Serialize)]
struct Entry<'a> {
    file: Cow<'a, str>,
    kind: &'static str,
    what: &'static str,
    bytes: Option<u64>,
    whole: Option<bool>,
    how: Option<&'a str>,
    facts: &'a Map<String, Value>,
    problems: &'a [Problem],
    next: &'a [String],
    #[serde(skip)]
    found: &'a Inspection,
}

impl<'a> Entry<'a> {
    fn new(file: &'a Path, found: &'a Inspection) -> Self {
        let (whole, how) = match &found.whole {
            Whole::Yes(how) => (Some(true), Some(how.as_str())),
            Whole::Unknown(why) => (None, Some(why.as_str())),
            Whole::No => (Some(false), None),
        };
        Self {
            file: file.to_string_lossy(),
            kind: found.kind.name(),
            what: found.kind.words(),
            bytes: found.bytes,
            whole,
            how,
            facts: &found.facts.values,
            problems: &found.problems,
            next: &found.next,
            found,
        }
    }
}

impl fmt::Display for Inspected<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let texts: Vec<String> = self.files.iter().map(|f| text(&f.file, f.found)).collect();
        f.write_str(&texts.join("\n\n"))
    }
}
