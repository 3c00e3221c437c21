//! Rotations.
//!
//! # Model
//! Perturbation on the right, `R ⊞ δ = R Exp(δ)`, `R₁ ⊟ R₀ = Log(R₀ᵀ R₁)`, δ in radians.
//! ```text
//! Exp(φ + δ) ≈ Exp(φ) Exp(Jr(φ) δ)        Jr(φ) = I − (1−cos θ)/θ² [φ]× + (θ − sin θ)/θ³ [φ]×²
//! ```

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::real::Real;

/// `[v]×`, with `[v]× w = v × w`.
#[inline]
pub fn hat<T: Real>(v: &Vector3<T>) -> Matrix3<T> {
    let o = T::ZERO;
    Matrix3::new(o, -v.z, v.y, v.z, o, -v.x, -v.y, v.x, o)
}

/// The rotation by the angle `‖φ‖` (rad) about `φ`.
#[inline]
pub fn exp<T: Real>(phi: &Vector3<T>) -> UnitQuaternion<T> {
    let half = T::of(0.5);
    let angle_squared = phi.norm_squared();
    // Below this the next term of the series is under the rounding error of f32 (and of f64 at 1e-4⁴ / 384).
    let (scale, w) = if angle_squared < T::of(1e-8) {
        (half - angle_squared * T::of(1.0 / 48.0), T::one() - angle_squared * T::of(0.125))
    } else {
        let angle = angle_squared.root();
        let (sine, cosine) = (angle * half).sine_cosine();
        (sine / angle, cosine)
    };
    UnitQuaternion::new_unchecked(Quaternion::new(w, phi.x * scale, phi.y * scale, phi.z * scale))
}

/// The rotation vector (rad) of the shorter way, `‖φ‖ ≤ π`.
#[inline]
pub fn log<T: Real>(rotation: &UnitQuaternion<T>) -> Vector3<T> {
    let q = rotation.quaternion();
    let flip = if q.w < T::ZERO { -T::one() } else { T::one() };
    let (w, v) = (q.w * flip, Vector3::new(q.i, q.j, q.k) * flip);
    let sine_squared = v.norm_squared();
    let scale = if sine_squared < T::of(1e-8) {
        // 2 atan(s/w)/s with s → 0, w → 1
        (T::of(2.0) - sine_squared / (w * w) * T::of(2.0 / 3.0)) / w
    } else {
        let sine = sine_squared.root();
        sine.arc_tangent(w) * T::of(2.0) / sine
    };
    v * scale
}

/// The right Jacobian `Jr(φ)`, 3×3.
#[inline]
pub fn right_jacobian<T: Real>(phi: &Vector3<T>) -> Matrix3<T> {
    let angle_squared = phi.norm_squared();
    let (a, b) = if angle_squared < T::of(1e-4) {
        (
            T::of(0.5) - angle_squared * (T::of(1.0 / 24.0) - angle_squared * T::of(1.0 / 720.0)),
            T::of(1.0 / 6.0) - angle_squared * T::of(1.0 / 120.0),
        )
    } else {
        // 1 − cos θ = 2 sin²(θ/2), sin θ = 2 sin(θ/2) cos(θ/2): in f32 the plain difference would leave four digits at 1°.
        let angle = angle_squared.root();
        let (sine, cosine) = (angle * T::of(0.5)).sine_cosine();
        let two = T::of(2.0);
        (two * sine * sine / angle_squared, (angle - two * sine * cosine) / (angle_squared * angle))
    };
    let cross = hat(phi);
    Matrix3::identity() - cross * a + cross * cross * b
}

