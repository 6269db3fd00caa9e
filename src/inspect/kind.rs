//! Kinds of files and folders. The first bytes of a file decide its kind, or its name if the bytes do not decide.

use crate::report::is_report;

macro_rules! kinds {
    ($($kind:ident $name:literal $words:literal)*) => {
        /// A kind of file or folder.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind {
            $(#[doc = $words] $kind,)*
        }

        impl Kind {
            /// Returns the kind's name in JSON.
            pub fn name(self) -> &'static str {
                match self { $(Self::$kind => $name,)* }
            }

            /// Returns the kind's name for people.
            pub fn words(self) -> &'static str {
                match self { $(Self::$kind => $words,)* }
            }
        }
    };
}

kinds! {
    Partial "partial" "partial, the result of one shard"
    TupleExr "tuple_exr" "tuple.exr, the layers of one scene"
    Exr "exr" "OpenEXR image"
    TupleRecord "tuple_record" "tuple.json, the record of one scene's tuple"
    Spec "spec" "spec.json, the frozen settings of a run"
    Manifest "manifest" "manifest, one scene per line"
    Scene "scene" "single scene, for `glasshouse render`"
    Recipe "recipe" "recipe"
    DepthRanges "depth_ranges" "table of depth ranges by category"
    PhotographList "photograph_list" "list of photographs"
    Rejected "rejected" "list of rejected draws"
    Quarantine "quarantine" "quarantine record: the error of a scene that cannot be made"
    Attempt "attempt" "record of an attempt at some shards"
    Control "control" "control.json, which pauses or cancels a run"
    Receipt "receipt" "receipt: the worker of a tuple"
    MadeBy "made_by" "note: the worker of some partials"
    Finished "finished" "finished.json, the mark of a finished run"
    TrainRecipe "train_recipe" "train.json, the recipe's [train]"
    CheckpointState "checkpoint_state" "state.json of a checkpoint"
    Tensors "tensors" "safetensors file"
    Best "best" "best.json, the best checkpoint of a stage"
    Metrics "metrics" "metrics.csv, the losses of a training stage"
    Events "events" "TensorBoard event file"
    EvaluationRows "evaluation_rows" "scores, one row per picture"
    EvaluationTable "evaluation_table" "table of mean scores"
    Output "output" "JSON that a command of this program printed"
    Archive "archive" "tar archive"
    Tuples "tuples" "shard of exported tuples, in the format of safetensors"
    Listing "listing" "list of an exported data set, one sample per line"
    Card "card" "README.md, the card of an exported data set"
    Croissant "croissant" "croissant.json, the description of an exported data set"
    Sums "sums" "SHA256SUMS, digests of the files beside it"
    Report "report" "report page"
    Written "written" "list of the files that commands wrote into a folder"
    Photographs "photographs" "photograph.json, the record of one scene's photographs"
    Developed "developed" "develop.json, the record of a folder of photographs"
    DepthMaps "depth_maps" "depth.json, the record of a folder of depth maps"
    DepthRecords "depth_records" "made.jsonl, the digests of pictures and their depth maps"
    Digests "digests" "memory of digests, for the next call of a command"
    DevelopedFolder "developed_folder" "photographs of a run's scenes"
    DepthFolder "depth_folder" "depth maps of a folder of pictures"
    TrainedOn "trained_on" "tuples.json, the tuples of a training"
    Raw "raw" "raw.dng, the numbers of a scene's sensor"
    Picture "picture" "picture"
    Array "array" ".npy array"
    Mesh "mesh" "PLY mesh"
    Lock "lock" "lock, empty on purpose"
    Run "run" "run"
    TupleFolder "tuple" "tuple, all files of one scene"
    CheckpointFolder "checkpoint" "checkpoint of a training stage"
    StageFolder "stage" "training of one stage"
    Unknown "unknown" "unknown"
}

/// Schemas of JSON and TOML files, with the kinds of the files.
const SCHEMAS: &[(&str, Kind)] = &[
    (glasshouse_line::SCENE_SCHEMA, Kind::Scene),
    (plan::RECIPE_SCHEMA, Kind::Recipe),
    (plan::PHOTOGRAPH_SCHEMA, Kind::PhotographList),
    (plan::DEPTH_RANGES_SCHEMA, Kind::DepthRanges),
    (render::shard::SPEC_SCHEMA, Kind::Spec),
    (render::merge::TUPLE_SCHEMA, Kind::TupleRecord),
    (crate::run::QUARANTINE_SCHEMA, Kind::Quarantine),
    (crate::run::ATTEMPT_SCHEMA, Kind::Attempt),
    (crate::run::CONTROL_SCHEMA, Kind::Control),
    ("glasshouse.receipt/1", Kind::Receipt),
    ("glasshouse.made_by/1", Kind::MadeBy),
    ("glasshouse.finished/1", Kind::Finished),
    (crate::develop::PHOTOGRAPHS_SCHEMA, Kind::Photographs),
    (crate::develop::REQUEST_SCHEMA, Kind::Developed),
    ("glasshouse.depth_maps/1", Kind::DepthMaps),
    (crate::made::DEPTH_RECORD_SCHEMA, Kind::DepthRecords),
    (crate::made::DIGESTS_SCHEMA, Kind::Digests),
    ("glasshouse.trained_on/1", Kind::TrainedOn),
    ("glasshouse.checkpoint/1", Kind::CheckpointState),
    (crate::outputs::WRITTEN_SCHEMA, Kind::Written),
];

