//! Finds the one array of a `.npz` file, NumPy's ZIP archive of `.npy` files.

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::limits::MAX_PIXELS;
use super::npy_header::NpyHeader;
use std::borrow::Cow;
use std::io::{Cursor, Read};
use zip::ZipArchive;

/// Bytes that hold the header of every array here.
const HEADER_BYTES: u64 = 1 << 16;
/// Largest size of a pixel: four channels of eight bytes.
const PIXEL_BYTES: usize = 32;
/// What an archive of several arrays lacks.
const ONE: &str =
    "a .npz of one array: `numpy.save(\"OUT.npy\", numpy.load(\"IN.npz\")[\"NAME\"])`";
/// Number of names in an error.
const SHOWN: usize = 8;

pub(super) fn is_archive(file: &NamedBytes) -> bool {
    file.bytes.starts_with(b"PK\x03\x04")
}

/// Returns the bytes of a `.npy` file, or those of the only array of a `.npz` file.
pub(super) fn array(file: &NamedBytes) -> Result<Cow<'_, [u8]>, SceneError> {
    if !is_archive(file) {
        return Ok(Cow::Borrowed(&file.bytes));
    }
    file.contain(FileFormat::Npy, || unpacked(file).map(Cow::Owned))
}

fn unpacked(file: &NamedBytes) -> Result<Vec<u8>, SceneError> {
    let failed = |error: zip::result::ZipError| file.unreadable(FileFormat::Npy, error);
    let mut archive = ZipArchive::new(Cursor::new(file.bytes.as_slice())).map_err(failed)?;
    let mut arrays = Vec::new();
    for name in archive.file_names() {
        let name = name.map_err(failed)?.into_owned();
        // NumPy writes the ending in lower case.
        if name.strip_suffix(".npy").is_some() {
            arrays.push(name);
        }
    }
    let [name] = arrays.as_slice() else {
        let shown: Vec<&str> = arrays.iter().take(SHOWN).map(String::as_str).collect();
        let found = match arrays.len() {
            0 => "a ZIP archive without arrays".to_owned(),
            count => format!("{count} arrays ({})", shown.join(", ")),
        };
        return Err(file.wrong_layout(found, ONE));
    };
    let mut entry = archive.by_name(name).map_err(failed)?;
    let cut = |error: std::io::Error| file.unreadable(FileFormat::Npy, error);
    let mut bytes = Vec::new();
    entry.by_ref().take(HEADER_BYTES).read_to_end(&mut bytes).map_err(cut)?;
    // An archive of few bytes may claim any size, so the array's shape bounds the memory.
    let header = NpyHeader::parse(&bytes).map_err(|e| file.unreadable(FileFormat::Npy, e))?;
    let size = header.shape.iter().try_fold(header.element.size(), |n, side| n.checked_mul(*side));
    let Some(size) = size.filter(|size| *size <= MAX_PIXELS * PIXEL_BYTES) else {
        let found = format!("an array of shape {:?}", header.shape);
        return Err(file.wrong_layout(found, "an image within the limits of size"));
    };
    // One byte more, so that an array that is too long is found.
    let left = (header.data_offset + size + 1).saturating_sub(bytes.len());
    entry.take(left as u64).read_to_end(&mut bytes).map_err(cut)?;
    Ok(bytes)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::npy::tests::npy;
    use super::super::npy::{Axes, NpyHead, NpyImage};
    use super::*;
    use std::io::Write;
    use zip::CompressionMethod::{Deflated, Stored};
    use zip::write::SimpleFileOptions;

    /// Returns an archive of these files.
    pub(crate) fn npz(arrays: &[(&str, &[u8])], method: zip::CompressionMethod) -> NamedBytes {
        let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in arrays {
            let options = SimpleFileOptions::default().compression_method(method);
            writer.start_file(*name, options).unwrap();
            writer.write_all(bytes).unwrap();
        }
        let bytes = writer.finish().unwrap().into_inner();
        NamedBytes { path: "a.npz".into(), bytes }
    }

    fn values(file: &NamedBytes) -> Result<Vec<f64>, String> {
        let image = NpyImage::parse(file, Axes::Single, "x").map_err(|e| e.to_string())?;
        Ok(image.values(|value| value))
    }

    #[test]
    fn the_only_array_is_read_as_from_its_own_file() {
        let array = npy("<u2", false, "(1, 3)", &[1, 0, 2, 0, 3, 0]);
        for method in [Stored, Deflated] {
            let file = npz(&[("depth.npy", &array.bytes)], method);
            assert_eq!(values(&file), Ok(vec![1.0, 2.0, 3.0]));
            let head = NpyHead::parse(&file, file.bytes.len() as u64, Axes::Single, "x").unwrap();
            assert_eq!((head.width, head.height), (3, 1));
            // The directory is at the end, so that a beginning is not conclusive.
            let start = NamedBytes { bytes: file.bytes[..60].to_vec(), ..file.clone() };
            let cut = NpyHead::parse(&start, file.bytes.len() as u64, Axes::Single, "x");
            assert!(matches!(cut, Err(SceneError::Unreadable { .. })));
            let beside = npz(&[("depth.npy", &array.bytes), ("note.txt", b"x")], method);
            assert_eq!(values(&beside), Ok(vec![1.0, 2.0, 3.0]));
        }
    }

    #[test]
    fn other_archives_are_refused_by_what_they_hold() {
        let array = npy("<u2", false, "(1, 1)", &[1, 0]).bytes;
        let two = npz(&[("depth.npy", &array), ("mask.npy", &array)], Deflated);
        let error = values(&two).unwrap_err();
        assert!(error.contains("a.npz holds 2 arrays (depth.npy, mask.npy)"), "{error}");
        assert!(error.contains("numpy.load"), "{error}");
        let error = values(&npz(&[("note.txt", b"x")], Stored)).unwrap_err();
        assert!(error.contains("without arrays"), "{error}");
        let giant = npy("<f8", false, "(99999999, 99999999)", &[]).bytes;
        assert!(values(&npz(&[("a.npy", &giant)], Stored)).is_err());
        for length in [array.len() - 1, array.len() - 2] {
            assert!(values(&npz(&[("a.npy", &array[..length])], Stored)).is_err());
        }
        let longer = [&array[..], &[0; 8]].concat();
        assert!(values(&npz(&[("a.npy", &longer)], Stored)).is_err());
    }
}
