//! Lists the photographs of a DIODE folder, or of a procedural set in DIODE's layout.
//!
//! ```text
//! [train|val/](indoors|outdoor)/scene_NNNNN/scan_NNNNN/NAME{.png,_depth.npy,_depth_mask.npy}
//! ```

use super::list::ListError as PhotographListError;
use glasshouse_line::{DepthRange, Side};
use procedural::Place;
use render::file_tree::{ListError, Visits, file_tree};
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

/// An RGBD photograph of a source. Paths are relative to the source's root, with `/` as separator.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceImage {
    pub color: String,
    pub depth: String,
    /// Root of the depth image, if it differs from the source's root.
    pub depth_root: Option<String>,
    /// Metric range of a relative depth, if it differs from the source's range.
    pub depth_range: Option<DepthRange>,
    pub mask: Option<String>,
    pub place: Place,
    /// Folder or category of the scene. For a photograph of a list: `scan`, or empty if the line names no scan.
    pub scene: String,
    /// Name of the scan, which has the views from one standpoint; derived from the photograph's path if it has no scan.
    pub scan: String,
    /// For a photograph of a list: the whole side, which replaces the source's keys and the other paths. `color` is its
    /// name.
    pub side: Option<Side>,
    /// For a photograph of a list: values of `"from_source"` parameters.
    pub values: BTreeMap<String, f64>,
    /// Number of the photograph among those that several sources have.
    pub shared: Option<usize>,
}

impl SourceImage {
    /// True if the photograph of another source is the same one.
    pub(super) fn is_shared_with(&self, other: &Self) -> bool {
        self.shared.is_some() && self.shared == other.shared
    }
}

/// The photographs of a source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Index {
    /// Photographs sorted by path, or in the order of a list.
    pub images: Vec<SourceImage>,
    /// Paths of colour images that have no depth image and are left out.
    pub without_depth: Vec<String>,
    /// Remarks on the listing.
    pub notes: Vec<String>,
}

/// Error of a source that cannot be listed.
#[derive(Debug, thiserror::Error)]
pub enum IndexError {
    #[error("source {name}: {error}; {}", error.remedy(name))]
    Folder { name: String, error: FolderError },
    #[error(
        "source {name}: {} holds no photograph with depth of the form \
         [train|val/](indoors|outdoor)/scene_*/scan_*/*.png with *_depth.npy beside it{}; pass --root \
         {name}=DIR with the right folder",
        path.display(), left_out(*without_depth)
    )]
    Empty {
        name: String,
        path: PathBuf,
        /// Number of colour images without depth.
        without_depth: usize,
    },
    #[error(
        "source {name}: {} holds no photograph of a category in {table} with a depth map below {}{}; pass --root {name}=DIR \
         and --root {name}-depth=DIR with the right folders",
        path.display(), depth_path.display(), left_out(*without_depth)
    )]
    NoPlaces {
        name: String,
        path: PathBuf,
        depth_path: PathBuf,
        table: String,
        /// Number of colour images without depth.
        without_depth: usize,
    },
    #[error("source {name}: cannot use its depth_ranges {}: {reason}", path.display())]
    Table { name: String, path: PathBuf, reason: String },
    #[error("source {name}: cannot read its list {}: {source}; set `list` to a path relative to the recipe, or put \
         photographs.jsonl into the source's root (--root {name}=DIR)", path.display())]
    NoList { name: String, path: PathBuf, source: io::Error },
    #[error("source {name}: list {}: {source}", path.display())]
    List { name: String, path: PathBuf, source: PhotographListError },
}

/// Reason why a folder cannot be a source.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    #[error(transparent)]
    List(#[from] ListError),
    #[error("{} holds no picture (.jpg, .jpeg, .jfif, .png, .exr, .hdr){}", path.display(), left_out_text(*unreadable, *other_formats))]
    NoPictures {
        path: PathBuf,
        /// Number of pictures that cannot be read.
        unreadable: usize,
        /// Number of pictures in formats that the program does not read.
        other_formats: usize,
    },
}

