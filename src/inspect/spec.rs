//! `spec.json`: the frozen rules of a run.

use super::facts::{Inspection, Problem, many};
use super::kind::Kind;
use super::look::Input;
use super::records::typed;
use render::shard::{Spec, manifest_digest};
use render::trace::TRACER_VERSION;
use serde_json::json;

/// What to do about a damaged spec.
const PLAN_AGAIN: &str = "plan the run again into a new folder";

pub(super) fn read(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::Spec);
    let Some(spec) = typed::<Spec>(&mut found, input, PLAN_AGAIN) else {
        return found;
    };
    let facts = &mut found.facts;
    facts.fact("name", spec.name.as_str(), spec.name.as_str());
    facts.fact(
        "scenes",
        crate::serve::text::grouped(spec.scenes.into()),
        spec.scenes,
    );
    facts.fact(
        "tile_px",
        format!("{} px a side", spec.tile_px),
        spec.tile_px,
    );
    facts.fact(
        "tracer_version",
        spec.tracer_version.to_string(),
        spec.tracer_version,
    );
    let start: String = spec.golden.blake3.chars().take(16).collect();
    facts.fact(
        "golden",
        format!("{} {start}…", spec.golden.scene),
        json!(spec.golden),
    );
    for (name, folder) in &spec.roots {
        facts.say("root", format!("{name} = {}", folder.display()));
    }
    facts.put("roots", json!(spec.roots));
    if !spec.left_out.is_empty() {
        let text = format!(
            "{} by --skip-invalid",
            many(spec.left_out.len() as u64, "name")
        );
        facts.fact("left_out", text, json!(spec.left_out));
    }
    if spec.tracer_version != TRACER_VERSION {
        found.next.push(format!(
            "it was planned with tracer version {}, this program has {TRACER_VERSION}: finish the run with the version \
             that planned it, or plan again into a new folder",
            spec.tracer_version
        ));
    }
    match (input.beside)("manifest.jsonl") {
        None => found.may_be_whole("manifest.jsonl, whose digest it holds, is not beside it"),
        Some(bytes) if manifest_digest(&String::from_utf8_lossy(&bytes)) == spec.manifest_blake3 => {
            found.may_be_whole("it fits manifest.jsonl beside it; it has no digest of its own");
        }
        Some(_) => found.wrong(Problem::new(
            "its digest of manifest.jsonl does not fit the one beside it: one of the two was changed",
            PLAN_AGAIN,
        )),
    }
    found
}
