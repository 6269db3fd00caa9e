//! PNG, JPEG, PNM and Radiance HDR files through the `image` crate, and what all colour formats decode to.

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::limits::{check_size, image_limits};
use image::codecs::{hdr::HdrDecoder, jpeg::JpegDecoder, png::PngDecoder, pnm::PnmDecoder};
use image::{ColorType, ImageDecoder};
use std::io::Cursor;

/// An image as decoded, row by row, channels together.
#[derive(Debug)]
pub(crate) struct Raster {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
    pub(crate) channels: usize,
    pub(crate) samples: Samples,
    /// The decoder spread codes of another range over the whole range of the type: right for
    /// colour, wrong for depth.
    pub(crate) rescaled: bool,
}

/// Samples of the types that files have.
#[derive(Debug)]
pub(crate) enum Samples {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
}

/// Bytes of the shortest header of a binary PNM, `P5 1 1 1 `.
const PNM_HEADER_BYTES: u64 = 9;

/// What a header says of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// As in [`Raster`].
    pub(crate) channels: usize,
    /// Samples have 16 bits, not 8.
    is_wide: bool,
    /// As in [`Raster`].
    pub(crate) rescaled: bool,
}

impl Head {
    /// Bytes that a binary PNM of this header has at least; no file has those of another.
    pub(crate) fn pnm_bytes(&self, start: &[u8]) -> u64 {
        if !matches!(start, [b'P', b'5' | b'6', ..]) {
            return u64::MAX;
        }
        let samples = (self.width * self.height * self.channels) as u64;
        samples * if self.is_wide { 2 } else { 1 } + PNM_HEADER_BYTES
    }
}

/// Reads the header of a PNG, JPEG, PNM or Radiance HDR file; `file` may hold only its beginning.
pub(crate) fn head(file: &NamedBytes, format: FileFormat) -> Result<Head, SceneError> {
    let bytes = Cursor::new(file.bytes.as_slice());
    let failed = |error: image::ImageError| file.unreadable(format, error);
    file.contain(format, || match format {
        FileFormat::Png => {
            let decoder = PngDecoder::with_limits(bytes, image_limits()).map_err(failed)?;
            head_of(file, format, &decoder, None)
        }
        FileFormat::Jpeg => {
            let decoder = JpegDecoder::new(bytes).map_err(failed)?;
            head_of(file, format, &decoder, None)
        }
        FileFormat::Pnm => {
            let decoder = PnmDecoder::new(bytes).map_err(failed)?;
            let original_max = decoder.header().maximal_sample();
            head_of(file, format, &decoder, Some(original_max))
        }
        FileFormat::Hdr => {
            let (width, height) = HdrDecoder::new(bytes).map_err(failed)?.dimensions();
            check_size(&file.path, width as u64, height as u64)?;
            Ok(Head {
                width: width as usize,
                height: height as usize,
                channels: 3,
                is_wide: false,
                rescaled: false,
            })
        }
        FileFormat::Ply => Err(mesh_in_place_of_image(file)),
        FileFormat::Exr | FileFormat::Npy | FileFormat::Pfm => {
            unreachable!("read by modules of their own")
        }
    })
}

fn mesh_in_place_of_image(file: &NamedBytes) -> SceneError {
    file.wrong_format(
        "a PLY mesh".to_owned(),
        "an image here, or name the file as \"mesh\" in place of color and depth",
    )
}

/// Decodes a PNG, JPEG, PNM or Radiance HDR file. Rotation tags, profiles and gamma chunks are ignored: the
/// manifest line says what the values mean.
///
/// The JPEG decoder picks its instructions by the machine; whether all of them agree to the bit is
/// not tested here.
pub(crate) fn decode(file: &NamedBytes, format: FileFormat) -> Result<Raster, SceneError> {
    let bytes = Cursor::new(file.bytes.as_slice());
    let failed = |error: image::ImageError| file.unreadable(format, error);
    file.contain(format, || match format {
        FileFormat::Png => {
            let decoder = PngDecoder::with_limits(bytes, image_limits()).map_err(failed)?;
            read(file, format, decoder, None)
        }
        FileFormat::Jpeg => {
            if !jpeg_is_whole(&file.bytes) {
                return Err(file.unreadable(format, "the file ends before the image does"));
            }
            read(file, format, JpegDecoder::new(bytes).map_err(failed)?, None)
        }
        FileFormat::Pnm => {
            let decoder = PnmDecoder::new(bytes).map_err(failed)?;
            let original_max = decoder.header().maximal_sample();
            read(file, format, decoder, Some(original_max))
        }
        FileFormat::Ply => Err(mesh_in_place_of_image(file)),
        FileFormat::Hdr => {
            let decoder = HdrDecoder::new(bytes).map_err(failed)?;
            let (width, height) = decoder.dimensions();
            check_size(&file.path, width as u64, height as u64)?;
            let mut values = vec![0f32; width as usize * height as usize * 3];
            decoder.read_image(bytemuck::cast_slice_mut(&mut values)).map_err(failed)?;
            Ok(Raster {
                width: width as usize,
                height: height as usize,
                channels: 3,
                samples: Samples::F32(values),
                rescaled: false,
            })
        }
        FileFormat::Exr | FileFormat::Npy | FileFormat::Pfm => {
            unreachable!("read by modules of their own")
        }
    })
}

