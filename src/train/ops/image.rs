//! Images and kernels in the layout of `direct.rs`.

use super::buffers::Buffers;
use super::lanes::LANES;

/// One image: (rows + 2, columns + 2, channels) numbers.
#[derive(Clone, Debug)]
pub(crate) struct Image {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    /// Number of channels, a multiple of 16; those past the image's own are 0.
    pub(crate) channels: usize,
    pub(crate) values: Vec<f32>,
}

impl Image {
    /// Creates a black image. `channels` is rounded up.
    pub(crate) fn zeros(rows: usize, columns: usize, channels: usize, buffers: &Buffers) -> Self {
        let mut image = Self::unwritten(rows, columns, channels, buffers);
        image.values.fill(0.0);
        image
    }

    /// Creates an image with a border of zeros. `channels` is rounded up. The pixels have arbitrary values, and the caller must write all of them.
    pub(crate) fn unwritten(
        rows: usize,
        columns: usize,
        channels: usize,
        buffers: &Buffers,
    ) -> Self {
        let channels = channels.next_multiple_of(LANES);
        let values = buffers.take((rows + 2) * (columns + 2) * channels);
        let mut image = Self { rows, columns, channels, values };
        let stride = image.stride();
        image.values[..stride].fill(0.0);
        for row in image.values[stride..].chunks_exact_mut(stride).take(rows) {
            row[..channels].fill(0.0);
            row[stride - channels..].fill(0.0);
        }
        image.values[stride * (rows + 1)..].fill(0.0);
        image
    }

    /// Returns the number of values in a row with its border.
    pub(super) fn stride(&self) -> usize {
        (self.columns + 2) * self.channels
    }

    /// Returns the pixels of a row, without the border.
    pub(crate) fn row(&self, row: usize) -> &[f32] {
        let start = (row + 1) * self.stride() + self.channels;
        &self.values[start..start + self.columns * self.channels]
    }

    /// Returns the pixels of a row for writing.
    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [f32] {
        let start = (row + 1) * self.stride() + self.channels;
        &mut self.values[start..start + self.columns * self.channels]
    }

    pub(super) fn check(&self) {
        assert!(self.channels.is_multiple_of(LANES), "channels must be a multiple of 16");
        assert_eq!(
            self.values.len(),
            (self.rows + 2) * self.stride(),
            "the image has another size"
        );
    }
}

/// A kernel in the order (16 outputs, row, column, input, output of the 16), with inputs and outputs padded to multiples
/// of 16, so that a convolution reads the weights of 16 outputs one after the other.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    /// Number of inputs without those at the end that are only padding, whose products are all 0.
    pub(super) used_inputs: usize,
    pub(crate) values: Vec<f32>,
}

impl Kernel {
    pub(crate) fn zeros(used_inputs: usize, outputs: usize) -> Self {
        let [inputs, outputs] = [used_inputs, outputs].map(|count| count.next_multiple_of(LANES));
        Self { inputs, outputs, used_inputs, values: vec![0.0; 9 * inputs * outputs] }
    }

    /// Returns the place of the weights of the 16 outputs from `output` on, for an input at a place (3 row + column) of
    /// the kernel.
    #[inline(always)]
    pub(super) fn at(&self, place: usize, input: usize, output: usize) -> usize {
        ((output / LANES * 9 + place) * self.inputs + input) * LANES
    }

    /// Returns the place of one weight.
    pub(crate) fn index(&self, [y, x]: [usize; 2], input: usize, output: usize) -> usize {
        self.at(3 * y + x, input, output) + output % LANES
    }

    pub(super) fn check(&self) {
        assert_eq!(
            self.values.len(),
            9 * self.inputs * self.outputs,
            "the kernel has another size"
        );
        assert!(self.used_inputs <= self.inputs, "more inputs are used than there are");
    }
}
