//! Lists the files below a folder, and tells whether two names are names of one file.
//!
//! Links are followed. A folder with several names is entered once, under a name without links if there is one, so that a
//! folder that contains itself ends. Folders of thumbnails and of other programs' resources are skipped.

use super::input_file::Call;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Folders, in lower case, in which photo programs, disks and archives keep previews, deleted files and resources.
const RESOURCE_FOLDERS: [&str; 7] =
    ["@eadir", "@__thumb", "__macosx", "@recycle", "#recycle", "#snapshot", "$recycle.bin"];

/// Identity of a file or folder, whatever its names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FileId {
    Inode {
        device: u64,
        inode: u64,
    },
    /// The real path, where the system has no numbers of files; the key of an object in a bucket.
    Path(PathBuf),
}

impl FileId {
    /// Returns the identity of an existing file or folder, to which links lead.
    pub fn of(path: &Path) -> io::Result<Self> {
        Ok(Self::with_bytes(path)?.0)
    }

    /// Returns the identity and the number of bytes of an existing file, to which links lead.
    pub fn with_bytes(path: &Path) -> io::Result<(Self, u64)> {
        let meta = fs::metadata(path)?;
        let id = match meta.ino() {
            // Some network and user-space file systems number nothing.
            0 => Self::Path(path.canonicalize()?),
            inode => Self::Inode { device: meta.dev(), inode },
        };
        Ok((id, meta.len()))
    }
}

/// How often a folder with several names is entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visits {
    /// Under one name.
    Once,
    /// Under each name: for files that are looked up by name, in folders that `enters` limits.
    EveryName,
}

/// The files below a folder. Paths are relative to the folder, with `/` as separator, and sorted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileTree {
    pub files: Vec<String>,
    /// Files and folders whose names are not UTF-8, with replacements.
    pub odd: Vec<String>,
    /// Folders that are not entered, each with the other name of the same folder, or `.` for one that contains all.
    pub other_names: Vec<(String, String)>,
    /// Files and folders of thumbnails and resources, which are skipped. Hidden folders are skipped, too, but not named.
    pub resources: Vec<String>,
}

impl FileTree {
    /// Returns remarks on folders that are not entered, with both names, and on skipped files.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some((name, other)) = self.other_names.first() {
            let same = match other.as_str() {
                "." => "leads to the listed folder, or to one around it".to_owned(),
                other => format!("is {other}"),
            };
            let count = self.other_names.len();
            notes.push(format!("folders are entered once, and {count} names of them are left out (first: {name} {same})"));
        }
        if let Some(first) = self.resources.first() {
            let count = self.resources.len();
            notes.push(format!(
                "{count} thumbnails or resources of other programs are skipped (first: {first})"
            ));
        }
        notes
    }
}

/// Error of a folder that cannot be listed.
#[derive(Debug, thiserror::Error)]
#[error("cannot list {}: {source}", path.display())]
pub struct ListError {
    pub path: PathBuf,
    pub source: io::Error,
}

/// True for the path of a file or folder that belongs to no user, below a folder or a URL: a thumbnail, a resource, or a hidden
/// folder.
pub fn is_resource(path: &str) -> bool {
    let (folders, file) = path.rsplit_once('/').unwrap_or(("", path));
    folders.split('/').any(|name| is_hidden(name) || is_resource_folder(name))
        || is_resource_file(file)
}

fn is_hidden(name: &str) -> bool {
    name.starts_with('.') && !matches!(name, "." | "..")
}

fn is_resource_folder(name: &str) -> bool {
    RESOURCE_FOLDERS.contains(&name.to_lowercase().as_str())
}

/// True for a file in which macOS keeps what the disk cannot.
fn is_resource_file(name: &str) -> bool {
    name.starts_with("._")
}

