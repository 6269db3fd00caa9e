//! Checks an input file by its beginning and end.
//!
//! Refuses no file that a scene can use: if the header is not conclusive, the caller reads the whole file. [`look`]
//! does not check the pixels (NaN, no valid depth).

use super::depth::DepthCodes;
use super::{color, depth, mask, panorama, smudges};
use crate::formats::PictureSize;
use crate::formats::error::SceneError;
use crate::formats::files::{FileFormat, NamedBytes};
use crate::formats::{jpeg, ply, raster};
use glasshouse_line::{Orientation, Transfer};

/// Number of bytes at a file's start that contain the header of most files; a JPEG may have a preview before its size.
pub const START_BYTES: usize = 1 << 14;
/// Number of bytes at a file's end that contain the end marker of a PNG or JPEG.
pub const END_BYTES: usize = 16;

/// Role of a file in a scene line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FileRole {
    Color,
    Depth,
    Mask,
    /// The colours of a panorama.
    Panorama,
    /// The depth map of a panorama.
    PanoramaDepth,
    Mesh,
    /// The picture of a card.
    Card,
    /// The map of a pane's smudges.
    Smudges,
}

/// The beginning and the end of a file.
#[derive(Clone, Debug)]
pub struct FileEnds {
    /// Name and first [`START_BYTES`] bytes or more; the whole file, if it is not longer.
    pub start: NamedBytes,
    /// Last [`END_BYTES`] bytes, if they were read.
    pub end: Option<Vec<u8>>,
    /// Length of the whole file, bytes.
    pub length: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// No error. Holds the size; `None` for a mesh.
    Sound(Option<PictureSize>),
    /// The parts are not conclusive, so the whole file must be read.
    Unsure,
}

/// Checks the parts of a file.
pub fn look(role: FileRole, ends: &FileEnds) -> Result<Look, SceneError> {
    let (file, length) = (&ends.start, ends.length);
    let is_whole = file.bytes.len() as u64 == length;
    match size(role, file, length) {
        Ok(size) if ends_well(ends, is_whole) => Ok(Look::Sound(size)),
        Ok(_) => Ok(Look::Unsure),
        // The header may be longer than the part that was read.
        Err(SceneError::Unreadable { .. }) if !is_whole => Ok(Look::Unsure),
        Err(error) => Err(error),
    }
}

/// Checks a whole file after [`Look::Unsure`].
pub fn look_at_whole(role: FileRole, file: &NamedBytes) -> Result<Option<PictureSize>, SceneError> {
    let size = size(role, file, file.bytes.len() as u64)?;
    let is_jpeg = file.bytes.starts_with(&[0xff, 0xd8, 0xff]);
    // The check of a JPEG reads all of its data, so decoding would only cost time.
    if !(is_jpeg && jpeg::check(&file.bytes).is_ok()) {
        match role {
            FileRole::Smudges => drop(smudges::decode_map(file)?),
            FileRole::Color | FileRole::Panorama => {
                drop(color::decode(file, Orientation::Stored, Transfer::Linear, [1.0; 3])?);
            }
            FileRole::Depth | FileRole::PanoramaDepth => {
                drop(depth::decode(file, Orientation::Stored, DepthCodes::PLAIN)?);
            }
            FileRole::Mask => drop(mask::decode(file, Orientation::Stored)?),
            FileRole::Mesh => drop(ply::decode(file)?),
            FileRole::Card => drop(color::decode_with_alpha(file, Transfer::Linear, [1.0; 3])?),
        }
    }
    Ok(size)
}

fn size(role: FileRole, file: &NamedBytes, length: u64) -> Result<Option<PictureSize>, SceneError> {
    Ok(match role {
        FileRole::Color | FileRole::Smudges => Some(color::size(file, length)?),
        FileRole::Card => {
            color::straight_format(file)?;
            Some(color::size(file, length)?)
        }
        FileRole::Depth => Some(depth::size(file, length)?),
        FileRole::Mask => Some(mask::size(file, length)?),
        FileRole::Panorama => Some(whole_sphere(file, color::size(file, length)?)?),
        FileRole::PanoramaDepth => Some(whole_sphere(file, depth::size(file, length)?)?),
        FileRole::Mesh => {
            ply::head(file, length)?;
            None
        }
    })
}

fn whole_sphere(file: &NamedBytes, size: PictureSize) -> Result<PictureSize, SceneError> {
    let [width, height] = size.upright_px();
    panorama::check_aspect(file, width, height)?;
    Ok(size)
}

