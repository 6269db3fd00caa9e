//! Finds photographs with several names: links, and files of equal bytes.
//!
//! A photograph counts once in its source, and is in one split even if several sources have it. Only files of equal sizes are
//! read, and most of them only at their ends.

use super::diode::SourceImage;
use glasshouse_line::is_url;
use rayon::iter::{IntoParallelIterator, IntoParallelRefIterator, ParallelIterator};
use render::file_tree::FileId;
use render::input_file::InputFile;
use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};

/// Bytes at the start and at the end of a file that are compared before the whole file is.
const END_BYTES: u64 = 1 << 14;
/// Bytes of a file that are digested at once.
const PART_BYTES: usize = 1 << 20;

/// Names that are left out, because they are further names of photographs: each with the name that stays.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Copies {
    /// Names of one file.
    of_files: Vec<(String, String)>,
    /// Files of equal bytes.
    of_bytes: Vec<(String, String)>,
}

impl Copies {
    /// Returns remarks with both names of the first photographs.
    pub(super) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some((name, other)) = self.of_files.first() {
            let count = self.of_files.len();
            notes.push(format!(
                "each file counts once, and {count} further names of files are left out (first: {name} is {other})"
            ));
        }
        if let Some((name, other)) = self.of_bytes.first() {
            let count = self.of_bytes.len();
            notes.push(format!(
                "each photograph counts once, and {count} files with the bytes of another one are left out (first: {name} has \
                 those of {other})"
            ));
        }
        notes
    }
}

/// Leaves one item of each photograph below `folder`. An item that has the name of another one stays, because a list with it is
/// wrong.
pub(super) fn copies<T>(folder: &Path, items: &mut Vec<T>, name: impl Fn(&T) -> &String) -> Copies {
    let (mut copies, root) = (Copies::default(), real(folder));
    let paths: Vec<PathBuf> = items.iter().map(|item| root.join(name(item))).collect();
    let names: Vec<String> = items.iter().map(|item| name(item).clone()).collect();
    let Photographs { of, has_equal_bytes } = Photographs::of(&paths);
    let mut numbers = 0..;
    items.retain(|_| {
        let k: usize = numbers.next().unwrap_or_default();
        if names[of[k]] == names[k] {
            return true;
        }
        let pair = (names[k].clone(), names[of[k]].clone());
        if has_equal_bytes[k] {
            copies.of_bytes.push(pair);
        } else {
            copies.of_files.push(pair);
        }
        false
    });
    copies
}

/// Numbers the photographs that several sources have. `folder_of` returns the folder of a source, if it has one.
pub(super) fn number_shared<'f>(
    sources: &mut BTreeMap<String, Vec<SourceImage>>,
    folder_of: impl Fn(&str) -> Option<&'f Path>,
) {
    let mut images: Vec<(usize, PathBuf, &mut SourceImage)> = Vec::new();
    for (source, (name, of_source)) in sources.iter_mut().enumerate() {
        let Some(root) = folder_of(name).map(real) else { continue };
        images.extend(of_source.iter_mut().map(|image| (source, root.join(&image.color), image)));
    }
    if images.iter().all(|(source, ..)| *source == images[0].0) {
        return;
    }
    let paths: Vec<PathBuf> = images.iter().map(|(_, path, _)| path.clone()).collect();
    let Photographs { of, .. } = Photographs::of(&paths);
    let mut count = vec![0; images.len()];
    for &k in &of {
        count[k] += 1;
    }
    for ((.., image), first) in images.into_iter().zip(of) {
        image.shared = (count[first] > 1).then_some(first);
    }
}

/// Returns the real path of a folder, or the folder if it does not exist or is a URL.
fn real(folder: &Path) -> PathBuf {
    if is_url(folder) {
        return folder.to_owned();
    }
    folder.canonicalize().unwrap_or_else(|_| folder.to_owned())
}

/// The photograph of each file of a list.
struct Photographs {
    /// Position in the list of the file that stands for the photograph.
    of: Vec<usize>,
    /// True for a file that does not stand for its photograph, and only has the bytes of the file that does.
    has_equal_bytes: Vec<bool>,
}

