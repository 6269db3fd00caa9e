//! The photograph's radiance, bilinear between pixel centres and constant beyond the outermost ones.
//!
//! Texture coordinates are projective: a surface point shows what the photograph shows at its projection, so an
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
        let max = texels
            .iter()
            .fold([0f32; 4], |m, t| [0, 1, 2, 3].map(|k| m[k].max(t[k])));
        let max = max[0].max(max[1]).max(max[2]);
        let stride = width + 1;
        texels.resize(stride * (height + 1), [0.0; 4]);
        // From the last row on, so that no row is overwritten before it has moved.
        for j in (0..height).rev() {
            texels.copy_within(j * width..(j + 1) * width, j * stride);
            texels[j * stride + width] = texels[j * stride + width - 1];
        }
        texels.copy_within((height - 1) * stride..height * stride, height * stride);
        Self {
            width,
            height,
            stride,
            texels,
            max,
        }
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

    /// Bilinear value in the cell whose upper left texel has index `cell`, at fractions (`fu`, `fv`).
    ///
    /// Written as `a + (b - a) f`, so that a constant photograph stays exactly constant.
    #[inline(always)]
    #[allow(
        unsafe_code,
        reason = "four bounds checks a sample cost a fifth of the fetch"
    )]
    pub(crate) fn bilinear(&self, cell: u32, fu: f32, fv: f32) -> [f32; 4] {
        let q = cell.min(self.last_cell()) as usize;
        // SAFETY: q <= (height - 1) stride + width - 1, so q + stride + 1 <= height stride + width, the index of
        // the last of the stride (height + 1) texels that `new` stored.
        let (a, b, c, d) = unsafe {
            (
                self.texels.get_unchecked(q),
                self.texels.get_unchecked(q + 1),
                self.texels.get_unchecked(q + self.stride),
                self.texels.get_unchecked(q + self.stride + 1),
            )
        };
        let mut value = [0.0; 4];
        for k in 0..4 {
            let upper = a[k] + (b[k] - a[k]) * fu;
            let lower = c[k] + (d[k] - c[k]) * fu;
            value[k] = upper + (lower - upper) * fv;
        }
        value
    }
}
