//! Reads PNG, JPEG, PNM and Radiance HDR images with the `image` crate; defines `Raster`, the decoded form of images.

use super::color_space::ColorSpace;
use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::hdr::HdrPicture;
use super::icc::ColorError;
use super::jpeg;
use super::limits::{check_size, image_limits};
use super::meaning;
use super::png_chunks::PngChunks;
use super::upright::{PictureSize, turn_of};
use image::codecs::{jpeg::JpegDecoder, png::PngDecoder, pnm::PnmDecoder};
use image::metadata::Orientation as Turn;
use image::{ColorType, ImageDecoder};
use std::io::Cursor;

/// A decoded image, row by row, with interleaved channels.
#[derive(Debug)]
pub(crate) struct Raster {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1: grey; 2: grey and alpha; 3: RGB; 4: RGB and alpha.
    pub(crate) channels: usize,
    pub(crate) samples: Samples,
    /// True if the decoder scaled codes of another range to the range of the type: right for colour, wrong for depth.
    pub(crate) rescaled: bool,
    /// Turn that makes the stored rows upright, from EXIF data.
    pub(crate) turn: Turn,
    /// Meaning of the codes as colours, if the file states another than sRGB. Depth and masks ignore it.
    pub(crate) color: Result<Option<ColorSpace>, ColorError>,
}

impl Raster {
    /// Makes an image of a format without orientation and with samples of the whole range.
    pub(crate) fn plain(width: usize, height: usize, channels: usize, samples: Samples) -> Self {
        let turn = Turn::NoTransforms;
        Self { width, height, channels, samples, rescaled: false, turn, color: Ok(None) }
    }
}

/// The samples of an image, by their type.
#[derive(Debug)]
pub(crate) enum Samples {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
}

impl Samples {
    /// Returns the size in memory, bytes.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::U8(samples) => samples.len(),
            Self::U16(samples) => 2 * samples.len(),
            Self::F32(samples) => 4 * samples.len(),
        }
    }
}

/// Length of the shortest header of a binary PNM, `P5 1 1 1 `.
const PNM_HEADER_BYTES: u64 = 9;

/// Type of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sample {
    U8,
    U16,
    F32,
}

/// Size and type of an image, from its header.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Head {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Same as [`Raster::channels`].
    pub(crate) channels: usize,
    sample: Sample,
    /// Same as [`Raster::rescaled`].
    pub(crate) rescaled: bool,
    turn: Turn,
    /// Same as [`Raster::color`].
    pub(crate) color: Result<Option<ColorSpace>, ColorError>,
}

impl Head {
    pub(crate) fn size(&self) -> PictureSize {
        let stored_px = [self.width, self.height];
        PictureSize { stored_px, exif_orientation: self.turn.to_exif() }
    }

    /// Returns the least length of a P5 or P6 file with this header, bytes; `u64::MAX` for other PNM files.
    pub(crate) fn pnm_bytes(&self, start: &[u8]) -> u64 {
        if !matches!(start, [b'P', b'5' | b'6', ..]) {
            return u64::MAX;
        }
        let samples = (self.width * self.height * self.channels) as u64;
        samples * if self.sample == Sample::U16 { 2 } else { 1 } + PNM_HEADER_BYTES
    }
}

/// A decoder of the `image` crate that has read the header, and the largest code according to the header of a PNM file;
/// `None` for other formats.
pub(super) type Opened<'a> = (Box<dyn ImageDecoder + 'a>, Option<u32>);

pub(super) fn open(file: &NamedBytes, format: FileFormat) -> Result<Opened<'_>, SceneError> {
    let bytes = Cursor::new(file.bytes.as_slice());
    let failed = |error: image::ImageError| file.unreadable(format, error);
    Ok(match format {
        FileFormat::Png => {
            (Box::new(PngDecoder::with_limits(bytes, image_limits()).map_err(failed)?), None)
        }
        FileFormat::Jpeg => match jpeg::Head::find(&file.bytes).kind() {
            jpeg::Kind::Common => (Box::new(JpegDecoder::new(bytes).map_err(failed)?), None),
            jpeg::Kind::Rare => {
                (Box::new(jpeg::RareDecoder::new(&file.bytes).map_err(failed)?), None)
            }
            jpeg::Kind::Refused(found, expected) => {
                return Err(file.wrong_format(found.to_owned(), expected));
            }
        },
        FileFormat::Hdr => (Box::new(HdrPicture::open(file)?), None),
        FileFormat::Pnm => {
            let decoder = PnmDecoder::new(bytes).map_err(failed)?;
            let original_max = decoder.header().maximal_sample();
            (Box::new(decoder), Some(original_max))
        }
        FileFormat::Ply => {
            return Err(file.wrong_format(
                "a PLY mesh".to_owned(),
                "an image here, or name the file as \"mesh\" in place of color and depth",
            ));
        }
        FileFormat::Tiff => {
            return Err(file.wrong_format(
                "TIFF, which is read as depth alone (`magick IN.tif OUT.png`)".to_owned(),
                "another format here",
            ));
        }
        FileFormat::Exr | FileFormat::Npy | FileFormat::Pfm => {
            unreachable!("other modules read these formats")
        }
    })
}

