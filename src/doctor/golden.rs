//! Checks that this machine computes the same bits as all other machines.

use super::finding::{Finding, seconds_text};
use render::shard::{Golden, golden_of, pinned, pinned_of};
use render::trace::{Isa, TRACER_VERSION};
use std::time::Instant;

/// Traces the golden shard and compares its digest with the digests of this version and, if given, of a run.
pub fn check_golden(isa: Isa, threads: usize, run: Option<&Golden>) -> Finding {
    let start = Instant::now();
    let set = run.map_or_else(|| pinned().scene, |run| run.scene.clone());
    let found = golden_of(&set, isa, threads);
    let text = format!("golden shard traced in {}", seconds_text(start.elapsed().as_secs_f64()));
    judge(&found, &pinned_of(&set), run, &text)
        .with("blake3", found.blake3)
        .with("tracer_version", TRACER_VERSION)
}

fn judge(found: &Golden, pinned: &Golden, run: Option<&Golden>, text: &str) -> Finding {
    if found != pinned {
        return Finding::fail(
            "right bits",
            format!("{text}, but its bits differ from those of tracer version {TRACER_VERSION}"),
            "do not use this machine for a run, and report its processor",
        );
    }
    if run.is_some_and(|run| run != pinned) {
        return Finding::fail(
            "right bits",
            format!(
                "{text}: its bits are those of this version, but another version planned the run"
            ),
            "finish the run with the version that planned it, or plan again into a new folder",
        );
    }
    Finding::ok("right bits", format!("{text} with the bits of tracer version {TRACER_VERSION}"))
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    #[test]
    fn other_bits_fail() {
        let right = pinned();
        let mut wrong = right.clone();
        wrong.blake3.replace_range(..1, "x");
        assert_eq!(judge(&right, &right, None, "").level, Level::Ok);
        assert_eq!(judge(&wrong, &right, None, "").level, Level::Fail);
        assert_eq!(judge(&right, &right, Some(&wrong), "").level, Level::Fail);
        assert_eq!(check_golden(Isa::Baseline, 2, Some(&right)).level, Level::Ok);
    }
}
