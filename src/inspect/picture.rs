//! Inspects pictures, arrays and meshes: inputs and previews.

use super::digests::{Digested, hold_file};
use super::exr::say_layer;
use super::facts::{Inspection, Problem};
use super::input::{AGAIN, Input};
use super::kind::Kind;
use crate::develop::PhotographsRecord;
use crate::text::grouped;
use render::formats::{NamedBytes, SceneError, npy_facts, ply_counts};
use render::merge::TupleRecord;
use render::scene::{FileRole, look_at_whole};
use serde_json::json;

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let file = NamedBytes { path: input.name.into(), bytes: input.bytes.to_vec() };
    let read = match kind {
        Kind::Mesh => mesh(&mut found, &file),
        Kind::Array => array(&mut found, &file),
        Kind::Raw => {
            raw(&mut found);
            Ok(())
        }
        _ => picture(&mut found, &file),
    };
    match read {
        Err(error) => {
            let text = error.to_string();
            let reason = text.strip_prefix(&format!("{} ", input.name)).unwrap_or(&text);
            found.wrong(Problem::new(reason, AGAIN));
        }
        // In the folder of a tuple or of photographs, the record beside the picture has its digest.
        Ok(()) if (input.beside)(TupleRecord::NAME).is_some() => {
            hold_file::<TupleRecord>(&mut found, input);
        }
        Ok(()) if (input.beside)(PhotographsRecord::NAME).is_some() => {
            hold_file::<PhotographsRecord>(&mut found, input);
        }
        Ok(()) if input.bytes.starts_with(b"\x89PNG") => {
            found.is_whole("it can be decoded, and its checksums match");
        }
        Ok(()) => found.may_be_whole("it can be read completely; the format has no checksum"),
    }
    found
}

fn picture(found: &mut Inspection, file: &NamedBytes) -> Result<(), SceneError> {
    let encoding = "8-bit sRGB, values above 1 clipped; tuple.exr has the radiance";
    say_layer(found, &file.path.to_string_lossy(), encoding);
    if let Some(size) = look_at_whole(FileRole::Color, file)? {
        let [width, height] = size.upright_px();
        let text = format!("{width} x {height} px, usable as a colour image");
        found.facts.fact("image", text, json!([width, height]));
        if size.exif_orientation != 1 {
            let [width, height] = size.stored_px;
            let tag = size.exif_orientation;
            let text = format!(
                "{tag} (EXIF): {width} x {height} px are stored, and readers turn them upright"
            );
            found.facts.fact("orientation", text, json!(tag));
        }
    }
    Ok(())
}

/// Names the readers of a raw file.
fn raw(found: &mut Inspection) {
    let next = "raw converters and Python's rawpy open it; docs/camera.md describes the sensor";
    found.next.push(next.to_owned());
}

fn array(found: &mut Inspection, file: &NamedBytes) -> Result<(), SceneError> {
    let (element, shape) = npy_facts(file)?;
    let sizes: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let text = format!("{} of {element}", sizes.join(" x "));
    found.facts.fact("array", text, json!(shape));
    found.facts.put("element", element);
    let roles = [
        (FileRole::Depth, "depth image"),
        (FileRole::Mask, "mask"),
        (FileRole::Color, "colour image"),
    ];
    let usable = roles.into_iter().filter(|(role, _)| look_at_whole(*role, file).is_ok());
    let names: Vec<&str> = usable.map(|(_, name)| name).collect();
    found.facts.value("usable_as", json!(names));
    Ok(())
}

fn mesh(found: &mut Inspection, file: &NamedBytes) -> Result<(), SceneError> {
    let counts = ply_counts(file)?;
    let text = |(name, count): &(String, u64)| format!("{} {name}", grouped(*count));
    let elements: Vec<String> = counts.iter().map(text).collect();
    found.facts.say("elements", elements.join(", "));
    for (name, count) in &counts {
        found.facts.put(name, *count);
    }
    look_at_whole(FileRole::Mesh, file)?;
    found.facts.say("usable as", "a mesh");
    Ok(())
}
