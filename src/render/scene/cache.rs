//! A bounded cache of decoded photographs, for scenes with the same photographs.

use super::photograph::{Sheet, decode_photograph};
use crate::formats::{PhotographFiles, SceneError};
use crate::line::Photograph;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard};

/// Decoded photographs that all threads of a process share. The photograph that was not used for the longest time leaves
/// first.
///
/// A photograph is found by the contents of its files and by its line, so a changed file is decoded again.
pub struct PhotographCache {
    limit_bytes: usize,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    sheets: HashMap<[u8; 32], Entry>,
    bytes: usize,
    /// Number of uses so far.
    uses: u64,
}

struct Entry {
    sheet: Sheet,
    /// Number of the newest use.
    used: u64,
}

impl PhotographCache {
    /// Makes a cache that holds at most `limit_bytes`; 0 keeps nothing.
    pub fn new(limit_bytes: usize) -> Self {
        Self { limit_bytes, state: Mutex::default() }
    }

    /// Returns the decoded photograph. `digests` are those of the colour image, the depth image and the mask.
    pub(super) fn photograph(
        &self,
        line: &Photograph,
        files: &PhotographFiles,
        digests: [Option<blake3::Hash>; 3],
    ) -> Result<Sheet, SceneError> {
        if self.limit_bytes == 0 {
            return decode_photograph(line, files);
        }
        let key = key(line, digests);
        if let Some(sheet) = self.lock().find(&key) {
            return Ok(sheet);
        }
        // Threads that need the same photograph at the same time all decode it, but none waits for another.
        let sheet = decode_photograph(line, files)?;
        self.lock().keep(key, sheet.clone(), self.limit_bytes);
        Ok(sheet)
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder of this lock panics")
    }
}

impl State {
    fn find(&mut self, key: &[u8; 32]) -> Option<Sheet> {
        self.uses += 1;
        let entry = self.sheets.get_mut(key)?;
        entry.used = self.uses;
        Some(entry.sheet.clone())
    }

    fn keep(&mut self, key: [u8; 32], sheet: Sheet, limit_bytes: usize) {
        let bytes = sheet.bytes();
        if bytes > limit_bytes || self.sheets.contains_key(&key) {
            return;
        }
        while self.bytes + bytes > limit_bytes {
            let oldest = self.sheets.iter().min_by_key(|(_, entry)| entry.used);
            let oldest = *oldest.expect("a cache without photographs has room").0;
            let entry = self.sheets.remove(&oldest).expect("found above");
            self.bytes -= entry.sheet.bytes();
        }
        self.bytes += bytes;
        self.sheets.insert(key, Entry { sheet, used: self.uses });
    }
}

/// Computes the digest of everything that determines a decoded photograph.
fn key(line: &Photograph, digests: [Option<blake3::Hash>; 3]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    for digest in digests {
        hasher.update(digest.as_ref().map_or(&[0; 32], |digest| digest.as_bytes()));
    }
    // The position of the camera does not matter here, nor the names of files with the same contents.
    let [color, depth] = [String::new(), String::new()];
    let mask = line.mask.as_ref().map(|_| String::new());
    let line = Photograph { color, depth, mask, apex: None, cards: vec![], ..line.clone() };
    let line = serde_json::to_vec(&line).expect("a scene line can be written as JSON");
    *hasher.update(&line).finalize().as_bytes()
}

#[cfg(test)]
mod tests {
    use super::super::load::{SceneFiles, SideFiles, load, load_with};
    use super::*;
    use crate::formats::NamedBytes;
    use crate::line::{SceneLine, parse_scene};
    use std::sync::Arc;

    /// Bytes of a cached photograph of 2 x 2 px: four inverse depths, one block, four valid flags and 3 x 3 texels.
    const BYTES: usize = 16 + 8 + 4 + 144;

