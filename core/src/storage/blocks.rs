//! A symmetric or triangular matrix of square blocks, of which one triangle is stored.
//!
//! Block `(row, column)` with `column ≤ row` stands at `row (row + 1) / 2 + column`; its entries are row-major.
//! The kernels have constant trip counts and unit strides in the inner loop, so that they vectorise.

use crate::real::Real;

/// A square block, row-major.
pub type Block<T, const B: usize> = [[T; B]; B];

/// Place of block `(row, column)`, `column ≤ row`, in a stored triangle.
#[inline(always)]
#[must_use]
pub const fn place(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}

/// Number of blocks in a triangle of `n` block rows.
#[must_use]
pub const fn pairs(n: usize) -> usize {
    n * (n + 1) / 2
}

/// A block of zeros.
#[must_use]
pub const fn zero_block<T: Real, const B: usize>() -> Block<T, B> {
    [[T::ZERO; B]; B]
}

/// `C += Aᵀ B` with `A` K×M and `B` K×N.
// Kept out of line: the arguments are then known not to overlap, without which the loops stay scalar.
#[inline(never)]
pub fn add_transposed_product<T: Real, const K: usize, const M: usize, const N: usize>(
    c: &mut [[T; N]; M],
    a: &[[T; M]; K],
    b: &[[T; N]; K],
) {
    for (i, c_row) in c.iter_mut().enumerate() {
        let mut sum = [T::ZERO; N];
        for (a_row, b_row) in a.iter().zip(b) {
            let scale = a_row[i];
            for (out, value) in sum.iter_mut().zip(b_row) {
                *out += scale * *value;
            }
        }
        for (out, value) in c_row.iter_mut().zip(&sum) {
            *out += *value;
        }
    }
}

/// `C −= A B`.
// Out of line for the same reason.
#[inline(never)]
pub fn subtract_product<T: Real, const B: usize>(c: &mut Block<T, B>, a: &Block<T, B>, b: &Block<T, B>) {
    for (c_row, a_row) in c.iter_mut().zip(a) {
        for (scale, b_row) in a_row.iter().zip(b) {
            for (out, value) in c_row.iter_mut().zip(b_row) {
                *out -= *scale * *value;
            }
        }
    }
}

/// The columns of `A` from `first` on, as many as the result has.
#[inline(always)]
#[must_use]
pub fn columns<T: Real, const K: usize, const M: usize, const N: usize>(a: &[[T; M]; K], first: usize) -> [[T; N]; K] {
    core::array::from_fn(|r| core::array::from_fn(|c| a[r][first + c]))
}

/// `Aᵀ`.
#[inline]
#[must_use]
pub fn transpose<T: Real, const B: usize>(a: &Block<T, B>) -> Block<T, B> {
    let mut out = zero_block();
    for (i, row) in a.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            out[j][i] = *value;
        }
    }
    out
}
