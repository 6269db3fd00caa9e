//! Single-threaded matrix products, computed by the gemm crate.
#![allow(unsafe_code, reason = "gemm takes pointers, and threads write columns of one matrix")]

use std::marker::PhantomData;

/// A matrix in a slice, with arbitrary strides.
#[derive(Clone, Copy)]
pub struct Mat<'a> {
    values: &'a [f32],
    pub(super) rows: usize,
    pub(super) columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Mat<'a> {
    /// Returns a row-major matrix; `row_stride` is the distance between rows.
    pub fn by_rows(values: &'a [f32], rows: usize, columns: usize, row_stride: usize) -> Self {
        let matrix = Self { values, rows, columns, row_stride, column_stride: 1 };
        assert!(matrix.end() <= values.len(), "the matrix exceeds its slice");
        matrix
    }

    /// Returns the transpose, which shares the slice.
    pub(super) fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    /// Returns the index after the last element.
    fn end(&self) -> usize {
        if self.rows == 0 || self.columns == 0 {
            return 0;
        }
        (self.rows - 1) * self.row_stride + (self.columns - 1) * self.column_stride + 1
    }
}

/// A writable row-major matrix or a block of its columns, borrowed exclusively.
pub struct MatMut<'a> {
    start: *mut f32,
    pub(super) rows: usize,
    pub(super) columns: usize,
    row_stride: usize,
    _of: PhantomData<&'a mut f32>,
}

// SAFETY: the value is an exclusive borrow of its elements, and `f32` is `Send`.
unsafe impl Send for MatMut<'_> {}

impl<'a> MatMut<'a> {
    /// Returns the number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Returns the start of a slice as a whole row-major matrix.
    pub fn whole(values: &'a mut [f32], rows: usize, columns: usize) -> Self {
        assert!(rows * columns <= values.len(), "the matrix exceeds its slice");
        Self { start: values.as_mut_ptr(), rows, columns, row_stride: columns, _of: PhantomData }
    }

    /// Splits a row-major matrix into blocks of `width` columns for parallel writers. The last block may be narrower.
    pub fn column_blocks(
        values: &'a mut [f32],
        rows: usize,
        columns: usize,
        width: usize,
    ) -> Vec<Self> {
        assert!(rows * columns <= values.len(), "the matrix exceeds its slice");
        let start = values.as_mut_ptr();
        (0..columns)
            .step_by(width.max(1))
            .map(|first| Self {
                // SAFETY: `first` is below `columns`, so it is inside the slice. Without rows, the offset is 0.
                start: unsafe { start.add(if rows == 0 { 0 } else { first }) },
                rows,
                columns: width.max(1).min(columns - first),
                row_stride: columns,
                _of: PhantomData,
            })
            .collect()
    }
}

/// Computes `out = a b`, or `out += a b` if `add`. The order of sums depends only on the shapes and gemm's CPU kernel.
pub fn product(out: &mut MatMut, a: Mat, b: Mat, add: bool) {
    assert!(out.rows == a.rows && a.columns == b.rows && b.columns == out.columns, "wrong shapes");
    // SAFETY: the constructors check that every matrix ends within its slice, `out` borrows its elements exclusively,
    // and the strides are those of the matrices.
    unsafe {
        gemm::gemm(
            out.rows,
            out.columns,
            a.columns,
            out.start,
            1,
            out.row_stride as isize,
            add,
            a.values.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.values.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_column_blocks_equal_the_whole_product() {
        let a: Vec<f32> = (0..6).map(|v| v as f32).collect();
        let b: Vec<f32> = (0..15).map(|v| (v * v % 7) as f32).collect();
        let mut whole = vec![0.0; 10];
        product(
            &mut MatMut::whole(&mut whole, 2, 5),
            Mat::by_rows(&a, 2, 3, 3),
            Mat::by_rows(&b, 3, 5, 5),
            false,
        );
        for (row, column) in (0..2).flat_map(|r| (0..5).map(move |c| (r, c))) {
            let sum: f32 = (0..3).map(|k| a[row * 3 + k] * b[k * 5 + column]).sum();
            assert_eq!(whole[row * 5 + column], sum);
        }
        let mut blocks = vec![1.0; 10];
        for (block, first) in MatMut::column_blocks(&mut blocks, 2, 5, 2).iter_mut().zip([0, 2, 4])
        {
            let part = Mat::by_rows(&b[first..], 3, block.columns, 5);
            product(block, Mat::by_rows(&a, 2, 3, 3), part, true);
        }
        let one_more: Vec<f32> = whole.iter().map(|v| v + 1.0).collect();
        assert_eq!(blocks, one_more);
        let turned = Mat::by_rows(&a, 2, 3, 3).transposed();
        assert_eq!((turned.rows, turned.columns), (3, 2));
    }
}
