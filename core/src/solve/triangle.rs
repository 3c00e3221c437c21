//! A least-squares problem kept as an upper triangle: rows are folded in by Householder reflections.
//!
//! # Model
//! `‖R x + d‖²` with `R` upper triangular. Folding rows `(A, b)` in gives the triangle of the stacked problem,
//! ```text
//! ‖R x + d‖² + ‖A x + b‖² = ‖R' x + d'‖² + constant
//! ```
//! The normal equations are never formed, so the condition number is not squared: this is what makes the prior
//! survive `f32` (Demmel et al., ICCV 2021).

use crate::real::Real;
use crate::storage::blocks::{Block, place};

/// Rows of `n` blocks of `B` scalars with one right-hand side each, flat: row `i` is `[i (nB+1) .. (i+1) (nB+1)]`, last the right-hand side.
#[derive(Debug)]
pub struct Rows<'a, T: Real> {
    entries: &'a mut [T],
    width: usize,
}

impl<'a, T: Real> Rows<'a, T> {
    /// As many rows of `columns` scalars (and a right-hand side) as fit the buffer, at most `count`, all zero.
    pub fn zeros(buffer: &'a mut [T], columns: usize, count: usize) -> Self {
        let width = columns + 1;
        let fits = count.min(buffer.len() / width);
        debug_assert!(fits == count, "row buffer too short");
        let (entries, _) = buffer.split_at_mut(fits * width);
        entries.fill(T::ZERO);
        Self { entries, width }
    }

    /// A buffer that already holds rows.
    pub fn over(entries: &'a mut [T], columns: usize) -> Self {
        Self { entries, width: columns + 1 }
    }

    /// Number of rows.
    #[must_use]
    pub fn count(&self) -> usize {
        self.entries.len() / self.width
    }

    /// Row `i`, its right-hand side last.
    pub fn row_mut(&mut self, i: usize) -> &mut [T] {
        &mut self.entries[i * self.width..(i + 1) * self.width]
    }
}

/// Squared length of a column below which it says nothing (a standard deviation of 10¹²) and is left out: in `f32` its
/// reflection would divide by a number that is no longer normal.
const NOTHING: f64 = 1e-24;

/// Folds `rows` into the triangle `(R, d)` of `n` block rows. The rows are overwritten. `scratch` holds `n B + 1` scalars.
///
/// Block row `i` of `R` has its block of column `j ≥ i` at `place(j, i)`.
pub fn fold<T: Real, const B: usize>(triangle: &mut [Block<T, B>], right: &mut [[T; B]], rows: &mut Rows<'_, T>, scratch: &mut [T]) {
    let n = right.len();
    let columns = n * B;
    let width = rows.width;
    debug_assert!(width == columns + 1 && scratch.len() >= width);
    for i in 0..n {
        for r in 0..B {
            let column = i * B + r;
            let mut below = T::ZERO;
            for row in rows.entries.chunks_exact(width) {
                below += row[column] * row[column];
            }
            if !(below > T::of(NOTHING)) {
                continue;
            }
            let pivot = triangle[place(i, i)][r][r];
            let norm = (pivot * pivot + below).root();
            let reflected = if pivot > T::ZERO { -norm } else { norm };
            let head = pivot - reflected;
            // v = (head, rows[column]); H = I − (2/vᵀv) v vᵀ, vᵀv = 2 norm (norm + |pivot|)
            let scale = T::one() / (norm * (norm + pivot.abs()));
            let tail = &mut scratch[column + 1..width];
            // w = vᵀ [R_row; rows]
            for c in r + 1..B {
                tail[c - r - 1] = head * triangle[place(i, i)][r][c];
            }
            for j in i + 1..n {
                let at = (j - i) * B - r - 1;
                for (out, value) in tail[at..at + B].iter_mut().zip(&triangle[place(j, i)][r]) {
                    *out = head * *value;
                }
            }
            tail[columns - column - 1] = head * right[i][r];
            for row in rows.entries.chunks_exact(width) {
                let factor = row[column];
                if factor != T::ZERO {
                    for (out, value) in tail.iter_mut().zip(&row[column + 1..]) {
                        *out += factor * *value;
                    }
                }
            }
            // [R_row; rows] −= scale v w
            let step = head * scale;
            triangle[place(i, i)][r][r] = reflected;
            for c in r + 1..B {
                triangle[place(i, i)][r][c] -= step * tail[c - r - 1];
            }
            for j in i + 1..n {
                let at = (j - i) * B - r - 1;
                for (out, value) in triangle[place(j, i)][r].iter_mut().zip(&tail[at..at + B]) {
                    *out -= step * *value;
                }
            }
            right[i][r] -= step * tail[columns - column - 1];
            for row in rows.entries.chunks_exact_mut(width) {
                let factor = row[column] * scale;
                row[column] = T::ZERO;
                if factor != T::ZERO {
                    for (out, value) in row[column + 1..].iter_mut().zip(tail.iter()) {
                        *out -= factor * *value;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec;
    use std::vec::Vec;

    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    use super::{Rows, fold};
    use crate::storage::blocks::{pairs, place, zero_block};

    /// `(R, d)` as a dense matrix.
    fn dense(triangle: &[[[f64; 3]; 3]], right: &[[f64; 3]]) -> (DMatrix<f64>, DVector<f64>) {
        let n = right.len();
        let matrix = DMatrix::from_fn(3 * n, 3 * n, |r, c| {
            let (i, j) = (r / 3, c / 3);
            if r <= c { triangle[place(j, i)][r % 3][c % 3] } else { 0.0 }
        });
        (matrix, DVector::from_fn(3 * n, |r, _| right[r / 3][r % 3]))
    }

    proptest! {
        /// The triangle has the normal equations of all rows that were folded in, in whatever portions they came.
        #[test]
        fn folding_keeps_the_normal_equations(entries in prop::collection::vec(-3.0f64..3.0, 14 * 10), portion in 1usize..14) {
            let all = DMatrix::from_row_slice(14, 10, &entries);
            let mut triangle = vec![zero_block::<f64, 3>(); pairs(3)];
            let mut right = [[0.0; 3]; 3];
            let mut scratch = vec![0.0; 10];
            for rows in entries.chunks(portion * 10) {
                let mut copy: Vec<f64> = rows.to_vec();
                fold(&mut triangle, &mut right, &mut Rows::over(&mut copy, 9), &mut scratch);
            }
            let (r, d) = dense(&triangle, &right);
            let (a, b) = (all.columns(0, 9).into_owned(), all.column(9).into_owned());
            let expected = a.transpose() * &a;
            prop_assert!((r.transpose() * &r - &expected).norm() < 1e-10 * expected.norm());
            let expected = a.transpose() * &b;
            prop_assert!((r.transpose() * &d - &expected).norm() < 1e-10 * (1.0 + expected.norm()));
        }
    }
}
