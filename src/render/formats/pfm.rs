//! Portable float maps, a common format of depth estimates and light probes.
//!
//! A text header has three lines: `Pf` (grey) or `PF` (RGB), `width height`, and a scale. Any white space separates
//! their words. The sign of the scale gives the byte order (negative: little-endian); its magnitude is ignored, as in
//! other readers. 32-bit floats follow, **the lowest row first** (<https://www.pauldebevec.com/Research/HDR/PFM/>).

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::limits::check_size;
use super::raster::{Raster, Samples};

/// Largest length of a header word, and of the white space before it.
const WORD_BYTES: usize = 64;

pub(crate) struct PfmHead {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1 (grey) or 3 (RGB).
    pub(crate) channels: usize,
    is_little: bool,
    /// Offset of the first float from the start of the file, bytes.
    data_offset: usize,
}

/// Reads the header and checks it against the file's `length`; `file` may hold only the beginning.
pub(crate) fn head(file: &NamedBytes, length: u64) -> Result<PfmHead, SceneError> {
    let bad = |what: &str| file.unreadable(FileFormat::Pfm, what.to_owned());
    let mut rest = file.bytes.as_slice();
    let channels = match word(&mut rest) {
        Some("Pf") => 1,
        Some("PF") => 3,
        _ => return Err(bad("it begins with neither Pf nor PF")),
    };
    let mut side = || word(&mut rest)?.parse::<u64>().ok();
    let (Some(width), Some(height)) = (side(), side()) else {
        return Err(bad("its header has no width and height"));
    };
    check_size(&file.path, width, height)?;
    let scale = word(&mut rest).and_then(|text| text.parse::<f64>().ok());
    let is_little = match scale {
        Some(scale) if scale < 0.0 => true,
        Some(scale) if scale > 0.0 => false,
        _ => return Err(bad("its header has no scale")),
    };
    // One byte of white space ends the header; but floats may begin with such bytes, so the length decides if there are more.
    let data = file.bytes.len() - rest.len();
    let expected = width * height * (channels * size_of::<f32>()) as u64;
    let line_end = match rest.iter().position(|byte| *byte == b'\n') {
        Some(at) if rest[..at].iter().all(u8::is_ascii_whitespace) => data + at + 1,
        _ => data + 1,
    };
    let follow = |offset: usize| length.saturating_sub(offset as u64);
    let Some(data_offset) = [data + 1, line_end].into_iter().find(|o| follow(*o) == expected)
    else {
        let found = follow(line_end);
        return Err(bad(&format!("{found} bytes follow its header, but it needs {expected}")));
    };
    Ok(PfmHead { width: width as usize, height: height as usize, channels, is_little, data_offset })
}

pub(crate) fn decode(file: &NamedBytes) -> Result<Raster, SceneError> {
    let PfmHead { width, height, channels, is_little, data_offset } =
        head(file, file.bytes.len() as u64)?;
    let row_bytes = width * channels * size_of::<f32>();
    let float = |bytes: [u8; 4]| {
        if is_little { f32::from_le_bytes(bytes) } else { f32::from_be_bytes(bytes) }
    };
    let rows = file.bytes[data_offset..].chunks_exact(row_bytes).rev();
    let values = rows.flat_map(|row| row.as_chunks::<4>().0.iter().map(|&bytes| float(bytes)));
    Ok(Raster::plain(width, height, channels, Samples::F32(values.collect())))
}

/// Takes the next word and the white space before it. A word that ends with the bytes is cut.
fn word<'b>(rest: &mut &'b [u8]) -> Option<&'b str> {
    let start = rest.iter().take(WORD_BYTES).position(|byte| !byte.is_ascii_whitespace())?;
    let word = &rest[start..];
    let end = word.iter().take(WORD_BYTES).position(u8::is_ascii_whitespace)?;
    *rest = &word[end..];
    std::str::from_utf8(&word[..end]).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, values: &[[u8; 4]]) -> NamedBytes {
        let mut bytes = header.as_bytes().to_vec();
        bytes.extend(values.as_flattened());
        NamedBytes { path: "d.pfm".into(), bytes }
    }

    #[test]
    fn rows_are_read_from_the_lowest_in_either_byte_order() {
        let values = [1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0];
        let little = file("Pf\n3 2\n-1.0\n", &values.map(f32::to_le_bytes));
        let big = file("Pf\n3 2\n1\n", &values.map(f32::to_be_bytes));
        for file in [little, big] {
            let raster = decode(&file).unwrap();
            assert_eq!((raster.width, raster.height, raster.channels), (3, 2, 1));
            let Samples::F32(found) = raster.samples else { panic!("floats") };
            assert_eq!(found, [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
        }
        let color = file("PF 1 2 -1 ", &values.map(f32::to_le_bytes));
        let Samples::F32(found) = decode(&color).unwrap().samples else { panic!("floats") };
        assert_eq!(found, [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn any_white_space_separates_the_words() {
        // The first float begins with bytes of white space.
        let values = [[0x0a, 0x0a, 0x20, 0x40], [0x0d, 0x0a, 0x80, 0x3f]];
        let expected = values.map(f32::from_le_bytes);
        for header in [
            "Pf\n2 1\n-1.0\n",
            "Pf\r\n2 1\r\n-1.0\r\n",
            "Pf\n2 1 \n-1.0\n",
            "Pf\n2  1\n-1.0 \n",
            "Pf \n 2\t1\n\n  -1\n",
            "Pf\t2\n1\r-1 ",
        ] {
            let Samples::F32(found) = decode(&file(header, &values)).unwrap().samples else {
                panic!("floats")
            };
            assert_eq!(found, expected, "{header:?}");
        }
    }

    #[test]
    fn errors_name_the_problem() {
        let four = [[0; 4]; 4];
        for (header, values, words) in [
            ("Pf\n2 2\n-1\n", &four[..3], "12 bytes follow its header, but it needs 16"),
            ("Pf\n2\n", &[], "width and height"),
            ("Pf\n# note\n2 2\n-1\n", &four[..], "width and height"),
            ("Pf\n2 2\n0\n", &four[..], "no scale"),
            ("Pf\n99999 99999\n-1\n", &four[..], "99999x99999"),
            ("P5\n2 2\n-1\n", &four[..], "neither Pf nor PF"),
            ("Pf", &[], "neither Pf nor PF"),
        ] {
            let error = decode(&file(header, values)).unwrap_err().to_string();
            assert!(error.contains(words), "{header:?}: {error}");
        }
    }
}
