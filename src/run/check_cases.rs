//! A finished run of hard cases against what is expected of it: one row for each expectation.

use crate::run::{QuarantineRecord, Run};
use plan::cases::{Case, CaseFile, Measured};
use render::merge::decode_exr_channels;
use render::trace::LAYERS;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

/// A tuple that cannot be looked at.
#[derive(Debug, thiserror::Error)]
#[error("cannot read {}: {reason}; delete its folder and run again", path.display())]
pub struct CheckError {
    /// The file.
    pub path: PathBuf,
    /// Why.
    pub reason: String,
}

/// One expectation and what became of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckRow {
    /// Which case.
    pub case: String,
    /// Which layer; empty for a refusal.
    pub layer: String,
    /// What is compared.
    pub quantity: String,
    /// On paper, or words of the reason.
    pub expected: serde_json::Value,
    /// In the run.
    pub got: serde_json::Value,
    /// Their distance; `null` where there is none.
    pub error: Option<f64>,
    /// What it may be.
    pub bound: Option<f64>,
    /// It is.
    pub ok: bool,
}

/// The layers of a tuple by name.
type Layers = BTreeMap<String, Vec<[f32; 3]>>;

/// Compares every expectation of `file` with the tuples and quarantine records of `run`.
pub fn check(file: &CaseFile, run: &Run) -> Result<Vec<CheckRow>, CheckError> {
    let mut tuples: BTreeMap<&str, Layers> = BTreeMap::new();
    for case in &file.cases {
        let path = run.dir.tuple(&case.line.id).join("tuple.exr");
        if path.is_file() {
            let layers = read_tuple(&path, case).map_err(|reason| CheckError { path, reason })?;
            tuples.insert(case.line.id.as_str(), layers);
        }
    }
    let mut rows = Vec::new();
    for case in &file.cases {
        let reason = QuarantineRecord::read(&run.dir, &case.line.id).map(|r| r.reason);
        if let Some(words) = &case.refused {
            rows.push(refusal(case, words, reason.as_deref()));
            continue;
        }
        for expect in &case.expect {
            let other = expect.same_as.as_deref().map(|name| {
                let (id, layer) = name.split_once('/').unwrap_or((name, &expect.layer));
                tuples.get(id).and_then(|layers| layers.get(layer))
            });
            let layer = tuples
                .get(case.line.id.as_str())
                .and_then(|layers| layers.get(&expect.layer));
            let measured = layer
                .and_then(|layer| expect.measure(case, layer, other.flatten().map(Vec::as_slice)));
            let mut row = CheckRow {
                case: case.line.id.to_string(),
                layer: expect.layer.clone(),
                quantity: expect.quantity(),
                expected: serde_json::Value::Null,
                got: reason.clone().into(),
                error: None,
                bound: Some(expect.bound),
                ok: false,
            };
            if let Some(Measured {
                expected,
                got,
                error,
            }) = measured
            {
                row.expected = expected.into();
                row.got = got.into();
                row.error = Some(error);
                // False for NaN.
                row.ok = error <= expect.bound;
            }
            rows.push(row);
        }
    }
    Ok(rows)
}

fn refusal(case: &Case, words: &str, reason: Option<&str>) -> CheckRow {
    CheckRow {
        case: case.line.id.to_string(),
        layer: String::new(),
        quantity: "refused".to_owned(),
        expected: words.into(),
        got: reason.unwrap_or("it was rendered").into(),
        error: None,
        bound: None,
        ok: reason.is_some_and(|reason| reason.contains(words)),
    }
}

fn read_tuple(path: &std::path::Path, case: &Case) -> Result<Layers, String> {
    let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
    let channels = decode_exr_channels(&bytes)?;
    let film = &case.line.film;
    if [channels.width, channels.height] != [film.width as usize, film.height as usize] {
        return Err("it has another size than its film".to_owned());
    }
    let layer = |name: &str| Ok((name.to_owned(), channels.layer(name)?));
    LAYERS.into_iter().map(layer).collect()
}

/// The rows as a table of text.
pub fn table(rows: &[CheckRow]) -> String {
    let number = |value: &serde_json::Value| match value.as_f64() {
        Some(v) if v == 0.0 || (1e-3..1e6).contains(&v.abs()) => format!("{v:.7}"),
        Some(v) => format!("{v:.6e}"),
        None => "-".to_owned(),
    };
    let widths = [
        rows.iter().map(|r| r.case.len()).max().unwrap_or(0).max(4),
        rows.iter()
            .map(|r| r.quantity.len())
            .max()
            .unwrap_or(0)
            .max(8),
    ];
    let mut text = format!(
        "{:w0$}  {:16}  {:w1$}  {:>14}  {:>14}  {:>8}  {:>8}  ok",
        "case",
        "layer",
        "quantity",
        "expected",
        "got",
        "error",
        "bound",
        w0 = widths[0],
        w1 = widths[1],
    );
    for row in rows {
        let _ = write!(
            text,
            "\n{:w0$}  {:16}  {:w1$}  ",
            row.case,
            row.layer,
            row.quantity,
            w0 = widths[0],
            w1 = widths[1],
        );
        let ok = if row.ok { "yes" } else { "NO" };
        let _ = match (row.error, row.bound) {
            (Some(error), Some(bound)) => write!(
                text,
                "{:>14}  {:>14}  {error:>8.1e}  {bound:>8.1e}  {ok}",
                number(&row.expected),
                number(&row.got)
            ),
            _ if row.ok => write!(text, "{:<50}  {ok}", row.expected.as_str().unwrap_or("-")),
            _ => write!(
                text,
                "{ok}: expected {}, got {}",
                row.expected,
                row.got.as_str().unwrap_or("no tuple")
            ),
        };
    }
    text
}
