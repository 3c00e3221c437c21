//! Small matrices out of line, for what is done once an image or at the start: unrolled where it is written, a product of 3×3 is 300
//! bytes of a microcontroller's flash, and there are a hundred of them. The results are those of the operators, bit for bit.

use nalgebra::{Const, Matrix3, SMatrix, SymmetricEigen, UnitQuaternion};

use crate::real::Real;

/// `a b`.
#[inline(never)]
pub(crate) fn product<T: Real, const R: usize, const K: usize, const C: usize>(
    a: &SMatrix<T, R, K>,
    b: &SMatrix<T, K, C>,
) -> SMatrix<T, R, C> {
    a * b
}

/// `aᵀ b`.
#[inline(never)]
pub(crate) fn transposed_product<T: Real, const R: usize, const K: usize, const C: usize>(
    a: &SMatrix<T, K, R>,
    b: &SMatrix<T, K, C>,
) -> SMatrix<T, R, C> {
    a.tr_mul(b)
}

/// `a + b`.
#[inline(never)]
pub(crate) fn sum<T: Real>(a: &Matrix3<T>, b: &Matrix3<T>) -> Matrix3<T> {
    a + b
}

/// The matrix of a rotation.
#[inline(never)]
pub(crate) fn of_rotation<T: Real>(rotation: &UnitQuaternion<T>) -> Matrix3<T> {
    rotation.to_rotation_matrix().into_inner()
}

/// The 3×3 block of a larger matrix whose first entry is at a row and a column.
#[inline(never)]
pub(crate) fn block<T: Real, const N: usize>(matrix: &SMatrix<T, N, N>, row: usize, column: usize) -> Matrix3<T> {
    matrix.fixed_view::<3, 3>(row, column).into_owned()
}

/// Writes such a block.
#[inline(never)]
pub(crate) fn put<T: Real, const N: usize>(matrix: &mut SMatrix<T, N, N>, row: usize, column: usize, block: &Matrix3<T>) {
    matrix.fixed_view_mut::<3, 3>(row, column).copy_from(block);
}

/// `diag(values)`.
#[inline(never)]
pub(crate) fn diagonal<T: Real, const N: usize>(values: impl Iterator<Item = T>) -> SMatrix<T, N, N> {
    let mut matrix = SMatrix::zeros();
    for (i, value) in values.enumerate().take(N) {
        matrix[(i, i)] = value;
    }
    matrix
}

/// Eigenvalues and eigenvectors of a symmetric matrix; `None` where the iteration finds no end.
#[inline(never)]
pub(crate) fn symmetric_eigen<T: Real>(matrix: &Matrix3<T>) -> Option<SymmetricEigen<T, Const<3>>> {
    SymmetricEigen::try_new(*matrix, T::default_epsilon(), 64)
}
