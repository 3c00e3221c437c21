//! Blocked Cholesky factorisation in place.
//!
//! `A = L Lᵀ` over the lower block triangle, right-looking. Work: `n³/6` multiply-adds for `n` scalar rows.

use crate::real::Real;
use crate::storage::blocks::{Block, place, subtract_product, transpose};

/// The matrix is not positive definite: the pivot of this scalar row is not positive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotPositiveDefinite {
    /// Scalar row of the failed pivot.
    pub row: usize,
}

/// Replaces the lower triangle of `A` (`n` block rows) by `L`.
///
/// # Errors
/// When a pivot is not positive (or not a number); the triangle is then partly overwritten.
pub fn factorize<T: Real, const B: usize>(blocks: &mut [Block<T, B>], n: usize) -> Result<(), NotPositiveDefinite> {
    debug_assert!(blocks.len() >= place(n, 0));
    for k in 0..n {
        let diagonal = &mut blocks[place(k, k)];
        factorize_block(diagonal).map_err(|row| NotPositiveDefinite { row: k * B + row })?;
        let diagonal = *diagonal;
        for i in k + 1..n {
            solve_right_transposed(&diagonal, &mut blocks[place(i, k)]);
        }
        for j in k + 1..n {
            let column = transpose(&blocks[place(j, k)]);
            for i in j..n {
                // Block (i, k) lies before (i, j) in the same block row.
                let (before, target) = blocks.split_at_mut(place(i, j));
                subtract_product(&mut target[0], &before[place(i, k)], &column);
            }
        }
    }
    Ok(())
}

/// Solves `L Lᵀ x = b` in place.
pub fn solve<T: Real, const B: usize>(factor: &[Block<T, B>], x: &mut [[T; B]]) {
    let n = x.len();
    forward(factor, x);
    for i in (0..n).rev() {
        for k in i + 1..n {
            let (head, tail) = x.split_at_mut(k);
            // xᵢ −= L_kiᵀ x_k
            for (row, value) in factor[place(k, i)].iter().zip(&tail[0]) {
                for (out, entry) in head[i].iter_mut().zip(row) {
                    *out -= *entry * *value;
                }
            }
        }
        let diagonal = &factor[place(i, i)];
        for r in (0..B).rev() {
            let mut sum = x[i][r];
            for s in r + 1..B {
                sum -= diagonal[s][r] * x[i][s];
            }
            x[i][r] = sum / diagonal[r][r];
        }
    }
}

/// Solves `L y = b` in place.
pub fn forward<T: Real, const B: usize>(factor: &[Block<T, B>], x: &mut [[T; B]]) {
    for i in 0..x.len() {
        for k in 0..i {
            let (head, tail) = x.split_at_mut(i);
            for (out, row) in tail[0].iter_mut().zip(&factor[place(i, k)]) {
                let mut sum = T::ZERO;
                for (entry, value) in row.iter().zip(&head[k]) {
                    sum += *entry * *value;
                }
                *out -= sum;
            }
        }
        let diagonal = &factor[place(i, i)];
        for r in 0..B {
            let mut sum = x[i][r];
            for s in 0..r {
                sum -= diagonal[r][s] * x[i][s];
            }
            x[i][r] = sum / diagonal[r][r];
        }
    }
}

/// One block `A = L Lᵀ`, lower triangle; the error is the row of the pivot.
pub(super) fn factorize_block<T: Real, const B: usize>(a: &mut Block<T, B>) -> Result<(), usize> {
    for c in 0..B {
        let mut pivot = a[c][c];
        for k in 0..c {
            pivot -= a[c][k] * a[c][k];
        }
        if !(pivot > T::ZERO && pivot.is_usable()) {
            return Err(c);
        }
        let root = pivot.root();
        a[c][c] = root;
        let inverse = T::one() / root;
        for r in c + 1..B {
            let mut sum = a[r][c];
            for k in 0..c {
                sum -= a[r][k] * a[c][k];
            }
            a[r][c] = sum * inverse;
        }
    }
    Ok(())
}

/// `X ← X L⁻ᵀ` for one lower-triangular block.
#[inline(never)]
fn solve_right_transposed<T: Real, const B: usize>(l: &Block<T, B>, x: &mut Block<T, B>) {
    let mut inverse = [T::ZERO; B];
    for (out, r) in inverse.iter_mut().zip(0..B) {
        *out = T::one() / l[r][r];
    }
    // Column c of X needs columns before it: work on the transpose, where columns are rows.
    let mut columns = transpose(x);
    for c in 0..B {
        let (before, from_c) = columns.split_at_mut(c);
        for (k, column) in before.iter().enumerate() {
            let scale = l[c][k];
            for (out, value) in from_c[0].iter_mut().zip(column) {
                *out -= scale * *value;
            }
        }
        for out in &mut from_c[0] {
            *out *= inverse[c];
        }
    }
    *x = transpose(&columns);
}

#[cfg(test)]
mod tests {
    use std::vec;

    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    use super::{factorize, solve};
    use crate::storage::blocks::{pairs, place, zero_block};

    proptest! {
        #[test]
        fn agrees_with_a_dense_solution(entries in prop::collection::vec(-1.0f64..1.0, 12 * 12), right in prop::array::uniform12(-5.0f64..5.0)) {
            let root = DMatrix::from_row_slice(12, 12, &entries);
            let matrix = &root * root.transpose() + DMatrix::identity(12, 12) * 0.1;
            let mut blocks = vec![zero_block::<f64, 4>(); pairs(3)];
            for (r, c) in (0..12).flat_map(|r| (0..12).map(move |c| (r, c))).filter(|(r, c)| c / 4 <= r / 4) {
                blocks[place(r / 4, c / 4)][r % 4][c % 4] = matrix[(r, c)];
            }
            prop_assert!(factorize(&mut blocks, 3).is_ok());
            let mut x = [[0.0; 4]; 3];
            x.as_flattened_mut().copy_from_slice(&right);
            solve(&blocks, &mut x);
            let residual = &matrix * DVector::from_column_slice(x.as_flattened()) - DVector::from_column_slice(&right);
            prop_assert!(residual.norm() < 1e-9 * DVector::from_column_slice(&right).norm().max(1.0));
        }
    }

    #[test]
    fn names_the_pivot_that_fails() {
        let mut blocks = vec![zero_block::<f64, 2>(); pairs(2)];
        blocks[place(0, 0)] = [[1.0, 0.0], [0.0, 1.0]];
        blocks[place(1, 1)] = [[1.0, 0.0], [0.0, -1.0]];
        assert_eq!(factorize(&mut blocks, 2).map_err(|failure| failure.row), Err(3));
    }
}
