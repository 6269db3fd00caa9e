//! Small built-in scenes whose pixels every machine must reproduce before it joins a run.

use super::golden_scenes::{GoldenScene, golden_scenes};
use super::layout::samples_per_range;
use super::spec::Golden;
use crate::trace::{Isa, Tile, trace_tile};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Name of the set of scenes; a new one when any scene changes, comes or goes.
pub(super) const SET: &str = "builtin/3";

/// Traces the golden scenes on this machine, some tens of milliseconds of one thread: one digest of all their digests.
pub fn golden(isa: Isa, threads: usize) -> Golden {
    let scenes = golden_scenes();
    let digests: Vec<OnceLock<String>> = scenes.iter().map(|_| OnceLock::new()).collect();
    let next = AtomicUsize::new(0);
    let trace = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(scene) = scenes.get(index) else {
                break;
            };
            digests[index].get_or_init(|| digest(scene, isa));
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.min(scenes.len()) {
            scope.spawn(trace);
        }
        trace();
    });
    let mut hasher = blake3::Hasher::new();
    for digest in &digests {
        hasher.update(digest.wait().as_bytes());
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
        ("mirror", "d470984cd07f6e1e97d64ac052b1348218efae1d34e02f4fa3f274fbcda2ef78"),
        ("camera", "71fc5f54ff479773878711be54579d901cd7571e55df1365cb0cdd8fc3ffe51f"),
        ("tilted-absorbing", "e82a23c5335c5a808911e3ad83fa95cf38b1cb50586ef5fc17c496f45ae88e8c"),
        ("tilted-camera-gaussian", "a73574fe971079b7e28b9978f73da2e7372be7ffe525cee3069105c61a117f1c"),
        ("lights", "2328b32be562fb3a95760048ad1ed3830b6c14aa28d1a818276606e17273cd78"),
        ("pinhole", "0486a12f05c39eebea9242ce6162b7ee6d8e0c247ad6ef1f38c7c291ff1e66ba"),
        ("thin-pane", "b92f558239a997d495bccc63e984bb7166d050d7eee40e778ad417fbb988091e"),
        ("air", "4d637ccff7f31c1a1d1f2c8f044f0b16d6aaddd8bb397db4a4aafc8393b62724"),
        ("steep", "7f5738ce1df47afa4de50db6521adce5efb8084ab6641470734ef1000eb301df"),
        ("two-ranges", "41bf5e705f90a90adc18b7cd23da9a86d0c0920f1e53797058a0c60246c593b5"),
        ("one-row", "dbc2a4a3f85400c723d730b75adcc00b5d9229cce53ce5c03ed3a3cbd13e5eec"),
        ("one-column", "b088a3cf9840ad6319ecea7a28f69a544ce0cedc57cd843482de110d7360c329"),
        ("adaptive", "35b14cb42345899ec606e323e54f18fe5f59195ff0d7eb66d44ab038f9ce0d4b"),
        ("two-layers", "d2f03ec689046d401d3148cc62fb875c5dbb41451e34779cab887da7b0dcf4d1"),
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
        assert_eq!(golden(Isa::Baseline, 1), golden(Isa::detect(), 3));
    }
}
