//! Inspects `tuple.exr` and `tuple.json`, and compares them with each other.

use super::digests::{Digested, hold_file, hold_record};
use super::exr::{self, Head, say_layers, say_size};
use super::facts::{Inspection, Problem};
use super::input::Input;
use super::kind::Kind;
use super::record::{tell, typed};
use crate::plot::number;
use crate::text::many;
use glasshouse_line::SceneLine;
use render::formats::decode_exr_channels;
use render::merge::{
    TUPLE_SCHEMA_1, TupleRecord, decode_tuple_exr, decode_tuple_labels, light_notes, tuple_files,
};
use render::trace::TRACER_VERSION;
use serde_json::json;

impl Digested for TupleRecord {
    const NAME: &'static str = "tuple.json";
    const TO_DO: &'static str = "`glasshouse retry RUN SCENE --anew`, then `glasshouse work RUN`";
    const NEEDS_FILES: bool = false;

    fn files(&self) -> Vec<&str> {
        if self.schema == TUPLE_SCHEMA_1 {
            return vec!["tuple.exr"];
        }
        self.files.keys().map(String::as_str).collect()
    }

    /// Compares a file with its digest. Before, compares the layers of `tuple.exr` with theirs, to name a damaged layer,
    /// after a check of the header's size against the file's length.
    fn compare(&self, name: &str, bytes: &[u8]) -> Result<(), String> {
        if name == "tuple.exr" {
            exr::head(bytes)?;
            decode_tuple_exr(bytes, self)?;
            decode_tuple_labels(bytes, self)?;
        }
        self.check_file(name, bytes)
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
    if let Err(reason) = record.check_complete() {
        found.wrong(Problem::new(reason, TupleRecord::TO_DO));
        return found;
    }
    let files = tuple_files(&record.scene);
    let is_missing = |name: &&String| (input.beside)(name).is_none();
    let missing: Vec<&str> = files.iter().filter(is_missing).map(String::as_str).collect();
    // A record without any other file of its tuple is a copy.
    if missing.len() + 1 >= files.len() && files.len() > 1 {
        found.may_be_whole("its tuple's other files are not beside it");
        return found;
    }
    if !missing.is_empty() {
        let what = format!("files of its tuple are missing: {}", missing.join(", "));
        found.wrong(Problem::new(what, "`glasshouse work RUN` makes the tuple again"));
    }
    hold_record(&mut found, input, &record);
    if found.is_sound() && record.schema == TUPLE_SCHEMA_1 {
        found.may_be_whole(PNGS_NOT_CHECKED);
    }
    found
}

/// Reason why a tuple of [`TUPLE_SCHEMA_1`] may be damaged.
pub(super) const PNGS_NOT_CHECKED: &str = "the layers of tuple.exr match their digests; PNGs not checked: glasshouse.tuple/1 has no digests of them";

fn say(found: &mut Inspection, record: &TupleRecord) {
    let SceneLine { id, split, front, back, film, .. } = &record.scene;
    let object = json!({
        "scene": id, "split": split, "front": front.name(), "back": back.name(),
        "film": { "width": film.width, "height": film.height, "spp": film.spp },
        "layers": record.layers, "tracer_version": record.tracer_version,
    });
    tell(found, object.as_object().into_iter().flatten());
    let inputs = many(record.inputs.0.len() as u64, "input file");
    found.facts.fact("inputs", inputs, json!(record.inputs));
    if let (Some(photographs), Some(sensor)) = (&record.photographs, &record.scene.sensor) {
        let name = sensor.name.as_deref().unwrap_or("a sensor");
        let factor = number(photographs.exposure_factor);
        let text = format!("by {name}, {factor} times the light");
        found.facts.fact("photographs", text, json!(photographs));
    }
    for note in record.facts.notes() {
        found.facts.say("depth", note);
    }
    for note in light_notes(&record.layers) {
        found.facts.say("light", note);
    }
    if record.tracer_version != TRACER_VERSION {
        found.next.push(format!(
            "tracer version {} made it, but this program has {TRACER_VERSION}",
            record.tracer_version
        ));
    }
    if found.is_sound() {
        let next = "`glasshouse render tuple.json --out DIR` renders its images again";
        found.next.push(next.to_owned());
    }
}
