//! Rows as text: pipe tables that a document can take as they are, and CSV.

use super::ladder::LayerRow;
use std::fmt::Write;

/// A pipe table whose columns are aligned. The first row is the head; the first `left` columns are words.
pub fn align(rows: &[Vec<String>], left: usize) -> String {
    let columns = rows.first().map_or(0, Vec::len);
    let cell = |row: &Vec<String>, k: usize| row.get(k).cloned().unwrap_or_default();
    let width = |k: usize| rows.iter().map(|row| cell(row, k).chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|k| width(k).unwrap_or(0).max(3)).collect();
    let mut text = String::new();
    for (n, row) in rows.iter().enumerate() {
        for (k, width) in widths.iter().enumerate() {
            let pad = " ".repeat(width - cell(row, k).chars().count());
            let _ = if k < left {
                write!(text, "| {}{pad} ", cell(row, k))
            } else {
                write!(text, "| {pad}{} ", cell(row, k))
            };
        }
        text += "|\n";
        if n == 0 {
            for (k, width) in widths.iter().enumerate() {
                let dashes = "-".repeat(width + 1);
                let _ =
                    if k < left { write!(text, "|{dashes}-") } else { write!(text, "|{dashes}:") };
            }
            text += "|\n";
        }
    }
    text
}

/// `error.csv`: a row for each variant, rung and layer; an empty field is a number that there is not.
pub fn csv(rows: &[LayerRow]) -> String {
    let mut text = "variant,layer,spp,samples,cpu_s,rmse,relative_mse,bias,srgb_steps,cell_rmse_worst,cell_rmse_p99,\
                    stated_rmse,stated_over_true\n"
        .to_owned();
    for row in rows {
        let d = &row.deviation;
        let optional = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:e}"));
        let _ = writeln!(
            text,
            "{},{},{},{},{:e},{:e},{:e},{:e},{:e},{:e},{:e},{},{}",
            row.variant,
            row.layer,
            row.spp,
            row.samples,
            row.cpu_s,
            d.rmse,
            d.relative_mse,
            d.bias,
            d.srgb_steps,
            d.cell_rmse_worst,
            d.cell_rmse_p99,
            optional(row.stated_rmse),
            optional(row.stated_over_true),
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_aligned() {
        let rows = [["a", "R~"], ["long", "10.5"]].map(|row| row.map(str::to_owned).to_vec());
        assert_eq!(align(&rows, 1), "| a    |   R~ |\n|------|-----:|\n| long | 10.5 |\n");
    }
}
