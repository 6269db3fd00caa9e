//! Checks all input files of a plan before any scene is traced.
//!
//! Usually reads only the beginning and the end of a file, and only the beginning of an object in a store. A worker
//! finds errors in the pixels when it loads the scene, and then quarantines the scene.

use super::inputs::{InputFiles, StoreUnavailable};
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Photograph, Roots, SceneLine, Side, is_url};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use render::formats::{NamedBytes, PictureSize};
use render::input_file::{InputFile, MAX_FILE_BYTES};
use render::scene::{
    AssembleError, END_BYTES, FileEnds, FileRole, Look, OddView, OtherAspect, PhotographSizes,
    START_BYTES, check_turned, depth_remarks, look, look_at_whole,
};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Least number of threads if files are in a store, because these threads mostly wait for responses.
const STORE_THREADS: usize = 32;
/// Largest number of rows in the table.
const SHOWN: usize = 20;
/// Largest width of the table's column of paths; longer paths are followed by their problem without padding.
const WIDEST: usize = 100;

/// An input file that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct InvalidInput {
    /// Path as in the scene lines.
    pub path: String,
    /// Description of the problem, in some cases with a remedy.
    pub problem: String,
    /// Scenes that need the file.
    pub scenes: Vec<SceneId>,
}

/// Formats a line with the counts, and a table of at most twenty files with their problems.
pub fn invalid_text(invalid: &[InvalidInput], files: usize) -> String {
    let scenes: BTreeSet<&SceneId> = invalid.iter().flat_map(|input| &input.scenes).collect();
    let mut text = format!(
        "{} of {files} input files cannot be used, in {} {}:\n",
        invalid.len(),
        scenes.len(),
        if scenes.len() == 1 { "scene" } else { "scenes" },
    );
    let shown = &invalid[..invalid.len().min(SHOWN)];
    // Longer widths than 65,535 panic in `format!`.
    let width = shown.iter().map(|input| input.path.chars().count().min(WIDEST)).max();
    for InvalidInput { path, problem, .. } in shown {
        let _ = writeln!(text, "  {path:width$}  {problem}", width = width.unwrap_or(0));
    }
    if invalid.len() > SHOWN {
        let _ =
            writeln!(text, "  ... and {} more (all of them with --json)", invalid.len() - SHOWN);
    }
    text
}

/// The result of checking a file.
#[derive(Clone, Debug)]
enum Checked {
    Sound {
        bytes: u64,
        /// Size of an image; `None` for a mesh.
        size: Option<PictureSize>,
    },
    Wrong(String),
    /// A pipe, a device, or a file that is too large: probably a wrong path, not a damaged photograph.
    Refused(String),
}

/// A checker of input files. It keeps the results, so that each file is read only once per role.
pub(super) struct Checker<'a> {
    roots: Roots,
    own: BTreeSet<&'a str>,
    inputs: &'a dyn InputFiles,
    threads: usize,
    on_file: &'a (dyn Fn(usize, usize) + Sync),
    seen: BTreeMap<(String, FileRole), Checked>,
}

impl<'a> Checker<'a> {
    /// Makes a checker that skips the roots `own`, because planning writes their files. `on_file` receives (done, all).
    pub(super) fn new(
        roots: Roots,
        own: BTreeSet<&'a str>,
        inputs: &'a dyn InputFiles,
        threads: usize,
        on_file: &'a (dyn Fn(usize, usize) + Sync),
    ) -> Self {
        Self { roots, own, inputs, threads, on_file, seen: BTreeMap::new() }
    }

    /// Returns the number of checked files.
    pub(super) fn files(&self) -> usize {
        let paths: BTreeSet<&str> = self.seen.keys().map(|(path, _)| path.as_str()).collect();
        paths.len()
    }

    /// True if a checked file is a pipe, a device, or too large.
    pub(super) fn has_refused(&self) -> bool {
        self.seen.values().any(|seen| matches!(seen, Checked::Refused(_)))
    }

