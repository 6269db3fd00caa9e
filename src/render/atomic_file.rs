//! Atomic writes of files and folders: temporary name, fsync, rename, fsync of the folder.
//!
//! A reader sees a whole file or none. After a power cut this holds for [`write()`] and [`write_whole`]; after
//! [`write_relaxed`], the file may be empty.

use super::disk::sync_folder;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, IntoInnerError, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A failed write of a file or folder.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}; check the disk's space and the folder's permissions", path.display())]
pub struct WriteError {
    pub path: PathBuf,
    pub source: io::Error,
}

/// Prefix of the names of unfinished files and folders.
const TEMPORARY_PREFIX: &str = ".tmp-";

/// True if `path` has the temporary name of an unfinished file or folder, which a killed process may have left.
pub fn is_temporary(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(TEMPORARY_PREFIX))
}

/// True if `path` has the temporary name of an unfinished file or folder, or that of an unfinished put into a local
/// store, such as `tuple.exr#1`.
pub fn is_unfinished(path: &Path) -> bool {
    let name = path.file_name().map(|name| name.to_string_lossy());
    let number = name.as_ref().and_then(|name| name.rsplit_once('#'));
    let is_put =
        number.is_some_and(|(_, n)| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    is_put || is_temporary(path)
}

/// Removes files that `is_leftover` accepts from a folder and its subfolders, down to `depth` levels. The caller must
/// be the only user of the folder. Skips files that cannot be removed, because they do no harm.
pub fn sweep(folder: &Path, depth: u32, is_leftover: &dyn Fn(&Path) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        match entry.file_type() {
            Ok(kind) if kind.is_dir() && depth > 0 => sweep(&entry.path(), depth - 1, is_leftover),
            Ok(kind) if kind.is_file() && is_leftover(&entry.path()) => {
                let _ = fs::remove_file(entry.path());
            }
            _ => {}
        }
    }
}

/// Creates `dir` and its missing parents, durably: without the entries of its folders, a power cut would lose a synced
/// file.
pub fn create_dir(dir: &Path) -> Result<(), WriteError> {
    let create = || -> io::Result<()> {
        let mut new = dir;
        let mut changed = Vec::new();
        while !new.as_os_str().is_empty() && !new.exists() {
            let parent = folder_of(new);
            changed.push(parent);
            new = parent;
        }
        fs::create_dir_all(dir)?;
        changed.into_iter().try_for_each(sync_dir)
    };
    create().map_err(|source| WriteError { path: dir.to_owned(), source })
}

/// Writes `bytes` to `path`, durably: on return the file survives a power cut.
///
/// The folder must exist. Replaces an existing file.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    write_inner(path, bytes, Wait::Durable)
}

/// Writes `bytes` to `path` atomically and waits for the bytes, but not for the name: a power cut may lose the file as a
/// whole until [`settle`], but never a part of it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    write_inner(path, bytes, Wait::Bytes)
}

/// Writes `bytes` to `path` atomically, without waiting for the disk: a power cut may leave an empty file.
///
/// Suits files that [`settle`] makes durable before they count, and files with a digest that readers compare.
pub fn write_relaxed(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    write_inner(path, bytes, Wait::No)
}

/// Appends a line to a file, or creates the file, durably. Lines of several processes do not mix. After an unfinished
/// line, which a killed process may have left, the new line starts on its own.
pub fn append_line(path: &Path, line: &str) -> Result<(), WriteError> {
    let append = || -> io::Result<()> {
        let mut file = File::options().read(true).append(true).create(true).open(path)?;
        let length = file.metadata()?.len();
        let mut last = [b'\n'];
        if length > 0 {
            file.seek(SeekFrom::Start(length - 1))?;
            file.read_exact(&mut last)?;
        }
        let start = if last == *b"\n" { "" } else { "\n" };
        file.write_all(format!("{start}{line}\n").as_bytes())?;
        file.sync_all()?;
        sync_dir(folder_of(path))
    };
    append().map_err(|source| WriteError { path: path.to_owned(), source })
}

