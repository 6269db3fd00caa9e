//! Small built-in scenes whose pixels every machine must reproduce before it joins a run.

use super::golden_scenes::{GoldenScene, golden_scenes};
use super::layout::samples_per_range;
use super::spec::Golden;
use crate::trace::{Isa, Tile, trace_tile};

/// Name of the set of scenes; a new one when any scene changes, comes or goes.
pub(super) const SET: &str = "builtin/2";

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
    let range = samples_per_range(scene.spp);
    let mut hasher = blake3::Hasher::new();
    for start in (0..scene.spp).step_by(range as usize) {
        let result = trace_tile(scene, tile, start..start + range, isa);
        for pixel in &result.pixels {
            for value in pixel.mean.iter().chain(&pixel.half).flatten() {
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
    const VERSION: u32 = 1;
    /// Digests of the scenes of [`golden_scenes`].
    #[rustfmt::skip]
    const DIGESTS: &[(&str, &str)] = &[
        ("mirror", "107d23234b886f4ddb529cf51d7e9213f35798e2460c2bd4734283180400762c"),
        ("camera", "49546748275928c2a152a42fd6814a7810e9a36caeac063da0d9859b7a43f350"),
        ("tilted-absorbing", "ce926ffff11fb3bff874124ecdce7e7601c475488f30251b146b0576d1246566"),
        ("tilted-camera-gaussian", "bf3f7f90f7ea20ec91b385d027785ac4fc935aceb30d757add5a1ce411db3690"),
        ("lights", "5ce051b7ba54761cb152221a0c25ea6b92cc74c3c14f42a58ae294b4701164fc"),
        ("pinhole", "f52c2127e021122c885d0b9d8dd0c04b1a00b9f1128a3c2a7c982f3895bfe7be"),
        ("thin-pane", "b49eac23b9878f4c00f08c9c9313321c1971018f924983683fd76011f0a63e1a"),
        ("air", "bb0e40f8e94c6a4ba35449e6a76ce838d34ce574a5c700a94900c70715fe5669"),
        ("steep", "f6382ae572e623a0a20540f0cc3162d51c15cb8fcadbdb27760b6122f84191fe"),
        ("two-ranges", "fd27c28ac6cebd06e6dc091d64b2304914f25b5d137d77f8ca5d2fc07d84078d"),
        ("one-row", "443ebf26594707da89963ab2e7669f82f46ef1848eccea5f8c1bb170d5d81a05"),
        ("one-column", "c73c61173148d4f3baeb79c33d8a2c8e5b35c11af9e34e5e9afab83a38632265"),
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
