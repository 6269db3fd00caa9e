//! A bounded cache of decoded photographs and cards, for scenes that share pictures.

use super::card::card_texture;
use super::color;
use super::photograph::{Shape, Sheet, check_line, decode_shape, texture};
use crate::formats::raster::Raster;
use crate::formats::{NamedBytes, PhotographFiles, SceneError};
use crate::trace::Texture;
use glasshouse_line::{Card, Photograph, Transfer};
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};

/// Digests of a photograph's files: colour image, depth image, mask.
pub(super) type PhotographDigests = [Option<blake3::Hash>; 3];

/// Decoded pictures that all threads of a process share. The picture that was not used for the longest time leaves first.
///
/// A picture is found by the contents of its files and by its line, so a changed file is decoded again. Geometry and samples
/// of a photograph are kept for lines with any light; a texture is kept for lines with the same light, and leaves before them.
pub struct PhotographCache {
    limit_bytes: usize,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    parts: HashMap<Key, Entry>,
    bytes: usize,
    /// Number of uses so far.
    uses: u64,
}

type Key = [u8; 32];

struct Entry {
    part: Part,
    bytes: usize,
    /// Number of the newest use.
    used: u64,
}

/// A part of a decoded picture.
#[derive(Clone)]
enum Part {
    /// Geometry of a photograph.
    Shape(Arc<Shape>),
    /// Samples of a colour image.
    Samples(Arc<Raster>),
    /// Radiance of a photograph in one light.
    Texture(Arc<Texture>),
}

impl PhotographCache {
    /// Makes a cache that holds at most `limit_bytes`; 0 keeps nothing.
    pub fn new(limit_bytes: usize) -> Self {
        Self { limit_bytes, state: Mutex::default() }
    }

    /// Returns the decoded photograph.
    pub(super) fn photograph(
        &self,
        line: &Photograph,
        files: &PhotographFiles,
        digests: PhotographDigests,
    ) -> Result<Sheet, SceneError> {
        let path = &files.color.path;
        check_line(line, path)?;
        let keys = PhotographKeys::new(line, digests);
        // Threads that need the same photograph at the same time all decode it, but none waits for another.
        let shape = if let Some(Part::Shape(shape)) = self.find(&keys.shape) {
            shape
        } else {
            let shape = Arc::new(decode_shape(line, files)?);
            self.keep(keys.shape, Part::Shape(Arc::clone(&shape)), shape.bytes());
            shape
        };
        let decode = || color::decode_samples(&files.color, line.orientation);
        let texture = match self.find(&keys.texture) {
            Some(Part::Texture(texture)) => texture,
            _ => self.new_texture(line, path, &keys, &*self.samples(keys.samples, decode)?)?,
        };
        Ok(shape.with(texture))
    }

    /// Returns a photograph without reading its files; `None` if the cache lacks a part of it. `path` is for errors.
    pub(super) fn cached(
        &self,
        line: &Photograph,
        path: &Path,
        digests: PhotographDigests,
    ) -> Option<Result<Sheet, SceneError>> {
        let keys = PhotographKeys::new(line, digests);
        let Some(Part::Shape(shape)) = self.find(&keys.shape) else {
            return None;
        };
        if let Some(Part::Texture(texture)) = self.find(&keys.texture) {
            return Some(Ok(shape.with(texture)));
        }
        let Some(Part::Samples(samples)) = self.find(&keys.samples) else {
            return None;
        };
        let texture =
            check_line(line, path).and_then(|()| self.new_texture(line, path, &keys, &samples));
        Some(texture.map(|texture| shape.with(texture)))
    }

    fn new_texture(
        &self,
        line: &Photograph,
        path: &Path,
        keys: &PhotographKeys,
        samples: &Raster,
    ) -> Result<Arc<Texture>, SceneError> {
        let texture = Arc::new(texture(line, path, samples)?);
        self.keep(keys.texture, Part::Texture(Arc::clone(&texture)), texture.bytes());
        Ok(texture)
    }

    /// Returns the decoded picture of a card.
    pub(super) fn card(
        &self,
        line: &Card,
        file: &NamedBytes,
        digest: blake3::Hash,
    ) -> Result<Arc<Texture>, SceneError> {
        let samples = self.samples(card_key(digest), || color::decode_straight(file))?;
        card_texture(line, &file.path, &samples)
    }

    /// Returns a card without reading its file; `None` if the cache lacks it. `path` is for errors.
    pub(super) fn cached_card(
        &self,
        line: &Card,
        path: &Path,
        digest: blake3::Hash,
    ) -> Option<Result<Arc<Texture>, SceneError>> {
        match self.find(&card_key(digest)) {
            Some(Part::Samples(samples)) => Some(card_texture(line, path, &samples)),
            _ => None,
        }
    }

    fn samples(
        &self,
        key: Key,
        decode: impl FnOnce() -> Result<Raster, SceneError>,
    ) -> Result<Arc<Raster>, SceneError> {
        if let Some(Part::Samples(samples)) = self.find(&key) {
            return Ok(samples);
        }
        let samples = Arc::new(decode()?);
        self.keep(key, Part::Samples(Arc::clone(&samples)), samples.samples.bytes());
        Ok(samples)
    }

    fn find(&self, key: &Key) -> Option<Part> {
        self.lock().find(key)
    }

    fn keep(&self, key: Key, part: Part, bytes: usize) {
        self.lock().keep(key, part, bytes, self.limit_bytes);
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder of this lock panics")
    }
}

impl State {
    fn find(&mut self, key: &Key) -> Option<Part> {
        self.uses += 1;
        let entry = self.parts.get_mut(key)?;
        entry.used = self.uses;
        Some(entry.part.clone())
    }

