//! Formats result rows as Markdown and CSV.

use compose::markdown_table;
use serde::Serialize;
use serde_json::Value;
use std::iter::once;

/// Formats a Markdown table; the first `left` columns are left-aligned. ` | ` separates the cells of `head`.
pub(super) fn table(
    head: &str,
    rows: impl IntoIterator<Item = Vec<String>>,
    left: usize,
) -> String {
    let head = head.split(" | ").map(str::to_owned).collect();
    markdown_table(&once(head).chain(rows).collect::<Vec<_>>(), left)
}

/// Formats rows with equal keys and plain values as CSV: the keys in the first line, and an empty field for `null`.
pub(super) fn csv<R: Serialize>(rows: &[R]) -> String {
    let cell = |value: &Value| match value {
        Value::String(text) => text.clone(),
        value => value.as_f64().map_or_else(String::new, |number| number.to_string()),
    };
    let mut text = String::new();
    for row in rows.iter().map(|row| serde_json::to_value(row).unwrap_or_default()) {
        let (keys, cells): (Vec<&str>, Vec<String>) = row
            .as_object()
            .into_iter()
            .flatten()
            .map(|(key, value)| (key.as_str(), cell(value)))
            .unzip();
        if text.is_empty() {
            text = keys.join(",") + "\n";
        }
        text += &(cells.join(",") + "\n");
    }
    text
}