/// Returns the schema of a kind's files, if they have a schema.
pub(super) fn schema_of(kind: Kind) -> Option<&'static str> {
    let kind = if kind == Kind::Manifest { Kind::Scene } else { kind };
    SCHEMAS.iter().find(|(_, of)| *of == kind).map(|(schema, _)| *schema)
}

/// Finds the kind of a file by its first bytes. For JSON without a unique form, the name decides, too.
pub(super) fn kind_of(name: &str, head: &[u8]) -> Option<Kind> {
    Some(match head {
        [] => return None,
        [0x76, 0x2f, 0x31, 0x01, ..] => Kind::Exr,
        [0x89, b'P', b'N', b'G', ..] | [0xff, 0xd8, 0xff, ..] | [b'#', b'?', b'R', ..] => {
            Kind::Picture
        }
        [b'P', b'1'..=b'7' | b'f' | b'F', b' ' | b'\t' | b'\r' | b'\n' | b'#', ..] => Kind::Picture,
        [b'I', b'I', b'*', 0, ..] if contains(head, b"Glasshouse") => Kind::Raw,
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Kind::Array,
        [b'p', b'l', b'y', b'\r' | b'\n', ..] => Kind::Mesh,
        _ if head.get(257..262) == Some(b"ustar") => Kind::Archive,
        // The metadata precede the tensors.
        [_, _, _, _, _, 0, 0, 0, b'{', start @ ..]
            if contains(&start[..start.len().min(64)], b"glasshouse.tuples/") =>
        {
            Kind::Tuples
        }
        [_, _, _, _, _, 0, 0, 0, b'{', ..] => Kind::Tensors,
        // A record starts with its length and checksum; the first event has the time and this text.
        _ if head.get(12..64).is_some_and(|start| contains(start, b"brain.Event:")) => Kind::Events,
        _ => return text_kind(name, text_of(head)?),
    })
}

/// Returns the head as text without leading spaces, or `None` if it is binary. The head may end within a character.
fn text_of(head: &[u8]) -> Option<&str> {
    if head.contains(&0) {
        return None;
    }
    let text = match std::str::from_utf8(head) {
        Ok(text) => text,
        Err(error) if head.len() - error.valid_up_to() < 4 => {
            std::str::from_utf8(&head[..error.valid_up_to()]).ok()?
        }
        Err(_) => return None,
    };
    Some(text.trim_start_matches('\u{feff}').trim_start())
}

fn text_kind(name: &str, text: &str) -> Option<Kind> {
    let first = text.lines().next().unwrap_or_default();
    if text.starts_with('{') {
        return json_kind(name, text);
    }
    if is_report(text.as_bytes()) {
        return Some(Kind::Report);
    }
    if first.starts_with("step,total,") {
        return Some(Kind::Metrics);
    }
    if first.starts_with("method,group,image,width,height,") {
        return Some(Kind::EvaluationRows);
    }
    if first.starts_with("| Method") || text.contains("\n| Method") {
        return Some(Kind::EvaluationTable);
    }
    if first == "---" && text.contains("\n- reflection-separation\n") {
        return Some(Kind::Card);
    }
    if is_sum(first) {
        return Some(Kind::Sums);
    }
    // In TOML, a key starts a line.
    text.lines()
        .find_map(|line| line.strip_prefix("schema").map(str::trim_start))
        .and_then(|rest| by_schema(rest.strip_prefix('=')?.trim_start().strip_prefix('"')?))
}

/// Finds the kind of files with the schema at the start of `text`, in any version.
fn by_schema(text: &str) -> Option<Kind> {
    let schema = text.split(['"', '\n']).next()?;
    let stem = |schema: &'static str| schema.split('/').next().unwrap_or(schema);
    let known = SCHEMAS.iter().find(|(known, _)| Some(stem(known)) == schema.split('/').next());
    match known {
        Some((_, kind)) => Some(*kind),
        None => schema.starts_with("glasshouse.").then_some(Kind::Output),
    }
}

