//! TensorBoard event files: every record's checksums, and which numbers there are.

use super::facts::{Inspection, Problem, first_of, many};
use super::kind::Kind;
use super::look::Input;
use serde_json::json;
use std::collections::BTreeSet;
use train::masked_crc;

/// What to do: nothing is computed from these files.
const NOTHING: &str = "nothing is lost but the curves from there on: metrics.csv has the numbers";

pub(super) fn read(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::Events);
    let (mut rest, mut at) = (input.bytes, 0u64);
    let (mut records, mut steps, mut tags) = (0u64, None::<[u64; 2]>, BTreeSet::new());
    while !rest.is_empty() {
        let (event, after) = match record(rest) {
            Ok(parts) => parts,
            Err(what) => {
                let problem =
                    Problem::new(what, NOTHING).at(format!("record {} (byte {at})", records + 1));
                found.wrong(problem);
                break;
            }
        };
        at += (rest.len() - after.len()) as u64;
        rest = after;
        records += 1;
        let (step, names) = facts_of(event);
        if !names.is_empty() {
            let [first, last] = steps.unwrap_or([step, step]);
            steps = Some([first.min(step), last.max(step)]);
        }
        tags.extend(names);
    }
    found
        .facts
        .fact("records", many(records, "record"), records);
    if let Some([first, last]) = steps {
        found
            .facts
            .fact("steps", format!("{first} to {last}"), json!([first, last]));
    }
    let tags: Vec<String> = tags.into_iter().collect();
    found.facts.fact("tags", first_of(&tags, 12), json!(tags));
    found.is_whole("both checksums of every record fit");
    found
}

/// The first record's content, and what comes after it.
fn record(bytes: &[u8]) -> Result<(&[u8], &[u8]), String> {
    let cut = || "it is cut within a record: the program was stopped while it wrote".to_owned();
    let (length, rest) = bytes.split_at_checked(8).ok_or_else(cut)?;
    let (sum, rest) = rest.split_at_checked(4).ok_or_else(cut)?;
    if masked_crc(length).to_le_bytes() != sum {
        return Err("the checksum of a record's length does not fit".to_owned());
    }
    let length = length
        .iter()
        .rev()
        .fold(0u64, |number, byte| number << 8 | u64::from(*byte));
    let length = usize::try_from(length).map_err(|_| cut())?;
    let (event, rest) = rest.split_at_checked(length).ok_or_else(cut)?;
    let (sum, rest) = rest.split_at_checked(4).ok_or_else(cut)?;
    if masked_crc(event).to_le_bytes() != sum {
        return Err("the checksum of a record does not fit".to_owned());
    }
    Ok((event, rest))
}

/// Step and names of an `Event`'s values.
fn facts_of(event: &[u8]) -> (u64, Vec<String>) {
    let (mut step, mut tags) = (0, Vec::new());
    for (field, value) in fields(event) {
        match (field, value) {
            (2, Field::Number(number)) => step = number,
            (5, Field::Bytes(summary)) => {
                let values = fields(summary).into_iter().filter(|(field, _)| *field == 1);
                for (_, value) in values {
                    let Field::Bytes(value) = value else { continue };
                    let tag = fields(value).into_iter().find(|(field, _)| *field == 1);
                    if let Some((_, Field::Bytes(tag))) = tag {
                        tags.push(String::from_utf8_lossy(tag).into_owned());
                    }
                }
            }
            _ => {}
        }
    }
    (step, tags)
}

/// A field of a protocol buffer.
enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

/// The fields of a message, as far as they make sense.
fn fields(mut bytes: &[u8]) -> Vec<(u64, Field<'_>)> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let Some((key, rest)) = varint(bytes) else {
            break;
        };
        let fixed = |length: usize| {
            let (value, rest) = rest.split_at_checked(length)?;
            Some((Field::Bytes(value), rest))
        };
        let next = match key & 7 {
            0 => varint(rest).map(|(number, rest)| (Field::Number(number), rest)),
            1 => fixed(8),
            2 => varint(rest).and_then(|(length, rest)| {
                let (value, rest) = rest.split_at_checked(usize::try_from(length).ok()?)?;
                Some((Field::Bytes(value), rest))
            }),
            5 => fixed(4),
            _ => None,
        };
        let Some((value, rest)) = next else { break };
        found.push((key >> 3, value));
        bytes = rest;
    }
    found
}

fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let mut number = 0u64;
    for (index, byte) in bytes.iter().take(10).enumerate() {
        number |= u64::from(byte & 0x7f) << (7 * index);
        if byte & 0x80 == 0 {
            return Some((number, &bytes[index + 1..]));
        }
    }
    None
}
