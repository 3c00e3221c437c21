//! Robust kernels on whitened squared residuals.
//!
//! # Model
//! A factor with the whitened residual `r` costs `½ ρ(s)`, `s = ‖r‖²`, and enters the normal equations with the weight `w = ρ'(s)`
//! (iteratively reweighted least squares). Threshold `δ²` in the same units as `s`: dimensionless, a χ² quantile such as
//! [`stats::CHI2_95_2DOF`](super::stats::CHI2_95_2DOF).
//! ```text
//! Huber    ρ(s) = s                  for s ≤ δ²,  2δ√s − δ²  beyond        ρ'(s) = min(1, δ/√s)
//! Cauchy   ρ(s) = δ² ln(1 + s/δ²)                                          ρ'(s) = 1/(1 + s/δ²)
//! ```
//! Both have `ρ(0) = 0` and `ρ'(0) = 1`: small residuals cost what they cost without a kernel.
//!
//! # Reference
//! P. J. Huber, "Robust Estimation of a Location Parameter", 1964; Z. Zhang, "Parameter Estimation Techniques", 1997.

use crate::real::Real;
use crate::storage::blank::Blank;

/// How much a squared residual is allowed to cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel<T: Real> {
    /// Plain least squares.
    Quadratic,
    /// Quadratic up to the threshold, linear beyond: convex, so it adds no local minima.
    Huber {
        /// `δ²`, dimensionless, positive.
        threshold_squared: T,
    },
    /// Logarithmic: a gross outlier has next to no pull, and the cost is no longer convex.
    Cauchy {
        /// `δ²`, dimensionless, positive.
        threshold_squared: T,
    },
}

impl<T: Real> Blank for Kernel<T> {
    const BLANK: Self = Self::Quadratic;
}

impl<T: Real> Kernel<T> {
    /// Huber's kernel with the threshold `δ²` on the squared whitened residual.
    #[must_use]
    pub const fn huber(threshold_squared: T) -> Self {
        Self::Huber { threshold_squared }
    }

    /// Cauchy's kernel with the threshold `δ²` on the squared whitened residual.
    #[must_use]
    pub const fn cauchy(threshold_squared: T) -> Self {
        Self::Cauchy { threshold_squared }
    }

    /// `w = ρ'(s)`, in (0, 1], for the squared whitened residual `s ≥ 0`.
    #[inline]
    #[must_use]
    pub fn weight(&self, squared_residual: T) -> T {
        match *self {
            Self::Quadratic => T::one(),
            Self::Huber { threshold_squared } if squared_residual <= threshold_squared => T::one(),
            Self::Huber { threshold_squared } => (threshold_squared / squared_residual).root(),
            Self::Cauchy { threshold_squared } => threshold_squared / (threshold_squared + squared_residual),
        }
    }

    /// `ρ(s)` for the squared whitened residual `s ≥ 0`; the cost is half of it.
    #[inline]
    #[must_use]
    pub fn rho(&self, squared_residual: T) -> T {
        match *self {
            Self::Quadratic => squared_residual,
            Self::Huber { threshold_squared } if squared_residual <= threshold_squared => squared_residual,
            Self::Huber { threshold_squared } => T::of(2.0) * (threshold_squared * squared_residual).root() - threshold_squared,
            Self::Cauchy { threshold_squared } => threshold_squared * (squared_residual / threshold_squared).ln_1p(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn kernels(threshold_squared: f64) -> [Kernel<f64>; 3] {
        [Kernel::Quadratic, Kernel::huber(threshold_squared), Kernel::cauchy(threshold_squared)]
    }

    proptest! {
        #[test]
        fn the_weight_is_the_derivative_of_rho(s in 0.01f64..200.0, threshold_squared in 0.5f64..20.0) {
            for kernel in kernels(threshold_squared) {
                let step = 1e-5 * s;
                let numerical = (kernel.rho(s + step) - kernel.rho(s - step)) / (2.0 * step);
                // Only at Huber's corner the second derivative jumps, and only that spoils the difference: by step/4δ² at most.
                prop_assert!((kernel.weight(s) - numerical).abs() < 1e-9 + step / threshold_squared, "{kernel:?} {s}");
            }
        }

        #[test]
        fn larger_residuals_weigh_less_and_cost_more(s in 0.0f64..200.0, more in 0.001f64..100.0, threshold_squared in 0.5f64..20.0) {
            for kernel in kernels(threshold_squared) {
                prop_assert!(kernel.weight(s) >= kernel.weight(s + more));
                prop_assert!(kernel.weight(s + more) > 0.0);
                prop_assert!(kernel.rho(s) < kernel.rho(s + more));
                prop_assert!(kernel.rho(s) <= s * (1.0 + 1e-15));
            }
        }
    }

    #[test]
    fn values_by_hand() {
        // δ = 2, ‖r‖ = 6: Huber 2·2·6 − 4 = 20, weight 1/3; Cauchy 4 ln(1 + 9), weight 1/10.
        let huber = Kernel::<f64>::huber(4.0);
        assert!((huber.rho(36.0) - 20.0).abs() < 1e-14 && (huber.weight(36.0) - 1.0 / 3.0).abs() < 1e-15);
        assert!(huber.rho(3.0) == 3.0 && huber.weight(4.0) == 1.0);
        let cauchy = Kernel::<f64>::cauchy(4.0);
        assert!((cauchy.rho(36.0) - 4.0 * 10f64.ln()).abs() < 1e-14 && (cauchy.weight(36.0) - 0.1).abs() < 1e-15);
        for kernel in kernels(4.0) {
            assert!(kernel.rho(0.0) == 0.0 && kernel.weight(0.0) == 1.0);
        }
    }
}
