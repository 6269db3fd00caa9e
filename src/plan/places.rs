//! Lists the photographs of a PLACES365 folder with their estimated depth maps.
//!
//! ```text
//! ROOT/       [data_*/][train/|val/][LETTER/]CATEGORY[/KIND]/NAME.(jpg|jpeg|jfif|png)
//! DEPTH_ROOT/ the same folders/NAME_depth(.npy|.pfm|.exr|.png), or NAME.*, or NAME-MODEL.* as MiDaS writes them
//! ```
//!
//! A table lists the categories and their depth ranges.

use super::diode::{FolderError, Index, IndexError, SourceImage};
use glasshouse_line::DepthRange;
use procedural::Place;
use render::file_tree::{FileTree, Visits, file_tree};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Schema name of a table of categories.
pub const DEPTH_RANGES_SCHEMA: &str = "glasshouse.depth_ranges/1";

/// File name extensions of depth maps, in order of preference.
const DEPTHS: [&str; 4] = ["npy", "pfm", "exr", "png"];

/// `depth-ranges.toml`: categories of PLACES365 with their depth ranges.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthRanges {
    /// Always [`DEPTH_RANGES_SCHEMA`].
    pub schema: String,
    /// Categories by their name in the official list, such as `bedroom` or `library/indoor`.
    pub category: BTreeMap<String, Category>,
}

/// A category of photographs, such as bedrooms.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Category {
    /// Indoors or outdoors.
    pub place: Place,
    /// Metric range of relative depths.
    pub range: DepthRange,
    /// Reason for the range.
    pub why: String,
}

/// Error of a table that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DepthRangesError {
    #[error("{0}")]
    Toml(#[from] Box<toml::de::Error>),
    /// A schema other than [`DEPTH_RANGES_SCHEMA`].
    #[error("its schema is {0:?}, but must be \"glasshouse.depth_ranges/1\"")]
    Schema(String),
    #[error("it names no category: add [category.NAME] with place, range and why")]
    Empty,
    #[error("{0}")]
    Range(#[from] glasshouse_line::LineError),
}

impl DepthRanges {
    /// Returns the table that ships with the program, `manifests/depth-ranges.toml`, with 34 categories.
    pub fn shipped() -> Self {
        Self::parse(include_str!("../../manifests/depth-ranges.toml"))
            .expect("the shipped table is tested")
    }

    /// Returns the names of all indoor or all outdoor categories, sorted.
    pub fn categories_of(&self, place: Place) -> Vec<&str> {
        let wanted = self.category.iter().filter(|(_, c)| c.place == place);
        wanted.map(|(name, _)| name.as_str()).collect()
    }

    /// Reads and checks a table.
    pub fn parse(text: &str) -> Result<Self, DepthRangesError> {
        let table: Self = toml::from_str(text).map_err(Box::new)?;
        if table.schema != DEPTH_RANGES_SCHEMA {
            return Err(DepthRangesError::Schema(table.schema));
        }
        if table.category.is_empty() {
            return Err(DepthRangesError::Empty);
        }
        for (name, category) in &table.category {
            category.range.validate(&format!("category.{name}.range"))?;
        }
        Ok(table)
    }

    /// Finds the category of a photograph by the photograph's path. Returns the category's name and its entry.
    fn category_of<'t, 'p>(&'t self, path: &'p str) -> Option<(&'p str, &'t Category)> {
        let (mut folder, _) = path.rsplit_once('/')?;
        while let Some((first, rest)) = folder.split_once('/')
            && (first.starts_with("data_") || matches!(first, "train" | "val"))
        {
            folder = rest;
        }
        if let Some((letter, rest)) = folder.split_once('/')
            && letter.len() == 1
            && rest.starts_with(letter)
        {
            folder = rest;
        }
        self.category.get_key_value(folder).map(|(_, c)| (folder, c))
    }

    /// Finds the photographs of the table's categories among `colors`, and their depth maps among `depths`. The depth
    /// maps are below the root `depth_root`. Paths have `/` as separator.
    pub fn index(&self, colors: &[String], depths: &[String], depth_root: &str) -> Index {
        let mut maps: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for depth in depths {
            if let Some((stem, _)) = depth.rsplit_once('.') {
                maps.entry(stem).or_default().push(depth);
            }
        }
        let mut sorted: Vec<&String> = colors.iter().collect();
        sorted.sort();
        let mut index = Index::default();
        for color in sorted {
            let Some((stem, ending)) = color.rsplit_once('.') else {
                continue;
            };
            if !["jpg", "jpeg", "jfif", "png"].contains(&ending.to_ascii_lowercase().as_str()) {
                continue;
            }
            let Some((name, category)) = self.category_of(color) else {
                continue;
            };
            let Some(depth) = map_of(&maps, stem) else {
                index.without_depth.push(color.clone());
                continue;
            };
            index.images.push(SourceImage {
                color: color.clone(),
                depth: depth.to_owned(),
                depth_root: Some(depth_root.to_owned()),
                depth_range: Some(category.range),
                mask: None,
                place: category.place,
                scene: name.to_owned(),
                // PLACES365 does not mark photographs from one standpoint, so each photograph is its own scan.
                scan: stem.to_owned(),
                side: None,
                values: BTreeMap::new(),
                shared: None,
            });
        }
        index
    }
}

/// Paths of a source: folders of photographs and depth maps, and the table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacesFolders<'a> {
    pub color: &'a Path,
    pub depth: &'a Path,
    pub table: &'a Path,
}

