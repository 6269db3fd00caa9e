//! The layout `folder`: a tree of pictures without depth.
//!
//! Intrinsics come from the EXIF focal length for 35 mm film, or from a stated field of view. The place comes from the names of
//! sub-folders, or is stated.

use super::diode::{Index, IndexError, SourceImage, files_below};
use super::inputs::InputFiles;
use super::source::Source;
use procedural::Place;
use render::formats::{NamedBytes, PictureSize};
use render::input_file::InputFile;
use render::line::{Apex, Intrinsics, Photograph, Sketch, Transfer, is_url};
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
const ENDINGS: [(&str, Transfer); 5] = [
    ("jpg", Transfer::Srgb),
    ("jpeg", Transfer::Srgb),
    ("png", Transfer::Srgb),
    ("exr", Transfer::Linear),
    ("hdr", Transfer::Linear),
];

/// The pictures of a folder, and remarks about them.
pub(crate) struct FolderIndex {
    pub(crate) index: Index,
    pub(crate) notes: Vec<String>,
}

/// Lists the pictures of the source `name` below `folder`, on a disk or in an object store.
pub(crate) fn index_folder(
    name: &str,
    folder: &Path,
    source: &Source,
    inputs: &dyn InputFiles,
) -> Result<FolderIndex, IndexError> {
    let mut paths = if is_url(folder) {
        let failed = |e: super::inputs::StoreUnavailable| IndexError::Read {
            name: name.to_owned(),
            path: folder.to_owned(),
            source: io::Error::other(e.to_string()),
        };
        inputs.list(folder).map_err(failed)?
    } else {
        files_below(name, folder, |path| !path.rsplit('/').next().unwrap_or(path).starts_with('.'))?
    };
    paths.sort();
    let (mut images, mut unknown, mut without_focal) = (Vec::new(), 0usize, 0usize);
    let mut unreadable: Vec<String> = Vec::new();
    for path in paths {
        let Some(transfer) = transfer_of(&path) else { continue };
        let picture = match Picture::read(&folder.join(&path), inputs) {
            Ok(picture) => picture,
            Err(reason) => {
                unreadable.push(format!("{path}: {reason}"));
                continue;
            }
        };
        let place = place_of(&path);
        unknown += usize::from(place.is_none() && source.place.is_none());
        let focal = if source.field_of_view_deg.is_some() { None } else { picture.focal_35_mm };
        without_focal += usize::from(focal.is_none() && source.field_of_view_deg.is_none());
        let photograph = Photograph {
            color: path.clone(),
            depth: String::new(),
            // Each scene draws its own.
            sketch: Some(Sketch::Plane { plane_m: 1.0 }),
            mask: None,
            orientation: source.orientation,
            transfer,
            depth_unit_m: 1.0,
            depth_kind: Default::default(),
            depth_range: None,
            intrinsics: intrinsics(picture.size.used_px(source.orientation), focal, source),
            exposure: 1.0,
            illuminant: [1.0; 3],
            highlights: source.highlights.filter(|_| transfer == Transfer::Srgb),
            fill: source.fill,
            apex: None::<Apex>,
            cards: Vec::new(),
        };
        images.push(SourceImage {
            color: path.clone(),
            depth: String::new(),
            depth_root: None,
            depth_range: None,
            mask: None,
            place: source.place.or(place).unwrap_or(Place::Outdoor),
            scene: String::new(),
            scan: path,
            side: Some(photograph.into()),
            values: BTreeMap::new(),
        });
    }
    if images.is_empty() {
        return Err(IndexError::NoPictures {
            name: name.to_owned(),
            path: folder.to_owned(),
            unreadable: unreadable.len(),
        });
    }
    let mut notes = Vec::new();
    if let Some(first) = unreadable.first() {
        let count = unreadable.len();
        notes.push(format!(
            "source {name}: {count} pictures cannot be read and are left out (first: {first})"
        ));
    }
    if unknown > 0 {
        notes.push(format!(
            "source {name}: {unknown} pictures are taken as outdoor, because no folder is named indoors or outdoor: sort \
             them, or set place"
        ));
    }
    if without_focal > 0 {
        notes.push(format!(
            "source {name}: {without_focal} pictures have no focal length in EXIF and are taken to see {FIELD_OF_VIEW_DEG} \
             degrees along their longer side: set field_of_view_deg"
        ));
    }
    Ok(FolderIndex { index: Index { images, without_depth: Vec::new() }, notes })
}

/// Returns the coding of a picture's colours by its ending; `None` for other files.
fn transfer_of(path: &str) -> Option<Transfer> {
    let ending = path.rsplit_once('.')?.1.to_lowercase();
    ENDINGS.into_iter().find(|(known, _)| *known == ending).map(|(_, transfer)| transfer)
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
    source: &Source,
) -> Intrinsics {
    let [w, h] = [width as f64, height as f64];
    let focal_px = match focal_35_mm {
        Some(mm) => mm * libm::hypot(w, h) / FILM_DIAGONAL_MM,
        None => {
            let degrees = source.field_of_view_deg.unwrap_or(FIELD_OF_VIEW_DEG);
            0.5 * w.max(h) / libm::tan(0.5 * degrees.to_radians())
        }
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