/// Reads the header of a PNG, JPEG, PNM or Radiance HDR file; `file` may hold only its beginning.
pub(crate) fn head(file: &NamedBytes, format: FileFormat) -> Result<Head, SceneError> {
    file.contain(format, || head_of(file, format, &mut open(file, format)?))
}

/// Decodes a PNG, JPEG, PNM or Radiance HDR file to its stored rows.
///
/// The common JPEG decoder selects instructions for the machine. No test compares its bits between instruction sets.
pub(crate) fn decode(file: &NamedBytes, format: FileFormat) -> Result<Raster, SceneError> {
    file.contain(format, || {
        let mut opened = open(file, format)?;
        let Head { width, height, channels, sample, rescaled, turn, color } =
            head_of(file, format, &mut opened)?;
        if format == FileFormat::Jpeg {
            jpeg::check(&file.bytes).map_err(|damage| file.unreadable(format, damage))?;
        }
        let (decoder, count) = (opened.0, width * height * channels);
        let failed = |error| file.unreadable(format, error);
        let samples = match sample {
            Sample::U8 => {
                let mut bytes = vec![0u8; count];
                decoder.read_image(&mut bytes).map_err(failed)?;
                Samples::U8(bytes)
            }
            Sample::U16 => {
                let mut words = vec![0u16; count];
                decoder.read_image(bytemuck::cast_slice_mut(&mut words)).map_err(failed)?;
                Samples::U16(words)
            }
            Sample::F32 => {
                let mut values = vec![0f32; count];
                decoder.read_image(bytemuck::cast_slice_mut(&mut values)).map_err(failed)?;
                Samples::F32(values)
            }
        };
        Ok(Raster { width, height, channels, samples, rescaled, turn, color })
    })
}

