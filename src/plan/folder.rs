//! The layout `folder`: a tree of pictures without depth.
//!
//! Intrinsics come from the EXIF focal length for 35 mm film, or from a stated field of view. The place comes from the names of
//! sub-folders, or is stated.

use super::copies::{Copies, copies};
use super::diode::{FolderError, Index, IndexError, SourceImage};
use super::inputs::{InputFiles, StoreUnavailable, list_objects};
use super::source::Source;
use glasshouse_line::{
    DepthKind, Fill, Intrinsics, Orientation, Photograph, Sketch, Transfer, is_url,
};
use procedural::Place;
use render::file_tree::{FileId, FileTree, ListError, Visits, file_tree};
use render::formats::{NamedBytes, PictureSize};
use render::input_file::InputFile;
use render::scene::{FileEnds, FileRole, Look, look, look_at_whole};
use std::collections::BTreeMap;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};

/// Bytes at the start of a file that have its EXIF data and, nearly always, its size.
const HEAD_BYTES: usize = 1 << 17;
/// Diagonal of the 36 x 24 mm frame, to which EXIF's focal length for 35 mm film refers.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;
/// Field of view of the longer side without any statement, degrees: that of a phone's main camera.
const FIELD_OF_VIEW_DEG: f64 = 65.0;

/// Endings of pictures, in lower case, and the coding of their colours.
const ENDINGS: [(&str, Transfer); 6] = [
    ("jfif", Transfer::Srgb),
    ("jpg", Transfer::Srgb),
    ("jpeg", Transfer::Srgb),
    ("png", Transfer::Srgb),
    ("exr", Transfer::Linear),
    ("hdr", Transfer::Linear),
];

/// Endings of pictures that the program does not read.
const OTHER_ENDINGS: [&str; 14] = [
    "heic", "heif", "avif", "webp", "gif", "bmp", "tif", "tiff", "jxl", "dng", "nef", "cr2", "cr3",
    "arw",
];

/// A picture of a folder.
#[derive(Clone, Debug, PartialEq)]
pub struct FolderPicture {
    /// The picture with its intrinsics. Its path is relative to the folder, and its shape a placeholder.
    pub photograph: Photograph,
    /// Where it was taken: stated, told by a folder's name, or outdoor.
    pub place: Place,
}

/// The pictures of a folder.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FolderPictures {
    /// Pictures in the order of their paths.
    pub pictures: Vec<FolderPicture>,
    /// Pictures that cannot be read, and the reason.
    pub unreadable: Vec<(String, String)>,
    /// Remarks on the listing.
    of_tree: Vec<String>,
    /// Further names of pictures, which are left out.
    copies: Copies,
    /// Number of pictures in formats that the program does not read.
    other_formats: usize,
    /// Number of pictures whose place nothing tells.
    unknown_places: usize,
    /// Number of pictures whose focal length nothing tells.
    unknown_focal_lengths: usize,
}

impl FolderPictures {
    /// Returns remarks on what was assumed.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.of_tree.clone();
        notes.extend(self.copies.notes());
        if let Some((path, reason)) = self.unreadable.first() {
            let count = self.unreadable.len();
            notes.push(format!(
                "{count} pictures cannot be read and are left out (first: {path}: {reason})"
            ));
        }
        if self.other_formats > 0 {
            notes.push(format!(
                "{} pictures are neither JPEG, PNG, EXR nor HDR and are left out: convert them",
                self.other_formats
            ));
        }
        if self.unknown_places > 0 {
            notes.push(format!(
                "{} pictures are taken as outdoor, because no folder is named indoors or outdoor: sort them, or state the \
                 place",
                self.unknown_places
            ));
        }
        if self.unknown_focal_lengths > 0 {
            notes.push(format!(
                "{} pictures have no focal length in EXIF and are taken to see {FIELD_OF_VIEW_DEG} degrees along their \
                 longer side: state the field of view",
                self.unknown_focal_lengths
            ));
        }
        notes
    }
}

