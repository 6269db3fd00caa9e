//! Finds a file's kind from its bytes or its name, and calls the kind's reader.

use super::digests::{CheckpointDigests, hold_file};
use super::facts::{Inspection, Problem};
use super::input::{AGAIN, Input};
use super::kind::{Kind, kind_by_name, kind_of, schema_of};
use super::{archive, lists, manifest, partial, picture, record, tuple, tuple_shard};
use glasshouse_line::layer::Layer;
use render::atomic_file::is_unfinished;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Number of bytes at the start of a file that decide its kind.
pub(super) const HEAD_BYTES: usize = 1 << 16;

/// Inspects a file. Never panics.
pub fn inspect_bytes(input: &Input) -> Inspection {
    let head = &input.bytes[..input.bytes.len().min(HEAD_BYTES)];
    let by_content = kind_of(input.name, head);
    let kind = by_content.or_else(|| kind_by_name(input.name)).unwrap_or(Kind::Unknown);
    let read = || match by_content {
        None => unknown(input, kind),
        Some(kind) => read(kind, input),
    };
    // Decoders of other crates may panic on hostile bytes.
    let mut found = catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let mut found = Inspection::new(kind);
        found.wrong(Problem::new("its reader panicked on invalid bytes", AGAIN));
        found
    });
    found.bytes = Some(input.bytes.len() as u64);
    found
}

fn read(kind: Kind, input: &Input) -> Inspection {
    match kind {
        Kind::Exr | Kind::Partial | Kind::TupleExr => image(input),
        Kind::TupleRecord => tuple::read_record(input),
        Kind::Manifest | Kind::Scene => manifest::read(kind, input),
        Kind::CheckpointState => {
            let mut found = record::read(kind, input);
            #[cfg(feature = "train")]
            super::tensors::check_state(&mut found, input);
            found
        }
        Kind::Tensors => {
            let mut found = Inspection::new(kind);
            #[cfg(feature = "train")]
            super::tensors::tell(&mut found, input);
            hold_file::<CheckpointDigests>(&mut found, input);
            found
        }
        Kind::Archive => archive::read(input.bytes, input.bytes.len() as u64),
        Kind::Tuples => tuple_shard::read(input),
        Kind::Picture | Kind::Array | Kind::Mesh | Kind::Raw => picture::read(kind, input),
        Kind::PhotographList
        | Kind::Rejected
        | Kind::Listing
        | Kind::Metrics
        | Kind::EvaluationRows
        | Kind::EvaluationTable
        | Kind::Card
        | Kind::Sums
        | Kind::Written
        | Kind::Report => lists::read(kind, input),
        Kind::Events => {
            let mut found = Inspection::new(kind);
            found.may_be_whole("TensorBoard checks every record when it reads the file");
            found
        }
        _ => record::read(kind, input),
    }
}

/// Inspects an OpenEXR file. A partial has the attribute `glasshouse`, and a tuple has layers.
fn image(input: &Input) -> Inspection {
    match super::exr::head(input.bytes) {
        Err(reason) => {
            let kind = kind_by_name(input.name).unwrap_or(Kind::Exr);
            let mut found = Inspection::new(kind);
            let what = format!("its header cannot be read: {reason}");
            found.wrong(Problem::new(what, super::exr::to_do(kind)));
            found
        }
        Ok(head) if head.attribute.is_some() => partial::read(input, &head),
        Ok(head) if Layer::NAMES.iter().any(|layer| head.has_layer(layer)) => {
            tuple::read_exr(input, &head)
        }
        Ok(head) => super::exr::read(input, &head),
    }
}

/// Inspects a file with bytes that identify no kind; `kind` is the kind by its name. Only an empty lock is intact.
fn unknown(input: &Input, kind: Kind) -> Inspection {
    let mut found = Inspection::new(kind);
    let start = format!("\"{}\"", input.bytes[..input.bytes.len().min(16)].escape_ascii());
    let is_empty = input.bytes.is_empty();
    let problem = match kind {
        Kind::Lock if is_empty => {
            found.is_whole("a lock has no bytes");
            return found;
        }
        _ if is_unfinished(Path::new(input.name)) => Problem::new(
            "a process is writing it, or left it when it was killed",
            "delete it if no process works in the folder",
        ),
        _ if is_empty => Problem::new("it is empty: 0 bytes", AGAIN),
        Kind::Unknown => Problem::new(
            format!("this program neither writes nor reads files that start with {start}"),
            "give a file of a run, of `render`, `train`, `evaluate` or `export`, a recipe, an input file, or a run's folder",
        ),
        _ => {
            let expected = schema_of(kind).map_or_else(
                || "its first bytes differ".to_owned(),
                |schema| format!("its first bytes lack the schema {schema:?}"),
            );
            let words = kind.words();
            let what = format!("its name belongs to the kind \"{words}\", but {expected}: {start}");
            Problem::new(what, AGAIN)
        }
    };
    found.wrong(problem);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The inspection of truncated and changed bytes never panics; exactly the files with problems are damaged.
    #[test]
    fn hostile_bytes_become_problems() {
        let beginnings: &[&[u8]] = &[
            b"",
            b"\0",
            b"\x76\x2f\x31\x01",
            b"\x76\x2f\x31\x01\x02\0\0\0channels\0chlist\0\xff\xff\xff\x7f",
            b"\x89PNG\r\n\x1a\n",
            b"\x93NUMPY\x01\0\xff\xff",
            b"ply\nformat ascii 1.0\nelement vertex 99999999999\n",
            b"\xff\xff\xff\xff\xff\0\0\0{",
            b"\x02\0\0\0\0\0\0\0{}",
            b"\x3b\0\0\0\0\0\0\0{\"__metadata__\":{\"schema\":\"glasshouse.tuples/1\",\"scenes\":\"\"}",
            b"\xff\xff\xff\xff\xff\xff\xff\xff\0\0\0\0brain.Event:2",
            b"{\"schema\":\"glasshouse.spec/1\"",
            b"{\"schema\":\"glasshouse.tuple/1\"}",
            b"{\"schema\":\"glasshouse.scene/1\"}\n{",
            b"step,total,x\n1,\n",
            b"method,image,width,height,\n\"",
            b"schema = \"glasshouse.recipe/1\"\nname = ",
            b"<!doctype html><title>x - Glasshouse</title>",
            b"P6 99999 99999 255 ",
            b"{\"@context\"",
        ];
        for start in beginnings {
            for length in 0..=start.len() {
                for fill in [0u8, 0xff, b'9'] {
                    let mut bytes = start[..length].to_vec();
                    bytes.resize(length + 600, fill);
                    for bytes in [&bytes[..], &start[..length]] {
                        let found = inspect_bytes(&Input { name: "x", bytes, beside: &|_| None });
                        assert_eq!(
                            found.whole == super::super::facts::Whole::No,
                            !found.problems.is_empty()
                        );
                    }
                }
            }
        }
    }
}
