//! Inspects `tuple.exr` and `tuple.json`, and compares them with each other.

use super::digests::{Digested, hold_file, hold_record};
use super::exr::{self, Head, say_layers, say_size};
use super::facts::{Inspection, Problem};
use super::input::Input;
use super::kind::Kind;
use super::record::typed;
use crate::text::many;
use render::formats::decode_exr_channels;
use render::layer::Layer;
use render::merge::{TupleRecord, decode_tuple_exr, tuple_files};
use render::trace::TRACER_VERSION;
use serde_json::json;
use std::fmt::Write;

impl Digested for TupleRecord {
    const NAME: &'static str = "tuple.json";
    const TO_DO: &'static str = "`glasshouse retry RUN SCENE --anew`, then `glasshouse work RUN`";
    const NEEDS_FILES: bool = false;

    fn files(&self) -> Vec<&str> {
        vec!["tuple.exr"]
    }

    /// Checks the size in the header against the file's length before it decompresses any data.
    fn compare(&self, _: &str, bytes: &[u8]) -> Result<(), String> {
        exr::head(bytes)?;
        decode_tuple_exr(bytes, self).map(drop)
    }
}

pub(super) fn read_exr(input: &Input, head: &Head) -> Inspection {
    let mut found = Inspection::new(Kind::TupleExr);
    say_size(&mut found, head);
    let record = (input.beside)(TupleRecord::NAME)
        .and_then(|bytes| serde_json::from_slice::<TupleRecord>(&bytes).ok());
    if let Some(record) = &record {
        let id = record.scene.id.as_str();
        let text = format!("{id} (from tuple.json beside it)");
        found.facts.fact("scene", text, id);
    }
    let wrong = |what: String| Problem::new(what, TupleRecord::TO_DO);
    match decode_exr_channels(input.bytes) {
        Ok(channels) => {
            let not_finite = say_layers(&mut found, &channels);
            if not_finite > 0 {
                found.wrong(wrong(format!("{} not finite", many(not_finite, "value"))));
            }
            hold_file::<TupleRecord>(&mut found, input);
        }
        Err(reason) => found.wrong(wrong(format!("its pixels cannot be read: {reason}"))),
    }
    found
}

pub(super) fn read_record(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::TupleRecord);
    let Some((record, _)) = typed::<TupleRecord>(&mut found, input, TupleRecord::TO_DO) else {
        return found;
    };
    say(&mut found, &record);
    if let Err(error) = record.scene.validate() {
        let problem = Problem::new(error.to_string(), TupleRecord::TO_DO);
        found.wrong(problem.at("its `scene`"));
    }
    let files = tuple_files(&record.scene);
    let is_missing = |name: &&String| (input.beside)(name).is_none();
    let missing: Vec<&str> = files.iter().filter(is_missing).map(String::as_str).collect();
    // A record without other files is a copy.
    if missing.len() + 1 >= files.len() && files.len() > 1 {
        found.may_be_whole("its tuple's other files are not beside it");
        return found;
    }
    if !missing.is_empty() {
        let what = format!("files of its tuple are missing: {}", missing.join(", "));
        found.wrong(Problem::new(what, "`glasshouse work RUN` makes the tuple again"));
    }
    hold_record(&mut found, input, &record);
    found
}

fn say(found: &mut Inspection, record: &TupleRecord) {
    let (scene, film) = (&record.scene, &record.scene.film);
    let facts = &mut found.facts;
    let text = format!("{}, split {}", scene.id, scene.split);
    facts.fact("scene", text, scene.id.as_str());
    facts.put("split", scene.split.to_string());
    let text = format!("{} x {} px, {} samples a pixel", film.width, film.height, film.spp);
    let size = json!({ "width": film.width, "height": film.height, "spp": film.spp });
    facts.fact("film", text, size);
    facts.value("front", scene.front.name());
    facts.value("back", scene.back.name());
    let made = Layer::NAMES.map(|name| Some((name, record.layers.get(name)?)));
    for (name, layer) in made.into_iter().flatten() {
        let error = layer.error_rms;
        let error = error.map_or_else(|| "unknown".to_owned(), |e| format!("{e:.1e}"));
        let mut text = format!("mean {:.5}  max {:.4}  error {error}", layer.mean, layer.max);
        for (what, share) in [("clipped", layer.clipped_share), ("missed", layer.miss_share)] {
            if share > 0.0 {
                let _ = write!(text, ", {:.2} % {what}", share * 100.0);
            }
        }
        facts.say(name, text);
    }
    facts.put("layers", json!(record.layers));
    let text = many(record.inputs.0.len() as u64, "input file");
    facts.fact("inputs", text, json!(record.inputs));
    facts.value("tracer_version", record.tracer_version);
    if record.tracer_version != TRACER_VERSION {
        found.next.push(format!(
            "tracer version {} made it, this program has {TRACER_VERSION}",
            record.tracer_version
        ));
    }
    if found.is_sound() {
        let next = "`glasshouse render tuple.json --out DIR` renders its images again";
        found.next.push(next.to_owned());
    }
}
