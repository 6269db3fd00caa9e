//! Markdown tables.

use std::fmt::Write;

/// Largest width of a column; longer cells have no padding. Widths above 65,535 panic in `format!`.
const WIDEST: usize = 200;

/// Formats a Markdown table with padded cells. The first row is the head; the first `left` columns are left-aligned.
pub fn markdown_table(rows: &[Vec<String>], left: usize) -> String {
    let columns = rows.first().map_or(0, Vec::len);
    let cell = |row: &Vec<String>, k: usize| row.get(k).cloned().unwrap_or_default();
    let width = |k: usize| rows.iter().map(|row| cell(row, k).chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|k| width(k).unwrap_or(0).clamp(3, WIDEST)).collect();
    let mut text = String::new();
    for (n, row) in rows.iter().enumerate() {
        for (k, &width) in widths.iter().enumerate() {
            let cell = cell(row, k);
            let _ = if k < left {
                write!(text, "| {cell:width$} ")
            } else {
                write!(text, "| {cell:>width$} ")
            };
        }
        text += "|\n";
        if n == 0 {
            for (k, width) in widths.iter().enumerate() {
                let end = if k < left { '-' } else { ':' };
                let _ = write!(text, "|{}{end}", "-".repeat(width + 1));
            }
            text += "|\n";
        }
    }
    text
}

/// Escapes a cell of a Markdown table.
pub(super) fn escaped(cell: &str) -> String {
    cell.replace('|', "\\|").replace(['\n', '\r'], " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned() {
        let rows = [["a", "R~"], ["long", "10.5"]].map(|row| row.map(str::to_owned).to_vec());
        let text = "| a    |   R~ |\n|------|-----:|\n| long | 10.5 |\n";
        assert_eq!(markdown_table(&rows, 1), text);
        assert_eq!(escaped("a|b\nc"), "a\\|b c");
    }
}
