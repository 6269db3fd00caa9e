//! Traces small built-in scenes. Every machine must reproduce their pixels before it joins a run.

use super::golden_scenes::{GoldenScene, golden_scenes};
use super::layout::samples_per_range;
use super::spec::Golden;
use crate::threads::on_threads;
use crate::trace::{Isa, Scene, Tile, trace_tile};
use glasshouse_line::layer::Layer;
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Names of the sets of scenes, and the number of scenes of each: a set contains those of the sets before it. A run keeps the set
/// of its planning.
const SETS: [(&str, usize); 3] = [("builtin/5", 19), ("builtin/6", 25), ("builtin/7", 26)];

/// Tracer version of the digests below.
#[cfg(test)]
const VERSION: u32 = 7;
/// Names and digests of the scenes of [`golden_scenes`].
#[rustfmt::skip]
const DIGESTS: &[(&str, &str)] = &[
    ("mirror", "4b9bd2f2d94a016b04dcba7bb8fd0ceb5d4cae8687da323bc860b1ac2affc35f"),
    ("mirror-gaussian", "7a643ff44f2f1b5428b1a0a61c8bbd5cf16894e6dc2ade9cce2dacc86e81795e"),
    ("camera", "292d7888d791214cf6329eb50c7b1430deb029518e2c436ed2144d69aba8d0eb"),
    ("tilted-absorbing", "6f1d16b1276c52be377a7ce04c3933947c831e9ce2306da7b1e0be194b1b3eaa"),
    ("tilted-camera-gaussian", "e3a830b2ea14af0c9bffc4be6443e617ddbdb4baf78b8754422aeb103cb7b351"),
    ("lights", "e179de99ef722def4632c802c67923535ac6ac58005ebdaff5ac2812fd4a4f4b"),
    ("pinhole", "7dce6ab67cfc89d642f789408d63aa9ccd768b5d5c1168b15b42c926613e3122"),
    ("thin-pane", "9cb915c999160f636cb17443bf02718121a659eec96e9c23861cd72f3e76f5c6"),
    ("air", "faf00d82de1ebd6cf987ed191546655389e27d0e67b83d3892b2b57aaf28b927"),
    ("steep", "709afeaedabf0aa4ca1cb25678bf57d57cbe06e8973166c00fb40c4851868ad4"),
    ("two-ranges", "0be8140cc9d870338375e25858a967e3213b927b5b1a1eb987df4f7ab442eb23"),
    ("camera-two-ranges", "142e9cdfe9b1690eabf7726a021a5a54fcec80113e2417297fc701dde3d83327"),
    ("one-row", "18e60d3399012cf8fc69c14342436e43c1c9c5864e94df6736b88b39f592c2ed"),
    ("one-column", "328de1d049b82438e48f622b6960ada5bdca8dd284e4c440321ba4a1d27aaa64"),
    ("adaptive", "de261df1fa018e71d63cbb634b5e66e2b5b8d07909402c44039968aa3d1a4c6d"),
    ("two-layers", "e62ca593424a882d9daf148dca542df494c663530806039fd66fe5d2ae47ff03"),
    ("jpeg", "ada672369b4f97ce2bb2df894b9399e6d6095ca7cdd860b8ba81901cd2dda1cd"),
    ("turned", "ad937acbdbc3874c240ddf76fc468bc6f918630e1c787d119f302564e29a6016"),
    ("display-p3", "ab43be7ad18a95d8fcf9c44a662c5abfd8d7144e15a9b0658544833fc26ed695"),
    ("double", "a8f1d3c24c323ca9245fe128ca1f820d3d7506a0f53a57c0f5a9ffa2255f1cc1"),
    ("bent", "160e31bfa9d9886fff097835e21764664d4369d9950f6955fb980d56a446ddb3"),
    ("rough", "f439f4ded23f98e7e555042c16d71acc2af23253f0478f1c8ffddf27165cac07"),
    ("waved", "c44262fbae44dbdd090d3020b712cd213534dc882e51bb714f04eb5dc80ea533"),
    ("framed", "6e4a7603b2807cebb95f8b7319497170798741121ac251db4011ffbc379432b6"),
    ("framed-camera", "c68f03a3be48dea4c62ce7c53f324e7b9a7a5028b6fc32db2d91265e981c5e15"),
    ("smudged", "446eaab85b92506e68dfd18a97b56455b2667acd81f540936eca0c543ad603f0"),
];

/// Traces the golden scenes on this machine, which takes one thread tens of milliseconds. Returns one joint digest.
pub fn golden(isa: Isa, threads: usize) -> Golden {
    golden_of(SETS[SETS.len() - 1].0, isa, threads)
}

/// Traces the golden scenes of a run's set; for an unknown set, those of the newest one.
pub fn golden_of(set: &str, isa: Isa, threads: usize) -> Golden {
    let (set, count) = known(set);
    let mut scenes = golden_scenes();
    scenes.truncate(count);
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
    on_threads(threads.min(scenes.len()), trace);
    digest_of(set, digests.iter().map(|digest| digest.wait().as_str()))
}

/// Returns the digest that every machine must reproduce with this version of the tracer.
pub fn pinned() -> Golden {
    pinned_of(SETS[SETS.len() - 1].0)
}

/// Returns the digest of a run's set; for an unknown set, that of the newest one.
pub fn pinned_of(set: &str) -> Golden {
    let (set, count) = known(set);
    digest_of(set, DIGESTS[..count].iter().map(|(_, digest)| *digest))
}

/// Returns the name of a set and the number of its scenes; for an unknown set, those of the newest one.
fn known(set: &str) -> (&'static str, usize) {
    let found = SETS.into_iter().find(|(name, _)| *name == set);
    found.unwrap_or(SETS[SETS.len() - 1])
}

fn digest_of<'a>(set: &str, digests: impl Iterator<Item = &'a str>) -> Golden {
    let mut hasher = blake3::Hasher::new();
    for digest in digests {
        hasher.update(digest.as_bytes());
    }
    Golden { scene: set.to_owned(), blake3: hasher.finalize().to_hex().to_string() }
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
        for (set, _) in SETS {
            assert_eq!(golden_of(set, Isa::detect(), 1), pinned_of(set));
        }
        let older = "1a13ab99";
        assert_eq!(&pinned_of("builtin/5").blake3[..8], older, "older runs must stay valid");
        assert_eq!(golden_of("unknown", Isa::detect(), 1), pinned());
    }
}
