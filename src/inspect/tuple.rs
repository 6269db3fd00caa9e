//! A tuple's `tuple.exr` and `tuple.json`, each held against the other.

use super::exr::{self, Head, say_layers, say_size, to_do};
use super::facts::{Inspection, Problem, Whole, many};
use super::kind::Kind;
use super::look::Input;
use super::records::typed;
use render::merge::{TupleRecord, decode_exr_channels, decode_tuple_exr, tuple_files};
use render::trace::{LAYERS, TRACER_VERSION};
use serde_json::json;

pub(super) fn read_exr(input: &Input, head: &Head) -> Inspection {
    let mut found = Inspection::new(Kind::TupleExr);
    say_size(&mut found, head);
    let record = (input.beside)("tuple.json")
        .and_then(|bytes| serde_json::from_slice::<TupleRecord>(&bytes).ok());
    if let Some(record) = &record {
        let id = record.scene.id.as_str();
        found
            .facts
            .fact("scene", format!("{id} (by tuple.json beside it)"), id);
    }
    match decode_exr_channels(input.bytes) {
        Ok(channels) => {
            let not_finite = say_layers(&mut found, &channels, "");
            if not_finite > 0 {
                let what = format!("{} not finite", many(not_finite, "value"));
                found.wrong(Problem::new(what, to_do(Kind::TupleExr)));
            }
        }
        Err(reason) => {
            found.wrong(Problem::new(
                format!("its pixels cannot be read: {reason}"),
                to_do(Kind::TupleExr),
            ));
            return found;
        }
    }
    hold(&mut found, input.bytes, record.as_ref());
    found
}

/// Holds the layers against the digests of the record.
fn hold(found: &mut Inspection, exr: &[u8], record: Option<&TupleRecord>) {
    let Some(record) = record else {
        found.may_be_whole("every pixel can be read; its digests are in tuple.json, which is not beside it or cannot be read");
        return;
    };
    match decode_tuple_exr(exr, record) {
        Ok(layers) => {
            let count = layers.iter().filter(|layer| !layer.is_empty()).count();
            let how = format!("the digests in tuple.json fit all {count} layers");
            found.is_whole(how);
        }
        Err(reason) => found.wrong(Problem::new(reason, to_do(Kind::TupleExr))),
    }
}

pub(super) fn read_record(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::TupleRecord);
    let Some(record) = typed::<TupleRecord>(&mut found, input, to_do(Kind::TupleExr)) else {
        return found;
    };
    say(&mut found, &record);
    if let Err(error) = record.scene.validate() {
        found.wrong(Problem::new(error.to_string(), to_do(Kind::TupleExr)).at("its `scene`"));
    }
    let files = tuple_files(&record.scene);
    let is_there = |name: &&String| (input.beside)(name).is_some();
    let there: Vec<&String> = files.iter().filter(is_there).collect();
    if there.len() == 1 && files.len() > 1 {
        found.may_be_whole("its tuple's other files are not beside it");
        return found;
    }
    let missing: Vec<&str> = files
        .iter()
        .filter(|name| !there.contains(name))
        .map(String::as_str)
        .collect();
    if !missing.is_empty() {
        let what = format!("files of its tuple are missing: {}", missing.join(", "));
        found.wrong(Problem::new(
            what,
            "`glasshouse work RUN` makes the tuple again",
        ));
    }
    if let Some(bytes) = (input.beside)("tuple.exr") {
        hold_exr(&mut found, &bytes, &record);
    }
    found
}

/// The record is right if the pixels beside it have its digests.
fn hold_exr(found: &mut Inspection, bytes: &[u8], record: &TupleRecord) {
    // Its size is held against the file before anything is unpacked.
    match exr::head(bytes).and_then(|_| decode_tuple_exr(bytes, record)) {
        Ok(_) => {
            found.may_be_whole("its digests fit tuple.exr beside it; it has no digest of its own");
        }
        Err(reason) => {
            found.wrong(Problem::new(
                format!("tuple.exr beside it: {reason}"),
                to_do(Kind::TupleExr),
            ));
        }
    }
}

fn say(found: &mut Inspection, record: &TupleRecord) {
    let (scene, film) = (&record.scene, &record.scene.film);
    let facts = &mut found.facts;
    facts.fact(
        "scene",
        format!("{}, split {}", scene.id, scene.split),
        scene.id.as_str(),
    );
    facts.put("split", scene.split.to_string());
    let text = format!(
        "{} x {} px, {} samples a pixel",
        film.width, film.height, film.spp
    );
    facts.fact(
        "film",
        text,
        json!({ "width": film.width, "height": film.height, "spp": film.spp }),
    );
    facts.fact("front", scene.front.name(), scene.front.name());
    facts.fact("back", scene.back.name(), scene.back.name());
    for name in LAYERS {
        let Some(layer) = record.layers.get(name) else {
            continue;
        };
        let error = layer
            .error_rms
            .map_or_else(|| "unknown".to_owned(), |e| format!("{e:.1e}"));
        let text = format!(
            "mean {:.5}  max {:.4}  error {error}",
            layer.mean, layer.max
        );
        facts.say(name, text);
    }
    let shares = |of: fn(&render::merge::LayerRecord) -> f64| {
        let made = LAYERS.iter().filter_map(|name| record.layers.get(*name));
        let shares: Vec<String> = made
            .map(|layer| format!("{:.2} %", of(layer) * 100.0))
            .collect();
        shares.join(", ")
    };
    facts.say(
        "clipped",
        format!("{} of the values in the PNGs", shares(|l| l.clipped_share)),
    );
    facts.say(
        "missed",
        format!("{} of the paths", shares(|l| l.miss_share)),
    );
    facts.put("layers", json!(record.layers));
    facts.fact(
        "inputs",
        many(record.inputs.0.len() as u64, "input file"),
        json!(record.inputs),
    );
    facts.fact(
        "tracer_version",
        record.tracer_version.to_string(),
        record.tracer_version,
    );
    if record.tracer_version != TRACER_VERSION {
        found.next.push(format!(
            "it was made by tracer version {}, this program has {TRACER_VERSION}",
            record.tracer_version
        ));
    }
    if found.whole == Whole::No {
        return;
    }
    found
        .next
        .push("`glasshouse render tuple.json --out DIR` makes its images again".to_owned());
}