/// Checks the size and the sample type, and returns the [`Head`].
fn head_of(
    file: &NamedBytes,
    format: FileFormat,
    (decoder, original_max): &mut Opened<'_>,
) -> Result<Head, SceneError> {
    let (width, height) = decoder.dimensions();
    check_size(&file.path, width as u64, height as u64)?;
    let (channels, sample) = match decoder.color_type() {
        ColorType::L8 => (1, Sample::U8),
        ColorType::La8 => (2, Sample::U8),
        ColorType::Rgb8 => (3, Sample::U8),
        ColorType::Rgba8 => (4, Sample::U8),
        ColorType::L16 => (1, Sample::U16),
        ColorType::La16 => (2, Sample::U16),
        ColorType::Rgb16 => (3, Sample::U16),
        ColorType::Rgba16 => (4, Sample::U16),
        ColorType::Rgb32F if format == FileFormat::Hdr => (3, Sample::F32),
        other => {
            let found = format!("pixels of type {other:?}");
            return Err(file.wrong_layout(found, "8- or 16-bit grey or RGB"));
        }
    };
    let type_max = if sample == Sample::U16 { 65535 } else { 255 };
    let is_partial = original_max.is_some_and(|max| max != type_max);
    // Byte 24 of a PNG holds the bits per sample, which the decoder does not report.
    let is_narrow = format == FileFormat::Png && file.bytes[24] < 8;
    let failed = |error: image::ImageError| file.unreadable(format, error);
    let (turn, color) = match format {
        FileFormat::Png => {
            let chunks = PngChunks::find(&file.bytes);
            let icc = decoder.icc_profile().map_err(failed)?;
            (turn_of(chunks.exif), meaning::of_png(&chunks, icc.as_deref(), channels))
        }
        FileFormat::Jpeg => {
            let exif = decoder.exif_metadata().map_err(failed)?;
            let icc = decoder.icc_profile().map_err(failed)?;
            let head = jpeg::Head::find(&file.bytes);
            let color = meaning::of_jpeg(icc.as_deref(), head.has_icc, head.components);
            (turn_of(exif.as_deref()), color)
        }
        _ => (Turn::NoTransforms, Ok(None)),
    };
    let (width, height) = (width as usize, height as usize);
    let rescaled = is_partial || is_narrow;
    Ok(Head { width, height, channels, sample, rescaled, turn, color })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use image::{ExtendedColorType, ImageEncoder};
    use std::path::PathBuf;

    /// Encodes pixels as a PNG file. 16-bit samples have the native byte order.
    pub(crate) fn png(
        pixels: &[u8],
        width: u32,
        height: u32,
        color: ExtendedColorType,
    ) -> NamedBytes {
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes)
            .write_image(pixels, width, height, color)
            .unwrap();
        NamedBytes { path: PathBuf::from("a.png"), bytes }
    }

    pub(crate) fn jpeg(pixels: &[u8], width: u32, height: u32) -> NamedBytes {
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
            .write_image(pixels, width, height, ExtendedColorType::Rgb8)
            .unwrap();
        NamedBytes { path: PathBuf::from("a.jpg"), bytes }
    }

    /// Corrects the checksums of a damaged PNG's chunks, so that the damage reaches the decoder.
    pub(crate) fn repair_png(bytes: &mut [u8]) {
        let mut at = 8;
        while let Some(&[a, b, c, d]) = bytes.get(at..at + 4) {
            let length = u32::from_be_bytes([a, b, c, d]) as usize;
            let (start, end) = (at + 4, at + 8 + length);
            if end + 4 > bytes.len() {
                return;
            }
            let crc = !bytes[start..end].iter().fold(u32::MAX, |crc, byte| {
                (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                    (crc >> 1) ^ (0xedb88320 & (crc & 1).wrapping_neg())
                })
            });
            bytes[end..end + 4].copy_from_slice(&crc.to_be_bytes());
            at = end + 4;
        }
    }

    #[test]
    fn a_cut_jpeg_is_an_error() {
        let mut file = jpeg(&[100; 64 * 64 * 3], 64, 64);
        assert!(decode(&file, FileFormat::Jpeg).is_ok());
        file.bytes.extend(b"trailing");
        assert!(decode(&file, FileFormat::Jpeg).is_ok());
        file.bytes.truncate(file.bytes.len() - 12);
        assert!(decode(&file, FileFormat::Jpeg).is_err());
    }

    #[test]
    fn large_sizes_are_refused_before_allocation() {
        let named = |text: &str| NamedBytes {
            path: PathBuf::from("a.ppm"),
            bytes: text.as_bytes().to_vec(),
        };
        for text in ["P6 16385 1 255 ", "P5 1 99999 65535 ", "P5 16384 16384 255 "] {
            let error = decode(&named(text), FileFormat::Pnm).unwrap_err();
            assert!(matches!(error, SceneError::Size { .. }), "{error}");
        }
        let overflowing = named("P5 4294967295 4294967295 65535 ");
        assert!(decode(&overflowing, FileFormat::Pnm).is_err());
        let mut file = png(&[0; 3], 1, 1, ExtendedColorType::Rgb8);
        file.bytes[16..20].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff]);
        assert!(decode(&file, FileFormat::Png).is_err());
    }

    #[test]
    fn narrow_samples_are_marked_as_rescaled() {
        let mut file = png(&[0x12, 0x34, 0xf0], 3, 1, ExtendedColorType::L8);
        assert!(!decode(&file, FileFormat::Png).unwrap().rescaled);
        // The row of 3 bytes also holds 6 samples of 4 bits.
        (file.bytes[19], file.bytes[24]) = (6, 4);
        repair_png(&mut file.bytes);
        let raster = decode(&file, FileFormat::Png).unwrap();
        assert!(raster.rescaled && raster.width == 6);
        let bits = NamedBytes { path: PathBuf::from("a.pbm"), bytes: b"P4 8 1 \xa5".to_vec() };
        assert!(decode(&bits, FileFormat::Pnm).unwrap().rescaled);
    }
}
