//! What the segments before the first scan say, and which decoder reads such a file.

use super::markers::segment;
use super::scan::marker_at;

/// The head of a JPEG file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Head {
    /// Number of colour components; 0, if the frame was not found.
    pub(crate) components: usize,
    /// True if a segment claims to hold a part of an ICC profile.
    pub(crate) has_icc: bool,
    /// Marker of the frame, C0 to CF; 0, if the frame was not found.
    coding: u8,
    /// Bits of a sample.
    precision: u8,
    /// Height of the frame, px; 0, if a marker behind the first scan states it.
    height: u16,
    /// Sampling factors of the components, horizontal and vertical.
    sampling: [[u8; 2]; 4],
    /// Number of components of the first scan, if it was found.
    first_scan: Option<usize>,
}

/// How the pixels of a JPEG are decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// By the `image` crate.
    Common,
    /// By the `jpeg-decoder` crate: kinds that the decoder of `image` reads wrongly.
    Rare,
    /// Not at all: what the file is, and what to give in its place.
    Refused(&'static str, &'static str),
}

/// An `expected` of [`Kind::Refused`].
const HUFFMAN: &str =
    "a Huffman-coded one: `jpegtran -optimize -outfile NEW.jpg OLD.jpg` rewrites it without loss";
const ONE_SCAN: &str =
    "one in a single scan: `jpegtran -optimize -outfile NEW.jpg OLD.jpg` rewrites it without loss";
const PPM: &str = "the picture as PPM: `djpeg -outfile NEW.ppm OLD.jpg`";
const PNG: &str = "the picture as PNG";
const PNG_16: &str = "the picture as PNG of 16 bits";

impl Head {
    /// Finds the segments in a file or in its beginning.
    pub(crate) fn find(bytes: &[u8]) -> Self {
        let mut found = Self::default();
        let mut at = 2;
        while let Some((marker, after)) = marker_at(bytes, at) {
            let Some(data) = segment(bytes, after) else { break };
            at = after + 2 + data.len();
            match marker {
                0xda => {
                    found.first_scan = data.first().map(|count| usize::from(*count));
                    break;
                }
                0xe2 => found.has_icc |= data.starts_with(b"ICC_PROFILE\0"),
                // C4 has Huffman tables, C8 is reserved, and CC has the conditions of arithmetic coding.
                0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => found.frame(marker, data),
                _ => {}
            }
        }
        found
    }

    fn frame(&mut self, marker: u8, data: &[u8]) {
        self.coding = marker;
        if let Some((&[precision, h1, h0, _, _, count], specs)) = data.split_first_chunk::<6>() {
            (self.precision, self.height) = (precision, u16::from_be_bytes([h1, h0]));
            self.components = count.into();
            for (factors, spec) in self.sampling.iter_mut().zip(specs.as_chunks::<3>().0) {
                *factors = [spec[1] >> 4, spec[1] & 15];
            }
        }
    }

    /// Returns how the pixels are decoded.
    ///
    /// `zune-jpeg` 0.5, the decoder of `image`, misreads most sequential frames in several scans, frames whose first
    /// component is coarser than another, and some with three different factors; it refuses factors of 3
    /// (`matrix_tests.rs`).
    pub(crate) fn kind(&self) -> Kind {
        match self.coding {
            0xc9 | 0xca => return Kind::Refused("a JPEG with arithmetic coding", HUFFMAN),
            0xc3 | 0xcb => return Kind::Refused("a lossless JPEG", PNG),
            0xc5..=0xc7 | 0xcd..=0xcf => return Kind::Refused("a hierarchical JPEG", PNG),
            0xc0..=0xc2 if self.precision == 12 => {
                return Kind::Refused("a JPEG with samples of 12 bits", PNG_16);
            }
            0xc0..=0xc2 if self.precision == 8 && self.height == 0 => {
                return Kind::Refused("a JPEG that states its height behind its data (DNL)", PNG);
            }
            _ => {}
        }
        let factors = &self.sampling[..self.components.min(4)];
        let most = [0, 1].map(|axis| factors.iter().map(|f| f[axis]).max().unwrap_or(1));
        // Other factors are damage, which the check names.
        if !factors.as_flattened().iter().all(|factor| (1..=4).contains(factor)) {
            return Kind::Common;
        }
        let is_fraction = |f: &[u8; 2]| (0..2).any(|k| !most[k].is_multiple_of(f[k]));
        if factors.iter().any(is_fraction) {
            let what = "a JPEG whose sampling factors are no multiples of each other";
            return Kind::Refused(what, PNG);
        }
        let is_progressive = self.coding == 0xc2;
        let is_split = !is_progressive && self.first_scan.is_some_and(|n| n < self.components);
        // `jpeg-decoder` 0.3 counts the blocks of scans of one component right for factors of 1 and of the largest.
        let is_between = factors.iter().any(|f| (0..2).any(|k| f[k] != 1 && f[k] != most[k]));
        let is_odd = factors.first().is_some_and(|first| *first != most)
            || factors.as_flattened().contains(&3)
            || is_between;
        let is_rare = self.components < 4 && !(is_between && (is_split || is_progressive));
        match (is_split, is_odd) {
            (false, false) => Kind::Common,
            _ if is_rare => Kind::Rare,
            (true, _) => {
                Kind::Refused("a JPEG in several scans of unusual sampling or CMYK", ONE_SCAN)
            }
            (false, true) => {
                Kind::Refused("a JPEG whose sampling factors are read in no decoder here", PPM)
            }
        }
    }
}
