//! Normal equations of one landmark, 3×3, and their Cholesky factor.

use nalgebra::Vector3;

use crate::factor::reprojection;
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::window::{DepthKnowledge, NormalizedPoint};

/// Added to the diagonal: an inverse depth that nothing is known of stays where it is.
pub(super) const FLOOR: f64 = 1e-6;

/// `C = Σ w J_lᵀ J_l` (lower triangle) and `g = Σ w J_lᵀ r` over `l = (x, y, λ)`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PointNormal<T: Real> {
    /// `g`.
    pub gradient: [T; 3],
    /// Rows `xx`, `yx yy`, `λx λy λλ`.
    lower: [T; 6],
}

impl<T: Real> PointNormal<T> {
    /// One row of a factor: its slopes, the same times its weight, its residual.
    #[inline(always)]
    pub fn add_row(&mut self, slope: &[T; 3], weighted: &[T; 3], residual: T) {
        let c = &mut self.lower;
        c[0] += weighted[0] * slope[0];
        c[1] += weighted[1] * slope[0];
        c[2] += weighted[1] * slope[1];
        c[3] += weighted[2] * slope[0];
        c[4] += weighted[2] * slope[1];
        c[5] += weighted[2] * slope[2];
        for (sum, value) in self.gradient.iter_mut().zip(weighted) {
            *sum += *value * residual;
        }
    }

    /// The observation in the anchor itself; returns its robust cost, twice.
    #[inline]
    pub fn add_anchor(&mut self, direction: &Vector3<T>, point: &NormalizedPoint<T>, kernel: &Kernel<T>) -> T {
        let residual = reprojection::at_anchor(direction, point);
        let squared = residual.norm_squared();
        let weighted = kernel.weight(squared) * point.inverse_sigma;
        self.lower[0] += weighted * point.inverse_sigma;
        self.lower[2] += weighted * point.inverse_sigma;
        self.gradient[0] += weighted * residual.x;
        self.gradient[1] += weighted * residual.y;
        kernel.rho(squared)
    }

    /// The prior on the inverse depth; returns its cost, twice.
    #[inline]
    pub fn add_prior(&mut self, inverse_depth: T, prior: &DepthKnowledge<T>) -> T {
        let (residual, slope) = (prior.residual(inverse_depth), prior.slope(inverse_depth));
        self.lower[5] += slope * slope;
        self.gradient[2] += slope * residual;
        residual * residual
    }

    /// `L` with `L Lᵀ = C + damping · diag C + floor`; nothing where `C` is no number.
    #[inline]
    pub fn factorize(&self, damping: T) -> Option<PointFactor<T>> {
        let c = &self.lower;
        let (more, floor) = (T::one() + damping, T::of(FLOOR));
        let usable = |pivot: T| if pivot > T::ZERO && pivot.is_usable() { Some(pivot.root()) } else { None };
        let xx = usable(c[0] * more + floor)?;
        let yx = c[1] / xx;
        let yy = usable(c[2] * more + floor - yx * yx)?;
        let zx = c[3] / xx;
        let zy = (c[4] - zx * yx) / yy;
        // Rounding alone may leave nothing of what is little: at least the floor is there.
        let zz = usable((c[5] * more + floor - zx * zx - zy * zy).max(floor))?;
        Some(PointFactor { below: [yx, zx, zy], inverse_pivots: [T::one() / xx, T::one() / yy, T::one() / zz] })
    }
}

/// A lower triangle of three rows, by its entries below the diagonal (`yx`, `λx`, `λy`) and the inverses of those on it.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointFactor<T: Real> {
    below: [T; 3],
    inverse_pivots: [T; 3],
}

impl<T: Real> PointFactor<T> {
    /// `L⁻¹ g`.
    #[inline]
    pub fn whiten(&self, g: &[T; 3]) -> [T; 3] {
        let ([yx, zx, zy], [x, y, z]) = (&self.below, &self.inverse_pivots);
        let first = g[0] * *x;
        let second = (g[1] - *yx * first) * *y;
        [first, second, (g[2] - *zx * first - *zy * second) * *z]
    }

    /// `L⁻¹ W` of three rows.
    #[inline]
    pub fn whiten_rows(&self, rows: &mut [[T; 6]; 3]) {
        let ([yx, zx, zy], [x, y, z]) = (&self.below, &self.inverse_pivots);
        let [first, second, third] = rows;
        for ((a, b), c) in first.iter_mut().zip(second).zip(third) {
            *a *= *x;
            *b = (*b - *yx * *a) * *y;
            *c = (*c - *zx * *a - *zy * *b) * *z;
        }
    }

    /// `C⁻¹ g`.
    #[inline]
    pub fn solve(&self, g: &[T; 3]) -> [T; 3] {
        let ([yx, zx, zy], [x, y, z]) = (&self.below, &self.inverse_pivots);
        let w = self.whiten(g);
        let third = w[2] * *z;
        let second = (w[1] - *zy * third) * *y;
        [(w[0] - *yx * second - *zx * third) * *x, second, third]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, SMatrix, Vector3};
    use proptest::prelude::*;

    use super::PointNormal;

    proptest! {
        #[test]
        fn the_factor_solves_the_equations(
            rows in prop::collection::vec(prop::array::uniform4(-2.0f64..2.0), 3..8), damping in 0.0f64..0.5,
            couplings in prop::array::uniform3(prop::array::uniform6(-1.0f64..1.0)),
        ) {
            let mut own = PointNormal::default();
            let (mut matrix, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            for [x, y, z, residual] in rows {
                let slope = Vector3::new(x, y, z);
                own.add_row(&[x, y, z], &[0.7 * x, 0.7 * y, 0.7 * z], residual);
                matrix += slope * slope.transpose() * 0.7;
                gradient += slope * residual * 0.7;
            }
            matrix += Matrix3::from_diagonal(&matrix.diagonal()) * damping + Matrix3::identity() * super::FLOOR;
            let inverse = matrix.try_inverse();
            prop_assume!(inverse.is_some_and(|inverse| inverse.norm() < 1e3));
            let (Some(factor), Some(inverse)) = (own.factorize(damping), inverse) else {
                return Err(TestCaseError::fail("no factor"));
            };
            prop_assert!((Vector3::from(factor.solve(&own.gradient)) - inverse * gradient).norm() < 1e-9);
            let whitened = Vector3::from(factor.whiten(&own.gradient));
            prop_assert!((whitened.norm_squared() - gradient.dot(&(inverse * gradient))).abs() < 1e-9);
            let mut rows = couplings;
            factor.whiten_rows(&mut rows);
            let dense = |rows: &[[f64; 6]; 3]| SMatrix::<f64, 3, 6>::from_fn(|r, c| rows[r][c]);
            let expected = dense(&couplings).tr_mul(&(inverse * dense(&couplings)));
            prop_assert!((dense(&rows).tr_mul(&dense(&rows)) - expected).norm() < 1e-8 * (1.0 + expected.norm()));
        }
    }

    #[test]
    fn numbers_that_are_none_have_no_factor() {
        for spoil in [f64::NAN, f64::INFINITY] {
            let mut own = PointNormal::default();
            own.add_row(&[1.0, spoil, 0.0], &[1.0, spoil, 0.0], 0.0);
            assert!(own.factorize(0.0).is_none());
        }
    }
}
