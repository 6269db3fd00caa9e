//! Radiance of a photograph: bilinear between pixel centres and constant beyond the outermost ones.
//!
//! Texture coordinates are projective: a surface point has the radiance of the photograph at its projection, so an
//! unrefracted view from the capture point is the photograph itself.

/// Linear Rec.709 radiance of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: usize,
    height: usize,
    /// Texels per stored row: one more than `width`.
    stride: usize,
    /// Texels row by row, with the last column and the last row repeated, so that every cell has four texels.
    texels: Vec<[f32; 4]>,
    /// Largest values of any colour in squares of [`SQUARE`] texels, row by row.
    squares: Vec<f32>,
    max: f32,
}

/// Side of a square whose largest value is known, texels.
const SQUARE: usize = 16;

impl Texture {
    /// Makes a texture of `width` x `height` texels (row by row; red, green, blue and an unused number).
    ///
    /// Panics if `width` or `height` is 0, or if the length of `texels` is not `width * height`.
    pub fn new(width: usize, height: usize, texels: &[[f32; 4]]) -> Self {
        Self::from_vec(width, height, texels.to_vec())
    }

    /// Makes a texture like [`Self::new`] from `texels` itself, without cloning them.
    pub fn from_vec(width: usize, height: usize, mut texels: Vec<[f32; 4]>) -> Self {
        assert!(
            width > 0 && height > 0 && texels.len() == width * height,
            "a texture needs width * height texels"
        );
        let columns = width.div_ceil(SQUARE);
        let mut squares = vec![0f32; columns * height.div_ceil(SQUARE)];
        for (j, row) in texels.chunks(width).enumerate() {
            let of_row = &mut squares[j / SQUARE * columns..];
            for (square, texels) in of_row.iter_mut().zip(row.chunks(SQUARE)) {
                let most =
                    texels.iter().fold([0f32; 4], |m, t| [0, 1, 2, 3].map(|k| m[k].max(t[k])));
                *square = square.max(most[0]).max(most[1]).max(most[2]);
            }
        }
        let max = squares.iter().fold(0f32, |most, v| most.max(*v));
        let stride = width + 1;
        texels.resize(stride * (height + 1), [0.0; 4]);
        // Starts at the last row, so that no row is overwritten before it moves.
        for j in (0..height).rev() {
            texels.copy_within(j * width..(j + 1) * width, j * stride);
            texels[j * stride + width] = texels[j * stride + width - 1];
        }
        texels.copy_within((height - 1) * stride..height * stride, height * stride);
        Self { width, height, stride, texels, squares, max }
    }

    /// Returns the number of texels across.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of texels down.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the number of texels per stored row.
    pub(crate) fn stride(&self) -> usize {
        self.stride
    }

    /// Returns `count` texels of row `j`, from column `i` on.
    pub(crate) fn row(&self, j: usize, i: usize, count: usize) -> &[[f32; 4]] {
        &self.texels[j * self.stride + i..][..count]
    }

    /// Returns the texels row by row, without the repeated column and row.
    pub fn rows(&self) -> impl Iterator<Item = &[[f32; 4]]> {
        (0..self.height).map(|j| self.row(j, 0, self.width))
    }

    /// Returns the texture's size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.texels[..])
    }

    /// Returns the largest value of any colour.
    pub fn max_radiance(&self) -> f32 {
        self.max
    }

    /// Bounds the values of any colour that a look-up meets between two columns and between two rows, `[least, most]`; those beyond the
    /// border are the border's.
    pub(crate) fn max_between(&self, columns: [f64; 2], rows: [f64; 2]) -> f32 {
        let squares = |[least, most]: [f64; 2], texels: usize| {
            let square = |v: f64| v.clamp(0.0, texels as f64 - 1.0) as usize / SQUARE;
            square(least.floor())..=square(most.ceil())
        };
        let stride = self.width.div_ceil(SQUARE);
        let columns = squares(columns, self.width);
        let rows = squares(rows, self.height).map(|j| &self.squares[j * stride..][columns.clone()]);
        rows.flatten().fold(0.0, |most, v| most.max(*v))
    }

    /// Returns the largest index of a texel with right, lower and lower right neighbours.
    pub(crate) fn last_cell(&self) -> u32 {
        ((self.height - 1) * self.stride + self.width - 1) as u32
    }

    /// Points to texel `cell` and its right neighbour, and to the two texels below: `[upper, lower]`.
    ///
    /// # Safety
    ///
    /// `cell` must be at most [`Texture::last_cell`].
    #[inline(always)]
    #[allow(
        unsafe_code,
        reason = "bounds checks cost a fifth of the fetch, and two texels are one load of eight numbers"
    )]
    pub(crate) unsafe fn quad(&self, cell: u32) -> [*const [f32; 8]; 2] {
        debug_assert!(cell <= self.last_cell());
        // SAFETY: cell <= (height - 1) stride + width - 1, so cell + stride + 1 <= height stride + width, the index of
        // the last of the stride (height + 1) stored texels.
        unsafe {
            let upper = self.texels.as_ptr().add(cell as usize);
            [upper.cast(), upper.add(self.stride).cast()]
        }
    }
}