/// Lists the photographs of the source `name` in the table's categories. `list` returns the files of a URL, and `None`
/// for a local folder.
pub(crate) fn index_places(
    name: &str,
    folders: &PlacesFolders,
    list: &dyn Fn(&Path) -> Option<Vec<String>>,
) -> Result<Index, IndexError> {
    let table = |reason: &dyn std::fmt::Display| IndexError::Table {
        name: name.to_owned(),
        path: folders.table.to_owned(),
        reason: reason.to_string(),
    };
    let text = render::input_file::read_to_string(folders.table).map_err(|e| table(&e))?;
    let ranges = DepthRanges::parse(&text).map_err(|e| table(&e))?;
    // Each folder is that of a root of its own, which an error names.
    let all = |root: &str, folder: &Path, visits, enters: &dyn Fn(&str) -> bool| match list(folder)
    {
        Some(files) => Ok(FileTree { files, ..FileTree::default() }),
        None => file_tree(folder, visits, enters).map_err(|e| FolderError::from(e).of(root)),
    };
    let colors = all(name, folders.color, Visits::Once, &|_| true)?;
    // Depth maps are looked up by the names of photographs, so links between their folders stay names of them.
    let with_color = folders_of(&colors.files);
    let depths = all(&depth_root(name), folders.depth, Visits::EveryName, &|folder| {
        with_color.contains(folder)
    })?;
    let mut index = ranges.index(&colors.files, &depths.files, &depth_root(name));
    index.notes = colors.notes();
    if index.images.is_empty() {
        return Err(IndexError::NoPlaces {
            name: name.to_owned(),
            path: folders.color.to_owned(),
            depth_path: folders.depth.to_owned(),
            table: folders.table.display().to_string(),
            without_depth: index.without_depth.len(),
        });
    }
    Ok(index)
}

/// Returns all folders of these files, with those around them.
fn folders_of(files: &[String]) -> BTreeSet<&str> {
    let mut folders = BTreeSet::new();
    for file in files {
        let mut path = file.as_str();
        while let Some((folder, _)) = path.rsplit_once('/')
            && folders.insert(folder)
        {
            path = folder;
        }
    }
    folders
}

/// Returns the name of the root of a source's depth maps.
pub(super) fn depth_root(name: &str) -> String {
    format!("{name}-depth")
}

