//! Reads files that may be no files, may never end, or may be on a disk that does not answer.
//!
//! Only regular files of a limited size are read. While a read lasts, [`longest_wait`] names its file, so that a program
//! can end a read that never returns: a thread inside the operating system cannot be interrupted.

use std::collections::BTreeMap;
use std::fs::{File, FileType};
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Largest size of a file that is read whole, bytes.
pub const MAX_FILE_BYTES: u64 = 1 << 31;

/// Bytes of one call of the operating system. Each call that returns counts as progress.
const CALL_BYTES: usize = 1 << 23;

/// The calls that have not returned, with the times of their start.
static CALLS: Mutex<BTreeMap<u64, (PathBuf, Instant)>> = Mutex::new(BTreeMap::new());

/// Returns the file of the call that has not returned for the longest time, with this time.
pub fn longest_wait() -> Option<(PathBuf, Duration)> {
    let calls = CALLS.lock().expect("no holder of this lock panics");
    let (path, start) = calls.values().min_by_key(|(_, start)| *start)?;
    Some((path.clone(), start.elapsed()))
}

/// A call of the operating system on a file, visible for [`longest_wait`] until it is dropped.
#[derive(Debug)]
#[must_use]
pub struct Call(u64);

impl Call {
    /// Records that a call on the file `path` begins now.
    pub fn begin(path: &Path) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let entry = (path.to_owned(), Instant::now());
        CALLS.lock().expect("no holder of this lock panics").insert(number, entry);
        Self(number)
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        CALLS.lock().expect("no holder of this lock panics").remove(&self.0);
    }
}

/// Reads a regular file of at most [`MAX_FILE_BYTES`]. Anything else is an error of the kind `InvalidInput`.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut file = InputFile::open(path)?;
    let length = file.len();
    if length > MAX_FILE_BYTES {
        return Err(invalid(format!(
            "it has {length} bytes, and at most {MAX_FILE_BYTES} are read"
        )));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length as usize).map_err(|_| {
        io::Error::new(io::ErrorKind::OutOfMemory, format!("no memory for its {length} bytes"))
    })?;
    // A file may grow, and the files of some virtual file systems have no length.
    (&mut file).take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(invalid(format!("it has more than {MAX_FILE_BYTES} bytes")));
    }
    Ok(bytes)
}

/// Works like [`read`] for text in UTF-8.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path)?).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))
}

/// Works like [`read`]; returns `None` if the file does not exist. Any other failure is an error: a disk that cannot be
/// read is not a disk without the file.
pub fn read_if_there(path: &Path) -> io::Result<Option<Vec<u8>>> {
    match read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

fn invalid(reason: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, reason)
}

/// A regular file that is read in parts.
#[derive(Debug)]
pub struct InputFile {
    file: File,
    path: PathBuf,
    length: u64,
}

impl InputFile {
    /// Opens a regular file. Anything else is an error of the kind `InvalidInput`.
    pub fn open(path: &Path) -> io::Result<Self> {
        let _call = Call::begin(path);
        // Opening a pipe waits for its writer, and opening a device may have effects.
        check(std::fs::metadata(path)?.file_type())?;
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        check(metadata.file_type())?;
        Ok(Self { file, path: path.to_owned(), length: metadata.len() })
    }

    /// Size at the time of opening, bytes.
    #[allow(clippy::len_without_is_empty, reason = "a size, not a collection")]
    pub fn len(&self) -> u64 {
        self.length
    }
}

fn check(kind: FileType) -> io::Result<()> {
    let name = if kind.is_file() {
        return Ok(());
    } else if kind.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder, not a file"));
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    };
    Err(invalid(format!("it is {name}, not a file")))
}

impl Read for InputFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = buffer.len().min(CALL_BYTES);
        let _call = Call::begin(&self.path);
        self.file.read(&mut buffer[..length])
    }
}

impl Seek for InputFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for length in [0, 1, CALL_BYTES + 1] {
            let bytes: Vec<u8> = (0..length).map(|k| (k % 251) as u8).collect();
            crate::atomic_file::write(&path, &bytes).unwrap();
            assert!(read(&path).unwrap() == bytes, "{length}");
        }
        // The files of this file system have the length 0.
        if Path::new("/proc/self/status").exists() {
            assert!(read_to_string(Path::new("/proc/self/status")).unwrap().contains("Pid:"));
        }
        let error = read(&folder.path().join("b")).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn only_files_of_limited_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        let _socket = std::os::unix::net::UnixListener::bind(folder.path().join("socket")).unwrap();
        let sparse = folder.path().join("sparse");
        File::create(&sparse).unwrap().set_len(MAX_FILE_BYTES + 1).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&pipe, &link).unwrap();
        for (path, words) in [
            (pipe.as_path(), "a pipe, not a file"),
            (&link, "a pipe, not a file"),
            (&folder.path().join("socket"), "a socket"),
            (Path::new("/dev/zero"), "a device"),
            (folder.path(), "a folder"),
            (&sparse, "has 2147483649 bytes, and at most 2147483648"),
        ] {
            let error = read(path).unwrap_err().to_string();
            assert!(error.contains(words), "{}: {error}", path.display());
        }
        let calls = CALLS.lock().unwrap();
        assert!(calls.values().all(|(path, _)| !path.starts_with(folder.path())), "{calls:?}");
    }

    #[test]
    fn a_call_that_does_not_return_is_named() {
        let is_named = || CALLS.lock().unwrap().values().any(|(path, _)| path == "slow");
        let call = Call::begin(Path::new("slow"));
        std::thread::sleep(Duration::from_millis(20));
        assert!(is_named());
        // Other tests may wait longer.
        assert!(longest_wait().unwrap().1 >= Duration::from_millis(20));
        drop(call);
        assert!(!is_named());
    }
}