fn json_kind(name: &str, text: &str) -> Option<Kind> {
    let schema = text.split_once("\"schema\"").and_then(|(_, rest)| {
        by_schema(rest.trim_start().strip_prefix(':')?.trim_start().strip_prefix('"')?)
    });
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let first = lines.next().unwrap_or_default();
    let is_lines = name.rsplit('.').next() == Some("jsonl")
        || (first.ends_with('}') && lines.next().is_some_and(|l| l.starts_with('{')));
    if let Some(kind) = schema {
        return Some(match kind {
            Kind::Scene if is_lines => Kind::Manifest,
            // The records of an exported data set.
            Kind::TupleRecord if is_lines => Kind::Listing,
            kind => kind,
        });
    }
    if text.contains("\"@context\"") {
        return Some(Kind::Croissant);
    }
    if is_lines && first.contains("\"rule\"") && first.contains("\"attempt\"") {
        return Some(Kind::Rejected);
    }
    if is_lines && first.contains("file_name\"") {
        return Some(Kind::Listing);
    }
    match name {
        "best.json" | "train.json" => kind_by_name(name),
        _ => None,
    }
}

/// True if a line has the form of `sha256sum`: digest, two spaces (or a space and `*`), name.
fn is_sum(line: &str) -> bool {
    let is_hex = |digest: &str| digest.bytes().all(|b| b.is_ascii_hexdigit());
    line.split_at_checked(64).is_some_and(|(digest, name)| {
        is_hex(digest) && (name.starts_with("  ") || name.starts_with(" *"))
    })
}

/// Finds the kind of a file by its name.
pub(super) fn kind_by_name(name: &str) -> Option<Kind> {
    let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
    Some(match name {
        "tuple.exr" => Kind::TupleExr,
        "tuple.json" => Kind::TupleRecord,
        "spec.json" => Kind::Spec,
        "manifest.jsonl" => Kind::Manifest,
        "rejected.jsonl" => Kind::Rejected,
        "metadata.jsonl" => Kind::Listing,
        "control.json" => Kind::Control,
        "finished.json" => Kind::Finished,
        "train.json" => Kind::TrainRecipe,
        "state.json" => Kind::CheckpointState,
        "best.json" => Kind::Best,
        "metrics.csv" => Kind::Metrics,
        "evaluation.csv" => Kind::EvaluationRows,
        "evaluation.json" => Kind::Output,
        "index.html" => Kind::Report,
        "evaluation.md" => Kind::EvaluationTable,
        "croissant.json" => Kind::Croissant,
        "SHA256SUMS" => Kind::Sums,
        crate::outputs::WRITTEN_FILE => Kind::Written,
        "work.lock" | "train.lock" | "export.lock" => Kind::Lock,
        _ if name.starts_with("events.out.tfevents") => Kind::Events,
        _ if ending == "exr"
            && name.len() == 10
            && name.bytes().take(6).all(|b| b.is_ascii_digit()) =>
        {
            Kind::Partial
        }
        _ => match ending {
            "exr" => Kind::Exr,
            "png" | "jpg" | "jpeg" | "jfif" | "ppm" | "pgm" | "pfm" | "hdr" => Kind::Picture,
            "npy" => Kind::Array,
            "ply" => Kind::Mesh,
            "tar" => Kind::Archive,
            "safetensors" => Kind::Tensors,
            "toml" => Kind::Recipe,
            "jsonl" => Kind::Manifest,
            _ => return None,
        },
    })
}

fn contains(bytes: &[u8], what: &[u8]) -> bool {
    bytes.windows(what.len()).any(|window| window == what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_decides_before_the_name() {
        let of = |text: &str| kind_of("x.png", text.as_bytes());
        assert_eq!(of(r#"{ "schema" : "glasshouse.spec/1"}"#), Some(Kind::Spec));
        assert_eq!(of(r#"{"schema":"glasshouse.spec/9"}"#), Some(Kind::Spec));
        assert_eq!(of(r#"{"schema":"glasshouse.status/1"}"#), Some(Kind::Output));
        assert_eq!(of("# words\nschema = \"glasshouse.recipe/1\"\n"), Some(Kind::Recipe));
        assert_eq!(of("\u{feff}step,total,a\n"), Some(Kind::Metrics));
        let line = "{\"schema\":\"glasshouse.scene/1\"}\n";
        assert_eq!(of(line), Some(Kind::Scene));
        assert_eq!(of(&line.repeat(2)), Some(Kind::Manifest));
        assert_eq!(kind_of("a.jsonl", line.as_bytes()), Some(Kind::Manifest));
        for nothing in ["", "words", "{\"a\":1}", "<!doctype html><title>x</title>", "\0\0"] {
            assert_eq!(of(nothing), None, "{nothing:?}");
        }
    }
}
