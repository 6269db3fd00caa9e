//! The result of `bench error` as text, JSON and files.

use super::cpu::on_cpu;
use super::error::BenchError;
use super::fit::Slope;
use super::ladder::{LayerRow, VARIANTS};
use super::plot::error_plot;
use super::reference::Reference;
use super::table::{csv, table};
use glasshouse_line::layer::Layer;
use render::atomic_file;
use serde::{Serialize, Serializer};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

pub const ERROR_SCHEMA: &str = "glasshouse.bench_error/1";

/// Errors of a scene's renderings against a reference, with the keys of [`ERROR_SCHEMA`].
#[derive(Serialize)]
pub struct ErrorReport<'a> {
    pub scene: &'a str,
    /// Width and height, px.
    pub film: [u32; 2],
    pub tracer_version: u32,
    /// Instruction set of the kernels.
    pub isa: &'static str,
    pub threads: usize,
    pub cpu: Option<String>,
    /// Number of seeds; errors are averages over the seeds.
    pub seeds: u32,
    /// Samples per pixel of each rung.
    pub spp: &'a [u32],
    pub reference: &'a Reference,
    pub slopes: Vec<Slope>,
    /// Rows by variant, rung and layer.
    pub rows: Vec<LayerRow>,
    /// Folder of the files; absent from `error.json` itself.
    #[serde(
        skip_serializing_if = "Option::is_none",
        serialize_with = "render::path_text::optional"
    )]
    pub out: Option<PathBuf>,
}

impl Serialize for Reference {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let dir = self.dir.to_string_lossy();
        let Some(record) = &self.record else {
            return json!({ "dir": dir }).serialize(serializer);
        };
        let stated: BTreeMap<_, _> = Layer::NAMES.into_iter().zip(record.error_rms).collect();
        let object = json!({
            "dir": dir, "spp": record.spp, "seed": record.seed, "stated_rmse": stated,
            "cpu_s": record.cpu_s, "reused": self.reused,
        });
        object.serialize(serializer)
    }
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    #[serde(flatten)]
    report: &'a ErrorReport<'a>,
}

impl ErrorReport<'_> {
    /// Names of the files of [`Self::write`].
    pub const FILES: [&'static str; 3] = ["error.csv", "error.svg", "error.json"];

    /// Writes [`Self::FILES`].
    pub fn write(&mut self, folder: &Path) -> Result<(), BenchError> {
        let title = format!(
            "Scene {}: error against CPU time (reference: {})",
            self.scene,
            truth(self.reference, "samples of another seed")
        );
        let document = Document { schema: ERROR_SCHEMA, report: self };
        let json = serde_json::to_value(document).unwrap_or_default();
        atomic_file::create_dir(folder)?;
        let texts = [csv(&self.rows), error_plot(&self.rows, &title), format!("{json:#}\n")];
        for (name, text) in Self::FILES.iter().zip(texts) {
            atomic_file::write(&folder.join(name), text.as_bytes())?;
        }
        self.out = Some(folder.to_owned());
        Ok(())
    }
}

impl fmt::Display for ErrorReport<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&text(self))?;
        match &self.out {
            Some(out) => write!(f, "look at {}", out.join("error.svg").display()),
            None => Ok(()),
        }
    }
}

/// Describes the reference: its folder, or its samples per pixel followed by `what`.
fn truth(reference: &Reference, what: &str) -> String {
    reference.record.as_ref().map_or_else(
        || format!("the images in {}", reference.dir.display()),
        |record| format!("{} {what}", record.spp),
    )
}

/// Formats the conditions, one table for each variant and layer, and the summary.
fn text(report: &ErrorReport) -> String {
    let ErrorReport { reference, rows, slopes, .. } = report;
    let mut text = format!(
        "{}, {} x {} px{}, against {}",
        report.scene,
        report.film[0],
        report.film[1],
        on_cpu(),
        truth(reference, "samples of another seed")
    );
    if let Some(record) = &reference.record {
        let stated: Vec<String> = Layer::NAMES
            .iter()
            .zip(record.error_rms)
            .map(|(name, error)| format!("{name} {}", optional(error, |e| format!("{e:.1e}"))))
            .collect();
        let _ = write!(text, " (stated error of the reference: {})", stated.join(", "));
    }
    text += "\n";
    for slope in slopes {
        let tail = slope
            .tail_slope
            .map_or_else(String::new, |s| format!(", samples^{s:.2} from 16 samples on"));
        let of_slope = |row: &&LayerRow| row.variant == slope.variant && row.layer == slope.layer;
        let has_samples = rows.iter().filter(of_slope).any(|row| row.samples > 0.0);
        let fitted = slope.slope.map_or_else(
            || if has_samples { "too few rungs for a slope" } else { "in closed form" }.to_owned(),
            |s| format!("RMSE ~ samples^{s:.2} over {} rungs{tail}", slope.rungs),
        );
        let _ = writeln!(text, "\n{}, {}: {fitted}\n", slope.layer, slope.variant);
        if !has_samples {
            continue;
        }
        let cells = rows.iter().filter(of_slope).map(|row| {
            let d = &row.deviation;
            vec![
                format!("{}", (row.samples * 10.0).round() / 10.0),
                format!("{:.3}", row.cpu_s),
                format!("{:.2e}", d.rmse),
                format!("{:.2e}", d.relative_mse),
                format!("{:+.1e}", d.bias),
                format!("{:.3}", d.srgb_steps),
                format!("{:.2e}", d.cell_rmse_worst),
                format!("{:.2e}", d.cell_rmse_p99),
                optional(row.stated_over_true, |ratio| format!("{ratio:.2}")),
            ]
        });
        let head = "samples | CPU s | RMSE | relative MSE | bias | sRGB steps | worst 8x8 | p99 8x8 | stated/true";
        text += &table(head, cells, 0);
    }
    text += "\n";
    text += &summary(rows, slopes);
    text += "\n";
    text
}

/// Formats a table with one row for each layer. A row has each variant's slopes, and the variant's error and CPU time
/// at the last rung.
fn summary(rows: &[LayerRow], slopes: &[Slope]) -> String {
    let top = rows.iter().map(|row| row.spp).max().unwrap_or(0);
    let heads =
        VARIANTS.map(|v| format!(" | {} slope | from 16 | RMSE at {top} spp | CPU s", v.name));
    let rows = Layer::NAMES.into_iter().map(|layer| {
        let mut cells = vec![layer.to_owned()];
        for variant in VARIANTS {
            let slope = slopes.iter().find(|s| s.variant == variant.name && s.layer == layer);
            for fitted in [slope.and_then(|s| s.slope), slope.and_then(|s| s.tail_slope)] {
                cells.push(optional(fitted, |s| format!("{s:.2}")));
            }
            let last =
                rows.iter().find(|r| r.variant == variant.name && r.layer == layer && r.spp == top);
            cells.push(optional(last.map(|r| r.deviation.rmse), |e| format!("{e:.2e}")));
            cells.push(optional(last.map(|r| r.cpu_s), |s| format!("{s:.2}")));
        }
        cells
    });
    table(&format!("layer{}", heads.concat()), rows, 1)
}

fn optional(value: Option<f64>, print: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "-".to_owned(), print)
}
