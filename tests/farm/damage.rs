//! Truncated, corrupted or foreign partials and tuples are detected, and made again.

use crate::support::outputs::{assert_same, assert_tidy, manifest, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{SCENES, SHARDS, partials, place, put_partials, reference};
use glasshouse_line::label::LabelImages;
use render::partial::{Partial, decode, encode};
use std::path::Path;

#[test]
fn damaged_partials_are_traced_again() {
    let place = place();
    place.plan();
    let (id, good) = partials(&place.run, 0);
    assert_eq!(good.len(), SHARDS);
    let paths = put_partials(&place.run, &id, &good);
    let bytes: Vec<Vec<u8>> = paths.iter().map(|p| std::fs::read(p).unwrap()).collect();

    let (_, of_other_scene) = partials(&place.run, 1);
    let mut of_other_inputs = good[13].header.clone();
    let digest = of_other_inputs.inputs.0.get_mut("front.depth").unwrap();
    *digest = "0".repeat(64);
    let of_other_inputs =
        Partial::new(of_other_inputs, good[13].pixels.clone(), LabelImages::new());
    // Partials with a right digest that no tracer writes.
    let forged = |shard: usize, forge: &dyn Fn(&mut Partial)| {
        let mut partial = good[shard].clone();
        forge(&mut partial);
        (shard, encode(&Partial::new(partial.header, partial.pixels, partial.labels)).unwrap())
    };
    let flipped = |shard: usize, at: usize| {
        let mut bytes = bytes[shard].clone();
        bytes[at] ^= 0x10;
        bytes
    };
    let length = bytes[0].len();
    let damaged: Vec<(usize, Vec<u8>)> = vec![
        (0, Vec::new()),
        (1, bytes[1][..1].to_vec()),
        (2, bytes[2][..100].to_vec()),
        (3, bytes[3][..length / 2].to_vec()),
        (4, bytes[4][..bytes[4].len() - 1].to_vec()),
        (5, flipped(5, length - 1)),
        (6, flipped(6, length / 2)),
        (7, flipped(7, 0)),
        (8, b"not an image at all".to_vec()),
        (9, vec![0; length]),
        (10, bytes[11].clone()),
        (12, encode(&of_other_scene[12]).unwrap()),
        (13, encode(&of_other_inputs).unwrap()),
        forged(14, &|forged| forged.pixels[3].mean[0][1] = -0.5),
        forged(15, &|forged| forged.pixels[3].half[2][0] = f32::NAN),
        forged(16, &|forged| forged.header.misses.0[1] = forged.header.paths.0[1] + 1),
        forged(17, &|forged| forged.header.layer_samples.0[0] = u32::MAX),
        forged(18, &|forged| forged.header.layer_samples.0[1] = 0),
    ];
    for (shard, content) in &damaged {
        std::fs::write(&paths[*shard], content).unwrap();
    }
    // This temporary file remains from an interrupted write.
    std::fs::write(paths[0].with_file_name(".tmp-torn"), &bytes[0][..99]).unwrap();

    let ended = run(&["work", text(&place.run), "-v", "--json"]).expect(0);
    let outcome = ended.json();
    assert_eq!(outcome["shards_resumed"], SHARDS - damaged.len());
    assert_eq!(outcome["shards_traced"], (SCENES - 1) * SHARDS + damaged.len());
    for (shard, _) in &damaged {
        let name = format!("{id}/{shard:06}.exr");
        assert!(ended.stderr.contains(&name), "{name} in {}", ended.stderr);
    }
    assert_same(&tuples(&place.run), reference());
    assert_tidy(&place.run);
}

#[test]
fn partials_of_replaced_inputs_are_traced_again() {
    let place = place();
    place.plan();
    let (id, good) = partials(&place.run, 0);
    put_partials(&place.run, &id, &good);
    // The back photograph's colour image overwrites the front photograph's.
    let line = &manifest(&place.run)[0];
    let path = |side: &str| {
        let text = line[side]["color"].as_str().unwrap();
        place.run.join("inputs/sample").join(text.strip_prefix("sample:").unwrap())
    };
    std::fs::copy(path("back"), path("front")).unwrap();
    let outcome = run(&["work", text(&place.run), "--json"]).expect(0).json();
    assert_eq!(outcome["shards_resumed"], 0);
    let (tuples, whole) = (tuples(&place.run), reference());
    let name = Path::new(&id).join("tuple.exr");
    assert!(tuples[&name] != whole[&name]);
}

/// Flips one bit at a time, in each byte of the header and in some bytes of the pixels: decoding fails or returns the
/// same content, without a panic or an oversized allocation.
#[test]
fn a_flipped_bit_never_changes_the_content() {
    let place = place();
    place.plan();
    let (_, all) = partials(&place.run, 0);
    let bytes = encode(&all[SHARDS - 1]).unwrap();
    let pixels = all[SHARDS - 1].pixels.len() * 96;
    let header = 0..bytes.len() - pixels;
    assert!(header.len() > 1000);
    let mut refused = 0;
    for at in header.clone().chain((header.end..bytes.len()).step_by(997)) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << (at % 8);
        match decode(Path::new("flipped"), &flipped) {
            Ok(found) => assert!(found == all[SHARDS - 1], "byte {at}"),
            Err(error) => {
                refused += 1;
                assert!(error.to_string().contains("traced again"), "{error}");
            }
        }
    }
    assert!(refused > header.len() / 2, "{refused} of {}", header.len());
}