    /// Returns the total size of the checked and usable files of the scenes, bytes.
    pub(super) fn bytes(&self, lines: &[SceneLine]) -> u64 {
        let mut sizes = BTreeMap::new();
        for (path, role) in lines.iter().flat_map(files_of) {
            let key = (path.to_owned(), role);
            if let Some(Checked::Sound { bytes, .. }) = self.seen.get(&key) {
                sizes.insert(path, *bytes);
            }
        }
        sizes.values().sum()
    }

    /// Checks the scenes' files that are not checked yet. Returns all unusable files of these scenes, sorted by path.
    /// An error means that a store does not respond.
    pub(super) fn check(
        &mut self,
        lines: &[SceneLine],
    ) -> Result<Vec<InvalidInput>, StoreUnavailable> {
        let wanted: BTreeSet<(&str, FileRole)> = lines.iter().flat_map(files_of).collect();
        let is_new = |(path, role): &(&str, FileRole)| {
            let root = path.split_once(':').map(|(root, _)| root);
            !root.is_some_and(|root| self.own.contains(root))
                && !self.seen.contains_key(&((*path).to_owned(), *role))
        };
        let new: Vec<(&str, FileRole)> = wanted.into_iter().filter(is_new).collect();
        let found = self.check_files(&new)?;
        for ((path, role), seen) in new.into_iter().zip(found) {
            self.seen.insert((path.to_owned(), role), seen);
        }
        let mut invalid: BTreeMap<&str, InvalidInput> = BTreeMap::new();
        for line in lines {
            for (path, problem) in self.problems(line) {
                let input = invalid.entry(path).or_insert_with(|| InvalidInput {
                    path: path.to_owned(),
                    problem,
                    scenes: Vec::new(),
                });
                if input.scenes.last() != Some(&line.id) {
                    input.scenes.push(line.id.clone());
                }
            }
        }
        Ok(invalid.into_values().collect())
    }

    /// Reads one usable depth file of each folder or root and unit, because a wrong unit is that of a whole data set.
    /// Returns remarks on those that are probably too far, or have codes that mean "no depth".
    pub(super) fn depth_remarks(&self, lines: &[SceneLine]) -> Vec<String> {
        let mut first: BTreeMap<(&str, u64), &Photograph> = BTreeMap::new();
        for photograph in photographs(lines).filter(|photograph| photograph.sketch.is_none()) {
            let place = place_of(&photograph.depth);
            let key = (photograph.depth.clone(), FileRole::Depth);
            if matches!(self.seen.get(&key), Some(Checked::Sound { .. })) {
                first.entry((place, photograph.depth_unit_m.to_bits())).or_insert(photograph);
            }
        }
        let notes = |photograph: &&Photograph| {
            let path = self.roots.resolve(Path::new(""), &photograph.depth).ok()?;
            // A worker names a file that cannot be decoded.
            let bytes = self.inputs.read(&path).ok()?;
            depth_remarks(photograph, &named(bytes), &photograph.depth).ok()
        };
        first.values().filter_map(notes).flatten().collect()
    }

    /// Returns a remark on the first photograph of each folder or root whose depth image has another aspect ratio than its
    /// colour image.
    pub(super) fn other_aspects(&self, lines: &[SceneLine]) -> Vec<String> {
        let mut first: BTreeMap<&str, String> = BTreeMap::new();
        for photograph in photographs(lines).filter(|photograph| photograph.sketch.is_none()) {
            let Photograph { color, depth, orientation, .. } = photograph;
            let px = |path, role| Some(self.size(path, role)?.used_px(*orientation));
            let px = px(color, FileRole::Color).zip(px(depth, FileRole::Depth));
            if let Some(other) = px.and_then(|(color, depth)| OtherAspect::find(color, depth)) {
                first.entry(place_of(depth)).or_insert_with(|| other.text(color));
            }
        }
        first.into_values().collect()
    }