impl FolderError {
    /// Returns what to do for the source `name`.
    fn remedy(&self, name: &str) -> String {
        match self {
            Self::NoPictures { other_formats: 1.., .. } => {
                "convert them to JPEG or PNG, for example by `heif-convert IN.heic OUT.jpg`"
                    .to_owned()
            }
            _ => format!("pass --root {name}=DIR with the right folder"),
        }
    }

    /// Makes the error of the source `name`.
    pub(super) fn of(self, name: &str) -> IndexError {
        IndexError::Folder { name: name.to_owned(), error: self }
    }
}

fn left_out_text(unreadable: usize, other_formats: usize) -> String {
    let unreadable = match unreadable {
        0 => String::new(),
        n => format!(" ({n} cannot be read)"),
    };
    match other_formats {
        0 => unreadable,
        n => format!(
            "{unreadable}, but {n} in formats that are not read (HEIC, AVIF, WebP, TIFF, BMP, raw photographs, ...)"
        ),
    }
}

fn left_out(without_depth: usize) -> String {
    match without_depth {
        0 => String::new(),
        n => format!(" ({n} without depth)"),
    }
}

/// Lists the photographs of the source `name`, in DIODE's layout, in `folder`.
pub(crate) fn index_source(name: &str, folder: &Path) -> Result<Index, IndexError> {
    let tree = file_tree(folder, Visits::Once, &may_hold_photographs);
    let tree = tree.map_err(|e| FolderError::from(e).of(name))?;
    Ok(Index { notes: tree.notes(), ..index_paths(name, folder, &tree.files)? })
}

/// Finds the photographs of the source `name` among `paths`, which are relative to `folder`, with `/` as separator.
pub(crate) fn index_paths(
    name: &str,
    folder: &Path,
    paths: &[String],
) -> Result<Index, IndexError> {
    let index = from_paths(paths);
    if index.images.is_empty() {
        return Err(IndexError::Empty {
            name: name.to_owned(),
            path: folder.to_owned(),
            without_depth: index.without_depth.len(),
        });
    }
    Ok(index)
}

/// True if the layout has photographs below a folder with this path.
fn may_hold_photographs(path: &str) -> bool {
    let mut parts = path.split('/').peekable();
    parts.next_if(|part| matches!(*part, "train" | "val"));
    parts.next().is_none_or(|part| place(part).is_some())
        && parts.next().is_none_or(|part| part.starts_with("scene_"))
        && parts.next().is_none_or(|part| part.starts_with("scan_"))
        && parts.next().is_none()
}

fn place(folder: &str) -> Option<Place> {
    [Place::Indoors, Place::Outdoor].into_iter().find(|place| place.name() == folder)
}

