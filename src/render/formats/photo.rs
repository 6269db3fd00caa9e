//! Photographs that a program reads, changes and writes again: pixels as sRGB, with the colour space and EXIF data of the
//! file.

use super::color_space::{ColorSpace, Inverse};
use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::raster;
use super::srgb_picture::{SrgbPicture, picture_format, srgb_picture};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::metadata::Orientation;
use image::{ExtendedColorType, ImageEncoder, ImageError};

/// A picture with the metadata of its file.
pub struct Photo {
    /// The upright pixels, see [`super::decode_srgb_picture`].
    pub picture: SrgbPicture,
    /// Pixels in the colour space of the ICC profile; `None` if the profile is sRGB, or if there is no RGB profile.
    own: Option<Own>,
    icc: Option<Vec<u8>>,
    /// EXIF data without an orientation, because the pixels are upright.
    exif: Option<Vec<u8>>,
}

/// The upright pixels as the file states them.
struct Own {
    /// Red, green and blue, row by row, as 8-bit codes.
    codes: Vec<u8>,
    space: ColorSpace,
}

impl Photo {
    /// Decodes a PNG or JPEG file; see [`super::decode_srgb_picture`]. A profile of grey pictures is not kept, because
    /// changed pixels have colours.
    pub fn decode(file: &NamedBytes) -> Result<Self, SceneError> {
        let format = picture_format(file)?;
        let raster = raster::decode(file, format)?.upright();
        let picture = srgb_picture(file, &raster)?;
        let (icc, exif) = metadata(file, format);
        let icc = icc.filter(|_| raster.channels > 2);
        let own = match (&icc, &raster.color) {
            (Some(_), Ok(Some(space))) => {
                Some(Own { codes: raster.samples.rgb8(raster.channels), space: space.clone() })
            }
            _ => None,
        };
        Ok(Self { picture, own, icc, exif })
    }

    /// Encodes a changed version of the picture, given as sRGB codes, with the profile and EXIF data of the file.
    ///
    /// A change that darkens a channel of the file's colour space scales its light, also of colours outside of the gamut
    /// of sRGB; one that brightens it moves its code by the difference. Unchanged pixels keep their codes.
    pub fn png_of_changed(&self, rgb: &[u8]) -> Result<Vec<u8>, ImageError> {
        let Some(Own { codes, space }) = &self.own else {
            return self.png(rgb);
        };
        let to_space = Inverse::of(space);
        let mut out = codes.clone();
        let before = self.picture.rgb.chunks_exact(3).zip(rgb.chunks_exact(3));
        for (out, (before, after)) in out.chunks_exact_mut(3).zip(before) {
            if before != after {
                let (from, to) = (to_space.linear(before), to_space.linear(after));
                for c in 0..3 {
                    out[c] = if to[c] < from[c] && from[c] > 0.0 {
                        let ratio = to[c].max(0.0) / from[c];
                        to_space.nearest(c, ratio * to_space.value(c, out[c]))
                    } else {
                        let [from, to] = [from, to].map(|v| i16::from(to_space.nearest(c, v[c])));
                        (i16::from(out[c]) + to - from).clamp(0, 255) as u8
                    };
                }
            }
        }
        self.png(&out)
    }

    /// Encodes another picture of the same size, given as sRGB codes, in the colour space of the file.
    pub fn png_of_other(&self, rgb: &[u8]) -> Result<Vec<u8>, ImageError> {
        let Some(Own { space, .. }) = &self.own else {
            return self.png(rgb);
        };
        let to_space = Inverse::of(space);
        let codes: Vec<u8> = rgb.chunks_exact(3).flat_map(|p| to_space.codes(p)).collect();
        self.png(&codes)
    }

    fn png(&self, codes: &[u8]) -> Result<Vec<u8>, ImageError> {
        let mut png = Vec::new();
        let (compression, filter) = (CompressionType::Fast, FilterType::Adaptive);
        let mut encoder = PngEncoder::new_with_quality(&mut png, compression, filter);
        if let Some(icc) = &self.icc {
            encoder.set_icc_profile(icc.clone()).map_err(ImageError::Unsupported)?;
        }
        if let Some(exif) = &self.exif {
            encoder.set_exif_metadata(exif.clone()).map_err(ImageError::Unsupported)?;
        }
        let (width, height) = (self.picture.width as u32, self.picture.height as u32);
        encoder.write_image(codes, width, height, ExtendedColorType::Rgb8)?;
        Ok(png)
    }
}

