//! Traces small built-in scenes. Every machine must reproduce their pixels before it joins a run.

use super::golden_scenes::{GoldenScene, golden_scenes};
use super::layout::samples_per_range;
use super::spec::Golden;
use crate::layer::Layer;
use crate::trace::{Isa, Scene, Tile, trace_tile};
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Names of the sets of scenes, and the number of scenes of each: a set contains those of the sets before it. A run keeps the set
/// of its planning.
const SETS: [(&str, usize); 3] = [("builtin/5", 19), ("builtin/6", 25), ("builtin/7", 26)];

/// Tracer version of the digests below.
#[cfg(test)]
const VERSION: u32 = 5;
/// Names and digests of the scenes of [`golden_scenes`].
#[rustfmt::skip]
const DIGESTS: &[(&str, &str)] = &[
    ("mirror", "82a38c95f6e942d6824e3d45dbe3fe92659c3226ff3ecc78c574428630dd23a8"),
    ("mirror-gaussian", "6e6897a2534c6acd0b052daaad55126261e438aa43f0b57078e10bcc1308b609"),
    ("camera", "c4b65fa0a12c404aa6c6f9f8ab3a4836a30e6687c822850f2f05cba47802e4d0"),
    ("tilted-absorbing", "6d1a280296dde4f82f57579b3f3464815cf9bd88de0d5031d9b21043e1026202"),
    ("tilted-camera-gaussian", "8ce3711116449cebe70e5cd0aabca31bab7a7478f2c5133480d6c8e7d542b86d"),
    ("lights", "8e24011a95f4ede16aa353b8304211cff084d1ca4ff8914ff84e1b3634d13fd6"),
    ("pinhole", "12d6f1c39a9c29e23b41aea8d6c9f7138c01f513e5bf50820dc402bb7a414936"),
    ("thin-pane", "e342ffe61ecc60cb4cd4fd837ed94b3f0edf4ff42b232193d1f1b3a8946cb69c"),
    ("air", "faf00d82de1ebd6cf987ed191546655389e27d0e67b83d3892b2b57aaf28b927"),
    ("steep", "e8c8d444949b1a3e5810b0687a3a5107d90c499ebe46e1745f1771e26c88e922"),
    ("two-ranges", "15c095c173d9cd4bd4ab772603c2554a740aa79fec1c18984d1df54d6814d4af"),
    ("camera-two-ranges", "2fdbf3d3010451839d5915e9cf6980911b64b5d52008be45f418e1a9ec42d0b7"),
    ("one-row", "d9349ee3fbef3cd6610b1b55bf46ea006670d3784c3fb78b43369b5375ee8e51"),
    ("one-column", "dd92bbd3f6cf23366a380d86056b5822c628e18173e2e2ed5ab4627233e433e9"),
    ("adaptive", "af8e5a899c818da97a5b0becce5062646e44846570b0680d8825144df39c3ef1"),
    ("two-layers", "e62ca593424a882d9daf148dca542df494c663530806039fd66fe5d2ae47ff03"),
    ("jpeg", "0796ed498897b641502085b1e8eddc81c01da818fded80b1d331ad42be9afc7f"),
    ("turned", "b3e16f60cd772cff19e23da9bc1f22e0ea8856cad1a0bc1a8aeddea6accea8e0"),
    ("display-p3", "35bcacb7dacc4b45a1ebd289bf069a1a61bee6addc498dd7b146c0d4f3f716fc"),
    ("double", "d091aec5da3f6bb069c1faffadac9e56ab23ce235d7a92cf47700f053d1a9a5c"),
    ("bent", "20827c7e72a2f486383a7b46d7382bb49b49cda23e7c4054d09d28e81eef817a"),
    ("rough", "062de532040a5243bb502ab23130548e79bbe969b1288a5662177f81a51f0501"),
    ("waved", "a70c6e070840e35a5502a3160826eb1d8e2c2340655678889fa19ee798f9032c"),
    ("framed", "9528fe93caf2a7cb7f47f5d9e8b7401c3717528b6792b02bbde8b8286e59a03a"),
    ("framed-camera", "fc52b28c2d77c2ac9906d2d831eefbd165b7a5f90d875162aa6e8f0d4c2d9654"),
    ("smudged", "f7e3eab97630008e5106b4d94b5fd04e662c504cdcce7495f4d22373cd720bf3"),
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
    std::thread::scope(|scope| {
        for _ in 1..threads.min(scenes.len()) {
            scope.spawn(trace);
        }
        trace();
    });
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
        let older = "9b630788";
        assert_eq!(&pinned_of("builtin/5").blake3[..8], older, "older runs must stay valid");
        assert_eq!(golden_of("unknown", Isa::detect(), 1), pinned());
    }
}
