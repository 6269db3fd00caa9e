//! Files of procedural photographs that are not written yet, for previews while a run is planned.

use super::content::ProceduralPhotograph;
use super::make::inputs_folder;
use procedural::SampleFiles;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Renders each photograph once, when one of its files is first read.
pub(super) struct SampleBytes<'a> {
    photographs: Vec<(&'a ProceduralPhotograph, OnceLock<Option<SampleFiles>>)>,
    /// Path to (index of the photograph, index of the file).
    places: BTreeMap<PathBuf, (usize, usize)>,
}

impl<'a> SampleBytes<'a> {
    pub(super) fn new(run: &Path, all: &'a [ProceduralPhotograph]) -> Self {
        let (mut photographs, mut places) = (Vec::new(), BTreeMap::new());
        for one in all {
            let (folder, photograph) = (inputs_folder(run, &one.root), &one.photograph);
            let files = [photograph.color_path(), photograph.depth_path(), photograph.mask_path()];
            for (kind, file) in files.iter().enumerate() {
                places.insert(folder.join(file), (photographs.len(), kind));
            }
            photographs.push((one, OnceLock::new()));
        }
        Self { photographs, places }
    }

    /// The bytes of a file; `None` if it does not belong to a procedural photograph.
    pub(super) fn read(&self, path: &Path) -> Option<io::Result<Vec<u8>>> {
        let &(index, kind) = self.places.get(path)?;
        if path.is_file() {
            return Some(std::fs::read(path));
        }
        let (one, made) = &self.photographs[index];
        let [width, height] = one.size;
        let files = made.get_or_init(|| procedural::encode(&one.photograph, width, height).ok());
        Some(match files {
            Some(files) => Ok([&files.color, &files.depth, &files.mask][kind].clone()),
            None => Err(io::Error::other("the photograph cannot be encoded")),
        })
    }
}
