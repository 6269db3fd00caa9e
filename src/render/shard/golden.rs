//! Traces small built-in scenes. Every machine must reproduce their pixels before it joins a run.

use super::golden_scenes::{GoldenScene, golden_scenes};
use super::layout::samples_per_range;
use super::spec::Golden;
use crate::layer::Layer;
use crate::trace::{Isa, Scene, Tile, trace_tile};
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Name of the set of scenes. Every change of the set needs a new name.
pub(super) const SET: &str = "builtin/4";

/// Tracer version of the digests below.
#[cfg(test)]
const VERSION: u32 = 4;
/// Names and digests of the scenes of [`golden_scenes`].
#[rustfmt::skip]
const DIGESTS: &[(&str, &str)] = &[
    ("mirror", "ac73e8028a89be8a9056e7481cbba9b6a18d676c22852db552b72b3889cbcbb0"),
    ("camera", "c4b65fa0a12c404aa6c6f9f8ab3a4836a30e6687c822850f2f05cba47802e4d0"),
    ("tilted-absorbing", "f96a2e1a9a1852fb1de49c91d59267c63ef40d16d6ffaa82bfab63de69afafa3"),
    ("tilted-camera-gaussian", "8ce3711116449cebe70e5cd0aabca31bab7a7478f2c5133480d6c8e7d542b86d"),
    ("lights", "e194cf8eaa036dbd54a06178a11af56ce014429fafde1498e317028120ce323a"),
    ("pinhole", "aed8961441e4507c42f9d5f3b4b97444a7f0e54468208338e0cd97b0ae205d16"),
    ("thin-pane", "58b1800c727162aeb40729de8bc5720fab61b5b0a06f601b5d972fe89f8dbee8"),
    ("air", "808d28e9d65d65f8a224ce6a764bb637fd4b528f200180091d12edba55fa722d"),
    ("steep", "1a1835a31ad9521c34752d274460d397402c5cf6cd35382e2135df0236968784"),
    ("two-ranges", "cd503bc31ea7ef6bd194985a8a462a51fbf1e2f6ceadc82918035156e6d1ef9b"),
    ("one-row", "bad5fffbf0e51bc4d557135a7f823b723334bba8912f2cb6da79aba7b3a7c90d"),
    ("one-column", "e9b2172f15d859e44642e8c19509f1dedfb55d517a4baa48842a3372ea567a97"),
    ("adaptive", "85b41402308c1b72155a33c29047e2a884ef8b05a31e8fbd86743b9cdcfbab87"),
    ("two-layers", "2262b0706e64c6f390184e9d163b0a53e1d0baae1299b446cd39273dd32e732b"),
    ("jpeg", "cb3b5f587aff2f9ed5618ab759902a4ce6c187f91f1fe1088507b70142daacde"),
    ("turned", "37417b93244307a4f947a4b19e67a73ea817f8b2019792d474ce3df63a87230c"),
    ("display-p3", "046e95689ac307da15afa091192893f5cf4f57857a11b66a794a2a192a2226ab"),
];

/// Traces the golden scenes on this machine, which takes one thread tens of milliseconds. Returns one joint digest.
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
    digest_of(digests.iter().map(|digest| digest.wait().as_str()))
}

/// Returns the digest that every machine must reproduce with this version of the tracer.
pub fn pinned() -> Golden {
    digest_of(DIGESTS.iter().map(|(_, digest)| *digest))
}

fn digest_of<'a>(digests: impl Iterator<Item = &'a str>) -> Golden {
    let mut hasher = blake3::Hasher::new();
    for digest in digests {
        hasher.update(digest.as_bytes());
    }
    Golden { scene: SET.to_owned(), blake3: hasher.finalize().to_hex().to_string() }
}

/// Returns a scene's film as one tile, and the sample ranges that a run uses.
pub fn whole(scene: &Scene) -> (Tile, Vec<Range<u32>>) {
    let tile = Tile { x: 0, y: 0, width: scene.film.width, height: scene.film.height };
    let step = match scene.target_error {
        Some(_) => scene.spp,
        None => samples_per_range(scene.spp),
    };
    let starts = (0..scene.spp).step_by(step as usize);
    (tile, starts.map(|start| start..start + step).collect())
}

/// Traces a golden scene and returns the BLAKE3 digest (hex) of the pixels, samples and misses of each range.
fn digest(golden: &GoldenScene, isa: Isa) -> String {
    let (tile, ranges) = whole(&golden.scene);
    let mut hasher = blake3::Hasher::new();
    for range in ranges {
        let result = trace_tile(&golden.scene, tile, range, isa);
        for pixel in &result.pixels {
            for value in pixel.values() {
                hasher.update(&value.to_le_bytes());
            }
        }
        for layer in Layer::ALL {
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

    /// A failure means that pixels have changed. The message lists the steps for an intended change.
    #[test]
    fn golden_pixels_match_the_tracer_version() {
        let found: Vec<(&str, String)> = golden_scenes()
            .iter()
            .map(|golden| (golden.name, digest(golden, Isa::Baseline)))
            .collect();
        let pinned: Vec<(&str, String)> =
            DIGESTS.iter().map(|(name, d)| (*name, (*d).to_owned())).collect();
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
            "golden pixels of tracer version {VERSION} and of this program (version {TRACER_VERSION}) differ in:{changed}\n\
             if the change is intended: raise TRACER_VERSION above {VERSION}, add a line to CHANGELOG.md, set VERSION in \
             src/render/shard/golden.rs to the new version and replace the rows of DIGESTS by\n{table}"
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
        assert_eq!(golden(Isa::detect(), 2), pinned());
    }
}
