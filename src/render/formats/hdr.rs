//! Radiance HDR pictures: the radiance of their pixels, before the exposure that their header states.
//!
//! Every program on the way of a picture may add a line `EXPOSURE=` or `COLORCORR=`. The pixels were multiplied by the
//! product of all of them (Radiance's "File Formats", "RADIANCE Picture Format").

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use image::codecs::hdr::HdrDecoder;
use image::{ColorType, ImageDecoder, ImageResult};
use std::io::{Chain, Read};

/// The signature that the decoder requires. Others, such as `#?RGBE`, name the program that wrote the file.
const SIGNATURE: &[u8] = b"#?RADIANCE";

/// A decoder that has read the header.
pub(super) struct HdrPicture<'a> {
    decoder: HdrDecoder<Chain<&'a [u8], &'a [u8]>>,
    /// Factors that the pixels have in the file: red, green, blue.
    exposure: [f32; 3],
}

impl<'a> HdrPicture<'a> {
    pub(super) fn open(file: &'a NamedBytes) -> Result<Self, SceneError> {
        let bytes = file.bytes.as_slice();
        let line = bytes.iter().position(|byte| *byte == b'\n').unwrap_or(bytes.len());
        let decoder = HdrDecoder::new(SIGNATURE.chain(&bytes[line..]))
            .map_err(|error| file.unreadable(FileFormat::Hdr, error))?;
        let meta = decoder.metadata();
        let (red, green, blue) = meta.color_correction.unwrap_or((1.0, 1.0, 1.0));
        let exposure = [red, green, blue].map(|factor| factor * meta.exposure.unwrap_or(1.0));
        if !exposure.iter().all(|factor| factor.is_normal() && *factor > 0.0) {
            let found = format!("a header whose EXPOSURE and COLORCORR multiply to {exposure:?}");
            return Err(file.wrong_layout(found, "pixels with an exposure above 0"));
        }
        Ok(Self { decoder, exposure })
    }
}

impl ImageDecoder for HdrPicture<'_> {
    fn dimensions(&self) -> (u32, u32) {
        self.decoder.dimensions()
    }

    fn color_type(&self) -> ColorType {
        self.decoder.color_type()
    }

    fn read_image(self, buffer: &mut [u8]) -> ImageResult<()> {
        self.decoder.read_image(buffer)?;
        if self.exposure != [1.0; 3] {
            for pixel in buffer.as_chunks_mut::<12>().0 {
                for (bytes, factor) in pixel.as_chunks_mut::<4>().0.iter_mut().zip(self.exposure) {
                    *bytes = (f32::from_ne_bytes(*bytes) / factor).to_ne_bytes();
                }
            }
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, buffer: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::super::raster::{self, Samples};
    use super::*;

    fn pixels(header: &str) -> Result<Vec<f32>, String> {
        let pixels = [0x80, 0x40, 0x20, 0x81];
        let text = format!("{header}\n\n-Y 1 +X 1\n");
        let bytes = [text.as_bytes(), &pixels].concat();
        let file = NamedBytes { path: "a.hdr".into(), bytes };
        match file.format("x").and_then(|f| raster::decode(&file, f)).map_err(|e| e.to_string())? {
            raster::Raster { samples: Samples::F32(values), .. } => Ok(values),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn any_program_may_have_written_the_file() {
        for signature in ["RADIANCE", "RGBE", "AUTOPANO", "rgbe", "RADIANCE written by a"] {
            let found = pixels(&format!("#?{signature}\nFORMAT=32-bit_rle_rgbe"));
            assert_eq!(found, Ok(vec![1.0, 0.5, 0.25]), "{signature}");
        }
    }

    #[test]
    fn the_product_of_all_exposures_divides_the_pixels() {
        let with = |lines: &str| pixels(&format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n{lines}"));
        assert_eq!(with("EXPOSURE=2.0"), Ok(vec![0.5, 0.25, 0.125]));
        assert_eq!(with("EXPOSURE=2\nview\nEXPOSURE= 0.25"), Ok(vec![2.0, 1.0, 0.5]));
        assert_eq!(with("COLORCORR= 1 2 4\nEXPOSURE=0.5"), Ok(vec![2.0, 0.5, 0.125]));
        assert_eq!(with("COLORCORR=1 2 4\nCOLORCORR=1 0.5 0.25"), Ok(vec![1.0, 0.5, 0.25]));
        for lines in ["EXPOSURE=0", "EXPOSURE=-1", "EXPOSURE=nan", "EXPOSURE=1e30\nEXPOSURE=1e30"] {
            let error = with(lines).unwrap_err();
            assert!(error.contains("EXPOSURE") && error.contains("a.hdr"), "{error}");
        }
        assert!(with("EXPOSURE=two").is_err() && with("COLORCORR=1 2").is_err());
    }
}
