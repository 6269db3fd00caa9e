//! What `evaluate` says: a table with what one must know of it, and the same as JSON.

use super::evaluate_rows::{Gain, LeftOut};
use super::network::Network;
use compose::{Protocol, Row, Scores, means_table};
use serde_json::{Value, json};
use std::fmt::Write;

/// All that an evaluation found.
pub(super) struct Evaluation<'a> {
    /// Folder of the run, or of the pairs.
    pub(super) place: String,
    /// Of a run.
    pub(super) split: Option<&'static str>,
    pub(super) methods: &'a [String],
    pub(super) rows: &'a [Row],
    pub(super) gain: Option<&'a Gain>,
    /// With their rows' names.
    pub(super) networks: &'a [(String, Network)],
    /// Side of the networks' tiles, px.
    pub(super) tile_px: u32,
    pub(super) left_out: &'a [LeftOut],
}

impl Evaluation<'_> {
    /// The table, and the lines under it.
    pub(super) fn text(&self, protocol: Protocol) -> String {
        let mut text = means_table(self.rows, protocol);
        text.push('\n');
        text += "Protocol: no resizing; scored as 8-bit sRGB. Means over images.\n";
        text += "input: the pictures as they are.\n";
        if let Some(gain) = self.gain {
            let _ = writeln!(
                text,
                "{}: their linear light times the factor that is best for {}: what comes of brightness alone.",
                gain.row_name(),
                gain.fitted_to(),
            );
        }
        for (name, network) in self.networks {
            let _ = writeln!(text, "{name}: {}.", network.path.display());
        }
        let tiled = |row: &&Row| row.width.max(row.height) > self.tile_px;
        let tiled = self.of_method("input").filter(tiled).count();
        if tiled > 0 && !self.networks.is_empty() {
            let _ = writeln!(
                text,
                "Networks saw {} in overlapping tiles of {} px, each with a norm of its own.",
                counted(tiled, "picture"),
                self.tile_px,
            );
        }
        text
    }

    /// A document of its own.
    pub(super) fn markdown(&self, protocol: Protocol) -> String {
        let mut text = format!("# Evaluation\n\n{}\n\n", self.what());
        // Lines of the text are paragraphs' items here, or they would run into one another.
        let (table, notes) = match self.text(protocol).rsplit_once("\n\n") {
            Some((table, notes)) => (format!("{table}\n"), notes.to_owned()),
            None => (String::new(), self.text(protocol)),
        };
        text += &table;
        text.push('\n');
        for note in notes.lines() {
            let _ = writeln!(text, "- {note}");
        }
        if !self.left_out.is_empty() {
            text += "\n## Left out\n\n";
            for LeftOut { image, reason } in self.left_out {
                let _ = writeln!(text, "- {image}: {reason}");
            }
        }
        text
    }

    /// What was scored, in a line.
    pub(super) fn what(&self) -> String {
        let images = self.rows.len() / self.methods.len().max(1);
        let what = match self.split {
            Some("all") => counted(images, "scene"),
            Some(split) => counted(images, &format!("{split} scene")),
            None => counted(images, "pair"),
        };
        let left_out = match self.left_out.len() {
            0 => String::new(),
            count => format!("; left out: {}", counted(count, "picture")),
        };
        format!("{what} of {}{left_out}.", self.place)
    }

    /// The object of `--json`, without the files. PSNR of equal pictures is the string `inf`; means of nothing are null.
    pub(super) fn json(&self) -> Value {
        let rows: Vec<Value> = self.methods.iter().map(|m| self.row_json(m)).collect();
        let networks = self.networks.iter().map(|(name, network)| {
            let state = &network.state;
            json!({
                "method": name, "path": network.path.display().to_string(), "stage": state.stage.name(),
                "step": state.step, "features": state.settings.features, "examples": state.settings.examples,
                "a_priori": state.settings.a_priori,
            })
        });
        let left_out = self.left_out.iter();
        json!({
            "where": self.place, "split": self.split,
            "images": self.rows.len() / self.methods.len().max(1),
            "resized": false, "bits": 8, "tile_px": self.tile_px, "rows": rows,
            "gain": self.gain.map(|gain| json!({
                "factor": gain.factor, "fitted_to": gain.place, "images": gain.images,
            })),
            "checkpoints": networks.collect::<Vec<_>>(),
            "left_out": left_out.map(|l| json!({ "image": l.image, "reason": l.reason })).collect::<Vec<_>>(),
        })
    }

    fn of_method(&self, method: &str) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.method == method)
    }

    fn row_json(&self, method: &str) -> Value {
        let of_method = || self.of_method(method);
        let scores: Vec<Scores> = of_method().map(|row| row.scores).collect();
        let mut object = mean_json(&scores);
        let measured = of_method().any(|row| row.shift_px.is_some());
        let aligned: Vec<Scores> = of_method()
            .filter(|row| row.is_aligned())
            .map(|row| row.scores)
            .collect();
        object["aligned"] = if measured {
            mean_json(&aligned)
        } else {
            Value::Null
        };
        let mut row = json!({ "method": method });
        if let (Value::Object(row), Value::Object(object)) = (&mut row, object) {
            row.extend(object);
        }
        row
    }
}

fn mean_json(scores: &[Scores]) -> Value {
    let mean = Scores::mean(scores);
    json!({
        "images": scores.len(),
        "psnr_colour_db": number(mean.psnr_colour_db), "ssim_grey": number(mean.ssim_grey),
        "psnr_channels_db": number(mean.psnr_channels_db), "ssim_channels": number(mean.ssim_channels),
    })
}

/// `1 pair`, `2 pairs`.
fn counted(count: usize, what: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {what}{plural}")
}

/// JSON has no infinite numbers.
fn number(value: f64) -> Value {
    if value.is_infinite() {
        json!("inf")
    } else {
        json!(value)
    }
}

impl Gain {
    /// How its row is called.
    pub(super) fn row_name(&self) -> String {
        format!("input x {:.3}", self.factor)
    }

    fn fitted_to(&self) -> String {
        format!("{} of {}", counted(self.images, self.kind), self.place)
    }
}
