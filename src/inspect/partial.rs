//! Inspects partials: header, values and digest.

use super::exr::{Head, say_values, to_do};
use super::facts::{Inspection, Problem};
use super::input::Input;
use super::kind::Kind;
use super::record::tell;
use crate::run::keys;
use glasshouse_line::layer::Layer;
use render::partial::{PARTIAL_SCHEMA, PartialHeader, decode};
use render::trace::TRACER_VERSION;
use serde_json::json;
use std::path::Path;

pub(super) fn read(input: &Input, head: &Head) -> Inspection {
    let mut found = Inspection::new(Kind::Partial);
    let json = head.attribute.as_deref().unwrap_or_default();
    match serde_json::from_str::<PartialHeader>(json) {
        Ok(header) => say(&mut found, &header, input.name),
        Err(error) => {
            let what = format!("its attribute `glasshouse` cannot be read: {error}");
            found.wrong(Problem::new(what, to_do(Kind::Partial)));
            return found;
        }
    }
    match decode(Path::new(input.name), input.bytes) {
        Ok(partial) => {
            for layer in Layer::ALL {
                let header = &partial.header;
                if header.layer_samples[layer] == 0 && !header.is_closed_form(layer) {
                    found
                        .facts
                        .say(layer.name(), "not requested, or without samples in this range");
                    continue;
                }
                let values =
                    partial.pixels.iter().flat_map(|pixel| pixel.mean[layer as usize].iter());
                say_values(&mut found, layer.name(), values);
            }
            found.is_whole("its digest matches its header and every pixel");
        }
        Err(error) => found.wrong(Problem::new(error.reason, to_do(Kind::Partial))),
    }
    found
}

fn say(found: &mut Inspection, header: &PartialHeader, name: &str) {
    // `inputs` and `facts` are in tuple.json, too, and the digest is checked separately.
    const OMITTED: [&str; 4] = ["schema", "inputs", "facts", "blake3"];
    let object = json!(header);
    let object = object.as_object().into_iter().flatten();
    tell(found, object.filter(|(key, _)| !OMITTED.contains(&key.as_str())));
    if header.schema != PARTIAL_SCHEMA {
        let what =
            format!("its schema is {:?}, but this program reads {PARTIAL_SCHEMA:?}", header.schema);
        found.wrong(Problem::new(what, to_do(Kind::Partial)));
    }
    if header.tracer_version != TRACER_VERSION {
        found.next.push(format!(
            "this program has another tracer version, {TRACER_VERSION}: all partials of a run must have the same version"
        ));
    }
    if keys::shard_of(name).is_some_and(|shard| shard != header.shard) {
        let what = format!("its name belongs to another shard than its header: {}", header.shard);
        found.wrong(Problem::new(what, to_do(Kind::Partial)));
    }
}
