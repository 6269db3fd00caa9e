//! Decodes the JPEGs that the decoder of the `image` crate misreads.

use image::error::{DecodingError, ImageFormatHint};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use std::io::Cursor;

/// A decoder that has read the frame of a file with one or three components.
pub(crate) struct RareDecoder<'a> {
    decoder: jpeg_decoder::Decoder<Cursor<&'a [u8]>>,
    info: jpeg_decoder::ImageInfo,
}

impl<'a> RareDecoder<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> ImageResult<Self> {
        let mut decoder = jpeg_decoder::Decoder::new(Cursor::new(bytes));
        decoder.read_info().map_err(failed)?;
        let info = decoder.info().ok_or_else(|| failed("it has no frame"))?;
        Ok(Self { decoder, info })
    }
}

fn failed(error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> ImageError {
    let hint = ImageFormatHint::Exact(ImageFormat::Jpeg);
    ImageError::Decoding(DecodingError::new(hint, error))
}

impl ImageDecoder for RareDecoder<'_> {
    fn dimensions(&self) -> (u32, u32) {
        (self.info.width.into(), self.info.height.into())
    }

    fn color_type(&self) -> ColorType {
        match self.info.pixel_format {
            jpeg_decoder::PixelFormat::L8 => ColorType::L8,
            _ => ColorType::Rgb8,
        }
    }

    fn icc_profile(&mut self) -> ImageResult<Option<Vec<u8>>> {
        Ok(self.decoder.icc_profile())
    }

    fn exif_metadata(&mut self) -> ImageResult<Option<Vec<u8>>> {
        Ok(self.decoder.exif_data().map(<[u8]>::to_vec))
    }

    fn read_image(mut self, buffer: &mut [u8]) -> ImageResult<()> {
        let pixels = self.decoder.decode().map_err(failed)?;
        if pixels.len() != buffer.len() {
            return Err(failed("it has another number of pixels than its frame states"));
        }
        buffer.copy_from_slice(&pixels);
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, buffer: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(buffer)
    }
}
