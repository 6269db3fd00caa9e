//! Traces small built-in scenes. Every machine must reproduce their pixels before it joins a run.

use super::golden_scenes::{GoldenScene, golden_scenes};
use super::layout::samples_per_range;
use super::spec::Golden;
use crate::layer::Layer;
use crate::threads::on_threads;
use crate::trace::{Isa, Scene, Tile, trace_tile};
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
    ("mirror", "8ae03b6a838ad11218497acf33da1f10dc43d6218a8c2769b92f5abe0ffb0c88"),
    ("mirror-gaussian", "ccca99f473a64140c274fbfb1688c0af43a43f7d9b44ab2b4503ca0fa77ad1ba"),
    ("camera", "30e8b43d8a327426fee658c078a8738897ddf6289547d6133353931d749b4e8e"),
    ("tilted-absorbing", "9b94649b9d762de295178bf5291e1b52f55fac23c520e20c52319d551569da61"),
    ("tilted-camera-gaussian", "4e303c45099eab0115cb8cfd9c9e334e8c3668af740614a83ffb5f67bf8bf3ad"),
    ("lights", "74c818941090db409a0334cc1e1c61fa74dfdffedcefdba96d2a757a4c117b86"),
    ("pinhole", "1ca519ca49b0d904e0b70948a32501d3d5ab75810aa49ba439577e3f1f099804"),
    ("thin-pane", "a17b365c97daf3614d7cee260a5b69bd1097dd36d794165f6017ccf5aac4ada9"),
    ("air", "faf00d82de1ebd6cf987ed191546655389e27d0e67b83d3892b2b57aaf28b927"),
    ("steep", "910465f1ab65b336e84370d0a4cb32233b84a7d4efc9909e7f2dd806200c491a"),
    ("two-ranges", "dbd5527583afbab69e8f81595083b8d2db99797e2beaafcb6e3fa1f9e0e77966"),
    ("camera-two-ranges", "bc4ab17f4805c5028d9196dd1851eade27990e2dcab051d1a7b39e55ead1d911"),
    ("one-row", "18e60d3399012cf8fc69c14342436e43c1c9c5864e94df6736b88b39f592c2ed"),
    ("one-column", "328de1d049b82438e48f622b6960ada5bdca8dd284e4c440321ba4a1d27aaa64"),
    ("adaptive", "de261df1fa018e71d63cbb634b5e66e2b5b8d07909402c44039968aa3d1a4c6d"),
    ("two-layers", "e62ca593424a882d9daf148dca542df494c663530806039fd66fe5d2ae47ff03"),
    ("jpeg", "e1d19414692798b4705f521b3667b299e5589af4d726fd8d8f20c6ce005f2d2b"),
    ("turned", "966333b150e3505909dd90141f9b77f0364b6a1f02cd52925a1e793d9f2d1421"),
    ("display-p3", "fc407955087b716b57633d3a7c58af1a3f6e66b1ca1da473c4fff8da82a736af"),
    ("double", "41ea30788f4b0ff12dbe2213226e95f284d1e256a5799a32bd38d2a309d14c29"),
    ("bent", "e2d9a8c69789b43dd7c77d40cf3151804ae53f190b49a64f650c0b50275d8557"),
    ("rough", "6cc4d532203a3f9b77b6444b8296056176d36cfe434b1668ed1323a6fb58a11d"),
    ("waved", "45beee508d80bdaa96b0071139060ce9b7735a03c38751086d856d625146ffa0"),
    ("framed", "d3df85854581832b764fe26c91178f531d341575593c92724d36abaad78ce441"),
    ("framed-camera", "124b8f85146ebf692cdda8486ba16ff0a5c1e251fb41d247743d77ed55b62786"),
    ("smudged", "434c3b991ca9b743b5f4c88c70e6669d1051b2f85970b782fb634919963ef9af"),
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
        let older = "f7033c6b";
        assert_eq!(&pinned_of("builtin/5").blake3[..8], older, "older runs must stay valid");
        assert_eq!(golden_of("unknown", Isa::detect(), 1), pinned());
    }
}
