//! From bytes to facts: the reader of each kind.

use super::facts::{Inspection, Problem};
use super::kind::{Kind, kind_by_name, kind_of, schema_of};
use super::{
    archive, checkpoint, exr, listing, manifest, page, picture, recipe, records, spec, sums, table,
    tuple,
};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Bytes that tell the kind.
pub(super) const HEAD_BYTES: usize = 1 << 16;

/// A file's bytes, its name, and the files beside it.
pub struct Input<'a> {
    /// Without folders.
    pub name: &'a str,
    /// All of it.
    pub bytes: &'a [u8],
    /// A file in the same folder (or in one above: `../x`), if it is there and can be read.
    pub beside: &'a dyn Fn(&str) -> Option<Vec<u8>>,
}

impl Input<'_> {
    /// The file as text; what is wrong with it is added to `found`.
    pub(super) fn text(&self, found: &mut Inspection) -> Option<&str> {
        match std::str::from_utf8(self.bytes) {
            Ok(text) => Some(text),
            Err(error) => {
                let place = format!("byte {}", error.valid_up_to());
                found.wrong(Problem::new("it is no UTF-8 text", AGAIN).at(place));
                None
            }
        }
    }
}

/// What to do about a file that is one of many.
pub(super) const AGAIN: &str = "take it from where it was made, or make it again";

/// Explains a file. Never panics.
pub fn inspect_bytes(input: &Input) -> Inspection {
    let head = &input.bytes[..input.bytes.len().min(HEAD_BYTES)];
    let by_content = kind_of(input.name, head);
    let kind = by_content
        .or_else(|| kind_by_name(input.name))
        .unwrap_or(Kind::Unknown);
    let read = || match by_content {
        None => unknown(input, kind),
        Some(kind) => read(kind, input),
    };
    // Foreign decoders may panic on hostile bytes.
    let mut found = catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let mut found = Inspection::new(kind);
        found.wrong(Problem::new(
            "its reader gave up on it: the bytes make no sense",
            AGAIN,
        ));
        found
    });
    found.bytes = Some(input.bytes.len() as u64);
    found
}

fn read(kind: Kind, input: &Input) -> Inspection {
    match kind {
        Kind::Exr | Kind::Partial | Kind::TupleExr => exr::read(input),
        Kind::TupleRecord => tuple::read_record(input),
        Kind::Spec => spec::read(input),
        Kind::Manifest | Kind::Scene => manifest::read(kind, input),
        Kind::Recipe | Kind::DepthRanges => recipe::read(kind, input),
        Kind::PhotographList | Kind::Rejected | Kind::Listing => listing::read(kind, input),
        Kind::Metrics | Kind::EvaluationRows | Kind::EvaluationTable => table::read(kind, input),
        Kind::CheckpointState => checkpoint::read_state(input),
        Kind::Tensors => checkpoint::read_tensors(input),
        Kind::Events => checkpoint::read_events(input),
        Kind::Archive => archive::read(
            input.bytes,
            input.bytes.len() as u64,
            input.name,
            input.beside,
        ),
        Kind::Sums => sums::read(input),
        Kind::Report => page::read(input),
        Kind::Picture | Kind::Array | Kind::Mesh => picture::read(kind, input),
        Kind::Quarantine
        | Kind::Attempt
        | Kind::Control
        | Kind::Receipt
        | Kind::MadeBy
        | Kind::Finished
        | Kind::TrainRecipe
        | Kind::Best
        | Kind::Croissant
        | Kind::Output => records::read(kind, input),
        Kind::Lock
        | Kind::Run
        | Kind::TupleFolder
        | Kind::CheckpointFolder
        | Kind::StageFolder
        | Kind::Unknown => Inspection::new(kind),
    }
}

/// A file whose bytes tell nothing; its name may say what was expected.
fn unknown(input: &Input, kind: Kind) -> Inspection {
    let mut found = Inspection::new(kind);
    let name = input.name;
    let is_empty = input.bytes.is_empty();
    let problem = match kind {
        Kind::Lock if is_empty => {
            found.is_whole("a lock has no bytes");
            return found;
        }
        _ if name.starts_with(".tmp-") => Problem::new(
            "it is being written, or was left by a process that was killed",
            "delete it if no process works here",
        ),
        _ if is_empty => Problem::new("it is empty: 0 bytes", AGAIN),
        Kind::Unknown => Problem::new(
            format!(
                "nothing that this program writes or reads begins like this: {}",
                beginning(input.bytes)
            ),
            "give a file of a run, of `render`, `train`, `evaluate` or `export`, a recipe, an input file, or a run's folder",
        ),
        _ => {
            let expected = schema_of(kind).map_or_else(
                || "it does not begin like one".to_owned(),
                |schema| format!("no schema {schema:?} is found at its beginning"),
            );
            Problem::new(
                format!(
                    "its name is that of a {}, but {expected}: {}",
                    kind.words(),
                    beginning(input.bytes)
                ),
                AGAIN,
            )
        }
    };
    found.wrong(problem);
    found
}

/// The first bytes: as text if they are that, else as numbers.
fn beginning(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(16)];
    if start.is_empty() {
        return "nothing".to_owned();
    }
    match std::str::from_utf8(start) {
        Ok(text) if text.chars().all(|c| !c.is_control() || c == '\n') => format!("{text:?}"),
        _ => {
            let hex: Vec<String> = start.iter().map(|byte| format!("{byte:02x}")).collect();
            format!("bytes {}", hex.join(" "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No bytes of any kind, cut or changed anywhere, make a reader panic or say that all is well when it cannot know.
    #[test]
    fn hostile_bytes_come_back() {
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
                        let found = inspect_bytes(&Input {
                            name: "x",
                            bytes,
                            beside: &|_| None,
                        });
                        assert_eq!(
                            found.whole == super::super::Whole::No,
                            !found.problems.is_empty()
                        );
                    }
                }
            }
        }
    }
}