    /// Returns a remark on the first photograph of each folder or root with intrinsics that are probably wrong.
    pub(super) fn odd_views(&self, lines: &[SceneLine]) -> Vec<String> {
        let mut first: BTreeMap<&str, String> = BTreeMap::new();
        for (line, side, photograph) in lines.iter().flat_map(photographs_of) {
            let place = place_of(&photograph.color);
            if first.contains_key(place) {
                continue;
            }
            if let Ok(Some(view)) = self.view(line, side, photograph) {
                first.insert(place, view.text(&photograph.color));
            }
        }
        first.into_values().collect()
    }

    /// Checks the intrinsics of a photograph with usable files.
    fn view(
        &self,
        line: &SceneLine,
        side: &'static str,
        photograph: &Photograph,
    ) -> Result<Option<OddView>, AssembleError> {
        let px = |path, role| Some(self.size(path, role)?.used_px(photograph.orientation));
        let depth_px = || match &photograph.sketch {
            None => px(&photograph.depth, FileRole::Depth),
            Some(_) => photograph.intrinsics.size.map(|size| size.map(|side| side as usize)),
        };
        match px(&photograph.color, FileRole::Color).zip(depth_px()) {
            Some((color_px, depth_px)) => OddView::find(line, side, color_px, depth_px),
            None => Ok(None),
        }
    }

    /// Returns the size of a usable picture.
    fn size(&self, path: &str, role: FileRole) -> Option<PictureSize> {
        match self.seen.get(&(path.to_owned(), role)) {
            Some(Checked::Sound { size, .. }) => *size,
            _ => None,
        }
    }

    fn check_files(&self, files: &[(&str, FileRole)]) -> Result<Vec<Checked>, StoreUnavailable> {
        let paths: Vec<_> = files
            .iter()
            .map(|(path, role)| (self.roots.resolve(Path::new(""), path), *role))
            .collect();
        let is_remote = paths.iter().any(|(path, _)| path.as_ref().is_ok_and(is_url));
        let threads = if is_remote { self.threads.max(STORE_THREADS) } else { self.threads };
        let (done, all) = (AtomicUsize::new(0), files.len());
        (self.on_file)(0, all);
        let look = || {
            paths
                .into_par_iter()
                .map(|(path, role)| {
                    let seen = match path {
                        Ok(path) => check_file(&path, role, self.inputs)?,
                        Err(error) => Checked::Wrong(error.to_string()),
                    };
                    (self.on_file)(done.fetch_add(1, Ordering::Relaxed) + 1, all);
                    Ok(seen)
                })
                .collect()
        };
        match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => pool.install(look),
            // If the system cannot start threads, the caller's pool does the work.
            Err(_) => look(),
        }
    }

    /// Returns the unusable files of a scene with their problems.
    fn problems<'l>(&self, line: &'l SceneLine) -> Vec<(&'l str, String)> {
        let seen = |path: &str, role| self.seen.get(&(path.to_owned(), role));
        let mut problems = Vec::new();
        for (line, side, photograph) in photographs_of(line) {
            if let Err(error) = self.view(line, side, photograph) {
                problems.push((photograph.color.as_str(), error.to_string()));
            }
        }
        for side in [&line.front, &line.back] {
            for (path, role) in roles(side) {
                if let Some(Checked::Wrong(problem) | Checked::Refused(problem)) = seen(path, role)
                {
                    problems.push((path, problem.clone()));
                }
            }
            if let Side::Photograph(photograph) = side {
                problems.extend(self.problem_of_sizes(photograph));
            }
        }
        problems
    }

    /// Returns a problem of the sizes of a photograph's usable files, with the file to blame.
    fn problem_of_sizes<'l>(&self, photograph: &'l Photograph) -> Option<(&'l str, String)> {
        let Photograph { color, depth, mask, orientation, .. } = photograph;
        let of_depth = self.size(depth, FileRole::Depth)?;
        let of_mask =
            mask.as_deref().and_then(|mask| Some((mask, self.size(mask, FileRole::Mask)?)));
        if let Some(of_color) = self.size(color, FileRole::Color) {
            let sizes = PhotographSizes {
                color: (Path::new("it"), of_color),
                depth: (Path::new(depth), of_depth),
                mask: of_mask.map(|(mask, size)| (Path::new(mask), size)),
            };
            if let Err(error) = check_turned(photograph, &sizes) {
                return Some((color, error.to_string()));
            }
        }
        let (mask, of_mask) = of_mask?;
        let [[w, h], [width, height]] = [of_mask, of_depth].map(|size| size.used_px(*orientation));
        ([w, h] != [width, height]).then(|| {
            let problem = format!(
                "it has {w}x{h} pixels, but the depth image has {width}x{height}; give a mask of the depth's size, or none"
            );
            (mask, problem)
        })
    }
}

