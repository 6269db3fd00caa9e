//! `inspect FILE...`

use crate::cli::exit_code::Exit;
use crate::cli::output::Output;
use crate::cli::rows::{WIDTH, rows, wrapped};
use crate::doctor::bytes_text;
use crate::inspect::{Inspection, Kind, Problem, Whole, inspect_path};
use clap::Args as ClapArgs;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(Debug, ClapArgs)]
pub(super) struct InspectArgs {
    /// Files that this program wrote or reads; folders of a run, a tuple, a checkpoint
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
}

pub(super) fn run(args: &InspectArgs, output: &Output) -> Exit {
    // Decoders of other crates may panic on hostile bytes; the panic is caught and reported as a problem.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let found: Vec<(&Path, Inspection)> =
        args.files.iter().map(|path| (path.as_path(), inspect_path(path))).collect();
    std::panic::set_hook(hook);
    let sound = found.iter().filter(|(_, found)| found.is_sound()).count();
    let files: Vec<Value> = found.iter().map(|(path, found)| object(path, found)).collect();
    let texts: Vec<String> = found.iter().map(|(path, found)| text(path, found)).collect();
    let object = json!({ "sound": sound, "unsound": found.len() - sound, "files": files });
    output.say("glasshouse.inspect/1", object, texts.join("\n\n"));
    if sound == found.len() { Exit::Done } else { Exit::InvalidInput }
}

/// A file's inspection as text.
fn text(path: &Path, found: &Inspection) -> String {
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

/// The path and the kind of the file.
fn title(path: &Path, found: &Inspection) -> String {
    let words = match found.kind {
        Kind::Unknown => "nothing that is known here".to_owned(),
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
    let line = format!("{}: {words}", path.display());
    if line.chars().count() <= WIDTH {
        line
    } else {
        format!("{}:\n  {}", path.display(), wrapped(&words, WIDTH - 2).join("\n  "))
    }
}

/// A file's inspection as JSON.
fn object(file: &Path, found: &Inspection) -> Value {
    let (whole, how) = match &found.whole {
        Whole::Yes(how) => (Some(true), Some(how)),
        Whole::Unknown(why) => (None, Some(why)),
        Whole::No => (Some(false), None),
    };
    json!({
        "file": file.to_string_lossy(),
        "kind": found.kind.name(),
        "what": found.kind.words(),
        "bytes": found.bytes,
        "whole": whole,
        "how": how,
        "facts": found.facts.values,
        "problems": found.problems,
        "next": found.next,
    })
}
