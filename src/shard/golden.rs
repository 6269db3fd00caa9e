//! Small built-in scenes whose pixels every machine must reproduce before it joins a run.

use super::golden_scenes::{GoldenScene, golden_scenes};
use super::layout::samples_per_range;
use super::spec::Golden;
use crate::trace::{Isa, Tile, trace_tile};

/// Name of the set of scenes; a new one when any scene changes, comes or goes.
pub(super) const SET: &str = "builtin/3";

/// Traces the golden scenes on this machine, some tens of milliseconds: one digest of all their digests.
pub fn golden(isa: Isa) -> Golden {
    let mut hasher = blake3::Hasher::new();
    for scene in golden_scenes() {
        hasher.update(digest(&scene, isa).as_bytes());
    }
    Golden {
        scene: SET.to_owned(),
        blake3: hasher.finalize().to_hex().to_string(),
    }
}

/// BLAKE3 (hex) of a golden scene's shards: pixels, samples and misses of each range.
fn digest(golden: &GoldenScene, isa: Isa) -> String {
    let scene = &golden.scene;
    let tile = Tile {
        x: 0,
        y: 0,
        width: scene.film.width,
        height: scene.film.height,
    };
    let range = match scene.target_error {
        Some(_) => scene.spp,
        None => samples_per_range(scene.spp),
    };
    let mut hasher = blake3::Hasher::new();
    for start in (0..scene.spp).step_by(range as usize) {
        let result = trace_tile(scene, tile, start..start + range, isa);
        for pixel in &result.pixels {
            for value in pixel.values() {
                hasher.update(&value.to_le_bytes());
            }
        }
        for layer in 0..4 {
            hasher.update(&result.samples[layer].to_le_bytes());
            hasher.update(&result.misses[layer].to_le_bytes());
        }
    }
    hasher.finalize().to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::TRACER_VERSION;
    use std::fmt::Write;

    /// The tracer version that the digests below are of.
    const VERSION: u32 = 2;
    /// Digests of the scenes of [`golden_scenes`].
    #[rustfmt::skip]
    const DIGESTS: &[(&str, &str)] = &[
        ("mirror", "cdcf01d0cdbb3414d81ea48ff562b628a8d98e5eb9efd702da675b8e5ef84c8a"),
        ("camera", "507ef3c2eda71998c845e0cedd563ada947e2aa32cda8789d1a6256a72fcf1d6"),
        ("tilted-absorbing", "c05d855499b8af1f44fcb92877c7fddae57841f1a6c0dc2a0f99fd5a184a9857"),
        ("tilted-camera-gaussian", "76a55181691cfdb7b5a6959616a375e94abb7d0cbda893359ac2dc6583281076"),
        ("lights", "9ef181248410a4c49d9e08382db4e874866514ecfefd213daf31feb9680063f3"),
        ("pinhole", "edc97cdc9dbd889360e52c256ac0da23630874957c559c8af614d79f20317ffa"),
        ("thin-pane", "10577b59145860ed5ecb7e16d1d222c5d81d4e3d7fc8595d2812463390de863c"),
        ("air", "c3e53ab9d67ebf53dc4d872d1e20317fd96f3902b3b0a60035a32f19b9cda2e2"),
        ("steep", "361896a2d4cd327c760ed887bf75061567c69e3fd4a1d84833b833507ad1eb2a"),
        ("two-ranges", "05163e2444b91d1c389524047971dc22139f43a8686bcacd72eb58a2590897b6"),
        ("one-row", "2dcb9690e812bec381445cdc7ef50a306ba6fb7b71ce0297f7f2af14da72506b"),
        ("one-column", "e5220fa76ee03eccc7522ea17a72be93d6d5a05cda556f8b3f79202c9bcc1daf"),
    ];

    /// If this fails, pixels have changed: raise `TRACER_VERSION`, say so in CHANGELOG, then paste the printed table.
    #[test]
    fn pixels_are_those_of_this_tracer_version() {
        let found: Vec<(&str, String)> = golden_scenes()
            .iter()
            .map(|golden| (golden.name, digest(golden, Isa::Baseline)))
            .collect();
        let pinned: Vec<(&str, String)> = DIGESTS
            .iter()
            .map(|(name, d)| (*name, (*d).to_owned()))
            .collect();
        let mut changed = String::new();
        let mut table = String::new();
        for (name, digest) in &found {
            let old = pinned.iter().find(|(other, _)| other == name);
            if old.is_none_or(|(_, old)| old != digest) {
                let _ = write!(changed, " {name}");
            }
            let _ = writeln!(table, "        (\"{name}\", \"{digest}\"),");
        }
        assert!(
            found == pinned && TRACER_VERSION == VERSION,
            "golden pixels of tracer version {VERSION} and of this one ({TRACER_VERSION}) differ in:{changed}\n\
             if that is meant: raise TRACER_VERSION above {VERSION}, add a line to CHANGELOG.md, set VERSION in \
             src/shard/golden.rs to it and replace the rows of DIGESTS by\n{table}"
        );
    }

    #[test]
    fn instruction_sets_agree() {
        for golden in golden_scenes() {
            assert_eq!(
                digest(&golden, Isa::Baseline),
                digest(&golden, Isa::detect()),
                "{}",
                golden.name
            );
        }
        assert_eq!(golden(Isa::Baseline), golden(Isa::detect()));
    }
}
