//! Loads scenes of local files, for callers that load many scenes of the same photographs.

use super::DecodedSide;
use super::cache::{PhotographCache, PhotographDigests};
use super::load::{
    DecodedScene, LoadError, LoadedScene, SceneDigests, assemble_loaded, decode_with, read_files,
};
use glasshouse_line::{Photograph, Roots, SceneLine, Side};
use serde::Serialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::UNIX_EPOCH;

/// A loader that reads a file again only if the file changed, or if its picture left the cache of decoded pictures.
///
/// A file has changed if its size or its time of modification has. Scenes have the bits of [`super::load()`].
pub struct SceneLoader {
    cache: PhotographCache,
    /// Digests of the files that were read, by path, size and time of modification.
    digests: Mutex<HashMap<Mark, blake3::Hash>>,
}

/// Digest of a file's path, size and time of modification, or of a sketch and its colour image.
type Mark = [u8; 32];

/// The files of a photograph and of its cards.
struct Marks {
    color: Mark,
    depth: Mark,
    mask: Option<Mark>,
    cards: Vec<Mark>,
    /// Path of the colour image and of the cards' pictures, for errors.
    path: PathBuf,
    card_paths: Vec<PathBuf>,
}

impl SceneLoader {
    /// Makes a loader whose decoded pictures take at most `limit_bytes`.
    pub fn new(limit_bytes: usize) -> Self {
        Self { cache: PhotographCache::new(limit_bytes), digests: Mutex::default() }
    }

    /// Loads a scene. Relative paths start from `base`.
    pub fn load(
        &self,
        line: &SceneLine,
        roots: &Roots,
        base: &Path,
    ) -> Result<LoadedScene, LoadError> {
        let marks = [&line.front, &line.back].map(|side| Marks::of(side, roots, base));
        let [Some(front), Some(back)] = marks else {
            return self.read(line, roots, base, None);
        };
        let marks = [front, back];
        if line.glass.smudges.as_ref().and_then(|smudges| smudges.map.as_ref()).is_some() {
            return self.read(line, roots, base, None);
        }
        match self.cached(line, &marks) {
            Some(decoded) => assemble_loaded(line, decoded?),
            None => self.read(line, roots, base, Some(&marks)),
        }
    }

    /// Reads all files of the scene, and remembers their digests.
    fn read(
        &self,
        line: &SceneLine,
        roots: &Roots,
        base: &Path,
        marks: Option<&[Marks; 2]>,
    ) -> Result<LoadedScene, LoadError> {
        let files = read_files(line, roots, base)?;
        let digests = SceneDigests::of(&files);
        let loaded = assemble_loaded(line, decode_with(line, &files, &digests, &self.cache)?)?;
        let mut known = self.known();
        for (marks, digests) in marks.into_iter().flatten().zip(&digests.sides) {
            let [color, depth, mask] = digests.of_photograph();
            known.extend(color.map(|digest| (marks.color, digest)));
            known.extend(depth.map(|digest| (marks.depth, digest)));
            known.extend(marks.mask.zip(mask));
            known.extend(marks.cards.iter().copied().zip(digests.cards.iter().copied()));
        }
        Ok(loaded)
    }

    /// Returns the decoded scene if the cache has all of its pictures.
    fn cached(
        &self,
        line: &SceneLine,
        marks: &[Marks; 2],
    ) -> Option<Result<DecodedScene, LoadError>> {
        let [of_front, of_back] = marks;
        let front = self.cached_digests(of_front)?;
        let back = self.cached_digests(of_back)?;
        let front_side = self.cached_side(&line.front.seen_by(&line.camera), of_front, &front)?;
        let back_side = self.cached_side(&line.back.seen_by(&line.camera), of_back, &back)?;
        let inputs = SceneDigests::of_photographs([front, back]).inputs();
        let scene = |front, back| DecodedScene { front, back, smudges: None, inputs };
        Some(front_side.and_then(|front| Ok(scene(front, back_side?))))
    }

    fn cached_digests(&self, marks: &Marks) -> Option<(PhotographDigests, Vec<blake3::Hash>)> {
        let known = self.known();
        let digest = |mark: &Mark| known.get(mark).copied();
        let mask = match &marks.mask {
            Some(mask) => Some(digest(mask)?),
            None => None,
        };
        let cards = marks.cards.iter().map(digest).collect::<Option<_>>()?;
        Some(([Some(digest(&marks.color)?), Some(digest(&marks.depth)?), mask], cards))
    }

    fn cached_side(
        &self,
        side: &Side,
        marks: &Marks,
        (digests, of_cards): &(PhotographDigests, Vec<blake3::Hash>),
    ) -> Option<Result<DecodedSide, LoadError>> {
        let Side::Photograph(line) = side else {
            return None;
        };
        let sheet = self.cache.cached(line, &marks.path, *digests)?;
        let mut cards = Vec::with_capacity(of_cards.len());
        for ((card, path), digest) in line.cards.iter().zip(&marks.card_paths).zip(of_cards) {
            cards.push(self.cache.cached_card(card, path, *digest)?);
        }
        let cards = cards.into_iter().collect::<Result<_, _>>();
        Some(
            sheet
                .and_then(|sheet| Ok(DecodedSide { surface: sheet.into(), cards: cards? }))
                .map_err(LoadError::from),
        )
    }

    fn known(&self) -> MutexGuard<'_, HashMap<Mark, blake3::Hash>> {
        self.digests.lock().expect("no holder of this lock panics")
    }
}

