//! Reads OpenEXR pictures in linear light, such as developed photographs.

use super::error::SceneError;
use super::exr_raster::decode_color;
use super::files::NamedBytes;
use super::raster::Samples;

/// A picture in linear light, row by row. Values are of any size; NaN and infinity occur if the file has them.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearPicture {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[f32; 3]>,
}

/// Decodes the first layer with R, G and B, else the first with Y, which is repeated in three channels. The channels are
/// taken as linear light with the primaries of sRGB.
pub fn decode_linear_exr(file: &NamedBytes) -> Result<LinearPicture, SceneError> {
    let raster = decode_color(file)?;
    let Samples::F32(values) = raster.samples else {
        unreachable!("the reader of OpenEXR makes floats");
    };
    let pixel = |samples: &[f32]| match samples {
        [r, g, b] => [*r, *g, *b],
        grey => [grey[0]; 3],
    };
    let pixels = values.chunks_exact(raster.channels).map(pixel).collect();
    Ok(LinearPicture { width: raster.width, height: raster.height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::encode_rgb_exr;
    use std::path::PathBuf;

    #[test]
    fn a_written_picture_is_read_again() {
        let pixels: Vec<[f32; 3]> = (0..6u8).map(|k| [f32::from(k), 0.25, -1.5]).collect();
        let bytes = encode_rgb_exr(&pixels, 3, 2).unwrap();
        let mut file = NamedBytes { path: PathBuf::from("a.exr"), bytes };
        let found = decode_linear_exr(&file).unwrap();
        assert_eq!(found, LinearPicture { width: 3, height: 2, pixels });
        file.bytes.truncate(file.bytes.len() / 2);
        assert!(decode_linear_exr(&file).unwrap_err().to_string().contains("a.exr"));
    }
}