impl Photographs {
    /// Groups files by identity and bytes. Of the names of a file that no link is part of (or else of all), the first of those with
    /// the fewest folders stands for it.
    /// Objects in a store have one name each, and a file that cannot be read is a photograph of its own.
    fn of(paths: &[PathBuf]) -> Self {
        let mut of: Vec<usize> = (0..paths.len()).collect();
        let mut files = Vec::new();
        let depth = |k: usize| paths[k].components().count();
        // Each file is a wait on a network disk.
        let known: Vec<Option<(FileId, u64)>> =
            paths.par_iter().map(|path| identity(path)).collect();
        let id = |&k: &usize| known[k].as_ref().map(|(id, _)| id);
        let bytes = |&k: &usize| known[k].as_ref().map(|(_, bytes)| *bytes).filter(|n| *n > 0);
        for group in grouped(0..paths.len(), id) {
            let is_own = |k: usize| paths[k].canonicalize().is_ok_and(|real| real == paths[k]);
            let rank = |k: &&usize| (group.len() > 1 && !is_own(**k), depth(**k), **k);
            let chosen = *group.iter().min_by_key(rank).unwrap_or(&group[0]);
            for &k in &group {
                of[k] = chosen;
            }
            files.push(chosen);
        }
        files.sort_by_key(|&k| (depth(k), k));
        let mut first_of: BTreeMap<usize, usize> = BTreeMap::new();
        for group in of_equal_bytes(paths, grouped(files, bytes)) {
            first_of.extend(group[1..].iter().map(|&k| (k, group[0])));
        }
        let has_equal_bytes = of.iter().map(|k| first_of.contains_key(k)).collect();
        for k in &mut of {
            *k = *first_of.get(k).unwrap_or(k);
        }
        Self { of, has_equal_bytes }
    }
}

/// Groups files by their bytes, from groups of equal sizes. Leaves out files without equal ones.
fn of_equal_bytes(paths: &[PathBuf], of_equal_size: Vec<Vec<usize>>) -> Vec<Vec<usize>> {
    let several = |mut groups: Vec<Vec<usize>>| {
        groups.retain(|group| group.len() > 1);
        groups
    };
    let mut groups = several(of_equal_size);
    for digest in [digest_of_ends, digest] {
        let members = groups.into_iter().enumerate();
        let members = members.flat_map(|(g, group)| group.into_iter().map(move |k| (g, k)));
        let members: Vec<(usize, usize)> = members.collect();
        let digested: Vec<_> = members
            .into_par_iter()
            .map(|(g, k)| (k, digest(&paths[k]).ok().map(|digest| (g, digest))))
            .collect();
        let equal = grouped(digested, |(_, digest)| *digest).into_iter();
        groups = several(equal.map(|group| group.into_iter().map(|(k, _)| k).collect()).collect());
    }
    groups
}

/// Groups items by key, in the order of their first members. Items without a key are left out.
fn grouped<T, K: Ord>(
    items: impl IntoIterator<Item = T>,
    key: impl Fn(&T) -> Option<K>,
) -> Vec<Vec<T>> {
    let (mut places, mut groups) = (BTreeMap::new(), Vec::<Vec<T>>::new());
    for item in items {
        let Some(key) = key(&item) else { continue };
        let place = *places.entry(key).or_insert(groups.len());
        if place == groups.len() {
            groups.push(Vec::new());
        }
        groups[place].push(item);
    }
    groups
}

/// Returns the identity of a file or object, and the bytes of a file; `None` for a file that does not exist.
fn identity(path: &Path) -> Option<(FileId, u64)> {
    if is_url(path) {
        let parts = path.components().filter(|part| *part != Component::CurDir);
        return Some((FileId::Path(parts.collect()), 0));
    }
    FileId::with_bytes(path).ok()
}

type Digest = [u8; 32];

fn digest_of_ends(path: &Path) -> io::Result<Digest> {
    let mut file = InputFile::open(path)?;
    let (mut hasher, length) = (blake3::Hasher::new(), file.len());
    let mut bytes = Vec::new();
    Read::by_ref(&mut file).take(END_BYTES).read_to_end(&mut bytes)?;
    file.seek(SeekFrom::Start(length.saturating_sub(END_BYTES)))?;
    file.take(END_BYTES).read_to_end(&mut bytes)?;
    hasher.update(&bytes);
    Ok(*hasher.finalize().as_bytes())
}