    fn keep(&mut self, key: Key, part: Part, bytes: usize, limit_bytes: usize) {
        if bytes > limit_bytes || self.parts.contains_key(&key) {
            return;
        }
        while self.bytes + bytes > limit_bytes {
            // A texture takes several times the memory of its samples, and is quickly made of them.
            let order = |entry: &Entry| (!matches!(entry.part, Part::Texture(_)), entry.used);
            let first = self.parts.iter().min_by_key(|(_, entry)| order(entry));
            let first = *first.expect("a cache without pictures has room").0;
            let entry = self.parts.remove(&first).expect("found above");
            self.bytes -= entry.bytes;
        }
        self.bytes += bytes;
        self.parts.insert(key, Entry { part, bytes, used: self.uses });
    }
}

/// Keys of the parts of a photograph: digests of everything that determines them.
struct PhotographKeys {
    shape: Key,
    samples: Key,
    texture: Key,
}

impl PhotographKeys {
    fn new(line: &Photograph, digests: PhotographDigests) -> Self {
        // Neither the position of the camera nor the names of files with the same contents matter, and light only for textures.
        let [color, depth] = [String::new(), String::new()];
        let mask = line.mask.as_ref().map(|_| String::new());
        let shape = Photograph {
            color,
            depth,
            mask,
            apex: None,
            cards: vec![],
            transfer: Transfer::default(),
            highlights: None,
            exposure: 1.0,
            illuminant: [1.0; 3],
            ..line.clone()
        };
        let light =
            (line.orientation, line.transfer, line.highlights, line.exposure, line.illuminant);
        Self {
            shape: key("shape", &digests, &shape),
            samples: key("samples", &digests[..1], &line.orientation),
            texture: key("texture", &digests[..1], &light),
        }
    }
}

fn card_key(digest: blake3::Hash) -> Key {
    key("card", &[Some(digest)], &())
}

fn key(part: &str, digests: &[Option<blake3::Hash>], line: &impl Serialize) -> Key {
    let mut hasher = blake3::Hasher::new();
    hasher.update(part.as_bytes());
    for digest in digests {
        hasher.update(digest.as_ref().map_or(&[0; 32], |digest| digest.as_bytes()));
    }
    let line = serde_json::to_vec(line).expect("a scene line can be written as JSON");
    *hasher.update(&line).finalize().as_bytes()
}

#[cfg(test)]
mod tests {
    use super::super::load::{SceneFiles, SideFiles, load, load_with};
    use super::*;
    use crate::formats::NamedBytes;
    use glasshouse_line::{SceneLine, parse_scene};
    use std::sync::Arc;

    /// Bytes of the parts of a photograph of 2 x 2 px: four inverse depths, one block, its ceiling and four valid flags; 2 x 2 samples of
    /// three floats; 3 x 3 texels.
    const SHAPE: usize = 16 + 8 + 4 + 4;
    const SAMPLES: usize = 48;
    const TEXTURE: usize = 144;

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

    /// Returns the numbers of kept shapes, samples and textures.
    fn held(cache: &PhotographCache) -> [usize; 3] {
        let mut held = [0; 3];
        let (mut bytes, state) = (0, cache.lock());
        for entry in state.parts.values() {
            let kind = match entry.part {
                Part::Shape(_) => 0,
                Part::Samples(_) => 1,
                Part::Texture(_) => 2,
            };
            held[kind] += 1;
            bytes += [SHAPE, SAMPLES, TEXTURE][kind];
        }
        assert_eq!(state.bytes, bytes);
        held
    }

    #[test]
    fn photographs_with_equal_lines_and_files_are_shared() {
        let cache = PhotographCache::new(10_000);
        let [front, back] = sides(&cache, 1.0, [0.5, 0.5]);
        assert_eq!((front, held(&cache)), (back, [1, 1, 1]));
        assert_eq!(sides(&cache, 1.0, [0.5, 0.25])[0], front);
        // Another file is another photograph, and another light another texture.
        assert_eq!(sides(&cache, 1.0, [0.125, 0.25])[0].1, 0.125);
        assert_eq!(sides(&cache, 2.0, [0.5, 0.25])[0].1, 1.0);
        assert_eq!(held(&cache), [3, 3, 5]);
    }

    #[test]
    fn textures_leave_first_then_the_least_recently_used() {
        let cache = PhotographCache::new(2 * (SHAPE + SAMPLES + TEXTURE));
        let [(a, _), _] = sides(&cache, 1.0, [0.5, 0.25]);
        assert_eq!((sides(&cache, 1.0, [0.5, 0.25])[0].0, held(&cache)), (a, [2, 2, 2]));
        sides(&cache, 1.0, [0.5, 0.125]);
        assert_eq!(held(&cache), [3, 3, 1]);
        // Room for one photograph without its texture.
        let small = PhotographCache::new(SHAPE + SAMPLES + 1);
        for _ in 0..2 {
            let [(front, _), (back, _)] = sides(&small, 1.0, [0.5, 0.25]);
            assert!(front != back);
            assert_eq!(held(&small), [1, 1, 0]);
        }
        for limit in [0, SHAPE - 1] {
            let none = PhotographCache::new(limit);
            sides(&none, 1.0, [0.5, 0.25]);
            assert_eq!(held(&none), [0, 0, 0]);
        }
    }

    #[test]
    fn a_cached_scene_has_the_same_facts() {
        let cache = PhotographCache::new(10_000);
        for _ in 0..2 {
            let cached = load_with(&line(1.5), &files([0.5, 0.25]), &cache).unwrap();
            let plain = load(&line(1.5), &files([0.5, 0.25])).unwrap();
            assert_eq!((cached.facts, cached.inputs), (plain.facts, plain.inputs));
        }
    }
}