/// Returns the photographs of a line, each with the line and the name of its side.
fn photographs_of(
    line: &SceneLine,
) -> impl Iterator<Item = (&SceneLine, &'static str, &Photograph)> {
    let sides = [("front", &line.front), ("back", &line.back)].into_iter();
    sides.filter_map(move |(name, side)| Some((line, name, side.photograph()?)))
}

fn photographs(lines: &[SceneLine]) -> impl Iterator<Item = &Photograph> {
    lines.iter().flat_map(photographs_of).map(|(.., photograph)| photograph)
}

/// Returns the root or the folder of a path in a scene line.
fn place_of(path: &str) -> &str {
    match path.split_once(':') {
        Some((root, _)) => root,
        None => path.rsplit_once('/').map_or("", |(folder, _)| folder),
    }
}

fn files_of(line: &SceneLine) -> impl Iterator<Item = (&str, FileRole)> {
    let map = line.glass.smudges.as_ref().and_then(|smudges| smudges.map.as_ref());
    let map = map.map(|map| (map.as_str(), FileRole::Smudges));
    [&line.front, &line.back].into_iter().flat_map(roles).chain(map)
}

/// Returns the files of a side with their roles.
fn roles(side: &Side) -> Vec<(&str, FileRole)> {
    let paths = side.paths().into_iter();
    let role = |key: &str| match (side, key) {
        (_, key) if key.starts_with("cards") => FileRole::Card,
        (Side::Photograph(_), "depth") => FileRole::Depth,
        (Side::Photograph(_), "mask") => FileRole::Mask,
        (Side::Photograph(_), _) => FileRole::Color,
        (Side::Panorama(_), "depth") => FileRole::PanoramaDepth,
        (Side::Panorama(_), _) => FileRole::Panorama,
        (Side::Mesh(_), _) => FileRole::Mesh,
    };
    paths.map(|(key, path)| (path, role(&key))).collect()
}

/// Checks one file or object.
fn check_file(
    path: &Path,
    role: FileRole,
    inputs: &dyn InputFiles,
) -> Result<Checked, StoreUnavailable> {
    let ends = match ends(path, inputs) {
        Ok(ends) => ends,
        Err(error) => return unreadable(path, error, inputs),
    };
    let bytes = ends.length;
    if bytes > MAX_FILE_BYTES {
        let problem = format!("it has {bytes} bytes, and at most {MAX_FILE_BYTES} are read");
        return Ok(Checked::Refused(problem));
    }
    let seen = match look(role, &ends) {
        Ok(Look::Sound(size)) => Ok(size),
        Ok(Look::Unsure) => match inputs.read(path) {
            Ok(bytes) => look_at_whole(role, &named(bytes)),
            Err(error) => return unreadable(path, error, inputs),
        },
        Err(error) => Err(error),
    };
    Ok(match seen {
        Ok(size) => Checked::Sound { bytes, size },
        Err(error) => Checked::Wrong(error.to_string()),
    })
}

/// Distinguishes a store that does not respond (an error) from a file that cannot be read (a problem).
fn unreadable(
    path: &Path,
    error: io::Error,
    inputs: &dyn InputFiles,
) -> Result<Checked, StoreUnavailable> {
    match inputs.store_failure(error) {
        Ok(error) => Err(error),
        Err(error) => {
            // The table has the path of the scene line, whose root the user may not know.
            let problem = format!("it cannot be read: {error} ({})", path.display());
            let is_refused = error.kind() == io::ErrorKind::InvalidInput;
            Ok(if is_refused { Checked::Refused(problem) } else { Checked::Wrong(problem) })
        }
    }
}