/// A file that is written in parts, for content that does not fit into memory. The file has a temporary name until
/// [`Self::finish`]; dropping an unfinished value removes the file.
pub struct PendingFile {
    writer: BufWriter<NamedTempFile>,
    path: PathBuf,
}

impl PendingFile {
    /// Creates the temporary file for `path`. The folder must exist.
    pub fn begin(path: &Path) -> Result<Self, WriteError> {
        let file =
            temporary(path).map_err(|source| WriteError { path: path.to_owned(), source })?;
        Ok(Self { writer: BufWriter::with_capacity(1 << 18, file), path: path.to_owned() })
    }

    /// Copies all bytes that were written to `to`.
    pub fn copy_to(&mut self, to: &mut impl Write) -> io::Result<()> {
        self.writer.flush()?;
        let file = self.writer.get_mut();
        file.rewind()?;
        io::copy(&mut BufReader::with_capacity(1 << 18, file), to)?;
        Ok(())
    }

    /// Renames the file to its final path, durably. Replaces an existing file.
    pub fn finish(self) -> Result<(), WriteError> {
        let path = self.path;
        let persist = || {
            let file = self.writer.into_inner().map_err(IntoInnerError::into_error)?;
            persist(file, &path, Wait::Durable)
        };
        persist().map_err(|source| WriteError { path: path.clone(), source })
    }
}

impl Write for PendingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// Waits until all data of `folder`'s file system are on the disk: one wait for many calls of [`write_relaxed`].
pub fn settle(folder: &Path) -> Result<(), WriteError> {
    let sync = || -> io::Result<()> {
        let folder = File::open(folder)?;
        #[cfg(target_os = "linux")]
        rustix::fs::syncfs(&folder)?;
        #[cfg(not(target_os = "linux"))]
        {
            drop(folder);
            rustix::fs::sync();
        }
        Ok(())
    };
    sync().map_err(|source| WriteError { path: folder.to_owned(), source })
}

/// Makes the names of files durable that [`write_whole`] wrote.
pub fn sync_names(files: impl IntoIterator<Item = PathBuf>) -> Result<(), WriteError> {
    let folders: BTreeSet<PathBuf> = files.into_iter().map(|f| folder_of(&f).to_owned()).collect();
    let sync =
        |folder: PathBuf| sync_dir(&folder).map_err(|source| WriteError { path: folder, source });
    folders.into_iter().try_for_each(sync)
}

/// Creates a folder with all its files atomically: `fill` writes the files into a temporary folder, which is then
/// renamed to `path`. An existing folder is removed just before the rename.
pub fn write_dir<E: From<WriteError>>(
    path: &Path,
    fill: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let failed = |source| WriteError { path: path.to_owned(), source };
    let parent = path.parent().unwrap_or(Path::new("."));
    create_dir(parent)?;
    let temporary =
        tempfile::Builder::new().prefix(TEMPORARY_PREFIX).tempdir_in(parent).map_err(failed)?;
    fill(temporary.path())?;
    let rename = || -> io::Result<()> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            fs::set_permissions(temporary.path(), fs::Permissions::from_mode(0o755))?;
        }
        sync_dir(temporary.path())?;
        match fs::remove_dir_all(path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(e),
            _ => {}
        }
        fs::rename(temporary.path(), path)?;
        sync_dir(parent)
    };
    let renamed = rename().map_err(failed);
    // After the rename, `TempDir` has no folder to remove.
    if renamed.is_ok() {
        let _ = temporary.keep();
    }
    Ok(renamed?)
}

/// What a write waits for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wait {
    No,
    Bytes,
    /// Bytes and name.
    Durable,
}

/// Removes a folder with all its files. After a crash, it is whole, or its rest has a temporary name.
pub fn remove_dir(path: &Path) -> io::Result<()> {
    let parent = folder_of(path);
    let bin = tempfile::Builder::new().prefix(TEMPORARY_PREFIX).tempdir_in(parent)?;
    fs::rename(path, bin.path())?;
    // Without the sync, a power cut could keep the old name and lose files.
    sync_dir(parent)?;
    bin.close()
}

