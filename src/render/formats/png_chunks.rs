//! The chunks of a PNG file that state its orientation and the meaning of its codes.

/// Contents of the chunks, as stored.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct PngChunks<'a> {
    /// EXIF data. The chunk may follow the pixels.
    pub(super) exif: Option<&'a [u8]>,
    /// Coding-independent code points of ITU-T H.273: primaries, transfer, matrix, full range.
    pub(super) cicp: Option<[u8; 4]>,
    pub(super) has_icc: bool,
    pub(super) is_srgb: bool,
    /// Reciprocal of the exponent of the codes, in units of 1e-5.
    pub(super) gamma: Option<u32>,
    /// Chromaticities of white, red, green and blue (x, then y of each), in units of 1e-5.
    pub(super) chromaticities: Option<[u32; 8]>,
}

impl<'a> PngChunks<'a> {
    /// Finds the chunks in a file or in its beginning. The first chunk of a kind counts.
    pub(super) fn find(bytes: &'a [u8]) -> Self {
        let mut found = Self::default();
        let mut rest = bytes.get(8..).unwrap_or_default();
        while let Some((head, after)) = rest.split_first_chunk::<8>() {
            let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
            let Some(data) = after.get(..length) else { break };
            match &head[4..] {
                b"eXIf" => found.exif = found.exif.or(Some(data)),
                b"cICP" => found.cicp = found.cicp.or(data.try_into().ok()),
                b"iCCP" => found.has_icc = true,
                b"sRGB" => found.is_srgb = true,
                b"gAMA" => {
                    found.gamma = found.gamma.or(data.try_into().ok().map(u32::from_be_bytes));
                }
                b"cHRM" if data.len() == 32 => {
                    let words = data.as_chunks::<4>().0;
                    let all = std::array::from_fn(|k| u32::from_be_bytes(words[k]));
                    found.chromaticities = found.chromaticities.or(Some(all));
                }
                _ => {}
            }
            // The checksum has 4 bytes.
            rest = after.get(length + 4..).unwrap_or_default();
        }
        found
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::formats::raster::tests::{png, repair_png};
    use image::ExtendedColorType;

    /// Inserts a chunk before the pixels of a PNG, with a right checksum.
    pub(crate) fn with_chunk(bytes: &[u8], name: [u8; 4], data: &[u8]) -> Vec<u8> {
        // IHDR ends at byte 33.
        insert(bytes, 33, name, data)
    }

    fn insert(bytes: &[u8], at: usize, name: [u8; 4], data: &[u8]) -> Vec<u8> {
        let length = (data.len() as u32).to_be_bytes();
        let chunk = [&length[..], &name, data, &[0; 4]].concat();
        let mut all = bytes.to_vec();
        all.splice(at..at, chunk);
        repair_png(&mut all);
        all
    }

    #[test]
    fn chunks_are_found_in_any_place() {
        let plain = png(&[1, 2, 3], 1, 1, ExtendedColorType::Rgb8).bytes;
        assert_eq!(PngChunks::find(&plain), PngChunks::default());
        let many = with_chunk(&plain, *b"gAMA", &45_455u32.to_be_bytes());
        let many = with_chunk(&many, *b"cHRM", &[0; 32]);
        let many = with_chunk(&many, *b"cICP", &[12, 13, 0, 1]);
        let many = with_chunk(&many, *b"sRGB", &[0]);
        let end = many.len() - 12;
        let many = insert(&many, end, *b"eXIf", b"II");
        let found = PngChunks::find(&many);
        assert_eq!((found.gamma, found.cicp), (Some(45_455), Some([12, 13, 0, 1])));
        assert_eq!((found.chromaticities, found.is_srgb), (Some([0; 8]), true));
        assert_eq!((found.exif, found.has_icc), (Some(&b"II"[..]), false));
        for length in 0..many.len() {
            let _ = PngChunks::find(&many[..length]);
        }
    }
}
