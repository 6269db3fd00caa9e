//! Error rows as CSV.

use super::ladder::LayerRow;
use std::fmt::Write;

/// Formats `error.csv`: one row for each variant, rung and layer; an absent number is an empty field.
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