/// What is stated about a folder's pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FolderOptions {
    /// Place of all pictures.
    pub place: Option<Place>,
    /// Field of view of the longer side, degrees.
    pub field_of_view_deg: Option<f64>,
    pub orientation: Orientation,
    /// A folder below, by any name, whose pictures are left out.
    pub without: Option<FileId>,
}

/// Lists the pictures of the source `name` below `folder`, on a disk or in an object store.
pub(crate) fn index_folder(
    name: &str,
    folder: &Path,
    source: &Source,
    inputs: &dyn InputFiles,
) -> Result<Index, IndexError> {
    let options = FolderOptions {
        place: source.place,
        field_of_view_deg: source.field_of_view_deg,
        orientation: source.orientation,
        without: None,
    };
    let found = folder_pictures(folder, &options, inputs).map_err(|e| e.of(name))?;
    let image = |picture: &FolderPicture| {
        let mut photograph = picture.photograph.clone();
        photograph.highlights = source.highlights.filter(|_| photograph.transfer == Transfer::Srgb);
        photograph.fill = source.fill;
        let color = photograph.color.clone();
        SourceImage {
            color: color.clone(),
            depth: String::new(),
            depth_root: None,
            depth_range: None,
            mask: None,
            place: picture.place,
            scene: String::new(),
            scan: color,
            side: Some(photograph.into()),
            values: BTreeMap::new(),
            shared: None,
        }
    };
    let images = found.pictures.iter().map(image).collect();
    Ok(Index { images, notes: found.notes(), ..Index::default() })
}

/// Lists the pictures below `folder`.
pub fn folder_pictures(
    folder: &Path,
    options: &FolderOptions,
    inputs: &dyn InputFiles,
) -> Result<FolderPictures, FolderError> {
    let mut found = FolderPictures::default();
    let tree = if is_url(folder) {
        let failed = |e: StoreUnavailable| ListError {
            path: folder.to_owned(),
            source: io::Error::other(e.to_string()),
        };
        let mut files = list_objects(folder, inputs).map_err(failed)?;
        files.sort();
        FileTree { files, ..FileTree::default() }
    } else {
        let is_without = |id: FileId| Some(&id) == options.without.as_ref();
        let enters = |below: &str| !FileId::of(&folder.join(below)).is_ok_and(is_without);
        file_tree(folder, Visits::Once, &enters)?
    };
    found.of_tree = tree.notes();
    let not_text = |path| (path, "its name is not UTF-8".to_owned());
    found.unreadable.extend(tree.odd.into_iter().map(not_text));
    let mut names = Vec::new();
    for path in tree.files {
        let ending = path.rsplit_once('.').map_or("", |(_, ending)| ending).to_lowercase();
        match ENDINGS.into_iter().find(|(known, _)| *known == ending) {
            Some((_, transfer)) => names.push((path, transfer)),
            None => found.other_formats += usize::from(OTHER_ENDINGS.contains(&ending.as_str())),
        }
    }
    found.copies = copies(folder, &mut names, |(path, _)| path);
    for (path, transfer) in names {
        let picture = match Picture::read(&folder.join(&path), inputs) {
            Ok(picture) => picture,
            Err(reason) => {
                found.unreadable.push((path, reason));
                continue;
            }
        };
        let place = options.place.or_else(|| place_of(&path));
        found.unknown_places += usize::from(place.is_none());
        let focal = picture.focal_35_mm.filter(|_| options.field_of_view_deg.is_none());
        let is_unknown = focal.is_none() && options.field_of_view_deg.is_none();
        found.unknown_focal_lengths += usize::from(is_unknown);
        let size = picture.size.used_px(options.orientation);
        let photograph = Photograph {
            color: path,
            depth: String::new(),
            // Each scene draws its own.
            sketch: Some(Sketch::Plane { plane_m: 1.0 }),
            mask: None,
            orientation: options.orientation,
            transfer,
            depth_unit_m: 1.0,
            depth_none_code: None,
            depth_kind: DepthKind::default(),
            depth_range: None,
            intrinsics: intrinsics(size, focal, options.field_of_view_deg),
            exposure: 1.0,
            illuminant: [1.0; 3],
            highlights: None,
            fill: Fill::default(),
            apex: None,
            cards: Vec::new(),
        };
        let place = place.unwrap_or(Place::Outdoor);
        found.pictures.push(FolderPicture { photograph, place });
    }
    if found.pictures.is_empty() {
        return Err(FolderError::NoPictures {
            path: folder.to_owned(),
            unreadable: found.unreadable.len(),
            other_formats: found.other_formats,
        });
    }
    Ok(found)
}

