//! Input files and pictures, in a line each.

use super::facts::{Inspection, Problem};
use super::kind::Kind;
use super::look::{AGAIN, Input};
use render::formats::{NamedBytes, SceneError, npy_facts, ply_counts};
use render::scene::{FileRole, look_at_whole};
use render::trace::LAYERS;
use serde_json::json;

pub(super) fn read(kind: Kind, input: &Input) -> Inspection {
    let mut found = Inspection::new(kind);
    let file = NamedBytes {
        path: input.name.into(),
        bytes: input.bytes.to_vec(),
    };
    let has_checksums = input.bytes.starts_with(b"\x89PNG");
    let read = match kind {
        Kind::Mesh => mesh(&mut found, &file),
        Kind::Array => array(&mut found, &file),
        _ => picture(&mut found, &file),
    };
    match read {
        Ok(how) if has_checksums => found.is_whole(how),
        Ok(how) => found.may_be_whole(how),
        Err(error) => {
            let text = error.to_string();
            let reason = text
                .strip_prefix(&format!("{} ", input.name))
                .unwrap_or(&text);
            found.wrong(Problem::new(reason.to_owned(), AGAIN));
        }
    }
    found
}

fn picture(found: &mut Inspection, file: &NamedBytes) -> Result<&'static str, SceneError> {
    let name = file.path.to_string_lossy().into_owned();
    let stem = name.strip_suffix(".png").unwrap_or(&name);
    if LAYERS.contains(&stem) {
        let text =
            format!("{stem}, 8-bit sRGB, values above 1 clipped; tuple.exr has the radiance");
        found.facts.fact("layer", text, stem);
    }
    let size = look_at_whole(FileRole::Color, file)?;
    if let Some([width, height]) = size {
        found.facts.fact(
            "image",
            format!("{width} x {height} px, usable as a colour image"),
            json!([width, height]),
        );
    }
    Ok(if file.bytes.starts_with(b"\x89PNG") {
        "it can be decoded, and its checksums fit"
    } else {
        "it can be read to its end; the format has no checksum"
    })
}

fn array(found: &mut Inspection, file: &NamedBytes) -> Result<&'static str, SceneError> {
    let (element, shape) = npy_facts(file)?;
    let sizes: Vec<String> = shape.iter().map(ToString::to_string).collect();
    found.facts.fact(
        "array",
        format!("{} of {element}", sizes.join(" x ")),
        json!(shape),
    );
    found.facts.put("element", element);
    let usable = [
        (FileRole::Depth, "depth image"),
        (FileRole::Mask, "mask"),
        (FileRole::Color, "colour image"),
    ];
    let usable = usable
        .into_iter()
        .filter(|(role, _)| look_at_whole(*role, file).is_ok());
    let names: Vec<&str> = usable.map(|(_, name)| name).collect();
    found.facts.fact(
        "usable_as",
        if names.is_empty() {
            "nothing here".to_owned()
        } else {
            names.join(", ")
        },
        json!(names),
    );
    Ok("it has as many bytes as its header says; arrays have no checksum")
}

fn mesh(found: &mut Inspection, file: &NamedBytes) -> Result<&'static str, SceneError> {
    let counts = ply_counts(file)?;
    let text: Vec<String> = counts
        .iter()
        .map(|(name, count)| format!("{} {name}", crate::serve::text::grouped(*count)))
        .collect();
    found.facts.say("elements", text.join(", "));
    for (name, count) in &counts {
        found.facts.put(name, *count);
    }
    look_at_whole(FileRole::Mesh, file)?;
    found.facts.say("usable as", "a mesh");
    Ok("every element of its header is there; meshes have no checksum")
}
