//! Numerical Jacobians for unit tests.

use nalgebra::{SMatrix, SVector};

/// Central differences of `f: ℝᴺ → ℝᴹ` around zero, M×N.
pub fn numerical_jacobian<const M: usize, const N: usize>(
    step: f64,
    f: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
) -> SMatrix<f64, M, N> {
    let mut jacobian = SMatrix::<f64, M, N>::zeros();
    for column in 0..N {
        let mut delta = SVector::zeros();
        delta[column] = step;
        let difference = (f(&delta) - f(&-delta)) / (2.0 * step);
        jacobian.set_column(column, &difference);
    }
    jacobian
}

/// Asserts that two matrices agree to `tolerance` relative to the larger norm.
pub fn assert_close<const M: usize, const N: usize>(actual: &SMatrix<f64, M, N>, expected: &SMatrix<f64, M, N>, tolerance: f64) {
    let scale = expected.norm().max(actual.norm()).max(1e-12);
    let error = (actual - expected).norm() / scale;
    assert!(error < tolerance, "relative error {error:.2e} > {tolerance:.0e}\nactual {actual}\nexpected {expected}");
}
