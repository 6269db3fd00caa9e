//! Compares the check with libjpeg-turbo's strict decoder, on the damaged pictures of `tests/formats/jpeg/strict.py`.

use super::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/formats/jpeg")
}

/// Ranges of the scans, from SOS to the next marker that is no restart.
fn scans(jpeg: &[u8]) -> Vec<std::ops::Range<usize>> {
    let (mut found, mut at) = (Vec::new(), 2);
    while jpeg[at + 1] != 0xd9 {
        let (start, marker) = (at, jpeg[at + 1]);
        at += 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
        if marker == 0xda {
            while jpeg[at] != 0xff || matches!(jpeg[at + 1], 0 | 0xd0..=0xd7) {
                at += 1;
            }
            found.push(start..at);
        }
    }
    found
}

fn damaged(jpeg: &[u8], damage: &str, at: usize) -> Vec<u8> {
    let mut bytes = jpeg.to_vec();
    match damage {
        "cut" => {
            bytes.truncate(at);
            bytes.extend([0xff, 0xd9]);
        }
        "scan" => drop(bytes.drain(scans(jpeg)[at].clone())),
        "flip" => bytes[at / 8] ^= 128 >> (at % 8),
        other => panic!("{other}"),
    }
    bytes
}

/// The table of docs/formats.md, "Damaged files". libjpeg-turbo refuses nothing that is accepted here, and nothing is
/// refused here that has the right pixels.
#[test]
fn verdicts_agree_with_libjpeg_turbo() {
    let table = std::fs::read_to_string(folder().join("verdicts.csv")).unwrap();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut disagreements = Vec::new();
    for row in table.lines() {
        let cells: Vec<&str> = row.split(',').collect();
        let [name, damage, at, verdict, pixels] = cells[..] else { panic!("{row}") };
        let jpeg = std::fs::read(folder().join(format!("{name}.jpg"))).unwrap();
        assert_eq!(check(&jpeg), Ok(()), "{name}");
        let found = check(&damaged(&jpeg, damage, at.parse().unwrap()));
        let by = match (verdict, &found) {
            ("refused", Err(_)) => "refused by both",
            ("whole", Err(_)) => "refused here alone",
            ("whole", Ok(())) if pixels == "0" => "used, pixels equal",
            ("whole", Ok(())) => "used, pixels differ",
            _ => "used here alone",
        };
        *counts.entry(format!("{damage}: {by}")).or_default() += 1;
        if by == "used here alone" || (by == "refused here alone" && pixels == "0") {
            disagreements.push(format!("{row}: {found:?}"));
        }
    }
    assert!(disagreements.is_empty(), "{disagreements:#?}");
    let counts: Vec<_> = counts.iter().map(|(what, count)| (what.as_str(), *count)).collect();
    let expected = [
        ("cut: refused by both", 237),
        ("cut: refused here alone", 3),
        ("flip: refused by both", 103),
        ("flip: refused here alone", 17),
        ("flip: used, pixels differ", 196),
        ("flip: used, pixels equal", 44),
        ("scan: refused by both", 10),
        ("scan: refused here alone", 6),
    ];
    assert_eq!(counts, expected);
}

#[test]
fn damage_is_named() {
    let read = |name: &str| std::fs::read(folder().join(name)).unwrap();
    let error = |bytes: &[u8]| check(bytes).unwrap_err().to_string();
    let jpeg = read("progressive.jpg");
    let ranges = scans(&jpeg);
    let without = |k: usize| error(&damaged(&jpeg, "scan", k));
    assert_eq!(
        without(0),
        "scan 1 does not continue the scans before it: it has AC coefficients, but no scan has their DC coefficients"
    );
    let last = without(ranges.len() - 1);
    assert!(last.contains("the picture is incomplete"), "{last}");
    let cut = ranges[0].start + 20;
    assert!(error(&damaged(&jpeg, "cut", cut)).contains("they end early"));
    assert_eq!(error(&jpeg[..jpeg.len() - 2]), "the file ends within the picture");
    let mut junk = jpeg.clone();
    junk.splice(2..2, [1, 2, 3]);
    assert_eq!(error(&junk), "3 extraneous bytes before marker FFE0 at byte 5");
    let jpeg = read("restarts.jpg");
    let restart = jpeg.windows(2).position(|pair| pair == [0xff, 0xd1]).unwrap();
    let mut lost = jpeg.clone();
    lost[restart + 1] = 0xd2;
    assert!(error(&lost).contains("a restart marker is missing"));
    let mut longer = jpeg;
    let end = longer.len() - 2;
    longer.splice(end..end, [0; 7]);
    assert_eq!(check(&longer), Ok(()));
    longer.splice(end..end, [0]);
    assert!(error(&longer).contains("bytes follow the last block"));
}

#[test]
fn any_bytes_give_a_verdict() {
    let jpeg = std::fs::read(folder().join("progressive.jpg")).unwrap();
    for length in 0..jpeg.len() {
        assert!(check(&jpeg[..length]).is_err(), "{length}");
    }
    let mut state = 1u32;
    for _ in 0..2000 {
        let mut bytes = jpeg.clone();
        for _ in 0..3 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let at = 2 + state as usize % (bytes.len() - 2);
            bytes[at] = (state >> 24) as u8;
        }
        let _ = check(&bytes);
    }
}
