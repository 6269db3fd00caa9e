//! Matrices of colours.

/// A matrix, row by row.
pub(super) type Matrix = [[f64; 3]; 3];

/// Returns the inverse of a matrix, by cofactors. Its determinant must not be 0.
pub fn inverse(m: &Matrix) -> Matrix {
    let cofactor = |row: usize, column: usize| {
        let [a, b] = [(row + 1) % 3, (row + 2) % 3];
        let [c, d] = [(column + 1) % 3, (column + 2) % 3];
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|column| m[0][column] * cofactor(0, column)).sum();
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| cofactor(column, row) / determinant))
}

/// Returns the product of two matrices.
pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|row| [0, 1, 2].map(|column| (0..3).map(|k| row[k] * b[k][column]).sum()))
}

/// Multiplies each row by a factor, and rounds to f32.
pub(super) fn scaled(m: &Matrix, factors: [f64; 3]) -> [[f32; 3]; 3] {
    [0, 1, 2].map(|row| m[row].map(|value| (value * factors[row]) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverses_multiply_to_one() {
        let m = [[1.7, -0.5, -0.2], [-0.1, 1.4, -0.3], [0.05, -0.6, 1.55]];
        for (row, values) in product(&m, &inverse(&m)).into_iter().enumerate() {
            for (column, value) in values.into_iter().enumerate() {
                assert!((value - f64::from(u8::from(row == column))).abs() < 1e-14);
            }
        }
    }
}