/// Finds the photographs among `paths`, which are relative to the source's root, with `/` as separator.
pub(crate) fn from_paths(paths: &[String]) -> Index {
    let sorted: BTreeSet<&str> = paths.iter().map(String::as_str).collect();
    let mut index = Index::default();
    for path in &sorted {
        let Some((folder, stem)) =
            path.strip_suffix(".png").and_then(|stem_path| stem_path.rsplit_once('/'))
        else {
            continue;
        };
        let mut parts = folder.split('/').peekable();
        parts.next_if(|part| matches!(*part, "train" | "val"));
        let (Some(place), Some(scene), Some(scan), None) = (
            parts.next().and_then(place),
            parts.next().filter(|part| part.starts_with("scene_")),
            parts.next().filter(|part| part.starts_with("scan_")),
            parts.next(),
        ) else {
            continue;
        };
        let depth = format!("{folder}/{stem}_depth.npy");
        let mask = format!("{folder}/{stem}_depth_mask.npy");
        if !sorted.contains(depth.as_str()) {
            index.without_depth.push((*path).to_owned());
            continue;
        }
        index.images.push(SourceImage {
            color: (*path).to_owned(),
            depth,
            depth_root: None,
            depth_range: None,
            mask: sorted.contains(mask.as_str()).then_some(mask),
            place,
            scene: scene.to_owned(),
            scan: scan.to_owned(),
            side: None,
            values: BTreeMap::new(),
            shared: None,
        });
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const SCAN: &str = "val/outdoor/scene_00022/scan_00193";

    fn paths(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn images_are_listed_with_depth_and_mask() {
        let index = from_paths(&paths(&[
            "val/outdoor/scene_00022/scan_00193/b.png",
            "val/outdoor/scene_00022/scan_00193/b_depth.npy",
            "val/outdoor/scene_00022/scan_00193/a_depth_mask.npy",
            "val/outdoor/scene_00022/scan_00193/a_depth.npy",
            "val/outdoor/scene_00022/scan_00193/a.png",
            "val/outdoor/scene_00022/scan_00193/c.png",
            "indoors/scene_1/scan_2/d.png",
            "indoors/scene_1/scan_2/d_depth.npy",
            "readme.png",
            "val/garden/scene_1/scan_2/e.png",
            "val/indoors/scene_1/scan_2/deep/f.png",
        ]));
        let colors: Vec<_> = index.images.iter().map(|i| i.color.as_str()).collect();
        assert_eq!(
            colors,
            [
                "indoors/scene_1/scan_2/d.png".to_owned(),
                format!("{SCAN}/a.png"),
                format!("{SCAN}/b.png")
            ]
        );
        assert_eq!(index.images[1].mask, Some(format!("{SCAN}/a_depth_mask.npy")));
        assert_eq!(index.images[2].mask, None);
        assert_eq!(index.images[1].place, Place::Outdoor);
        assert_eq!(index.images[1].scene, "scene_00022");
        assert_eq!(index.images[1].scan, "scan_00193");
        assert_eq!(index.without_depth, [format!("{SCAN}/c.png")]);
    }

    #[test]
    fn a_folder_of_other_formats_is_answered_with_a_conversion() {
        let text = |unreadable, other_formats| {
            let path = PathBuf::from("album");
            FolderError::NoPictures { path, unreadable, other_formats }.of("photos").to_string()
        };
        let error = text(0, 6);
        assert!(error.contains("6 in formats that are not read (HEIC"), "{error}");
        assert!(error.contains("heif-convert") && !error.contains("right folder"), "{error}");
        assert!(
            text(2, 0)
                .ends_with("(2 cannot be read); pass --root photos=DIR with the right folder")
        );
    }

    #[test]
    fn a_folder_on_disk_is_listed_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let error = index_source("diode", dir.path()).unwrap_err().to_string();
        assert!(error.contains("pass --root diode=DIR"), "{error}");

        for name in ["indoors/scene_2/scan_1/x", "train/outdoor/scene_1/scan_1/y", "logs/scan_1/z"]
        {
            let stem = dir.path().join(name);
            fs::create_dir_all(stem.parent().unwrap()).unwrap();
            for ending in [".png", "_depth.npy", "_depth_mask.npy"] {
                let file = format!("{}{ending}", stem.display());
                render::atomic_file::write_relaxed(Path::new(&file), b"").unwrap();
            }
        }
        let archive = dir.path().join("indoors/scene_2/scan_1.zip");
        render::atomic_file::write_relaxed(&archive, b"").unwrap();
        let index = index_source("diode", dir.path()).unwrap();
        let colors: Vec<_> = index.images.iter().map(|i| i.color.as_str()).collect();
        assert_eq!(colors, ["indoors/scene_2/scan_1/x.png", "train/outdoor/scene_1/scan_1/y.png"]);

        let missing = dir.path().join("missing");
        let error = index_source("diode", &missing).unwrap_err().to_string();
        assert!(error.contains("missing") && error.contains("--root diode=DIR"), "{error}");
    }
}