/// Returns the place that a folder of the path names, the innermost first.
fn place_of(path: &str) -> Option<Place> {
    let (folders, _) = path.rsplit_once('/')?;
    folders.rsplit('/').find_map(|folder| {
        let name = folder.to_lowercase();
        let begins = |words: &[&str]| words.iter().any(|word| name.starts_with(word));
        if begins(&["indoor", "inside", "interior"]) {
            Some(Place::Indoors)
        } else if begins(&["outdoor", "outside", "exterior"]) {
            Some(Place::Outdoor)
        } else {
            None
        }
    })
}

/// Returns the intrinsics of a picture of `width` x `height` px with the principal point in its middle.
fn intrinsics(
    [width, height]: [usize; 2],
    focal_35_mm: Option<f64>,
    field_of_view_deg: Option<f64>,
) -> Intrinsics {
    let [w, h] = [width as f64, height as f64];
    let focal_px = if let Some(mm) = focal_35_mm {
        mm * libm::hypot(w, h) / FILM_DIAGONAL_MM
    } else {
        let degrees = field_of_view_deg.unwrap_or(FIELD_OF_VIEW_DEG);
        0.5 * w.max(h) / libm::tan(0.5 * degrees.to_radians())
    };
    let focal_px = super::draw::nine_digits(focal_px);
    let size = Some([width, height].map(|side| side as u32));
    Intrinsics { fx: focal_px, fy: focal_px, cx: 0.5 * w, cy: 0.5 * h, size }
}

/// The size and the focal length of a picture.
struct Picture {
    size: PictureSize,
    focal_35_mm: Option<f64>,
}

impl Picture {
    fn read(path: &Path, inputs: &dyn InputFiles) -> Result<Self, String> {
        let (start, length) = head(path, inputs).map_err(|e| e.to_string())?;
        let focal_35_mm = focal_35_mm(&start);
        let start = NamedBytes { path: PathBuf::from("it"), bytes: start };
        let ends = FileEnds { start, end: None, length };
        let size = match look(FileRole::Color, &ends).map_err(|e| e.to_string())? {
            Look::Sound(size) => size,
            Look::Unsure => {
                let bytes = inputs.read(path).map_err(|e| e.to_string())?;
                let file = NamedBytes { path: PathBuf::from("it"), bytes };
                look_at_whole(FileRole::Color, &file).map_err(|e| e.to_string())?
            }
        };
        let size = size.ok_or("it has no size")?;
        Ok(Self { size, focal_35_mm })
    }
}

/// Reads the first bytes of a file, and its length.
fn head(path: &Path, inputs: &dyn InputFiles) -> io::Result<(Vec<u8>, u64)> {
    if is_url(path) {
        return inputs.read_start(path, HEAD_BYTES);
    }
    let file = InputFile::open(path)?;
    let length = file.len();
    let mut start = Vec::with_capacity(HEAD_BYTES.min(length as usize));
    file.take(HEAD_BYTES as u64).read_to_end(&mut start)?;
    Ok((start, length))
}

/// Returns the EXIF focal length for 35 mm film, mm, if it is a possible one.
fn focal_35_mm(start: &[u8]) -> Option<f64> {
    let data = exif::Reader::new().read_from_container(&mut Cursor::new(start)).ok()?;
    let field = data.get_field(exif::Tag::FocalLengthIn35mmFilm, exif::In::PRIMARY)?;
    let mm = f64::from(field.value.get_uint(0)?);
    (1.0..=2000.0).contains(&mm).then_some(mm)
}
