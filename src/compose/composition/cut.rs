//! The square part of a picture that an example shows.

use crate::random::Stream;

/// The crop of an example in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// First row.
    pub row: usize,
    /// First column.
    pub column: usize,
    /// Side, px.
    pub size: usize,
    /// True if the crop is flipped left to right.
    pub mirrored: bool,
}

impl Cut {
    /// Draws a square crop with a side of `size` px; returns `None` if the image is smaller. Takes three numbers from
    /// the stream.
    pub fn draw(
        rows: usize,
        columns: usize,
        size: usize,
        flip: bool,
        stream: &mut Stream,
    ) -> Option<Self> {
        if rows < size || columns < size {
            return None;
        }
        let row = stream.below(rows - size + 1);
        let column = stream.below(columns - size + 1);
        let mirrored = stream.unit() < 0.5;
        Some(Self { row, column, size, mirrored: flip && mirrored })
    }
}
