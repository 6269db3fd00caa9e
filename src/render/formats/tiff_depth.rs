//! Reads depth from TIFF files with the `tiff` crate: one channel of floats, or of integers of 8 or 16 bits.

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::limits::{MAX_PIXELS, check_size};
use super::raster::{Raster, Samples};
use super::upright::PictureSize;
use image::metadata::Orientation as Turn;
use std::io::Cursor;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

const LAYOUT: &str = "one grey channel of 8 or 16 bits, or of floats, in a file of one image";

type Opened<'a> = (Decoder<Cursor<&'a [u8]>>, Raster);

/// Reads the header of the first image, and checks its layout. The raster has no samples yet.
fn open(file: &NamedBytes) -> Result<Opened<'_>, SceneError> {
    let failed = |error: TiffError| file.unreadable(FileFormat::Tiff, error);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_PIXELS * size_of::<f64>();
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    let bytes = Cursor::new(file.bytes.as_slice());
    let mut decoder = Decoder::new(bytes).map_err(failed)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(failed)?;
    check_size(&file.path, width.into(), height.into())?;
    let color = decoder.colortype().map_err(failed)?;
    let is_white_zero =
        decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).map_err(failed)?
            == Some(0);
    let found = match color {
        ColorType::Gray(_) if is_white_zero => Some("codes whose 0 is white".to_owned()),
        ColorType::Gray(_) if decoder.more_images() => Some("several images".to_owned()),
        ColorType::Gray(8 | 16 | 32 | 64) => None,
        other => Some(format!("pixels of type {other:?}")),
    };
    if let Some(found) = found {
        return Err(file.wrong_layout(found, LAYOUT));
    }
    let turn = decoder.find_tag_unsigned::<u8>(Tag::Orientation).map_err(failed)?;
    let turn = turn.and_then(Turn::from_exif).unwrap_or(Turn::NoTransforms);
    let samples = Samples::F32(Vec::new());
    let plain = Raster::plain(width as usize, height as usize, 1, samples);
    Ok((decoder, Raster { turn, ..plain }))
}

/// Reads the size from the header; `file` may hold only the beginning.
pub(crate) fn size(file: &NamedBytes) -> Result<PictureSize, SceneError> {
    file.contain(FileFormat::Tiff, || Ok(open(file)?.1.size()))
}

/// Decodes the image to its stored rows. Doubles are rounded to floats.
pub(crate) fn decode(file: &NamedBytes) -> Result<Raster, SceneError> {
    file.contain(FileFormat::Tiff, || {
        let (mut decoder, raster) = open(file)?;
        let result = decoder.read_image().map_err(|e| file.unreadable(FileFormat::Tiff, e))?;
        let samples = match result {
            DecodingResult::U8(codes) => Samples::U8(codes),
            DecodingResult::U16(codes) => Samples::U16(codes),
            DecodingResult::F16(values) => {
                Samples::F32(values.into_iter().map(f32::from).collect())
            }
            DecodingResult::F32(values) => Samples::F32(values),
            DecodingResult::F64(values) => {
                Samples::F32(values.into_iter().map(|value| value as f32).collect())
            }
            _ => return Err(file.wrong_layout("integers of another type".to_owned(), LAYOUT)),
        };
        let count = match &samples {
            Samples::U8(codes) => codes.len(),
            Samples::U16(codes) => codes.len(),
            Samples::F32(values) => values.len(),
        };
        if count != raster.width * raster.height {
            return Err(file.unreadable(FileFormat::Tiff, "it has another number of pixels"));
        }
        Ok(Raster { samples, ..raster })
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use tiff::encoder::{TiffEncoder, TiffValue, colortype};

    /// Returns a file of `pages` equal images of 3 x 1 pixels.
    pub(crate) fn tiff<C: colortype::ColorType>(pages: usize, pixels: &[C::Inner]) -> NamedBytes
    where
        [C::Inner]: TiffValue,
    {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        for _ in 0..pages {
            encoder.write_image::<C>(3, 1, pixels).unwrap();
        }
        NamedBytes { path: "d.tif".into(), bytes: bytes.into_inner() }
    }

    #[test]
    fn one_channel_of_codes_or_floats_is_read() {
        let words = tiff::<colortype::Gray16>(1, &[0, 1500, 65535]);
        assert_eq!(words.format("x").unwrap(), FileFormat::Tiff);
        assert!(
            matches!(decode(&words).unwrap().samples, Samples::U16(w) if w == [0, 1500, 65535])
        );
        assert_eq!(size(&words).unwrap(), PictureSize::plain([3, 1]));
        let floats = tiff::<colortype::Gray32Float>(1, &[0.5, f32::INFINITY, 7.25]);
        let Samples::F32(found) = decode(&floats).unwrap().samples else { panic!("floats") };
        assert_eq!(found, [0.5, f32::INFINITY, 7.25]);
        for length in 0..floats.bytes.len() {
            let cut = NamedBytes { bytes: floats.bytes[..length].to_vec(), ..floats.clone() };
            assert!(decode(&cut).is_err(), "{length}");
        }
    }

    #[test]
    fn other_layouts_are_named() {
        let error = |file: &NamedBytes| decode(file).unwrap_err().to_string();
        let color = tiff::<colortype::RGB8>(1, &[7; 9]);
        assert!(error(&color).contains("pixels of type RGB(8); give one grey channel"));
        assert!(error(&tiff::<colortype::Gray16>(2, &[1, 2, 3])).contains("several images"));
        assert!(error(&tiff::<colortype::Gray32>(1, &[1, 2, 3])).contains("another type"));
    }
}