/// Lists the files below `root`, in the folders that `enters` accepts.
pub fn file_tree(
    root: &Path,
    visits: Visits,
    enters: &dyn Fn(&str) -> bool,
) -> Result<FileTree, ListError> {
    let mut walk = Walk {
        root,
        visits,
        enters,
        entered: BTreeMap::new(),
        above: above(root),
        open: vec![String::new()],
        links: BTreeSet::new(),
        tree: FileTree::default(),
    };
    // Folders before links, so that a folder keeps the name that it has itself.
    while let Some(below) = walk.open.pop().or_else(|| walk.links.pop_first()) {
        walk.list(&below)?;
    }
    let mut tree = walk.tree;
    tree.files.sort();
    tree.odd.sort();
    tree.other_names.sort();
    tree.resources.sort();
    Ok(tree)
}

/// Returns the identities of the folders that contain a folder. A link to one of them would list all of the disk.
fn above(root: &Path) -> BTreeSet<FileId> {
    let real = root.canonicalize().unwrap_or_default();
    real.ancestors().skip(1).filter_map(|path| FileId::of(path).ok()).collect()
}

/// A listing in progress.
struct Walk<'a> {
    root: &'a Path,
    visits: Visits,
    enters: &'a dyn Fn(&str) -> bool,
    /// Names of the entered folders.
    entered: BTreeMap<FileId, String>,
    above: BTreeSet<FileId>,
    /// Folders to list.
    open: Vec<String>,
    /// Links to folders to list.
    links: BTreeSet<String>,
    tree: FileTree,
}

