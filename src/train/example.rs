//! One example: up to four images of one size, sRGB-coded.

use super::random::Stream;

/// Three planes R, G, B of one image, row by row, each value in [0, 1].
pub type Planes = Vec<f32>;

#[derive(Clone, Debug, PartialEq)]
pub struct Example {
    pub rows: usize,
    pub columns: usize,
    pub input: Planes,
    pub transmission: Planes,
    /// `None` if the tuple or pair lacks this layer; the same holds for `clean_reflection`.
    pub glass_reflection: Option<Planes>,
    pub clean_reflection: Option<Planes>,
}

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
    /// Draws a square crop with a side of `size` px; returns `None` if the image is smaller.
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

impl Example {
    pub fn bytes(&self) -> usize {
        let layers = [Some(&self.input), Some(&self.transmission)];
        let rest = [self.glass_reflection.as_ref(), self.clean_reflection.as_ref()];
        let values: usize = layers.iter().chain(&rest).flatten().map(|p| p.len()).sum();
        values * size_of::<f32>()
    }

    /// Returns an example of the given size: the results of `layer` for all layers.
    pub(super) fn map(
        &self,
        [rows, columns]: [usize; 2],
        layer: impl Fn(&Planes) -> Planes,
    ) -> Self {
        Self {
            rows,
            columns,
            input: layer(&self.input),
            transmission: layer(&self.transmission),
            glass_reflection: self.glass_reflection.as_ref().map(&layer),
            clean_reflection: self.clean_reflection.as_ref().map(&layer),
        }
    }

    #[must_use]
    pub fn cut(&self, cut: Cut) -> Self {
        self.map([cut.size; 2], |planes| {
            let mut out = Vec::with_capacity(3 * cut.size * cut.size);
            for plane in planes.chunks_exact(self.rows * self.columns) {
                for row in cut.row..cut.row + cut.size {
                    let line = &plane[row * self.columns + cut.column..][..cut.size];
                    if cut.mirrored {
                        out.extend(line.iter().rev());
                    } else {
                        out.extend_from_slice(line);
                    }
                }
            }
            out
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_crop_and_mirror_every_layer() {
        let planes: Planes = (0..3 * 4 * 5).map(|k| k as f32).collect();
        let example = Example {
            rows: 4,
            columns: 5,
            input: planes.clone(),
            transmission: planes,
            glass_reflection: None,
            clean_reflection: None,
        };
        let mut cut = Cut { row: 1, column: 2, size: 2, mirrored: false };
        let part = example.cut(cut);
        assert_eq!(part.input[..4], [7.0, 8.0, 12.0, 13.0]);
        assert_eq!(part.transmission[4..8], [27.0, 28.0, 32.0, 33.0]);
        cut.mirrored = true;
        assert_eq!(example.cut(cut).input[..4], [8.0, 7.0, 13.0, 12.0]);
        assert_eq!(Cut::draw(4, 5, 6, true, &mut Stream::new(1, "cut")), None);
        for k in 0..50 {
            let cut = Cut::draw(4, 5, 3, true, &mut Stream::new(k, "cut")).unwrap();
            assert!(cut.row <= 1 && cut.column <= 2);
        }
    }
}