fn digest(path: &Path) -> io::Result<Digest> {
    let mut file = InputFile::open(path)?;
    let (mut hasher, mut part) = (blake3::Hasher::new(), vec![0; PART_BYTES]);
    loop {
        match file.read(&mut part)? {
            0 => return Ok(*hasher.finalize().as_bytes()),
            count => hasher.update(&part[..count]),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use render::atomic_file::{create_dir, write_relaxed};
    use std::fs;
    use std::os::unix::fs::symlink;

    fn names(folder: &Path, items: &[&str]) -> (Vec<String>, Copies) {
        let mut items: Vec<String> = items.iter().map(|&item| item.to_owned()).collect();
        let copies = copies(folder, &mut items, |item| item);
        (items, copies)
    }

    fn pair(name: &str, other: &str) -> (String, String) {
        (name.to_owned(), other.to_owned())
    }

    #[test]
    fn a_photograph_has_one_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        create_dir(&path("2024")).unwrap();
        create_dir(&path("album")).unwrap();
        for (name, bytes) in
            [("2024/a", "one"), ("b", "two"), ("copy", "one"), ("d", ""), ("e", "")]
        {
            write_relaxed(&path(name), bytes.as_bytes()).unwrap();
        }
        symlink("../2024/a", path("album/a")).unwrap();
        symlink("2024", path("0")).unwrap();
        fs::hard_link(path("b"), path("b2")).unwrap();
        write_relaxed(&path("z"), b"three").unwrap();
        fs::hard_link(path("z"), path("2024/z")).unwrap();
        let given = "2024/z z 0/a 2024/a ./2024/a album/a b b2 copy d e missing missing";
        let (kept, copies) = names(dir.path(), &given.split(' ').collect::<Vec<_>>());
        // The name with the fewest folders stays, and so do files that cannot be photographs, and a name that is there twice.
        assert_eq!(kept, ["z", "b", "copy", "d", "e", "missing", "missing"]);
        assert_eq!(copies.of_files, [pair("2024/z", "z"), pair("b2", "b")]);
        let of_bytes = ["0/a", "2024/a", "./2024/a", "album/a"].map(|name| pair(name, "copy"));
        assert_eq!(copies.of_bytes, of_bytes);
        let notes = copies.notes();
        assert!(
            notes[0].contains("2 further names of files are left out (first: 2024/z is z)"),
            "{notes:?}"
        );
        assert!(
            notes[1].contains("4 files") && notes[1].ends_with("(first: 0/a has those of copy)"),
            "{notes:?}"
        );
    }

    #[test]
    fn a_name_without_links_stands_for_a_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        create_dir(&path("2024/may")).unwrap();
        write_relaxed(&path("2024/may/a"), b"one").unwrap();
        symlink("2024/may/a", path("a")).unwrap();
        symlink("2024/may", path("0")).unwrap();
        let (kept, copies) = names(dir.path(), &["0/a", "2024/may/a", "a"]);
        assert_eq!(kept, ["2024/may/a"]);
        assert_eq!(copies.of_files, [pair("0/a", "2024/may/a"), pair("a", "2024/may/a")]);
    }

    #[test]
    fn files_that_differ_only_in_the_middle_are_different() {
        let dir = tempfile::tempdir().unwrap();
        for (name, middle) in [("a", 1), ("b", 2), ("c", 1)] {
            let mut bytes = vec![0; 3 * END_BYTES as usize];
            bytes[END_BYTES as usize + 9] = middle;
            write_relaxed(&dir.path().join(name), &bytes).unwrap();
        }
        let (kept, copies) = names(dir.path(), &["a", "b", "c"]);
        assert_eq!(kept, ["a", "b"]);
        assert_eq!(copies.of_bytes, [pair("c", "a")]);
    }

    #[test]
    fn an_object_has_one_key() {
        let (kept, copies) = names(Path::new("s3://b/x"), &["a", "./a", "y/a"]);
        assert_eq!(kept, ["a", "y/a"]);
        assert_eq!(copies.of_files, [pair("./a", "a")]);
    }

    #[test]
    fn photographs_of_several_sources_are_numbered() {
        let dir = tempfile::tempdir().unwrap();
        let mut sources = BTreeMap::new();
        for (source, files) in [("aa", ["x", "y"]), ("bb", ["y", "z"])] {
            create_dir(&dir.path().join(source)).unwrap();
            let mut images = super::super::split::tests::set(2, 0);
            for (image, name) in images.iter_mut().zip(files) {
                name.clone_into(&mut image.color);
                write_relaxed(&dir.path().join(source).join(name), name.as_bytes()).unwrap();
            }
            sources.insert(source.to_owned(), images);
        }
        let folders = ["aa", "bb"].map(|name| dir.path().join(name));
        number_shared(&mut sources, |name| Some(&folders[usize::from(name == "bb")]));
        let shared = |source: &str| [0, 1].map(|k: usize| sources[source][k].shared);
        let [[x, y], [y2, z]] = [shared("aa"), shared("bb")];
        assert!(x.is_none() && z.is_none() && y.is_some() && y == y2, "{x:?} {y:?} {y2:?} {z:?}");
    }
}