#[test]
fn incomplete_tuples_and_tuples_of_another_plan_are_made_again() {
    let place = place();
    run(&place.arguments("run", &[])).expect(0);
    let before = tuples(&place.run);
    let entries = std::fs::read_dir(place.run.join("tuples")).unwrap();
    let folders: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    assert_eq!(folders.len(), SCENES);
    std::fs::remove_file(folders[0].join("tuple.exr")).unwrap();
    let record = folders[1].join("tuple.json");
    let text_of_record = std::fs::read_to_string(&record).unwrap();
    assert!(text_of_record.contains("\"thickness_m\": 0.01"));
    let other = text_of_record.replace("\"thickness_m\": 0.01", "\"thickness_m\": 0.02");
    std::fs::write(&record, other).unwrap();
    std::fs::write(folders[2].join("tuple.json"), "{").unwrap();
    let ended = run(&["work", text(&place.run), "--json"]).expect(0);
    assert_eq!(ended.json()["merged"], 3);
    assert_eq!(ended.json()["already_merged"], SCENES - 3);
    assert_same(&tuples(&place.run), &before);
    assert_tidy(&place.run);
}

/// A flipped bit in a copy of the store's spec or manifest is repaired from the store; another whole run is refused.
#[test]
fn a_damaged_copy_of_a_run_is_fetched_again() {
    let place = place();
    place.plan();
    let copy = place.folder.path().join("copy");
    let merge = || run(&["merge", text(&copy), "--store", text(&place.run), "-n"]);
    merge().expect(3);
    for name in ["spec.json", "manifest.jsonl"] {
        let path = copy.join(name);
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(whole, std::fs::read(place.run.join(name)).unwrap());
        // A flip inside of a string of the spec could make another whole spec.
        for byte in [0, whole.len() - 3] {
            let mut damaged = whole.clone();
            damaged[byte] ^= 4;
            std::fs::write(&path, &damaged).unwrap();
            merge().expect(3);
            assert_eq!(std::fs::read(&path).unwrap(), whole, "{name}, byte {byte}");
        }
        std::fs::write(&path, b"").unwrap();
        merge().expect(3);
        assert_eq!(std::fs::read(&path).unwrap(), whole, "{name}");
    }
    // Another plan of the same scenes.
    let other = place.folder.path().join("other");
    run(&["plan", text(&place.recipe), "--out", text(&other), "--tile", "128"]).expect(0);
    let before = std::fs::read(other.join("spec.json")).unwrap();
    let refused = run(&["merge", text(&other), "--store", text(&place.run), "-n"]);
    refused.expect(5).says(&["holds another run"]);
    assert_eq!(std::fs::read(other.join("spec.json")).unwrap(), before);
}
