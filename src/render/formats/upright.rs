//! The EXIF orientation of an image, and the upright order of its pixels.

use super::raster::{Raster, Samples};
use glasshouse_line::Orientation;
use image::metadata::Orientation as Turn;

/// Size of an image as it is stored, with the orientation that its EXIF data states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureSize {
    /// Width and height of the stored rows, px.
    pub stored_px: [usize; 2],
    /// EXIF orientation, 1 to 8; 1 without a tag.
    pub exif_orientation: u8,
}

impl PictureSize {
    /// Returns the size of an image that is stored upright.
    pub fn plain(stored_px: [usize; 2]) -> Self {
        Self { stored_px, exif_orientation: 1 }
    }

    /// Returns the size of the upright image.
    pub fn upright_px(self) -> [usize; 2] {
        let [width, height] = self.stored_px;
        if self.exif_orientation < 5 { [width, height] } else { [height, width] }
    }

    /// Returns the size of the image that a scene with this key uses.
    pub fn used_px(self, orientation: Orientation) -> [usize; 2] {
        match orientation {
            Orientation::Upright => self.upright_px(),
            Orientation::Stored => self.stored_px,
        }
    }

    /// True if an image of this size covers the stored rows, but not the upright image. Images of one field of view
    /// may have different sizes, so sizes that differ are compared by their aspect.
    pub(crate) fn is_fit_only_by_stored(self, other_px: [usize; 2]) -> bool {
        let (stored, upright) = (self.stored_px, self.upright_px());
        if stored == upright || other_px == upright {
            return false;
        }
        other_px == stored || (is_similar(other_px, stored) && !is_similar(other_px, upright))
    }
}

/// True if the aspects of two images differ by at most 2 %.
fn is_similar([w, h]: [usize; 2], [width, height]: [usize; 2]) -> bool {
    let (a, b) = ((w * height) as f64, (h * width) as f64);
    (a / b - 1.0).abs() <= 0.02
}

/// Returns the orientation that EXIF data state; none, if they are missing, damaged, or state no orientation.
pub(super) fn turn_of(exif: Option<&[u8]>) -> Turn {
    // A PNG chunk should not have the prefix of a JPEG segment, but some programs write it.
    let data = exif.map(|exif| exif.strip_prefix(b"Exif\0\0").unwrap_or(exif));
    data.and_then(Turn::from_exif_chunk).unwrap_or(Turn::NoTransforms)
}

impl Raster {
    pub(crate) fn size(&self) -> PictureSize {
        PictureSize { stored_px: [self.width, self.height], exif_orientation: self.turn.to_exif() }
    }

    /// Returns the image as a scene with this key uses it.
    pub(crate) fn read_as(self, orientation: Orientation) -> Self {
        match orientation {
            Orientation::Upright => self.upright(),
            Orientation::Stored => self,
        }
    }

    /// Turns and mirrors the stored rows to the upright image. The pixels keep their bits.
    pub(crate) fn upright(self) -> Self {
        if self.turn == Turn::NoTransforms {
            return self;
        }
        let Self { channels, turn, .. } = self;
        let [width, height] = self.size().upright_px();
        let order = Order { stored: [self.width, self.height], upright: [width, height], turn };
        let samples = match &self.samples {
            Samples::U8(codes) => Samples::U8(order.of(codes, channels)),
            Samples::U16(codes) => Samples::U16(order.of(codes, channels)),
            Samples::F32(values) => Samples::F32(order.of(values, channels)),
        };
        Self { width, height, samples, turn: Turn::NoTransforms, ..self }
    }
}

/// The order of the stored pixels in the upright image.
struct Order {
    stored: [usize; 2],
    upright: [usize; 2],
    turn: Turn,
}

impl Order {
    /// Returns column and row of the stored pixel that is at (x, y) in the upright image.
    fn stored_at(&self, x: usize, y: usize) -> (usize, usize) {
        let [right, bottom] = self.stored.map(|side| side - 1);
        match self.turn {
            Turn::NoTransforms => (x, y),
            Turn::FlipHorizontal => (right - x, y),
            Turn::Rotate180 => (right - x, bottom - y),
            Turn::FlipVertical => (x, bottom - y),
            Turn::Rotate90FlipH => (y, x),
            Turn::Rotate90 => (y, bottom - x),
            Turn::Rotate270FlipH => (right - y, bottom - x),
            Turn::Rotate270 => (right - y, x),
        }
    }