/// Checks size and type. `original_max` is the code that stands for 1, if not the type's maximum.
fn head_of(
    file: &NamedBytes,
    format: FileFormat,
    decoder: &impl ImageDecoder,
    original_max: Option<u32>,
) -> Result<Head, SceneError> {
    let (width, height) = decoder.dimensions();
    check_size(&file.path, width as u64, height as u64)?;
    let color = decoder.color_type();
    let (channels, is_wide) = match color {
        ColorType::L8 => (1, false),
        ColorType::La8 => (2, false),
        ColorType::Rgb8 => (3, false),
        ColorType::Rgba8 => (4, false),
        ColorType::L16 => (1, true),
        ColorType::La16 => (2, true),
        ColorType::Rgb16 => (3, true),
        ColorType::Rgba16 => (4, true),
        other => {
            let found = format!("pixels of type {other:?}");
            return Err(file.wrong_layout(found, "8- or 16-bit grey or RGB"));
        }
    };
    let is_partial = original_max.is_some_and(|max| max != if is_wide { 65535 } else { 255 });
    // Bits a sample, in a PNG's first chunk; the decoder does not tell.
    let is_narrow = format == FileFormat::Png && file.bytes[24] < 8;
    Ok(Head {
        width: width as usize,
        height: height as usize,
        channels,
        is_wide,
        rescaled: is_partial || is_narrow,
    })
}

/// Checks the header, then reads the pixels.
fn read(
    file: &NamedBytes,
    format: FileFormat,
    decoder: impl ImageDecoder,
    original_max: Option<u32>,
) -> Result<Raster, SceneError> {
    let head = head_of(file, format, &decoder, original_max)?;
    let count = head.width * head.height * head.channels;
    let failed = |error| file.unreadable(format, error);
    let samples = if head.is_wide {
        let mut words = vec![0u16; count];
        decoder.read_image(bytemuck::cast_slice_mut(&mut words)).map_err(failed)?;
        Samples::U16(words)
    } else {
        let mut bytes = vec![0u8; count];
        decoder.read_image(&mut bytes).map_err(failed)?;
        Samples::U8(bytes)
    };
    Ok(Raster {
        width: head.width,
        height: head.height,
        channels: head.channels,
        samples,
        rescaled: head.rescaled,
    })
}

/// Whether the last scan is closed by an end marker. The decoder would paint the missing rest of a
/// cut file grey and say nothing. Neither marker can occur inside a scan.
pub fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xff, marker]);
    match (last(0xda), last(0xd9)) {
        (Some(scan), Some(end)) => scan < end,
        _ => false,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use image::{ExtendedColorType, ImageEncoder};
    use std::path::PathBuf;

    /// A PNG file of the given pixels; 16-bit samples in native order.
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

    /// Makes the checksums of a damaged PNG's chunks right, so that the damage reaches the decoder.
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
    fn sizes_are_refused_before_memory_is_taken() {
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
    fn narrow_samples_are_noticed() {
        let mut file = png(&[0x12, 0x34, 0xf0], 3, 1, ExtendedColorType::L8);
        assert!(!decode(&file, FileFormat::Png).unwrap().rescaled);
        // The same rows hold 6 samples of 4 bits.
        (file.bytes[19], file.bytes[24]) = (6, 4);
        repair_png(&mut file.bytes);
        let raster = decode(&file, FileFormat::Png).unwrap();
        assert!(raster.rescaled && raster.width == 6);
        let bits = NamedBytes { path: PathBuf::from("a.pbm"), bytes: b"P4 8 1 \xa5".to_vec() };
        assert!(decode(&bits, FileFormat::Pnm).unwrap().rescaled);
    }
}