impl Walk<'_> {
    /// Lists the files of one folder, if it is not listed yet.
    fn list(&mut self, below: &str) -> Result<(), ListError> {
        let path = if below.is_empty() { self.root.to_owned() } else { self.root.join(below) };
        // A disk that does not answer is visible to the watchdog.
        let _call = Call::begin(&path);
        let failed = |source| ListError { path: path.clone(), source };
        if self.is_known(below, FileId::of(&path).map_err(failed)?) {
            return Ok(());
        }
        for entry in fs::read_dir(&path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name();
            let relative = |name: &str| {
                if below.is_empty() { name.to_owned() } else { format!("{below}/{name}") }
            };
            let Some(name) = name.to_str() else {
                self.tree.odd.push(relative(&name.to_string_lossy()));
                continue;
            };
            let kind = entry.file_type().map_err(failed)?;
            let is_link = kind.is_symlink();
            let is_folder = kind.is_dir() || is_link && entry.path().is_dir();
            self.add(relative(name), name, is_folder, is_link);
        }
        Ok(())
    }

    /// Records a folder. True if it is not to be listed.
    fn is_known(&mut self, below: &str, id: FileId) -> bool {
        if self.visits == Visits::EveryName {
            return false;
        }
        let other = match self.entered.get(&id) {
            Some(name) if name.is_empty() => ".",
            Some(name) => name,
            None if self.above.contains(&id) => ".",
            None => {
                self.entered.insert(id, below.to_owned());
                return false;
            }
        };
        self.tree.other_names.push((below.to_owned(), other.to_owned()));
        true
    }

    fn add(&mut self, relative: String, name: &str, is_folder: bool, is_link: bool) {
        match (is_folder, is_link) {
            (true, _) if is_hidden(name) => {}
            (true, _) if is_resource_folder(name) => self.tree.resources.push(relative),
            (true, _) if !(self.enters)(&relative) => {}
            (true, false) => self.open.push(relative),
            (true, true) => drop(self.links.insert(relative)),
            (false, _) if is_resource_file(name) => self.tree.resources.push(relative),
            (false, _) => self.tree.files.push(relative),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic_file::{create_dir, write_relaxed};
    use std::os::unix::fs::symlink;

    fn write(root: &Path, files: &[&str]) {
        for file in files {
            let path = root.join(file);
            create_dir(path.parent().unwrap()).unwrap();
            write_relaxed(&path, file.as_bytes()).unwrap();
        }
    }

    fn tree(root: &Path) -> FileTree {
        file_tree(root, Visits::Once, &|_| true).unwrap()
    }

    fn names(pairs: &[(String, String)]) -> Vec<(&str, &str)> {
        pairs.iter().map(|(name, other)| (name.as_str(), other.as_str())).collect()
    }

    #[test]
    fn each_folder_is_entered_once_under_its_own_name() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path().join("photos");
        write(&root, &["2024/a.jpg", "2024/b/c.jpg", "z.jpg"]);
        write(dir.path(), &["elsewhere/d.jpg"]);
        // To itself, up, out of the folder, to a neighbour before and after it, and two that multiply.
        for (target, name) in [
            (".", "me"),
            ("..", "up"),
            ("/", "disk"),
            ("../elsewhere", "away"),
            ("../elsewhere", "away2"),
            ("2024", "0-latest"),
            ("2024", "latest"),
            ("..", "2024/b/x"),
            ("../..", "2024/b/y"),
            ("nowhere", "broken"),
            ("ring", "ring"),
        ] {
            symlink(target, root.join(name)).unwrap();
        }
        let tree = tree(&root);
        let files = ["2024/a.jpg", "2024/b/c.jpg", "away/d.jpg", "broken", "ring", "z.jpg"];
        assert_eq!(tree.files, files);
        let others = [
            ("0-latest", "2024"),
            ("2024/b/x", "2024"),
            ("2024/b/y", "."),
            ("away2", "away"),
            ("disk", "."),
            ("latest", "2024"),
            ("me", "."),
            ("up", "."),
        ];
        assert_eq!(names(&tree.other_names), others);
        let notes = tree.notes();
        assert!(
            notes[0].ends_with("8 names of them are left out (first: 0-latest is 2024)"),
            "{notes:?}"
        );
    }

    #[test]
    fn thumbnails_and_resources_are_skipped() {
        let dir = tempfile::tempdir().unwrap();
        let skipped = [
            "@eaDir/a.jpg/SYNOPHOTO_THUMB_M.jpg",
            "2024/.@__thumb/a.jpg",
            "2024/._a.jpg",
            ".thumbnails/a.jpg",
            "__MACOSX/2024/._a.jpg",
        ];
        write(dir.path(), &skipped);
        write(dir.path(), &["2024/a.jpg", "_a.jpg", "b.jpg"]);
        let tree = tree(dir.path());
        assert_eq!(tree.files, ["2024/a.jpg", "_a.jpg", "b.jpg"]);
        assert_eq!(tree.resources, ["2024/._a.jpg", "@eaDir", "__MACOSX"]);
        let notes = tree.notes();
        assert!(notes[0].starts_with("3 thumbnails or resources"), "{notes:?}");
        assert!(skipped.iter().all(|path| is_resource(path)));
        assert!(!tree.files.iter().any(|path| is_resource(path)) && !is_resource("./a.jpg"));
    }

    #[test]
    fn files_that_are_looked_up_keep_every_name() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), &["all/a.npy"]);
        symlink("all", dir.path().join("train")).unwrap();
        symlink(".", dir.path().join("all/all")).unwrap();
        let enters = |path: &str| ["all", "train"].contains(&path);
        let tree = file_tree(dir.path(), Visits::EveryName, &enters).unwrap();
        assert_eq!(tree.files, ["all/a.npy", "train/a.npy"]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = file_tree(Path::new("/no/where"), Visits::Once, &|_| true).unwrap_err();
        assert!(error.to_string().starts_with("cannot list /no/where: No such file"), "{error}");
    }

    /// The system's own tree of links, whose folders contain each other.
    #[test]
    fn links_that_multiply_end() {
        let devices = Path::new("/sys/class");
        if devices.is_dir() {
            let tree = file_tree(devices, Visits::Once, &|_| true).unwrap();
            assert!(!tree.files.is_empty() && !tree.other_names.is_empty());
        }
    }
}