    fn of<T: Copy>(&self, samples: &[T], channels: usize) -> Vec<T> {
        let mut upright = Vec::with_capacity(samples.len());
        for y in 0..self.upright[1] {
            for x in 0..self.upright[0] {
                let (column, row) = self.stored_at(x, y);
                let at = (row * self.stored[0] + column) * channels;
                upright.extend_from_slice(&samples[at..at + channels]);
            }
        }
        upright
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// EXIF data with an orientation: a little-endian TIFF directory with one entry, tag 0x112, a 16-bit number.
    pub(crate) fn exif(orientation: u8) -> Vec<u8> {
        let mut data = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        data.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        data
    }

    /// Inserts a segment after the first marker of a JPEG.
    pub(crate) fn with_segment(jpeg: &[u8], marker: u8, data: &[u8]) -> Vec<u8> {
        let length = (data.len() as u16 + 2).to_be_bytes();
        let mut all = jpeg.to_vec();
        all.splice(2..2, [&[0xff, marker], &length[..], data].concat());
        all
    }

    /// Inserts an EXIF orientation into a JPEG.
    pub(crate) fn turned_jpeg(jpeg: &[u8], orientation: u8) -> Vec<u8> {
        with_segment(jpeg, 0xe1, &[&b"Exif\0\0"[..], &exif(orientation)].concat())
    }

    /// The pixels of a letter F of 2 x 3 px, as the EXIF standard stores them for each orientation.
    #[test]
    fn all_eight_orientations_become_upright() {
        // Upright: 1 2 / 3 4 / 5 6. Each row of the table: orientation, stored width, stored codes.
        let stored: [(u8, usize, [u8; 6]); 8] = [
            (1, 2, [1, 2, 3, 4, 5, 6]),
            (2, 2, [2, 1, 4, 3, 6, 5]),
            (3, 2, [6, 5, 4, 3, 2, 1]),
            (4, 2, [5, 6, 3, 4, 1, 2]),
            (5, 3, [1, 3, 5, 2, 4, 6]),
            (6, 3, [2, 4, 6, 1, 3, 5]),
            (7, 3, [6, 4, 2, 5, 3, 1]),
            (8, 3, [5, 3, 1, 6, 4, 2]),
        ];
        for (tag, width, codes) in stored {
            for channels in [1, 3] {
                let wide = |codes: &[u8]| -> Vec<u8> {
                    codes
                        .iter()
                        .flat_map(|&code| (0..channels).map(move |c| code + 10 * c))
                        .collect()
                };
                let raster = Raster {
                    width,
                    height: 6 / width,
                    channels: channels as usize,
                    samples: Samples::U8(wide(&codes)),
                    rescaled: false,
                    turn: Turn::from_exif(tag).unwrap(),
                    color: Ok(None),
                };
                assert_eq!(raster.size().exif_orientation, tag);
                let upright = raster.read_as(Orientation::Upright);
                assert_eq!((upright.width, upright.height), (2, 3), "{tag}");
                let Samples::U8(found) = upright.samples else { panic!() };
                assert_eq!(found, wide(&[1, 2, 3, 4, 5, 6]), "{tag}");
            }
        }
    }

    #[test]
    fn sizes_fit_the_stored_rows_or_the_upright_image() {
        let turned = PictureSize { stored_px: [96, 128], exif_orientation: 6 };
        assert_eq!(turned.upright_px(), [128, 96]);
        assert_eq!(turned.used_px(Orientation::Stored), [96, 128]);
        for (other, only_stored) in [
            ([96, 128], true),
            ([48, 64], true),
            ([49, 65], true),
            ([128, 96], false),
            ([64, 48], false),
            // Neither fits: the scene line may still mean it.
            ([100, 20], false),
        ] {
            assert_eq!(turned.is_fit_only_by_stored(other), only_stored, "{other:?}");
        }
        let nearly_square = PictureSize { stored_px: [100, 101], exif_orientation: 8 };
        assert!(nearly_square.is_fit_only_by_stored([100, 101]));
        assert!(!nearly_square.is_fit_only_by_stored([200, 202]));
        let mirrored = PictureSize { stored_px: [96, 128], exif_orientation: 2 };
        assert!(!mirrored.is_fit_only_by_stored([96, 128]));
    }
}
