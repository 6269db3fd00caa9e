//! One example: up to four images of one size, sRGB-coded.

use compose::{ComposedExample, Cut};

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

impl Example {
    pub fn bytes(&self) -> usize {
        let layers = [Some(&self.input), Some(&self.transmission)];
        let rest = [self.glass_reflection.as_ref(), self.clean_reflection.as_ref()];
        let values: usize = layers.iter().chain(&rest).flatten().map(|p| p.len()).sum();
        values * size_of::<f32>()
    }

    /// Returns an example of the given size: the results of `layer` for all layers.
    pub(crate) fn map(
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

impl From<ComposedExample> for Example {
    fn from(example: ComposedExample) -> Self {
        Self {
            rows: example.side_px,
            columns: example.side_px,
            input: example.input,
            transmission: example.transmission,
            glass_reflection: Some(example.glass_reflection),
            clean_reflection: example.clean_reflection,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use compose::Stream;

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
