//! A cache of objects on this machine's disk, so that each object crosses the network once.
//!
//! A digest of the object's URL is the name of an entry's file. The file contains a line of JSON with the URL, the ETag
//! and a digest of the content, then the content. An entry is used only if the digest matches and the object in the
//! store still has the ETag. Files are renamed into place, so any number of workers can share a folder.

use render::atomic_file;
use serde::{Deserialize, Serialize};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

/// A folder of cached objects.
#[derive(Debug)]
pub struct Cache {
    folder: PathBuf,
    limit_bytes: u64,
    /// Number of bytes written since the folder was last listed.
    written_bytes: AtomicU64,
}

/// The first line of a file.
#[derive(Serialize, Deserialize)]
struct Head {
    url: String,
    etag: String,
    blake3: String,
}

pub(super) struct Entry {
    pub(super) etag: String,
    pub(super) bytes: Vec<u8>,
}

/// Age above which a temporary file counts as left by a killed process.
const UNFINISHED: Duration = Duration::from_hours(1);

impl Cache {
    /// Returns a cache of about `limit_bytes` in `folder`, which is created when it is needed. The cache evicts the
    /// least recently used entries. Each further process that shares the folder may exceed the limit by a twentieth.
    pub fn new(folder: PathBuf, limit_bytes: u64) -> Self {
        Self {
            folder,
            limit_bytes,
            // This value makes the first put list the folder.
            written_bytes: AtomicU64::new(limit_bytes),
        }
    }

    fn file(&self, url: &str) -> PathBuf {
        self.folder.join(&blake3::hash(url.as_bytes()).to_hex()[..32])
    }

    /// Returns the object if it is cached and intact. Removes an entry with a wrong URL or digest.
    pub(super) fn get(&self, url: &str) -> Option<Entry> {
        let path = self.file(url);
        let mut bytes = render::input_file::read(&path).ok()?;
        let end = bytes.iter().position(|b| *b == b'\n')?;
        let head: Head = serde_json::from_slice(&bytes[..end]).ok()?;
        bytes.drain(..=end);
        if head.url != url || head.blake3 != blake3::hash(&bytes).to_hex().as_str() {
            let _ = std::fs::remove_file(&path);
            return None;
        }
        let used = std::fs::File::options().append(true).open(&path);
        let _ = used.and_then(|file| file.set_modified(SystemTime::now()));
        Some(Entry { etag: head.etag, bytes })
    }

    /// Caches an object of at most half the limit. Ignores errors of the disk, which only cost time.
    pub(super) fn put(&self, url: &str, etag: &str, bytes: &[u8]) {
        let size = bytes.len() as u64;
        if size > self.limit_bytes / 2 {
            return;
        }
        let head = Head {
            url: url.to_owned(),
            etag: etag.to_owned(),
            blake3: blake3::hash(bytes).to_hex().to_string(),
        };
        let mut file = serde_json::to_vec(&head).expect("strings are JSON");
        file.push(b'\n');
        let _ = file.write_all(bytes);
        if atomic_file::create_dir(&self.folder).is_err() {
            return;
        }
        let written = self.written_bytes.fetch_add(size, Ordering::Relaxed) + size;
        if written > self.limit_bytes / 20 {
            self.written_bytes.store(0, Ordering::Relaxed);
            let _ = self.make_room(size);
        }
        let _ = atomic_file::write_relaxed(&self.file(url), &file);
    }

    /// Frees `size` and a twentieth of the limit: removes old unfinished files and the least recently used entries.
    fn make_room(&self, size: u64) -> io::Result<()> {
        let now = SystemTime::now();
        let mut files: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            let entry = entry?;
            let (path, facts) = (entry.path(), entry.metadata()?);
            let used = facts.modified()?;
            if atomic_file::is_temporary(&path) {
                let age = now.duration_since(used).unwrap_or_default();
                if age > UNFINISHED {
                    let _ = std::fs::remove_file(&path);
                }
            } else if is_entry(&path) {
                files.push((used, facts.len(), path));
            }
        }
        files.sort();
        let room = self.limit_bytes - self.limit_bytes / 20;
        let mut sum: u64 = size + files.iter().map(|(_, size, _)| size).sum::<u64>();
        for (_, size, path) in files {
            if sum <= room {
                break;
            }
            let _ = std::fs::remove_file(path);
            sum -= size;
        }
        Ok(())
    }
}

/// True if the path has the name of an entry. Other files in the folder stay.
fn is_entry(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    name.is_some_and(|name| name.len() == 32 && name.bytes().all(|b| b.is_ascii_hexdigit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn total(folder: &Path) -> u64 {
        let files = std::fs::read_dir(folder).unwrap();
        files.map(|f| f.unwrap().metadata().unwrap().len()).sum()
    }

    #[test]
    fn damaged_entries_are_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path().join("c"), 1 << 20);
        assert!(cache.get("s3://b/a").is_none());
        cache.put("s3://b/a", "e1", b"content\nof a");
        let entry = cache.get("s3://b/a").unwrap();
        assert_eq!((entry.etag.as_str(), &*entry.bytes), ("e1", &b"content\nof a"[..]));
        assert!(cache.get("s3://b/b").is_none());
        let file = cache.file("s3://b/a");
        let mut bytes = std::fs::read(&file).unwrap();
        for at in [0, bytes.len() - 1] {
            bytes[at] ^= 1;
            atomic_file::write_relaxed(&file, &bytes).unwrap();
            assert!(cache.get("s3://b/a").is_none());
            bytes[at] ^= 1;
        }
    }

    #[test]
    fn the_least_recently_used_entries_are_evicted() {
        let folder = tempfile::tempdir().unwrap();
        let strange = folder.path().join("notes.txt");
        atomic_file::write_relaxed(&strange, b"mine").unwrap();
        let cache = Cache::new(folder.path().to_owned(), 100_000);
        let url = |n: usize| format!("s3://b/{n}");
        for n in 0..40 {
            cache.put(&url(n), "e", &vec![n as u8; 9000]);
            assert!(total(folder.path()) < 105_000);
            std::thread::sleep(Duration::from_millis(5));
            // Frequent use keeps this entry.
            assert!(cache.get(&url(0)).is_some(), "{n}");
        }
        assert!(cache.get(&url(39)).is_some());
        assert!(cache.get(&url(1)).is_none());
        assert!(strange.exists());
        cache.put(&url(99), "e", &vec![0; 60_000]);
        assert!(cache.get(&url(99)).is_none(), "too large to keep");
    }
}
