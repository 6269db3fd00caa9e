//! What the writer thread is given. It waits for the disk, so that no thread that computes has to.

use super::finished::Files;
use super::local::FarmError;
use super::run_dir::RunDir;
use super::sweep::remove_partials;
use crate::atomic_file;
use crate::manifest::SceneLine;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Something to write, encoded already.
pub(super) struct Order<'a> {
    pub(super) line: &'a SceneLine,
    pub(super) failed: Arc<AtomicBool>,
    pub(super) what: What,
}

/// What to write.
pub(super) enum What {
    /// A shard's partial.
    Partial { shard: u32, bytes: Vec<u8> },
    /// A scene's tuple; when it is durable, the scene's partials are removed.
    Tuple { files: Files, miss_share: f64 },
}

impl Order<'_> {
    /// Writes it, durably.
    pub(super) fn write(&self, dir: &RunDir) -> Result<(), FarmError> {
        match &self.what {
            What::Partial { shard, bytes } => {
                atomic_file::write(&dir.partial(&self.line.id, *shard), bytes)?;
            }
            What::Tuple { files, .. } => {
                let folder = dir.tuple(&self.line.id);
                let write = || {
                    atomic_file::create_dir(&folder)?;
                    // In this order: tuple.json comes last.
                    let mut files = files.iter();
                    files
                        .try_for_each(|(name, bytes)| atomic_file::write(&folder.join(name), bytes))
                };
                write()?;
                remove_partials(&dir.partials(&self.line.id));
            }
        }
        Ok(())
    }
}
