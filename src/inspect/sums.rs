//! `SHA256SUMS`: the files beside it, held against it.

use super::facts::{Inspection, Problem, many};
use super::kind::Kind;
use super::look::Input;
use serde_json::json;
use sha2::{Digest, Sha256};
use std::fmt::Write;

/// Digest and name of a line as `sha256sum` writes it.
pub(super) fn line(text: &str) -> Option<(&str, &str)> {
    let (digest, name) = text.split_at_checked(64)?;
    let name = name
        .strip_prefix("  ")
        .or_else(|| name.strip_prefix(" *"))?;
    (digest.bytes().all(|b| b.is_ascii_hexdigit()) && !name.is_empty()).then_some((digest, name))
}

/// SHA-256 in hexadecimal digits.
pub(super) fn hex(digest: &[u8]) -> String {
    digest.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// What to do about a file that was changed.
const FETCH: &str = "fetch it again, or export again";

pub(super) fn read(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::Sums);
    let Some(text) = input.text(&mut found) else {
        return found;
    };
    let (mut names, mut same) = (Vec::new(), 0u64);
    for (index, row) in text.lines().enumerate() {
        let Some((digest, name)) = line(row) else {
            let problem = Problem::new("it is no digest and name", FETCH);
            found.wrong(problem.at(format!("line {}", index + 1)));
            continue;
        };
        names.push(name.to_owned());
        match (input.beside)(name) {
            None => found.wrong(Problem::new(
                format!("{name} is not there, or cannot be read"),
                FETCH,
            )),
            Some(bytes) if hex(&Sha256::digest(&bytes)).eq_ignore_ascii_case(digest) => same += 1,
            Some(_) => found.wrong(Problem::new(format!("{name} has another digest"), FETCH)),
        }
    }
    found
        .facts
        .fact("files", many(names.len() as u64, "file"), json!(names));
    found.facts.fact(
        "same",
        format!("{same} have the digest that stands here"),
        same,
    );
    if !text.ends_with('\n') {
        found.wrong(Problem::new("its last line is cut", FETCH));
    }
    found.is_whole(format!("all {same} files have the digests that stand here"));
    found
}