/// Names a file "it" in error messages, because the table shows the path beside them.
fn named(bytes: Vec<u8>) -> NamedBytes {
    NamedBytes { path: PathBuf::from("it"), bytes }
}

fn ends(path: &Path, inputs: &dyn InputFiles) -> io::Result<FileEnds> {
    if is_url(path) {
        let (start, length) = inputs.read_start(path, START_BYTES)?;
        return Ok(FileEnds { start: named(start), end: None, length });
    }
    let mut file = InputFile::open(path)?;
    let length = file.len();
    let mut start = Vec::with_capacity(START_BYTES.min(length as usize));
    Read::by_ref(&mut file).take(START_BYTES as u64).read_to_end(&mut start)?;
    let mut end = Vec::new();
    if length > (start.len() + END_BYTES) as u64 {
        file.seek(SeekFrom::End(-(END_BYTES as i64)))?;
    }
    file.take(END_BYTES as u64).read_to_end(&mut end)?;
    Ok(FileEnds { start: named(start), end: Some(end), length })
}

#[cfg(test)]
mod tests {
    use super::super::inputs::LocalFiles;
    use super::*;
    use render::atomic_file;

    fn seen(path: &Path, role: FileRole) -> Checked {
        check_file(path, role, &LocalFiles).unwrap()
    }

    #[test]
    fn files_of_any_length_are_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.npy");
        // Counts for files shorter than START_BYTES, and longer than START_BYTES + END_BYTES.
        for count in [1, 4000, 4060, 4064, 4068, 4100, 9000] {
            let text =
                format!("{{'descr': '<f4', 'fortran_order': False, 'shape': (1, {count:5}), }}");
            let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
            bytes.extend((text.len() as u16).to_le_bytes());
            bytes.extend(text.as_bytes());
            bytes.resize(bytes.len() + 4 * count, 0);
            atomic_file::write_relaxed(&path, &bytes).unwrap();
            match seen(&path, FileRole::Depth) {
                Checked::Sound { bytes: length, size } => {
                    assert_eq!(
                        (length, size),
                        (bytes.len() as u64, Some(PictureSize::plain([count, 1])))
                    );
                }
                wrong => panic!("{wrong:?}"),
            }
            bytes.pop();
            atomic_file::write_relaxed(&path, &bytes).unwrap();
            let Checked::Wrong(problem) = seen(&path, FileRole::Depth) else {
                panic!("{count}");
            };
            assert!(problem.starts_with("cannot read it as .npy: "), "{problem}");
        }
    }

    #[test]
    fn folders_and_missing_files_are_unusable() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path(), &folder.path().join("nowhere")] {
            assert!(matches!(seen(path, FileRole::Color), Checked::Wrong(_)));
        }
    }

    #[test]
    fn a_long_table_is_truncated() {
        let invalid: Vec<InvalidInput> = (0..25)
            .map(|n| InvalidInput {
                path: format!("diode:{n}.png"),
                problem: "it is empty".to_owned(),
                scenes: vec![SceneId::new(format!("s-{}", n / 2)).unwrap()],
            })
            .collect();
        let text = invalid_text(&invalid, 100);
        assert!(text.starts_with("25 of 100 input files cannot be used, in 13 scenes:\n"));
        assert_eq!(text.matches("it is empty").count(), SHOWN);
        assert!(text.ends_with("... and 5 more (all of them with --json)\n"));
    }

    #[test]
    fn a_path_may_have_any_length() {
        let path = "x".repeat(65_536);
        let scenes = vec![SceneId::new("s").unwrap()];
        let problem = "it is empty".to_owned();
        let text = invalid_text(&[InvalidInput { path: path.clone(), problem, scenes }], 1);
        assert!(text.ends_with(&format!("  {path}  it is empty\n")));
    }
}