/// Reads the ICC profile and the EXIF data of a file. Metadata that cannot be read are left out, because the pixels do
/// not depend on them.
fn metadata(file: &NamedBytes, format: FileFormat) -> (Option<Vec<u8>>, Option<Vec<u8>>) {
    let Ok((mut decoder, _)) = raster::open(file, format) else {
        return (None, None);
    };
    let icc = decoder.icc_profile().ok().flatten();
    let mut exif = decoder.exif_metadata().ok().flatten();
    if let Some(exif) = &mut exif {
        // PNG chunks have no prefix, unlike the segments of a JPEG.
        if let Some(rest) = exif.strip_prefix(b"Exif\0\0") {
            *exif = rest.to_vec();
        }
        let _ = Orientation::remove_from_exif_chunk(exif);
    }
    (icc, exif)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::upright::tests::exif;
    use glasshouse_line::color::{decode_srgb, linear_to_srgb};
    use std::path::Path;

    fn file(name: &str) -> NamedBytes {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/formats/icc");
        let path = folder.join(name);
        NamedBytes { bytes: std::fs::read(&path).unwrap(), path }
    }

    fn decode(bytes: Vec<u8>) -> Photo {
        Photo::decode(&NamedBytes { path: "written.png".into(), bytes }).unwrap()
    }

    /// Pictures in Display P3, with curves of other profiles, and of 16 bits keep their colours and profiles.
    #[test]
    fn unchanged_pictures_keep_their_codes_and_their_profile() {
        for name in ["p3.png", "adobe.png", "p3-jpeg.jpg", "prophoto.png", "power.png"] {
            let photo = Photo::decode(&file(name)).unwrap();
            let own = photo.own.as_ref().unwrap();
            let written = decode(photo.png_of_changed(&photo.picture.rgb).unwrap());
            assert_eq!(written.own.as_ref().unwrap().codes, own.codes, "{name}");
            assert_eq!((&written.icc, &written.picture), (&photo.icc, &photo.picture));
            // The way through sRGB keeps the codes of colours inside of its gamut to the rounding of both.
            let other = decode(photo.png_of_other(&photo.picture.rgb).unwrap());
            let other = &other.own.as_ref().unwrap().codes;
            let inside = |p: &[u8]| p.iter().all(|v| (1..255).contains(v));
            let pixels = photo.picture.rgb.chunks_exact(3);
            let pixels = pixels.zip(other.chunks_exact(3).zip(own.codes.chunks_exact(3)));
            for (_, (found, expected)) in pixels.filter(|(srgb, _)| inside(srgb)) {
                let most = (0..3).map(|c| found[c].abs_diff(expected[c])).max().unwrap();
                assert!(most <= 2, "{name}: {found:?} {expected:?}");
            }
        }
    }

    #[test]
    fn a_change_is_the_same_change_in_every_colour_space() {
        let photo = Photo::decode(&file("p3.png")).unwrap();
        let darker: Vec<u8> = photo.picture.rgb.iter().map(|v| v - v / 4).collect();
        let written = decode(photo.png_of_changed(&darker).unwrap());
        let inside = |p: &[u8]| p.iter().all(|v| (1..255).contains(v));
        let of_photo = photo.picture.rgb.chunks_exact(3);
        let pixels = of_photo.zip(written.picture.rgb.chunks_exact(3).zip(darker.chunks_exact(3)));
        let mut count = 0;
        for (_, (found, expected)) in pixels.filter(|(before, _)| inside(before)) {
            let most = (0..3).map(|c| found[c].abs_diff(expected[c])).max().unwrap();
            assert!(most <= 3, "{found:?} {expected:?}");
            count += 1;
        }
        assert!(count > 100, "{count}");
    }

    /// A quarter of the light is that of every channel, for colours outside of the gamut of sRGB too.
    #[test]
    fn darkening_scales_the_light_of_saturated_colours() {
        let photo = Photo::decode(&file("p3.png")).unwrap();
        let quarter: Vec<u8> = (0..=255u8)
            .map(|code| {
                (255.0 * linear_to_srgb((decode_srgb(f64::from(code) / 255.0) / 4.0) as f32))
                    .round() as u8
            })
            .collect();
        let darker: Vec<u8> = photo.picture.rgb.iter().map(|v| quarter[usize::from(*v)]).collect();
        let written = decode(photo.png_of_changed(&darker).unwrap());
        let [before, after] = [&photo, &written].map(|photo| &photo.own.as_ref().unwrap().codes);
        let mut outside = 0;
        let limited = decode(photo.png_of_other(&photo.picture.rgb).unwrap());
        let limited = limited.own.as_ref().unwrap().codes.chunks_exact(3);
        let pixels = limited.zip(before.chunks_exact(3).zip(after.chunks_exact(3)));
        for (limited, (before, after)) in pixels {
            outside += u32::from((0..3).any(|c| before[c].abs_diff(limited[c]) > 12));
            for c in 0..3 {
                // P3 has the curve of sRGB. Dark codes of sRGB have few steps.
                let expected = quarter[usize::from(before[c])];
                assert!(after[c].abs_diff(expected) <= 4, "{before:?} {after:?}");
            }
        }
        assert!(outside > 5, "{outside}");
    }

    #[test]
    fn exif_data_lose_only_the_orientation() {
        let png =
            crate::formats::raster::tests::png(&[1, 2, 3, 4, 5, 6], 2, 1, ExtendedColorType::Rgb8);
        let mut bytes = Vec::new();
        let mut encoder = PngEncoder::new(&mut bytes);
        encoder.set_exif_metadata(exif(6)).unwrap();
        encoder.write_image(&[1, 2, 3, 4, 5, 6], 2, 1, ExtendedColorType::Rgb8).unwrap();
        let photo = decode(bytes);
        assert_eq!((photo.picture.width, photo.picture.height), (1, 2));
        let written = decode(photo.png_of_changed(&photo.picture.rgb).unwrap());
        assert_eq!(written.picture, photo.picture);
        assert_eq!(written.exif.as_deref(), Some(&exif(1)[..]));
        assert_eq!(Photo::decode(&png).unwrap().exif, None);
    }
}