/// True if a PNG or JPEG ends with its end marker (and the data of a whole JPEG are sound), or if a PNM is long enough. Also true for other formats, and if the
/// end was not read.
fn ends_well(ends: &FileEnds, is_whole: bool) -> bool {
    let end = match &ends.end {
        _ if is_whole => &ends.start.bytes,
        Some(end) => end,
        None => return true,
    };
    match ends.start.format("") {
        Ok(FileFormat::Png) => end.ends_with(b"IEND\xae\x42\x60\x82"),
        Ok(FileFormat::Jpeg) => {
            end.ends_with(&[0xff, 0xd9]) && !(is_whole && jpeg::check(&ends.start.bytes).is_err())
        }
        Ok(FileFormat::Pnm) => raster::head(&ends.start, FileFormat::Pnm)
            .is_ok_and(|head| ends.length >= head.pnm_bytes(&ends.start.bytes)),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::exr_raster::tests::exr;
    use crate::formats::npy::tests::npy;
    use crate::formats::raster::tests::{jpeg, png};
    use ::exr::prelude::FlatSamples;
    use image::ExtendedColorType as Png;
    use proptest::prelude::*;

    fn ends(file: &NamedBytes, start: usize) -> FileEnds {
        let bytes = &file.bytes;
        FileEnds {
            start: NamedBytes {
                path: file.path.clone(),
                bytes: bytes[..start.min(bytes.len())].to_vec(),
            },
            end: Some(bytes[bytes.len().saturating_sub(END_BYTES)..].to_vec()),
            length: bytes.len() as u64,
        }
    }

    fn sound(role: FileRole, file: &NamedBytes, start: usize) -> Option<[usize; 2]> {
        match look(role, &ends(file, start)) {
            Ok(Look::Sound(size)) => size.map(PictureSize::upright_px),
            other => panic!("{other:?}"),
        }
    }

    fn whole(role: FileRole, file: &NamedBytes) -> Option<[usize; 2]> {
        look_at_whole(role, file).unwrap().map(PictureSize::upright_px)
    }

    fn noise(count: usize) -> Vec<u8> {
        (0..count as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect()
    }

    #[test]
    fn headers_give_the_size() {
        let size = Some([64, 48]);
        let color = png(&noise(64 * 48 * 3), 64, 48, Png::Rgb8);
        assert_eq!(sound(FileRole::Color, &color, 200), size);
        assert_eq!(sound(FileRole::Color, &color, usize::MAX), size);
        let color = png(&noise(64 * 32 * 3), 64, 32, Png::Rgb8);
        assert_eq!(sound(FileRole::Panorama, &color, 200), Some([64, 32]));
        let color = jpeg(&noise(64 * 48 * 3), 64, 48);
        assert_eq!(sound(FileRole::Color, &color, 1000), size);
        let depth = npy("<f4", false, "(48, 64, 1)", &[0; 64 * 48 * 4]);
        assert_eq!(sound(FileRole::Depth, &depth, 200), size);
        assert_eq!(sound(FileRole::Mask, &depth, 200), size);
        let depth = exr(64, 48, &[("Z", FlatSamples::F32(vec![1.0; 64 * 48]))]);
        assert_eq!(sound(FileRole::Depth, &depth, usize::MAX), size);
        let mut header = b"Pf\n64 48\n-1\n".to_vec();
        header.resize(header.len() + 64 * 48 * 4, 0);
        let depth = NamedBytes { path: "d.pfm".into(), bytes: header };
        assert_eq!(sound(FileRole::Depth, &depth, 100), size);
        let grey = NamedBytes { path: "m.pgm".into(), bytes: b"P5 2 1 255 ab".to_vec() };
        assert_eq!(whole(FileRole::Mask, &grey), Some([2, 1]));
    }

    #[test]
    fn wrong_formats_are_refused_by_their_beginning() {
        let rgb = png(&noise(64 * 48 * 3), 64, 48, Png::Rgb8);
        let jpeg = jpeg(&noise(64 * 48 * 3), 64, 48);
        let booleans = npy("|b1", false, "(48, 64)", &[0; 64 * 48]);
        let cube = npy("<f4", false, "(4, 4, 4, 4)", &[0; 1024]);
        let short = npy("<f4", false, "(48, 64)", &[0; 64 * 48 * 4 - 1]);
        let empty = NamedBytes { path: "e.png".into(), bytes: Vec::new() };
        for (role, file, words) in [
            (FileRole::Depth, &rgb, "3 channels"),
            (FileRole::Depth, &jpeg, "JPEG, which alters depths"),
            (FileRole::Depth, &booleans, "booleans"),
            (FileRole::Mask, &jpeg, "is JPEG"),
            (FileRole::Color, &booleans, "elements of type b1"),
            (FileRole::Color, &cube, "an array of shape"),
            (FileRole::Color, &empty, "is empty"),
            (FileRole::Mesh, &rgb, "a PNG file"),
            (FileRole::Panorama, &rgb, "64x48 pixels"),
            (FileRole::PanoramaDepth, &rgb, "3 channels"),
        ] {
            let error = look(role, &ends(file, 1000)).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        // A decoder's error counts only for the whole file.
        let looked = look(FileRole::Depth, &ends(&short, 1000)).unwrap();
        assert_eq!(looked, Look::Unsure);
        let error = look_at_whole(FileRole::Depth, &short).unwrap_err();
        let words = "needs 12288 bytes of data, but the file has 12287";
        assert!(error.to_string().contains(words), "{error}");
    }

    #[test]
    fn a_file_that_ends_early_is_read_as_a_whole() {
        let sound =
            [png(&noise(64 * 48 * 3), 64, 48, Png::Rgb8), jpeg(&noise(64 * 48 * 3), 64, 48)];
        for mut file in sound {
            assert_eq!(whole(FileRole::Color, &file), Some([64, 48]));
            file.bytes.truncate(file.bytes.len() * 3 / 4);
            for start in [1000, usize::MAX] {
                assert_eq!(look(FileRole::Color, &ends(&file, start)).unwrap(), Look::Unsure);
            }
            assert!(matches!(
                look_at_whole(FileRole::Color, &file),
                Err(SceneError::Unreadable { .. })
            ));
            file.bytes.truncate(20);
            assert!(look(FileRole::Color, &ends(&file, 1000)).is_err());
        }
    }

    /// Bytes after the image are not an error, because a scene can use the file.
    #[test]
    fn bytes_after_the_image_do_not_matter() {
        for mut file in [png(&noise(12), 2, 2, Png::Rgb8), jpeg(&noise(192), 8, 8)] {
            file.bytes.extend([7; 40]);
            assert_eq!(look(FileRole::Color, &ends(&file, 1000)).unwrap(), Look::Unsure);
            assert!(look_at_whole(FileRole::Color, &file).unwrap().is_some());
        }
    }

    #[test]
    fn a_long_header_is_accepted() {
        let mut file = jpeg(&noise(192), 8, 8);
        let mut note = vec![0xff, 0xe1, 0xea, 0x60];
        note.resize(2 + 60_000, 0);
        file.bytes.splice(2..2, note);
        assert_eq!(look(FileRole::Color, &ends(&file, START_BYTES)).unwrap(), Look::Unsure);
        assert_eq!(whole(FileRole::Color, &file), Some([8, 8]));
    }

    /// True if the whole file can be decoded, as for a scene.
    fn is_decoded(role: FileRole, file: &NamedBytes) -> bool {
        let is_sphere = |w, h| panorama::check_aspect(file, w, h).is_ok();
        let color = || color::decode(file, Orientation::Upright, Transfer::Linear, [1.0; 3]);
        let depth = || depth::decode(file, Orientation::Upright, DepthCodes::PLAIN);
        match role {
            FileRole::Color => color().is_ok(),
            FileRole::Smudges => smudges::decode_map(file).is_ok(),
            FileRole::Depth => depth().is_ok(),
            FileRole::Mask => mask::decode(file, Orientation::Upright).is_ok(),
            FileRole::Panorama => color().is_ok_and(|c| is_sphere(c.width, c.height)),
            FileRole::PanoramaDepth => depth().is_ok_and(|d| is_sphere(d.width, d.height)),
            FileRole::Mesh => ply::decode(file).is_ok(),
            FileRole::Card => color::decode_with_alpha(file, Transfer::Linear, [1.0; 3]).is_ok(),
        }
    }

    const ROLES: [FileRole; 8] = [
        FileRole::Color,
        FileRole::Depth,
        FileRole::Mask,
        FileRole::Panorama,
        FileRole::PanoramaDepth,
        FileRole::Mesh,
        FileRole::Card,
        FileRole::Smudges,
    ];

    const MESH: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 1 9 9 9\n1 0 1 9 9 9\n0 1 1 9 9 9\n3 0 1 2\n";

    proptest! {
        /// A damaged file is refused only if a scene cannot use it.
        #[test]
        fn refused_files_cannot_be_decoded(
            kind in 0usize..10,
            role in prop::sample::select(ROLES.to_vec()),
            flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..3),
            keep in prop::option::of(any::<prop::sample::Index>()),
            behind in 0usize..40,
            start in prop::sample::select(vec![20usize, 60, 200, usize::MAX]),
        ) {
            let mut file = match kind {
                0 => png(&noise(8 * 6 * 3), 8, 6, Png::Rgb8),
                1 => png(&noise(8 * 6 * 2), 8, 6, Png::L16),
                2 => jpeg(&noise(8 * 8 * 3), 8, 8),
                3 => npy("<f4", false, "(6, 8)", &[60; 192]),
                4 => exr(8, 6, &[("Z", FlatSamples::F32(vec![1.0; 48]))]),
                5 => NamedBytes { path: "a".into(), bytes: [&b"P5 8 6 255 "[..], &noise(48)].concat() },
                6 => NamedBytes { path: "a".into(), bytes: [&b"Pf\n8 6\n-1\n"[..], &[60; 192]].concat() },
                7 => NamedBytes { path: "a".into(), bytes: MESH.as_bytes().to_vec() },
                8 => png(&noise(12 * 6), 12, 6, Png::L8),
                _ => npy("|u1", true, "(6, 8, 3)", &noise(144)),
            };
            if let Some(keep) = keep {
                let keep = keep.index(file.bytes.len());
                file.bytes.truncate(keep);
            }
            for (at, value) in flips {
                if !file.bytes.is_empty() {
                    let at = at.index(file.bytes.len());
                    file.bytes[at] = value;
                }
            }
            file.bytes.resize(file.bytes.len() + behind, 0);
            let looked = look(role, &ends(&file, start));
            if looked.is_err() || look_at_whole(role, &file).is_err() {
                prop_assert!(!is_decoded(role, &file), "{looked:?}");
            }
        }
    }
}