/// The inverse of the right Jacobian, 3×3: `Log(Exp(φ) Exp(δ)) ≈ φ + Jr⁻¹(φ) δ`. Singular at `‖φ‖ = 2π`.
#[inline]
pub fn right_jacobian_inverse<T: Real>(phi: &Vector3<T>) -> Matrix3<T> {
    let angle_squared = phi.norm_squared();
    let b = if angle_squared < T::of(1e-4) {
        T::of(1.0 / 12.0) + angle_squared * T::of(1.0 / 720.0)
    } else {
        let angle = angle_squared.root();
        // (1 + cos θ)/sin θ = cot(θ/2), regular at π
        let (sine, cosine) = (angle * T::of(0.5)).sine_cosine();
        T::one() / angle_squared - cosine / (T::of(2.0) * angle * sine)
    };
    let cross = hat(phi);
    Matrix3::identity() + cross * T::of(0.5) + cross * cross * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, numerical_jacobian};
    use core::f64::consts::PI;
    use proptest::prelude::*;

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1.0f64..1.0)
            .prop_map(Vector3::from)
            .prop_filter("long enough to have a direction", |v| v.norm() > 0.1)
            .prop_map(|v| v.normalize())
    }

    /// Angles from 1e-12 to almost `limit`, as many small as large ones, and some just short of the limit.
    fn angle(limit: f64) -> impl Strategy<Value = f64> {
        prop_oneof![
            (-12.0f64..0.0).prop_map(|power| 10f64.powf(power)),
            1e-3..limit,
            (-9.0f64..-1.0).prop_map(move |power| limit - 10f64.powf(power)),
        ]
    }

    prop_compose! {
        fn rotation_vector(limit: f64)(axis in direction(), angle in angle(limit)) -> Vector3<f64> { axis * angle }
    }

    proptest! {
        #[test]
        fn log_inverts_exp(phi in rotation_vector(PI)) {
            prop_assert!((log(&exp(&phi)) - phi).norm() <= 1e-14 * (1.0 + phi.norm()));
            // Small angles keep their relative precision.
            prop_assert!((log(&exp(&phi)) - phi).norm() <= 4e-15 * phi.norm());
        }

        #[test]
        fn log_inverts_exp_in_single_precision(phi in rotation_vector(PI - 1e-6)) {
            let single = phi.cast::<f32>();
            prop_assert!((log(&exp(&single)) - single).norm() <= 1e-6 * single.norm());
        }

        #[test]
        fn exp_inverts_log(phi in rotation_vector(6.0)) {
            let rotation = exp(&phi);
            prop_assert!(log(&rotation).norm() <= PI + 1e-15);
            prop_assert!((exp(&log(&rotation)).to_rotation_matrix().matrix() - rotation.to_rotation_matrix().matrix()).norm() < 1e-14);
        }

        #[test]
        fn exp_is_the_matrix_exponential_of_hat(phi in rotation_vector(6.0)) {
            let by_series = hat(&phi).exp();
            prop_assert!((exp(&phi).to_rotation_matrix().matrix() - by_series).norm() < 1e-13);
            prop_assert!((exp(&phi).norm() - 1.0).abs() < 1e-15);
        }

        #[test]
        fn opposite_quaternions_are_one_rotation(phi in rotation_vector(PI)) {
            let rotation = exp(&phi);
            let opposite = UnitQuaternion::new_unchecked(-rotation.into_inner());
            prop_assert_eq!(log(&opposite), log(&rotation));
        }

        #[test]
        fn hat_is_the_cross_product(a in direction(), b in direction()) {
            prop_assert!((hat(&a) * b - a.cross(&b)).norm() < 1e-15);
        }

        #[test]
        fn right_jacobian_matches_central_differences(phi in rotation_vector(6.0)) {
            let base = exp(&phi).inverse();
            let numerical = numerical_jacobian(1e-5, |delta| log(&(base * exp(&(phi + delta)))));
            assert_close(&right_jacobian(&phi), &numerical, 1e-9);
        }

        #[test]
        fn inverse_right_jacobian_matches_central_differences(phi in rotation_vector(3.0)) {
            let numerical = numerical_jacobian(1e-5, |delta| log(&(exp(&phi) * exp(delta))));
            assert_close(&right_jacobian_inverse(&phi), &numerical, 1e-8);
        }

        #[test]
        fn the_two_jacobians_are_inverse_to_each_other(phi in rotation_vector(6.0)) {
            let error = right_jacobian(&phi) * right_jacobian_inverse(&phi) - Matrix3::identity();
            // The condition number grows towards 2π.
            prop_assert!(error.norm() < 1e-13 / (2.0 * PI - phi.norm()));
        }

        #[test]
        fn single_precision_jacobians_are_those_of_double_precision(phi in rotation_vector(3.1)) {
            let single = phi.cast::<f32>();
            let exact = single.cast::<f64>();
            prop_assert!((right_jacobian(&single).cast::<f64>() - right_jacobian(&exact)).norm() < 1e-6);
            prop_assert!((right_jacobian_inverse(&single).cast::<f64>() - right_jacobian_inverse(&exact)).norm() < 2e-6);
        }
    }

    #[test]
    fn nothing_turns_by_nothing() {
        let zero = Vector3::<f64>::zeros();
        assert_eq!(exp(&zero), UnitQuaternion::identity());
        assert_eq!(log(&UnitQuaternion::<f64>::identity()), zero);
        assert_eq!(right_jacobian(&zero), Matrix3::identity());
        assert_eq!(right_jacobian_inverse(&zero), Matrix3::identity());
    }

    #[test]
    fn half_a_turn() {
        for axis in [Vector3::x(), Vector3::y(), -Vector3::z(), Vector3::new(0.6, 0.0, 0.8)] {
            let phi = axis * PI;
            // The axis may come back with either sign: both are the same rotation.
            let back = log(&exp(&phi));
            assert!((back - phi).norm().min((back + phi).norm()) < 1e-14);
            let error = right_jacobian(&phi) * right_jacobian_inverse(&phi) - Matrix3::identity();
            assert!(error.norm() < 1e-14);
        }
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let turned = exp(&Vector3::new(0.0, 0.0, PI / 2.0)) * Vector3::x();
        assert!((turned - Vector3::y()).norm() < 1e-15);
    }
}
