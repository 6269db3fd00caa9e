//! Prints results to stdout and messages to stderr.
//!
//! Texts may contain scene paths, names and reasons from other machines and files. All of them pass through
//! [`printable`] or [`printable_json`] here, so that no escape code of a foreign text reaches the terminal.

use super::args::{ColorWhen, Global};
use super::exit_code::{Exit, Failure, failure};
use crate::text::{printable, printable_json};
use glasshouse_line::ids::SceneId;
use serde::{Serialize, Serializer};
use serde_json::{Value, json};
use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::OnceLock;

/// Schema of the error object that --json prints.
const ERROR_SCHEMA: &str = "glasshouse.error/1";

/// First failure to write to stdout.
static LOST: OnceLock<io::Error> = OnceLock::new();

/// Writes to stdout. [`check_stdout`] reports an error.
fn write_stdout(text: &str) {
    note_written(writeln!(io::stdout().lock(), "{text}"));
}

/// Flushes stdout after a write, and keeps an error for [`check_stdout`]. Ignores a closed pipe, because its reader has
/// what it needs.
pub(super) fn note_written(written: io::Result<()>) {
    if let Err(error) = written.and_then(|()| io::stdout().flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = LOST.set(error);
    }
}

/// Returns the failure if a part of the answer could not be written to stdout.
pub(super) fn check_stdout() -> Result<(), Failure> {
    LOST.get().map_or(Ok(()), |error| {
        Err(failure!(
            Exit::Failed,
            "the answer is incomplete: cannot write to standard output: {error}; what the command wrote to files is there"
        ))
    })
}

/// Prints the error object for an invalid command line.
pub(super) fn usage_json(error: &str) {
    let object =
        json!({ "schema": ERROR_SCHEMA, "error": error.trim_end(), "exit": Exit::Usage.code() });
    print_json(&object);
}

/// Serializes scenes with reasons as objects `{scene, reason}`.
pub(super) fn reasons<S: Serializer>(
    scenes: &[(SceneId, String)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Reason<'a> {
        scene: &'a SceneId,
        reason: &'a str,
    }
    serializer.collect_seq(scenes.iter().map(|(scene, reason)| Reason { scene, reason }))
}

/// Serializes named numbers as an object and keeps their order.
pub(super) fn as_map<S: Serializer>(
    numbers: &[(&'static str, f64)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(numbers.iter().copied())
}

fn print_object(schema: &str, object: Value) {
    let mut full = json!({ "schema": schema });
    if let (Value::Object(full), Value::Object(object)) = (&mut full, object) {
        full.extend(object);
    }
    print_json(&full);
}

fn print_json(object: &Value) {
    write_stdout(&printable_json(object.to_string()));
}

/// Prints a message of the argument parser. Arguments may contain control characters of foreign file names.
pub(super) fn usage(error: &clap::Error) {
    let text = error.to_string();
    let clean = printable(text.as_str());
    if clean != text {
        let _ = write!(io::stderr().lock(), "{clean}");
        return;
    }
    // This call uses colours.
    let printed = error.print();
    if !error.use_stderr() {
        note_written(printed);
    }
}

pub(super) struct Output {
    json: bool,
    pub(super) quiet: bool,
    pub(super) verbose: bool,
    color: bool,
}

impl Output {
    pub(super) fn new(global: &Global) -> Self {
        #[allow(clippy::disallowed_methods, reason = "only cli reads the environment")]
        let no_color = std::env::var("NO_COLOR").is_ok_and(|v| !v.is_empty());
        let color = match global.color {
            ColorWhen::Always => true,
            ColorWhen::Never => false,
            ColorWhen::Auto => std::io::stderr().is_terminal() && !no_color,
        };
        Self { json: global.json, quiet: global.quiet, verbose: global.verbose, color }
    }

    /// Returns the output of a command line that cannot be parsed.
    pub(super) fn plain() -> Self {
        Self { json: false, quiet: false, verbose: false, color: false }
    }

    /// Prints the command's result: with --json an object that begins with its schema, else a text.
    pub(super) fn show(&self, schema: &str, result: &(impl Serialize + Display)) {
        if self.json {
            let object = serde_json::to_value(result);
            print_object(schema, object.expect("a result has texts as keys and paths as texts"));
        } else {
            self.text(&result.to_string());
        }
    }

    /// Prints a line for the parent process; exits if that process is gone.
    pub(super) fn tell_parent(text: &str) {
        let mut stdout = std::io::stdout().lock();
        let told = writeln!(stdout, "{text}").and_then(|()| stdout.flush());
        if told.is_err() {
            Exit::Failed.now();
        }
    }

    /// Prints a result, or a line of it, as plain text.
    #[allow(clippy::unused_self, reason = "printing needs an output")]
    pub(super) fn text(&self, text: &str) {
        write_stdout(&printable(text));
    }

    /// Prints a note, unless --quiet is given.
    pub(super) fn note(&self, text: &str) {
        if !self.quiet {
            self.line("note", "36", text);
        }
    }

    pub(super) fn warning(&self, text: &str) {
        self.line("warning", "33", text);
    }

    /// Prints the error that ends the program; with --json also as an object on stdout.
    pub(super) fn error(&self, failure: &Failure) {
        let text = failure.text();
        if self.json {
            let mut object = json!({ "error": text, "exit": failure.exit.code() });
            if let Value::Object(object) = &mut object {
                object.extend(failure.details.clone());
            }
            print_object(ERROR_SCHEMA, object);
        }
        self.line("error", "31", &text);
    }

    fn line(&self, label: &str, code: &str, text: &str) {
        let text = printable(text);
        let mut stderr = std::io::stderr().lock();
        let _ = if self.color {
            writeln!(stderr, "\x1b[1;{code}m{label}:\x1b[0m {text}")
        } else {
            writeln!(stderr, "{label}: {text}")
        };
    }
}
