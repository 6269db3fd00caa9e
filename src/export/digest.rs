//! Digests of exported files: SHA-256 in the form of `sha256sum` and Croissant, and BLAKE3.

use crate::made;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::io::{self, Write};

/// Record of a file of an export.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileRecord {
    /// Path in the exported folder.
    pub(super) path: String,
    pub(super) bytes: u64,
    /// SHA-256, 64 hexadecimal digits.
    pub(super) sha256: String,
    /// BLAKE3, 64 hexadecimal digits: by it, a later call recognises the file.
    #[serde(default)]
    pub(super) blake3: String,
}

impl FileRecord {
    pub(super) fn new(path: &str, bytes: &[u8]) -> Self {
        Self {
            path: path.to_owned(),
            bytes: bytes.len() as u64,
            sha256: hex(&Sha256::digest(bytes)),
            blake3: made::digest(bytes),
        }
    }

    /// Formats the file's line in `SHA256SUMS`.
    pub(super) fn sum_line(&self) -> String {
        format!("{}  {}\n", self.sha256, self.path)
    }
}

fn hex(digest: &[u8]) -> String {
    digest.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// A writer that digests and counts the bytes that pass through.
pub(super) struct Digesting<W> {
    inner: W,
    sha256: Sha256,
    blake3: blake3::Hasher,
    bytes: u64,
}

impl<W: Write> Digesting<W> {
    pub(super) fn new(inner: W) -> Self {
        Self { inner, sha256: Sha256::new(), blake3: blake3::Hasher::new(), bytes: 0 }
    }

    /// Returns the inner writer and the record of the bytes.
    pub(super) fn finish(self, path: &str) -> (W, FileRecord) {
        let record = FileRecord {
            path: path.to_owned(),
            bytes: self.bytes,
            sha256: hex(&self.sha256.finalize()),
            blake3: self.blake3.finalize().to_hex().to_string(),
        };
        (self.inner, record)
    }
}

impl<W: Write> Write for Digesting<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.sha256.update(&bytes[..count]);
        self.blake3.update(&bytes[..count]);
        self.bytes += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_equal_those_of_sha256sum() {
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let record = FileRecord::new("a/b.png", b"abc");
        assert_eq!(record.sum_line(), format!("{expected}  a/b.png\n"));
        let mut passing = Digesting::new(Vec::new());
        passing.write_all(b"a").unwrap();
        passing.write_all(b"bc").unwrap();
        let (bytes, same) = passing.finish("a/b.png");
        assert_eq!((bytes.as_slice(), same), (&b"abc"[..], record));
    }
}
