//! The photographs of a procedural set and their paths.

use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;

const SCENES_PER_BLOCK: u32 = 2;
const SCANS_PER_SCENE: u32 = 3;
const VIEWS_PER_SCAN: u32 = 2;

/// Kind of place, as in DIODE.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// Rooms: depths of a few metres, daylight through windows, lamps.
    Indoors,
    /// Streets, squares and parks: depths up to 60 m, sky.
    Outdoor,
}

impl Place {
    /// Returns the name of the folder in DIODE.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Indoors => "indoors",
            Self::Outdoor => "outdoor",
        }
    }
}

/// One photograph of a procedural set. These six values, the size and the intrinsics determine the picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SamplePhotograph {
    /// Kind of place.
    pub place: Place,
    /// Number of the scene (a building or a quarter), unique over both places.
    pub scene: u32,
    /// Number of the scan (a room or a spot in the scene), unique over all scenes.
    pub scan: u32,
    /// Number of the view within the scan.
    pub index: u32,
    /// Seed of the whole set.
    pub seed: u64,
    /// True for surfaces with the texture of stone, bark, cloth or gravel; false for smooth ones.
    pub is_textured: bool,
}

impl SamplePhotograph {
    /// Returns the path of the colour image, relative to the set's root.
    pub fn color_path(&self) -> PathBuf {
        self.path(".png")
    }

    /// Returns the path of the depth image, relative to the set's root.
    pub fn depth_path(&self) -> PathBuf {
        self.path("_depth.npy")
    }

    /// Returns the path of the mask, relative to the set's root.
    pub fn mask_path(&self) -> PathBuf {
        self.path("_depth_mask.npy")
    }

    /// Returns the paths of all three files, relative to the set's root.
    pub fn paths(&self) -> [PathBuf; 3] {
        [self.color_path(), self.depth_path(), self.mask_path()]
    }

    fn path(&self, ending: &str) -> PathBuf {
        let (place, scene, scan) = (self.place.name(), self.scene, self.scan);
        let angle_deg = 10 * self.index;
        PathBuf::from(format!(
            "train/{place}/scene_{scene:05}/scan_{scan:05}/\
             {scene:05}_{scan:05}_{place}_000_{angle_deg:03}{ending}"
        ))
    }
}

/// Returns the first `count` photographs of the set with this seed, with smooth surfaces.
///
/// Places vary fastest, then scenes in a pair, then scans, then views. A shorter listing is a prefix of a longer one.
pub fn listing(count: usize, seed: u64) -> Vec<SamplePhotograph> {
    (0..count as u32).map(|i| photograph(i, seed)).collect()
}

fn photograph(i: u32, seed: u64) -> SamplePhotograph {
    let outdoor = i % 2;
    let k = i / 2;
    let block = k / (SCENES_PER_BLOCK * SCANS_PER_SCENE * VIEWS_PER_SCAN);
    let scene_of_place = block * SCENES_PER_BLOCK + k % SCENES_PER_BLOCK;
    let scan_of_scene = k / SCENES_PER_BLOCK % SCANS_PER_SCENE;
    let scene = 2 * scene_of_place + outdoor;
    SamplePhotograph {
        place: if outdoor == 0 { Place::Indoors } else { Place::Outdoor },
        scene,
        scan: scene * SCANS_PER_SCENE + scan_of_scene,
        index: k / (SCENES_PER_BLOCK * SCANS_PER_SCENE) % VIEWS_PER_SCAN,
        seed,
        is_textured: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn a_shorter_listing_is_a_prefix_of_a_longer_one() {
        let long = listing(60, 3);
        for count in [0, 1, 2, 7, 24, 59] {
            assert_eq!(listing(count, 3), long[..count]);
        }
    }

    #[test]
    fn no_two_photographs_share_a_file() {
        let paths: BTreeSet<_> = listing(500, 1).iter().map(SamplePhotograph::color_path).collect();
        assert_eq!(paths.len(), 500);
    }

    #[test]
    fn eight_photographs_have_two_scenes_per_place_and_two_scans_per_scene() {
        let photographs = listing(8, 0);
        for place in [Place::Indoors, Place::Outdoor] {
            let here = || photographs.iter().filter(move |p| p.place == place);
            let scenes: BTreeSet<_> = here().map(|p| p.scene).collect();
            assert_eq!(scenes.len(), 2);
            for scene in scenes {
                let scans: BTreeSet<_> =
                    here().filter(|p| p.scene == scene).map(|p| p.scan).collect();
                assert_eq!(scans.len(), 2);
            }
        }
    }

    #[test]
    fn paths_follow_the_published_layout() {
        let photograph = SamplePhotograph { scene: 22, scan: 193, index: 0, ..photograph(1, 0) };
        let color = "train/outdoor/scene_00022/scan_00193/00022_00193_outdoor_000_000.png";
        assert_eq!(photograph.color_path(), PathBuf::from(color));
        let depth = color.replace(".png", "_depth.npy");
        assert_eq!(photograph.depth_path(), PathBuf::from(depth));
        let mask = color.replace(".png", "_depth_mask.npy");
        assert_eq!(photograph.mask_path(), PathBuf::from(mask));
    }
}
