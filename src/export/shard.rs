//! Writes a WebDataset shard: a tar with bytes that depend on its members alone.

use super::digest::{Digesting, FileRecord};
use super::error::ExportError;
use bytes::Bytes;
use render::atomic_file::{PendingFile, WriteError};
use std::io;
use std::path::{Path, PathBuf};
use tar::{Builder, EntryType, Header};

const BLOCK: u64 = 512;
/// Length of the two empty blocks that end a tar.
const END: u64 = 2 * BLOCK;
/// Length above which a name needs an entry of its own, bytes.
const SHORT_NAME: usize = 100;

pub(super) struct Shard {
    tar: Builder<Digesting<PendingFile>>,
    path: PathBuf,
    name: String,
    bytes: u64,
}

impl Shard {
    pub(super) fn begin(out: &Path, name: String) -> Result<Self, ExportError> {
        let path = out.join(&name);
        let file = PendingFile::begin(&path)?;
        Ok(Self { tar: Builder::new(Digesting::new(file)), path, name, bytes: END })
    }

    pub(super) fn has_room(&self, files: &[(String, Bytes)], limit_bytes: u64) -> bool {
        self.bytes + tar_bytes(files) <= limit_bytes
    }

    /// Adds members with owner 0, mode 0644 and time 0.
    pub(super) fn add(&mut self, files: &[(String, Bytes)]) -> Result<(), ExportError> {
        for (name, bytes) in files {
            let mut header = Header::new_gnu();
            header.set_entry_type(EntryType::Regular);
            header.set_size(bytes.len() as u64);
            header.set_mode(0o644);
            header.set_uid(0);
            header.set_gid(0);
            header.set_mtime(0);
            let added = self.tar.append_data(&mut header, name, &bytes[..]);
            added.map_err(|e| self.failed(e))?;
        }
        self.bytes += tar_bytes(files);
        Ok(())
    }

    /// Ends the shard; on return it is durable.
    pub(super) fn finish(self) -> Result<FileRecord, ExportError> {
        let path = self.path;
        let failed = |source| WriteError { path: path.clone(), source };
        let (file, record) = self.tar.into_inner().map_err(failed)?.finish(&self.name);
        file.finish()?;
        debug_assert_eq!(record.bytes, self.bytes, "a tar has the predicted size");
        Ok(record)
    }

    fn failed(&self, source: io::Error) -> WriteError {
        WriteError { path: self.path.clone(), source }
    }
}

/// Computes the size of members in a tar, bytes.
fn tar_bytes(files: &[(String, Bytes)]) -> u64 {
    let blocks = |bytes: usize| (bytes as u64).div_ceil(BLOCK) * BLOCK;
    let of = |(name, bytes): &(String, Bytes)| {
        let long_name = if name.len() > SHORT_NAME { BLOCK + blocks(name.len() + 1) } else { 0 };
        long_name + BLOCK + blocks(bytes.len())
    };
    files.iter().map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tar_has_the_predicted_size_and_no_times() {
        let folder = tempfile::tempdir().unwrap();
        let files: Vec<(String, Bytes)> = [0, 1, 511, 512, 513, 5000]
            .into_iter()
            .map(|length| (format!("{}.{length}", "x".repeat(96)), vec![7u8; length].into()))
            .collect();
        let mut shard = Shard::begin(folder.path(), "a.tar".to_owned()).unwrap();
        shard.add(&files).unwrap();
        let foreseen = shard.bytes;
        assert!(shard.has_room(&files, 2 * foreseen) && !shard.has_room(&files, foreseen));
        let record = shard.finish().unwrap();
        let bytes = std::fs::read(folder.path().join("a.tar")).unwrap();
        assert_eq!(record, FileRecord::new("a.tar", &bytes));
        assert_eq!(bytes.len() as u64, foreseen);
        let mut archive = tar::Archive::new(&bytes[..]);
        for (entry, (name, content)) in archive.entries().unwrap().zip(&files) {
            let entry = entry.unwrap();
            let header = entry.header();
            assert_eq!(entry.path().unwrap().to_str(), Some(name.as_str()));
            assert_eq!(header.size().unwrap(), content.len() as u64);
            assert_eq!(header.mtime().unwrap(), 0);
            assert_eq!([header.uid().unwrap(), header.gid().unwrap()], [0, 0]);
            assert_eq!(header.mode().unwrap(), 0o644);
        }
    }
}
