//! The rotation inside one sampling interval.
//!
//! # Model
//! The rate is constant over the interval, the rotation vector of the whole of it is `φ = ω Δt`. With `M = R Exp(φ/2)`
//! the attitude at mid-interval, a change `δb` of the gyro bias turns (perturbation on the left, i.e. in the start frame)
//! ```text
//! end:  θ' = θ − Δt   M S(φ) δb          S(φ) = Exp(−φ/2) Jl(φ) = I + s [φ]ײ,   s = (1 − sin(θ/2)/(θ/2)) / θ²
//! mid:  θₘ = θ − Δt/2 M Jr(φ/2) δb       Jr(φ/2) = I − a [φ]× + b [φ]ײ
//! ```
//! Both in closed form, by series below 0.4 rad, which a gyro reaches only beyond 80 rad/s at 200 Hz.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::lie::so3;
use crate::real::Real;

/// `Exp(φ/2)` and the coefficients of `S(φ)` and `Jr(φ/2)`.
pub(super) struct Interval<T: Real> {
    /// `Exp(φ/2)`.
    pub half: UnitQuaternion<T>,
    s: T,
    a: T,
    b: T,
}

impl<T: Real> Interval<T> {
    /// For the rotation vector `phi` (rad) of the whole interval.
    #[inline]
    pub fn new(phi: &Vector3<T>) -> Self {
        let angle_squared = phi.norm_squared();
        if angle_squared < T::of(0.16) { Self::by_series(phi, angle_squared) } else { Self::in_closed_form(phi) }
    }

    #[inline]
    fn by_series(phi: &Vector3<T>, angle_squared: T) -> Self {
        // With x = |φ|/4 < 0.1 the first terms left out are x¹⁰/10! and x¹⁰/11!, < 3e-17.
        let x = angle_squared * T::of(1.0 / 16.0);
        let one = T::one();
        let sine = one - x * (T::of(1.0 / 6.0) - x * (T::of(1.0 / 120.0) - x * (T::of(1.0 / 5040.0) - x * T::of(1.0 / 362_880.0))));
        let cosine = one - x * (T::of(0.5) - x * (T::of(1.0 / 24.0) - x * (T::of(1.0 / 720.0) - x * T::of(1.0 / 40320.0))));
        let scale = sine * T::of(0.25);
        Self {
            half: UnitQuaternion::new_unchecked(Quaternion::new(cosine, phi.x * scale, phi.y * scale, phi.z * scale)),
            s: T::of(1.0 / 24.0) - angle_squared * (T::of(1.0 / 1920.0) - angle_squared * T::of(1.0 / 322_560.0)),
            a: T::of(0.25)
                - angle_squared * (T::of(1.0 / 192.0) - angle_squared * (T::of(1.0 / 23_040.0) - angle_squared * T::of(1.0 / 5_160_960.0))),
            b: T::of(1.0 / 24.0) - angle_squared * (T::of(1.0 / 1920.0) - angle_squared * T::of(1.0 / 322_560.0)),
        }
    }

    #[cold]
    fn in_closed_form(phi: &Vector3<T>) -> Self {
        let psi = phi * T::of(0.5);
        let angle = psi.norm();
        let (sine, cosine) = angle.sine_cosine();
        let angle_squared = angle * angle;
        let one = T::one();
        let s = (one - sine / angle) / (angle_squared * T::of(4.0));
        // Jr(ψ) = I − (1−cos)/ψ² [ψ] + (1 − sin/ψ)/ψ² [ψ]², [ψ] = [φ]/2; its last coefficient is s again.
        Self { half: so3::exp(&psi), s, a: (one - cosine) / angle_squared * T::of(0.5), b: s }
    }

    /// `(M S(φ), M Jr(φ/2))`, 3×3 each.
    #[inline]
    pub fn bias_to_rotation(&self, phi: &Vector3<T>, mid: &Matrix3<T>) -> (Matrix3<T>, Matrix3<T>) {
        // M [φ]ײ = M φ φᵀ − ‖φ‖² M,   M [φ]× = [M φ]× M
        let turned = mid * phi;
        let square = turned * phi.transpose() - mid * phi.norm_squared();
        let single = Matrix3::from_columns(&[turned.cross(&mid.column(0)), turned.cross(&mid.column(1)), turned.cross(&mid.column(2))]);
        (mid + square * self.s, mid - single * self.a + square * self.b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::assert_close;

    #[test]
    fn both_branches_agree_with_the_right_jacobian() {
        for angle in [1e-9, 1e-3, 0.05, 0.2, 0.39, 0.41, 1.0, 3.0] {
            let phi: Vector3<f64> = Vector3::new(0.3, -0.8, 0.52).normalize() * angle;
            let mid = so3::exp(&Vector3::new(0.4, 0.2, -1.0)).to_rotation_matrix().into_inner();
            let interval = Interval::new(&phi);
            let half = so3::exp(&(phi * 0.5));
            assert!(interval.half.angle_to(&half) < 1e-15 && (interval.half.norm() - 1.0).abs() < 4e-16);
            // S(φ) = Exp(φ/2) Jr(φ)
            let mean = mid * half.to_rotation_matrix().matrix() * series_jacobian(&phi);
            let (end, middle) = interval.bias_to_rotation(&phi, &mid);
            assert_close(&end, &mean, 1e-10);
            assert_close(&middle, &(mid * series_jacobian(&(phi * 0.5))), 1e-10);
        }
    }

    /// `Jr(φ) = Σ (−[φ]×)ᵏ / (k+1)!`.
    fn series_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
        let mut term = Matrix3::identity();
        let mut sum = term;
        for k in 1..40 {
            term = term * -so3::hat(phi) / f64::from(k + 1);
            sum += term;
        }
        sum
    }
}