fn write_inner(path: &Path, bytes: &[u8], wait: Wait) -> Result<(), WriteError> {
    let write = || -> io::Result<()> {
        let mut file = temporary(path)?;
        file.write_all(bytes)?;
        persist(file, path, wait)
    };
    write().map_err(|source| WriteError { path: path.to_owned(), source })
}

/// Creates an empty temporary file beside `path`.
fn temporary(path: &Path) -> io::Result<NamedTempFile> {
    tempfile::Builder::new().prefix(TEMPORARY_PREFIX).tempfile_in(folder_of(path))
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn persist(file: NamedTempFile, path: &Path, wait: Wait) -> io::Result<()> {
    // tempfile creates files that only their owner can read, but results must be readable by others.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.as_file().set_permissions(fs::Permissions::from_mode(0o644))?;
    }
    if wait != Wait::No {
        file.as_file().sync_all()?;
    }
    file.persist(path).map_err(|e| e.error)?;
    if wait == Wait::Durable { sync_dir(folder_of(path)) } else { Ok(()) }
}

/// Makes a new name, a rename or a removal inside `folder` durable, as far as its disk can ([`sync_folder`]).
pub fn sync_dir(folder: &Path) -> io::Result<()> {
    sync_folder(folder).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_write_replaces_the_file_and_leaves_no_temporary_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write(&path, b"one").unwrap();
        write(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_appears_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("step-1");
        for text in ["one", "two"] {
            write_dir(&path, |folder| {
                write(&folder.join("a"), text.as_bytes())?;
                assert!(folder.file_name().is_some_and(|n| is_temporary(Path::new(n))));
                Ok::<(), WriteError>(())
            })
            .unwrap();
            assert_eq!(fs::read_to_string(path.join("a")).unwrap(), text);
        }
        let failed = write_dir(&path, |folder| write(&folder.join("no/a"), b""));
        assert!(failed.is_err());
        assert_eq!(fs::read_to_string(path.join("a")).unwrap(), "two");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_pending_file_appears_when_it_is_finished() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tar");
        let mut pending = PendingFile::begin(&path).unwrap();
        pending.write_all(b"one").unwrap();
        drop(pending);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        let mut pending = PendingFile::begin(&path).unwrap();
        pending.write_all(b"t").unwrap();
        let mut copy = Vec::new();
        pending.copy_to(&mut copy).unwrap();
        pending.write_all(b"wo").unwrap();
        pending.copy_to(&mut copy).unwrap();
        assert_eq!(copy, b"ttwo");
        assert!(!path.exists());
        pending.finish().unwrap();
        settle(dir.path()).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_is_created_with_its_parents_and_removed_with_its_files() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a/b/c");
        create_dir(&path).unwrap();
        create_dir(&path).unwrap();
        write_whole(&path.join("file"), b"one").unwrap();
        sync_names([path.join("file"), dir.path().join("a/file")]).unwrap();
        append_line(&path.join("list"), "one").unwrap();
        append_line(&path.join("list"), "two").unwrap();
        assert_eq!(fs::read_to_string(path.join("list")).unwrap(), "one\ntwo\n");
        assert!(create_dir(&path.join("file/d")).is_err());
        remove_dir(&path).unwrap();
        assert_eq!(fs::read_dir(dir.path().join("a/b")).unwrap().count(), 0);
    }

    #[test]
    fn unfinished_files_have_one_of_two_names() {
        for (name, is_one) in
            [(".tmp-a", true), ("a.exr#12", true), ("a#", false), ("a#b", false), ("a", false)]
        {
            assert_eq!(is_unfinished(&Path::new("folder").join(name)), is_one, "{name}");
        }
    }

    #[test]
    fn an_error_names_the_file() {
        let error = write(Path::new("/nonexistent/folder/x.exr"), b"").unwrap_err();
        assert!(error.to_string().contains("/nonexistent/folder/x.exr"));
    }
}