impl Marks {
    /// Returns the marks of a photograph's files; `None` for other sides, and if a file cannot be found.
    fn of(side: &Side, roots: &Roots, base: &Path) -> Option<Self> {
        let Side::Photograph(photograph) = side else {
            return None;
        };
        let file = |text: &str| {
            let path = roots.resolve(base, text).ok()?;
            let found = path.metadata().ok()?;
            let modified = found.modified().ok()?.duration_since(UNIX_EPOCH).unwrap_or_default();
            let name = path.as_os_str().as_encoded_bytes();
            Some((mark(&(name, found.len(), modified.as_nanos())), path))
        };
        let (color, path) = file(&photograph.color)?;
        let depth = match &photograph.sketch {
            Some(sketch) => sketch_mark(photograph, sketch, &color),
            None => file(&photograph.depth)?.0,
        };
        let mask = match photograph.mask.as_deref() {
            Some(mask) => Some(file(mask)?.0),
            None => None,
        };
        let cards = photograph.cards.iter().map(|card| file(&card.color));
        let (cards, card_paths) = cards.collect::<Option<Vec<_>>>()?.into_iter().unzip();
        Some(Self { color, depth, mask, cards, path, card_paths })
    }
}

/// Returns the mark of a sketched depth image, which the sketch, the camera and the size of the colour image determine.
fn sketch_mark(photograph: &Photograph, sketch: &impl Serialize, color: &Mark) -> Mark {
    mark(&(sketch, photograph.orientation, &photograph.intrinsics, color))
}

fn mark(content: &impl Serialize) -> Mark {
    let json = serde_json::to_vec(content).expect("numbers and scene lines can be written as JSON");
    *blake3::hash(&json).as_bytes()
}

#[cfg(test)]
mod tests {
    use super::super::load::load;
    use super::*;
    use glasshouse_line::parse_scene;
    use std::fs::{File, remove_file};
    use std::time::Duration;

    fn pfm(kind: &str, value: f32, count: usize) -> Vec<u8> {
        let header = format!("{kind}\n2 2\n-1.0\n").into_bytes();
        [header, value.to_le_bytes().repeat(count)].concat()
    }

    /// Writes a file, with a time of modification of so many seconds.
    fn write(path: &Path, bytes: &[u8], second: u64) {
        crate::atomic_file::write(path, bytes).unwrap();
        let time = UNIX_EPOCH + Duration::from_secs(second);
        File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
    }

    fn line(front: &str, exposure: f64) -> SceneLine {
        let side = |depth: &str| {
            format!(
                r#"{{"color":"ROOT:color.pfm",{depth},"transfer":"linear","intrinsics":{{"fx":2,"fy":2,"cx":1,"cy":1}},
                "cards":[{{"color":"card.pfm","distance_m":1,"center_m":[0,0],"width_m":0.1,"transfer":"linear"}}]}}"#
            )
        };
        let (front, back) = (side(front), side(r#""depth":"depth.pfm","mask":"mask.npy""#));
        let line = format!(
            r#"{{"schema":"glasshouse.scene/1","id":"s","seed":1,"film":{{"width":8,"height":6,"spp":16}},
            "camera":{{"focal_length_mm":55,"aperture_radius_m":0.01,"focus":{{"distance_m":2}},"exposure":{exposure}}},
            "glass":{{"distance_m":0.3,"thickness_m":0.01,"ior":1.5}},"front":{front},"back":{back}}}"#
        );
        parse_scene(&line).unwrap()
    }

    #[test]
    fn scenes_are_those_of_their_files_until_these_change() {
        let folder = tempfile::tempdir().unwrap();
        let base = folder.path();
        let color = base.join("color.pfm");
        let mut roots = Roots::default();
        roots.insert("ROOT", base.to_owned()).unwrap();
        write(&color, &pfm("PF", 0.5, 12), 1);
        write(&base.join("depth.pfm"), &pfm("Pf", 2.0, 4), 1);
        write(&base.join("card.pfm"), &pfm("PF", 0.25, 12), 1);
        let mask =
            crate::formats::encode_npy(&[2, 2], &[1.0; 4], glasshouse_line::ExrPrecision::Float);
        write(&base.join("mask.npy"), &mask, 1);
        let loader = SceneLoader::new(1_000_000);
        let sketch = r#""sketch":{"plane_m":3}"#;
        let load_both = |front: &str, exposure: f64| {
            let line = line(front, exposure);
            let warm = loader.load(&line, &roots, base).unwrap();
            let cold = load(&line, &read_files(&line, &roots, base).unwrap()).unwrap();
            assert_eq!((&warm.facts, &warm.inputs), (&cold.facts, &cold.inputs));
            warm.facts.max_radiance.front
        };
        let depth = r#""depth":"depth.pfm""#;
        for front in [depth, sketch] {
            assert_eq!([1.0, 1.0, 4.0].map(|exposure| load_both(front, exposure)), [0.5, 0.5, 2.0]);
        }
        assert_eq!(loader.known().len(), 5);
        // The file has other bytes, but the same size and time: it is not read.
        write(&color, &pfm("PF", 0.75, 12), 1);
        let warm = loader.load(&line(depth, 8.0), &roots, base).unwrap();
        assert_eq!(warm.facts.max_radiance.front, 4.0);
        write(&color, &pfm("PF", 0.75, 12), 2);
        assert_eq!([depth, sketch].map(|front| load_both(front, 8.0)), [6.0, 6.0]);
        remove_file(&color).unwrap();
        let gone = loader.load(&line(depth, 8.0), &roots, base);
        assert!(matches!(gone, Err(LoadError::Read { path, .. }) if path == color));
    }
}
