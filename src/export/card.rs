//! Formats `README.md`: the dataset card, with the header for the Hugging Face Hub and `datasets`.

use super::card_numbers::{PARAMETERS, SumAndMax};
use super::finish::Summary;
use super::plan::ExportPlan;
use super::request::{ExportFormat, PixelEncoding};
use crate::run::Run;
use glasshouse_line::label::{Label, LabelSet};
use serde_json::json;
use std::fmt::Write;

/// Exclusive upper bounds and names of the Hub's size categories.
const SIZES: [(u64, &str); 6] = [
    (1_000, "n<1K"),
    (10_000, "1K<n<10K"),
    (100_000, "10K<n<100K"),
    (1_000_000, "100K<n<1M"),
    (10_000_000, "1M<n<10M"),
    (u64::MAX, "10M<n<100M"),
];

/// Maximum number of quarantined scenes on the card; `export.json` lists all of them.
const SHOWN: usize = 50;

pub(super) fn card(run: &Run, plan: &ExportPlan, summary: &Summary) -> String {
    let mut text = header(plan, summary);
    for section in [
        what(plan, summary),
        how(plan, summary),
        errors(plan, summary),
        left_out(plan),
        terms(run, summary),
        files(plan),
    ] {
        text.push('\n');
        text += &section;
    }
    text
}

fn header(plan: &ExportPlan, summary: &Summary) -> String {
    let size = SIZES.iter().find(|(below, _)| summary.numbers.tuples < *below);
    let size = size.map_or("", |(_, name)| name);
    // The name is a JSON string, because any JSON string is a valid YAML string.
    let mut text = format!(
        "---\nlicense: other\npretty_name: {}\ntask_categories:\n- image-to-image\ntags:\n- reflection-removal\n- \
         reflection-separation\n- synthetic\n- image\nsize_categories:\n- {size}\n",
        json!(plan.request.name)
    );
    let pattern = match plan.request.format {
        ExportFormat::Webdataset => "-*.tar",
        ExportFormat::Imagefolder => "/**",
        ExportFormat::Pairs | ExportFormat::Exr | ExportFormat::Safetensors => "",
    };
    if !pattern.is_empty() {
        text += "configs:\n- config_name: default\n  data_files:\n";
        for split in summary.splits.keys() {
            let _ = writeln!(text, "  - split: {split}\n    path: \"{split}{pattern}\"");
        }
    }
    text + "---\n"
}

fn what(plan: &ExportPlan, summary: &Summary) -> String {
    let mut text = format!(
        "# {}\n\nPictures of scenes behind a pane of glass that reflects another scene, with their exact layers, for training \
         and testing single-image reflection removal. Glasshouse made them after Kim, Huo and Yoon, \"Single Image Reflection \
         Removal with Physically-Based Training Images\" (CVPR 2020).\n\n| split | tuples |\n|---|---|\n",
        plan.request.name
    );
    for (split, tuples) in &summary.splits {
        let _ = writeln!(text, "| {split} | {tuples} |");
    }
    text += "\nNo photograph is in two splits if a recipe drew the scenes; a manifest written by hand may differ.\n";
    text += "\n| layer | contents |\n|---|---|\n";
    let contents = [
        "I: the front scene through the glass and the back scene reflected by it, with the lens",
        "T: the front scene through glass without losses and ghosts, with the lens",
        "R~: the back scene reflected by the glass (double image, loss), with the lens",
        "R: the back scene mirrored, without effects of glass and lens",
    ];
    for (layer, name) in plan.layers() {
        let _ = writeln!(text, "| `{name}` | {} |", contents[layer]);
    }
    for label in plan.labels.iter() {
        let _ = writeln!(text, "| `{label}` | {} |", label_contents(label));
    }
    let pixels = match plan.request.encoding {
        PixelEncoding::Srgb8 => "PNG of 8-bit sRGB codes; values above 1 are clipped",
        PixelEncoding::Srgb16 => "PNG of 16-bit sRGB codes; values above 1 are clipped",
        PixelEncoding::Photograph => {
            "PNG of photographs: `input` behind a camera with noise and JPEG, the others with its exposure and development, \
             without noise (each scene's `sensor` in the manifest has the numbers)"
        }
        PixelEncoding::Linear if plan.request.format == ExportFormat::Safetensors => {
            "tensors of 3 x height x width, linear Rec.709, not clipped, half floats (32-bit floats where the tuple has them)"
        }
        PixelEncoding::Linear => {
            "OpenEXR, linear Rec.709, not clipped, half floats (32-bit floats where the tuple has them)"
        }
    };
    let _ = write!(
        text,
        "\nPixels: {pixels}. `input - glass_reflection` is the front scene through the real glass only in linear light, not \
         in sRGB codes.\n"
    );
    if plan.labels != LabelSet::default() {
        text += match plan.request.format {
            ExportFormat::Exr => {
                "Labels are parts of the OpenEXR files, with their own channels.\n"
            }
            ExportFormat::Safetensors => {
                "Labels are tensors of height x width, or of 3 x height x width, linear; `front_depth` has 32-bit floats, the \
                 others have the precision of the tuple.\n"
            }
            ExportFormat::Webdataset | ExportFormat::Imagefolder | ExportFormat::Pairs => {
                "Labels are NumPy arrays (`.npy`) of height x width, or of height x width x 3, linear; `front_depth` has 32-bit \
                 floats, the others have the precision of the tuple.\n"
            }
        };
    }
    text
}