    fn files(radiance: [f32; 2]) -> SceneFiles {
        let pfm = |kind: &str, value: f32, count: usize| {
            let header = format!("{kind}\n2 2\n-1.0\n").into_bytes();
            let bytes = [header, value.to_le_bytes().repeat(count)].concat();
            NamedBytes { path: "wall.pfm".into(), bytes }
        };
        let [front, back] = radiance.map(|radiance| {
            SideFiles::Photograph(PhotographFiles {
                color: pfm("PF", radiance, 12),
                depth: pfm("Pf", 2.0, 4),
                mask: None,
            })
        });
        SceneFiles::new(front, back)
    }

    fn line(exposure: f64) -> SceneLine {
        let side = r#"{"color":"c","depth":"d","transfer":"linear","intrinsics":{"fx":2,"fy":2,"cx":1,"cy":1}}"#;
        let line = format!(
            r#"{{"schema":"glasshouse.scene/1","id":"s","seed":1,"film":{{"width":8,"height":6,"spp":16}},
            "camera":{{"focal_length_mm":55,"aperture_radius_m":0.01,"focus":{{"distance_m":2}},"exposure":{exposure}}},
            "glass":{{"distance_m":0.3,"thickness_m":0.01,"ior":1.5}},"front":{side},"back":{side}}}"#
        );
        parse_scene(&line).unwrap()
    }

    /// Returns the addresses of both sides' pixels, and the largest radiance of each.
    fn sides(cache: &PhotographCache, exposure: f64, radiance: [f32; 2]) -> [(usize, f64); 2] {
        let loaded = load_with(&line(exposure), &files(radiance), cache).unwrap();
        let facts = loaded.facts.max_radiance;
        let of = |surface: &crate::trace::Surface| match surface {
            crate::trace::Surface::Sheet(view) => Arc::as_ptr(&view.texture) as usize,
            crate::trace::Surface::Mesh(_) => unreachable!("both sides are photographs"),
        };
        [(of(&loaded.scene.front), facts.front), (of(&loaded.scene.back), facts.back)]
    }

    fn held(cache: &PhotographCache) -> usize {
        cache.lock().sheets.len()
    }

    #[test]
    fn photographs_with_equal_lines_and_files_are_shared() {
        let cache = PhotographCache::new(10 * BYTES);
        let [front, back] = sides(&cache, 1.0, [0.5, 0.5]);
        assert_eq!((front, held(&cache)), (back, 1));
        assert_eq!(sides(&cache, 1.0, [0.5, 0.25])[0], front);
        // Another file or another line is another photograph.
        assert_eq!(sides(&cache, 1.0, [0.125, 0.25])[0].1, 0.125);
        assert_eq!(sides(&cache, 2.0, [0.5, 0.25])[0].1, 1.0);
        assert_eq!(held(&cache), 5);
        assert_eq!(cache.lock().bytes, 5 * BYTES);
    }

    #[test]
    fn the_least_recently_used_photograph_leaves() {
        let cache = PhotographCache::new(2 * BYTES);
        let [(a, _), (b, _)] = sides(&cache, 1.0, [0.5, 0.25]);
        // The front is used again before the third photograph comes.
        let [(front, _), (c, _)] = sides(&cache, 1.0, [0.5, 0.125]);
        assert_eq!((front, held(&cache)), (a, 2));
        assert_eq!(sides(&cache, 1.0, [0.5, 0.125]).map(|side| side.0), [a, c]);
        assert_ne!(b, c);
        assert_eq!(cache.lock().bytes, 2 * BYTES);
        // A photograph that does not fit is decoded each time.
        for limit in [0, BYTES - 1] {
            let none = PhotographCache::new(limit);
            let [front, back] = sides(&none, 1.0, [0.5, 0.5]);
            assert!(front.0 != back.0 && held(&none) == 0);
        }
    }

    #[test]
    fn a_cached_scene_has_the_same_facts() {
        let cache = PhotographCache::new(10 * BYTES);
        for _ in 0..2 {
            let cached = load_with(&line(1.5), &files([0.5, 0.25]), &cache).unwrap();
            let plain = load(&line(1.5), &files([0.5, 0.25])).unwrap();
            assert_eq!((cached.facts, cached.inputs), (plain.facts, plain.inputs));
        }
    }
}
