//! The photograph's radiance, bilinear between pixel centres and constant beyond the outermost ones.
//!
//! Texture coordinates are projective: a surface point has the radiance of the photograph at its projection, so an
//! unrefracted view from the capture point is the photograph itself.

/// Linear Rec.709 radiance of a photograph.
pub struct Texture {
    width: usize,
    height: usize,
    /// Texels a row: one more than `width`.
    stride: usize,
    /// One column and one row are repeated at the end, so that four texels can always be read.
    texels: Vec<[f32; 4]>,
    max: f32,
}

impl Texture {
    /// A texture of `width` x `height` texels (row by row; red, green, blue, and a fourth that is not used).
    ///
    /// Panics if `texels` has another length.
    pub fn new(width: usize, height: usize, texels: &[[f32; 4]]) -> Self {
        Self::from_vec(width, height, texels.to_vec())
    }

    /// The same, in place: no second copy of a photograph is made.
    pub fn from_vec(width: usize, height: usize, mut texels: Vec<[f32; 4]>) -> Self {
        assert!(
            width > 0 && height > 0 && texels.len() == width * height,
            "a texture needs its texels"
        );
        let max = texels.iter().fold([0f32; 4], |m, t| [0, 1, 2, 3].map(|k| m[k].max(t[k])));
        let max = max[0].max(max[1]).max(max[2]);
        let stride = width + 1;
        texels.resize(stride * (height + 1), [0.0; 4]);
        // From the last row on, so that no row is overwritten before it has moved.
        for j in (0..height).rev() {
            texels.copy_within(j * width..(j + 1) * width, j * stride);
            texels[j * stride + width] = texels[j * stride + width - 1];
        }
        texels.copy_within((height - 1) * stride..height * stride, height * stride);
        Self { width, height, stride, texels, max }
    }

    /// Texels across.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Texels down.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Texels a stored row.
    pub(crate) fn stride(&self) -> usize {
        self.stride
    }

    /// Largest value of any colour.
    pub fn max_radiance(&self) -> f32 {
        self.max
    }

    /// Index of the texel from which (and its right, lower, lower right neighbours) the last cell interpolates.
    pub(crate) fn last_cell(&self) -> u32 {
        ((self.height - 1) * self.stride + self.width - 1) as u32
    }

    /// The texel with index `cell` and the one right of it, and the two below them: `[upper, lower]`.
    ///
    /// # Safety
    ///
    /// `cell` is at most [`Texture::last_cell`].
    #[inline(always)]
    #[allow(
        unsafe_code,
        reason = "bounds checks cost a fifth of the fetch, and two texels are one load of eight numbers"
    )]
    pub(crate) unsafe fn quad(&self, cell: u32) -> [*const [f32; 8]; 2] {
        debug_assert!(cell <= self.last_cell());
        // SAFETY: cell <= (height - 1) stride + width - 1, so cell + stride + 1 <= height stride + width, the
        // index of the last of the stride (height + 1) texels that `new` stored.
        unsafe {
            let upper = self.texels.as_ptr().add(cell as usize);
            [upper.cast(), upper.add(self.stride).cast()]
        }
    }
}
