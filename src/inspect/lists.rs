//! Inspects text files with one entry per line, and the report page.

use super::facts::{Inspection, Problem, first_of};
use super::input::{AGAIN, Input};
use super::kind::Kind;
use crate::made::DepthRecord;
use crate::outputs::Written;
use crate::text::{csv_cells, many};
use plan::{RejectedScene, parse_list};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

const SHOWN: usize = 12;

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let Some(text) = input.text(&mut found) else {
        return found;
    };
    match kind {
        Kind::PhotographList => match parse_list(text) {
            Ok(images) => count(&mut found, "photographs", images.len()),
            Err(error) => found.wrong(Problem::new(error.to_string(), "correct that line")),
        },
        Kind::Rejected => {
            let draws: Vec<RejectedScene> = json_lines(&mut found, text);
            count(&mut found, "draws", draws.len());
        }
        Kind::Listing => {
            let samples: Vec<Map<String, Value>> = json_lines(&mut found, text);
            count(&mut found, "samples", samples.len());
            let columns = samples.first().map(|first| first.keys().cloned().collect());
            say_columns(&mut found, columns.unwrap_or_default());
        }
        Kind::Written => {
            let calls: Vec<Written> = json_lines(&mut found, text);
            count(&mut found, "files", calls.iter().map(|call| call.files.len()).sum());
        }
        Kind::DepthRecords => {
            let records: Vec<DepthRecord> = json_lines(&mut found, text);
            count(&mut found, "records", records.len());
        }
        Kind::Card => {
            let name = text.lines().find_map(|line| line.strip_prefix("pretty_name: "));
            let name = name.and_then(|name| serde_json::from_str::<String>(name).ok());
            found.facts.value("name", name.unwrap_or_default());
        }
        Kind::Sums => {
            let names: Vec<&str> = text.lines().filter_map(|line| line.get(66..)).collect();
            let files = many(names.len() as u64, "file");
            found.facts.fact("files", files, json!(names));
        }
        Kind::Report => {
            report(&mut found, text);
            return found;
        }
        Kind::EvaluationTable => {
            let cells = |line: &str| {
                let cells = line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned());
                Some(cells.collect())
            };
            tables(&mut found, text, cells);
        }
        _ => table(&mut found, text.lines(), csv_cells),
    }
    if !text.ends_with('\n') {
        let place = format!("line {}", text.lines().count());
        found.wrong(Problem::new("its last line is truncated", AGAIN).at(place));
    }
    found.may_be_whole(match kind {
        Kind::Card => "a card has no digest; `sha256sum -c SHA256SUMS` compares it",
        Kind::Sums => "`sha256sum -c SHA256SUMS` compares the files beside it",
        _ => "every line can be read; files of this kind have no digest",
    });
    found
}

fn count(found: &mut Inspection, what: &str, count: usize) {
    let text = many(count as u64, what.trim_end_matches('s'));
    found.facts.fact(what, text, count);
}

fn say_columns(found: &mut Inspection, columns: Vec<String>) {
    found.facts.fact("columns", first_of(&columns, SHOWN), columns);
}

/// Parses the lines of a list, up to the first bad line.
fn json_lines<T: DeserializeOwned>(found: &mut Inspection, text: &str) -> Vec<T> {
    let mut read = Vec::new();
    for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        match serde_json::from_str(line) {
            Ok(value) => read.push(value),
            Err(error) => {
                let problem = Problem::new(format!("it cannot be read: {error}"), AGAIN);
                found.wrong(problem.at(format!("line {}", index + 1)));
                break;
            }
        }
    }
    read
}

/// Reads rows with one cell per column. Every cell of a training's metrics must be empty or a finite number.
fn table<'a>(
    found: &mut Inspection,
    mut lines: impl Iterator<Item = &'a str>,
    cells: impl Fn(&str) -> Option<Vec<String>>,
) {
    let columns = lines.next().and_then(&cells).unwrap_or_default();
    let rows = rows(found, &columns, lines, &cells);
    count(found, "rows", rows);
    say_columns(found, columns);
}

/// Checks several Markdown tables, each with its own head. The facts have the columns of the first one.
fn tables(found: &mut Inspection, text: &str, cells: impl Fn(&str) -> Option<Vec<String>>) {
    let lines: Vec<&str> = text.lines().collect();
    let blocks = lines.chunk_by(|a, b| a.starts_with('|') == b.starts_with('|'));
    let (mut all, mut first) = (0, None);
    for block in blocks.filter(|block| block[0].starts_with('|')) {
        let mut lines = block.iter().copied().filter(|line| !line.contains("---"));
        let columns = lines.next().and_then(&cells).unwrap_or_default();
        all += rows(found, &columns, lines, &cells);
        first.get_or_insert(columns);
    }
    count(found, "rows", all);
    say_columns(found, first.unwrap_or_default());
}

/// Checks the rows of a table with these columns, and counts them.
fn rows<'a>(
    found: &mut Inspection,
    columns: &[String],
    lines: impl Iterator<Item = &'a str>,
    cells: impl Fn(&str) -> Option<Vec<String>>,
) -> usize {
    let is_number = |cell: &String| cell.is_empty() || cell.parse().is_ok_and(f64::is_finite);
    let mut rows = 0;
    for line in lines {
        rows += 1;
        let place = format!("row {rows}");
        let Some(row) = cells(line).filter(|row| row.len() == columns.len()) else {
            let what = format!("it does not have {} cells", columns.len());
            found.wrong(Problem::new(what, AGAIN).at(place));
            break;
        };
        if found.kind == Kind::Metrics && !row.iter().all(is_number) {
            found.wrong(Problem::new("a cell is not a finite number", FINITE).at(place));
        }
    }
    rows
}

/// Remedy for a loss that is not finite.
const FINITE: &str = "train again with a smaller --learning-rate, in a new run";

fn report(found: &mut Inspection, text: &str) {
    let title = text.split_once("<title>").and_then(|(_, rest)| rest.split_once("</title>"));
    if let Some((title, _)) = title {
        found.facts.value("title", title);
    }
    if text.trim_end().ends_with("</html>") {
        found.may_be_whole("it ends with </html>; pages have no digest");
    } else {
        let what = "it is truncated: it does not end with </html>";
        found.wrong(Problem::new(what, "`glasshouse report RUN` writes it again"));
    }
}
