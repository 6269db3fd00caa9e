//! Tables of a training and of an evaluation: `metrics.csv`, `evaluation.csv`, `evaluation.md`.

use super::facts::{Inspection, Problem, first_of, many};
use super::kind::Kind;
use super::look::{AGAIN, Input};
use serde_json::json;

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let Some(text) = input.text(&mut found) else {
        return found;
    };
    match kind {
        Kind::Metrics => metrics(&mut found, text),
        Kind::EvaluationRows => scores(&mut found, text),
        _ => means(&mut found, text),
    }
    if !text.ends_with('\n') {
        let last = text.lines().count();
        found.wrong(Problem::new("its last line is cut", AGAIN).at(format!("line {last}")));
    }
    found.may_be_whole("every line can be read; tables have no digest");
    found
}

/// What to do about a curve.
const GOES_ON: &str = "`glasshouse train` writes the lines after its newest checkpoint anew";

fn metrics(found: &mut Inspection, text: &str) {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let (mut steps, mut losses, mut best, mut seconds) =
        (Vec::new(), Vec::new(), None::<(f64, u64)>, 0.0);
    let psnr_column = names.iter().position(|name| *name == "validation_psnr_db");
    let wall_column = names.iter().position(|name| *name == "wall_s");
    for (index, line) in lines.enumerate() {
        let place = format!("line {}", index + 2);
        let cells: Vec<&str> = line.split(',').collect();
        let numbers: Option<Vec<Option<f64>>> = cells
            .iter()
            .map(|cell| {
                if cell.is_empty() {
                    Some(None)
                } else {
                    cell.parse().ok().map(Some)
                }
            })
            .collect();
        let step = cells.first().and_then(|cell| cell.parse::<u64>().ok());
        let (Some(numbers), Some(step), true) = (numbers, step, cells.len() == names.len()) else {
            let what = format!("it has no {} numbers", names.len());
            found.wrong(Problem::new(what, GOES_ON).at(place));
            return;
        };
        if steps.last().is_some_and(|last| *last >= step) {
            found.wrong(
                Problem::new(
                    format!("step {step} does not follow the one before it"),
                    GOES_ON,
                )
                .at(place),
            );
        }
        let loss = numbers.get(1).copied().flatten();
        if loss.is_some_and(|loss| !loss.is_finite()) {
            let problem = Problem::new(
                "the loss is not finite",
                "train again with a smaller --learning-rate, in a new run",
            );
            found.wrong(problem.at(format!("step {step}")));
        }
        if let Some(psnr) = psnr_column.and_then(|k| numbers[k])
            && best.is_none_or(|(most, _)| psnr > most)
        {
            best = Some((psnr, step));
        }
        seconds += wall_column.and_then(|k| numbers[k]).unwrap_or(0.0);
        steps.push(step);
        losses.extend(loss);
    }
    let range = steps.first().zip(steps.last());
    let text = range.map_or_else(
        || "none yet".to_owned(),
        |(a, b)| format!("{a} to {b}, {} lines", steps.len()),
    );
    found.facts.fact("steps", text, json!(range));
    if let (Some(first), Some(last)) = (losses.first(), losses.last()) {
        found.facts.fact(
            "loss",
            format!("{first:.4} at first, {last:.4} at last"),
            json!([first, last]),
        );
    }
    if let Some((psnr, step)) = best {
        found.facts.fact(
            "best",
            format!("{psnr:.2} dB at step {step}"),
            json!({ "psnr_db": psnr, "step": step }),
        );
    }
    found.facts.say("time", crate::text::duration(seconds));
    found.facts.put("wall_s", seconds);
}

fn scores(found: &mut Inspection, text: &str) {
    let columns = text.lines().next().unwrap_or_default().split(',').count();
    let (mut methods, mut rows): (Vec<String>, u64) = (Vec::new(), 0);
    for (index, line) in text.lines().enumerate().skip(1) {
        let cells = cells(line);
        let is_row = cells.as_ref().is_some_and(|cells| {
            cells.len() == columns
                && cells[columns - 4..]
                    .iter()
                    .all(|cell| cell.parse::<f64>().is_ok())
        });
        let Some(cells) = cells.filter(|_| is_row) else {
            let problem = Problem::new(
                "it is no row of scores",
                "`glasshouse evaluate` writes it again",
            );
            found.wrong(problem.at(format!("line {}", index + 1)));
            return;
        };
        rows += 1;
        if !methods.contains(&cells[0]) {
            methods.push(cells[0].clone());
        }
    }
    found.facts.fact("rows", many(rows, "row"), rows);
    found
        .facts
        .fact("methods", first_of(&methods, 8), json!(methods));
}

/// Cells of a CSV line (RFC 4180); none if a quote is not closed.
fn cells(line: &str) -> Option<Vec<String>> {
    let (mut cells, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => {
                cell.push('"');
                letters.next();
            }
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => cells.push(std::mem::take(&mut cell)),
            letter => cell.push(letter),
        }
    }
    cells.push(cell);
    (!is_quoted).then_some(cells)
}

fn means(found: &mut Inspection, text: &str) {
    let rows: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
    found.facts.fact(
        "rows",
        many(rows.len().saturating_sub(2) as u64, "method"),
        rows.len().saturating_sub(2),
    );
    let cells = |row: &str| -> Vec<String> {
        let cells = row.trim_matches('|').split('|');
        cells.map(|cell| cell.trim().to_owned()).collect()
    };
    let mut rows = rows.into_iter();
    let head = rows.next().map(cells).unwrap_or_default();
    for row in rows
        .map(cells)
        .filter(|row| !row.iter().all(|cell| cell.starts_with('-')))
    {
        // Method and images come first; the first two scores do for a glance.
        let scores = head.iter().zip(&row).skip(2).take(2);
        let scores: Vec<String> = scores
            .map(|(name, score)| format!("{name} {score}"))
            .collect();
        let method = row.first().map_or("", String::as_str);
        found
            .facts
            .say("", format!("{method}: {}", scores.join(", ")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_may_hold_commas_and_quotes() {
        assert_eq!(cells("a,\"b,\"\"c\"\"\",").unwrap(), ["a", "b,\"c\"", ""]);
        assert_eq!(cells("a,\"b"), None);
    }
}