/// Describes a label in the table of layers.
fn label_contents(label: Label) -> &'static str {
    match label {
        Label::Coverage => "share of the pixel's camera rays that meet glass, 0 to 1",
        Label::FrontDepth => {
            "distance of the front's nearest surface along the optical axis, m; infinite without a surface"
        }
        Label::Ghosts => "R~ without the reflection of the glass's first face",
        Label::ReflectedShare => "luminance of R~ over that of I, 0 to 1",
    }
}

fn how(plan: &ExportPlan, summary: &Summary) -> String {
    let request = &plan.request;
    let mut text = format!(
        "## How it was made\n\nRecipe `{}`, manifest {} (BLAKE3), tracer version {}. RGBD photographs become sheets in space with \
         the photographed radiance; the tracer follows rays through a thin lens and a plane-parallel pane, and computes the \
         pane's orders of reflection in closed form.\n\n| parameter | least | largest |\n|---|---|---|\n",
        request.name, request.manifest_blake3, request.tracer_version
    );
    for ((name, _), [least, largest]) in PARAMETERS.iter().zip(&summary.numbers.ranges) {
        let _ = writeln!(text, "| {name} | {least} | {largest} |");
    }
    text
}

fn errors(plan: &ExportPlan, summary: &Summary) -> String {
    let mut text = "## Stated errors\n\nEach tuple states the RMS error of each layer, estimated from its own samples (linear light, \
                    white is 1). The table has these errors over all tuples, and the share of values above 1, which PNGs clip:\n\n\
                    | layer | pictures | mean error | largest error | mean share clipped | largest share |\n|---|---|---|---|---|---|\n"
        .to_owned();
    for (_, name) in plan.layers() {
        let Some(layer) = summary.numbers.layers.get(name) else {
            continue;
        };
        let [error, largest] = mean_and_max(layer.error, layer.stated);
        let [clipped, most] = mean_and_max(layer.clipped, layer.images);
        let _ = writeln!(
            text,
            "| `{name}` | {} | {error} | {largest} | {clipped} | {most} |",
            layer.images
        );
    }
    text
}

fn mean_and_max(of: SumAndMax, count: u64) -> [String; 2] {
    if count == 0 {
        return ["not stated".to_owned(), "not stated".to_owned()];
    }
    [of.sum / count as f64, of.max]
        .map(|value| if value == 0.0 { "0".to_owned() } else { format!("{value:.2e}") })
}

fn left_out(plan: &ExportPlan) -> String {
    let mut text = "## Missing scenes\n\n".to_owned();
    let missing = plan.missing();
    if missing > 0 {
        let _ = writeln!(
            text,
            "Scenes of the manifest that were not rendered yet when this set was exported: {missing}.\n"
        );
    }
    let quarantined = plan.quarantined().count();
    if quarantined == 0 {
        text += "No scene is in quarantine.\n";
        return text;
    }
    let _ = writeln!(
        text,
        "Scenes in quarantine, because they could not be rendered: {quarantined}.\n\n| scene | reason |\n|---|---|"
    );
    for (scene, reason) in plan.quarantined().take(SHOWN) {
        let reason = reason.replace('|', "\\|").replace(['\n', '\r'], " ");
        let _ = writeln!(text, "| `{scene}` | {reason} |");
    }
    if quarantined > SHOWN {
        let _ = writeln!(text, "\n`export.json` lists all of them.");
    }
    text
}

fn terms(run: &Run, summary: &Summary) -> String {
    let mut text = "## Sources and terms\n\nThe pictures show photographs of the sources below. **The sources' own terms apply to them**; \
                    `license: other` above remains until the publisher of this set names a licence that those terms allow.\n\n\
                    | source | sides of scenes | |\n|---|---|---|\n"
        .to_owned();
    for (root, sides) in &summary.numbers.roots {
        let name = if root.is_empty() {
            "files without a named root".to_owned()
        } else {
            format!("`{root}`")
        };
        // Planning writes procedural photographs into the run's folder.
        let is_procedural =
            run.spec.roots.get(root).is_some_and(|folder| folder.starts_with("inputs"));
        let note = if is_procedural {
            "procedural, made by Glasshouse: no photograph"
        } else {
            "photographs; see the terms of their publisher"
        };
        let _ = writeln!(text, "| {name} | {sides} | {note} |");
    }
    text
}

fn files(plan: &ExportPlan) -> String {
    let layout = match plan.request.format {
        ExportFormat::Webdataset => {
            "Shards `SPLIT-NNNNNN.tar` in the form of the WebDataset library, with `ID.LAYER.*` and `ID.json` (the whole record of the \
             tuple) for each tuple; `croissant.json` describes them."
        }
        ExportFormat::Imagefolder => {
            "`SPLIT/metadata.jsonl` and `SPLIT/LAYER/ID.png`, for `datasets.load_dataset`; `croissant.json` describes them."
        }
        ExportFormat::Pairs => {
            "`SPLIT/blended/ID.*` (input), `SPLIT/transmission_layer/`, `SPLIT/reflection_layer/` (glass_reflection), \
             `SPLIT/clean_reflection_layer/`."
        }
        ExportFormat::Exr => {
            "`SPLIT/ID.exr`: a multi-part OpenEXR file for each tuple. Each part has the name of its layer and channels R, G, B."
        }
        ExportFormat::Safetensors => {
            "Shards `SPLIT-NNNNNN.safetensors` with a tensor `ID.LAYER` for each layer of each tuple; the metadata `scenes` lists the \
             ids. `SPLIT.jsonl` has the whole record of each tuple, in the order of the shards."
        }
    };
    format!(
        "## Files\n\n{layout} `export.json` has the request. `SHA256SUMS` has the digests of all files: `sha256sum -c \
         SHA256SUMS` checks them.\n"
    )
}