/// Selects the depth map of a photograph, by preference of name, then of extension.
fn map_of<'m>(maps: &BTreeMap<&'m str, Vec<&'m str>>, stem: &str) -> Option<&'m str> {
    let depth = format!("{stem}_depth");
    let model = format!("{stem}-");
    let with_model = maps.range(model.as_str()..).next();
    let with_model = with_model.filter(|(name, _)| name.starts_with(&model));
    // `depth` links PNG photographs beside their maps, so `_depth` goes first.
    let named = [maps.get(depth.as_str()), maps.get(stem), with_model.map(|(_, m)| m)];
    named.into_iter().flatten().find_map(|maps| {
        let of = |format: &str| {
            let has = |map: &&&str| map.rsplit_once('.').is_some_and(|(_, e)| e == format);
            maps.iter().find(has).copied()
        };
        DEPTHS.into_iter().find_map(of)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use procedural::{
        PLACES_COLOR, PLACES_DEPTH, PlacesPhotograph, places_intrinsics, places_listing,
        render_through, write_places,
    };

    const TABLE: &str = r#"
schema = "glasshouse.depth_ranges/1"
[category.bedroom]
place = "indoors"
range = { mean_m = 4.0 }
why = "the paper"
[category."library/indoor"]
place = "indoors"
range = { near_m = 1, far_m = 20 }
why = "a guess"
[category.alley]
place = "outdoor"
range = { mean_m = 12.0, far_over_near = 12 }
why = "a guess"
"#;

    fn paths(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn photographs_are_listed_with_category_and_depth() {
        let table = DepthRanges::parse(TABLE).unwrap();
        let colors = paths(&[
            "data_256/a/alley/2.jpg",
            "data_256/a/alley/1.JPG",
            "b/bedroom/1.png",
            "bedroom/9.jpeg",
            "l/library/indoor/1.jpg",
            "l/library/outdoor/1.jpg",
            "k/kitchen/1.jpg",
            "b/bedroom/notes.txt",
            "x/y/alley/1.jpg",
            "alley.jpg",
        ]);
        let depths = paths(&[
            "data_256/a/alley/2-dpt_large_384.pfm",
            "data_256/a/alley/2-dpt_large_384.png",
            "data_256/a/alley/1.png",
            "data_256/a/alley/1.npy",
            "b/bedroom/1.png",
            "b/bedroom/1_depth.exr",
            "l/library/indoor/1.npy",
            "l/library/indoor/10.npy",
        ]);
        let index = table.index(&colors, &depths, "p-depth");
        let found: Vec<_> = index
            .images
            .iter()
            .map(|i| (i.color.as_str(), i.depth.as_str(), i.scene.as_str()))
            .collect();
        assert_eq!(
            found,
            [
                ("b/bedroom/1.png", "b/bedroom/1_depth.exr", "bedroom"),
                ("data_256/a/alley/1.JPG", "data_256/a/alley/1.npy", "alley"),
                ("data_256/a/alley/2.jpg", "data_256/a/alley/2-dpt_large_384.pfm", "alley"),
                ("l/library/indoor/1.jpg", "l/library/indoor/1.npy", "library/indoor"),
            ]
        );
        assert_eq!(index.images[0].place, Place::Indoors);
        assert_eq!(index.images[1].place, Place::Outdoor);
        assert_eq!(index.images[0].depth_root.as_deref(), Some("p-depth"));
        assert!(matches!(index.images[0].depth_range, Some(DepthRange::Mean { mean_m: 4.0, .. })));
        assert_eq!(index.without_depth, ["bedroom/9.jpeg"]);
    }

    #[test]
    fn errors_of_a_table_name_the_problem() {
        for (from, to, words) in [
            ("ranges/1", "ranges/2", "its schema is"),
            ("mean_m = 4.0", "mean_m = 0.0", "category.bedroom.range.mean_m is 0"),
            ("\"indoors\"", "\"inside\"", "unknown variant `inside`"),
            ("why = \"the paper\"", "", "missing field `why`"),
        ] {
            let error = DepthRanges::parse(&TABLE.replacen(from, to, 1)).unwrap_err();
            assert!(error.to_string().contains(words), "{error}");
        }
    }

    #[test]
    fn the_shipped_table_has_34_categories_of_the_official_list() {
        let shipped = include_str!("../../manifests/depth-ranges.toml");
        let table = DepthRanges::parse(shipped).unwrap();
        assert_eq!(table.category.len(), 34);
        let bedroom = &table.category["bedroom"];
        assert!(matches!(bedroom.range, DepthRange::Mean { mean_m: 4.0, .. }));
        assert!(table.category.values().all(|c| c.why.len() > 10));
    }

    /// Lists a procedural set in the categories of the shipped table.
    fn listing(count: usize, seed: u64) -> Vec<PlacesPhotograph> {
        let table = DepthRanges::shipped();
        let [indoors, outdoors] = [Place::Indoors, Place::Outdoor].map(|p| table.categories_of(p));
        places_listing(count, seed, &indoors, &outdoors)
    }

    #[test]
    fn indoor_and_outdoor_categories_each_get_equal_numbers() {
        let photographs = listing(4080, 1);
        assert_eq!(listing(100, 1), photographs[..100]);
        let mut counts = BTreeMap::new();
        let mut paths = BTreeSet::new();
        for p in &photographs {
            *counts.entry(p.category.as_str()).or_insert(0) += 1;
            assert!(paths.insert(p.color_path()));
        }
        assert_eq!(counts.len(), 34);
        let table = DepthRanges::shipped();
        for (category, count) in counts {
            let expected = match table.category[category].place {
                Place::Indoors => 102,
                Place::Outdoor => 145,
            };
            assert!((expected..=expected + 1).contains(&count), "{category}: {count}");
        }
        assert_eq!(photographs[0].color_path(), Path::new("a/airport_terminal/00000001.jpg"));
    }

    #[test]
    fn the_index_lists_all_procedural_files() {
        let folder = tempfile::tempdir().unwrap();
        let photographs = listing(6, 3);
        for photograph in &photographs {
            write_places(folder.path(), photograph, 48, 40).unwrap();
        }
        let table = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../manifests/depth-ranges.toml");
        let folders = PlacesFolders {
            color: &folder.path().join(PLACES_COLOR),
            depth: &folder.path().join(PLACES_DEPTH),
            table: &table,
        };
        let index = index_places("places", &folders, &|_| None).unwrap();
        assert!(index.without_depth.is_empty());
        let found: BTreeSet<_> = index.images.iter().map(|i| i.color.clone()).collect();
        let made = photographs.iter().map(PlacesPhotograph::color_path);
        assert_eq!(found, made.map(|p| p.to_string_lossy().into_owned()).collect());

        let photograph = &photographs[1];
        let rgbd = render_through(&photograph.photograph, &places_intrinsics(48, 40), 48, 40);
        let depth = image::open(folders.depth.join(photograph.depth_path())).unwrap();
        let codes = depth.as_luma16().expect("16-bit grey").as_raw().clone();
        assert_eq!((codes.iter().min(), codes.iter().max()), (Some(&0), Some(&65535)));
        // Codes are larger for nearer pixels, and the map has no holes.
        let mut order: Vec<usize> = (0..codes.len()).collect();
        order.sort_by_key(|&i| codes[i]);
        for pair in order.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|i| rgbd.inverse_depth_per_m[i]);
            assert!(codes[pair[0]] == codes[pair[1]] || a < b, "{a} {b}");
        }
        let color = image::open(folders.color.join(photograph.color_path())).unwrap();
        let off = color
            .into_rgb8()
            .into_raw()
            .iter()
            .zip(&rgbd.rgb)
            .map(|(a, b)| u32::from(a.abs_diff(*b)))
            .sum::<u32>();
        assert!(f64::from(off) / f64::from(48 * 40 * 3) < 8.0, "{off}");
    }
}
