//! Rigid poses, as `Isometry3`.
//!
//! # Model
//! Two ways to move a pose `T = (R, p)`. The estimator's perturbation `δ = [δφ δp]` (rad, m) turns on the right and shifts in the parent:
//! ```text
//! T ⊞ δ = (R Exp(δφ), p + δp)                 T ⊟ T₀ = [Log(R₀ᵀR), p − p₀]
//! x_W = R x_B + p        ∂x_W/∂δ = [ −R [x_B]×   I ]          3×6
//! x_B = Rᵀ(x_W − p)      ∂x_B/∂δ = [ [x_B]×     −Rᵀ ]         3×6
//! ```
//! The group's own exponential follows a screw `ξ = [φ ρ]`:
//! ```text
//! exp(ξ) = (Exp(φ), Jl(φ) ρ),  Jl(φ) = Jr(−φ)       T exp(ξ) T⁻¹ = exp(Ad(T) ξ),  Ad(T) = [ R 0 ; [p]×R R ]      6×6
//! ```
//! # Degeneracy
//! [`log`] and [`local`] take the shorter way round; at half a turn the axis may come with either sign.

use nalgebra::{Isometry3, Matrix3, Matrix3x6, Matrix6, Translation3, Vector3, Vector6};

use super::so3;
use crate::real::Real;

#[inline]
fn halves<T: Real>(delta: &Vector6<T>) -> (Vector3<T>, Vector3<T>) {
    (delta.fixed_rows::<3>(0).into_owned(), delta.fixed_rows::<3>(3).into_owned())
}

#[inline]
fn joined<T: Real>(top: &Vector3<T>, bottom: &Vector3<T>) -> Vector6<T> {
    Vector6::new(top.x, top.y, top.z, bottom.x, bottom.y, bottom.z)
}

#[inline]
fn side_by_side<T: Real>(left: &Matrix3<T>, right: &Matrix3<T>) -> Matrix3x6<T> {
    let mut both = Matrix3x6::zeros();
    both.fixed_view_mut::<3, 3>(0, 0).copy_from(left);
    both.fixed_view_mut::<3, 3>(0, 3).copy_from(right);
    both
}

/// `T ⊞ δ` with `δ = [δφ δp]`: rotation on the right, translation additive in the parent frame.
#[inline]
#[must_use]
pub fn retract<T: Real>(pose: &Isometry3<T>, delta: &Vector6<T>) -> Isometry3<T> {
    let (turn, shift) = halves(delta);
    let mut rotation = pose.rotation * so3::exp(&turn);
    rotation.renormalize_fast();
    Isometry3::from_parts(Translation3::from(pose.translation.vector + shift), rotation)
}

/// `T ⊟ T₀`, such that `T₀ ⊞ (T ⊟ T₀) = T`.
#[inline]
#[must_use]
pub fn local<T: Real>(pose: &Isometry3<T>, from: &Isometry3<T>) -> Vector6<T> {
    joined(&so3::log(&(from.rotation.inverse() * pose.rotation)), &(pose.translation.vector - from.translation.vector))
}

/// `x_W = T x_B` and its Jacobian with respect to `δ` of `T ⊞ δ`, 3×6. That with respect to `x_B` is `R`.
#[inline]
#[must_use]
pub fn transform_with_jacobian<T: Real>(world_from_body: &Isometry3<T>, point_in_body: &Vector3<T>) -> (Vector3<T>, Matrix3x6<T>) {
    let rotation = world_from_body.rotation.to_rotation_matrix();
    let d_turn = -(rotation.matrix() * so3::hat(point_in_body));
    (rotation * point_in_body + world_from_body.translation.vector, side_by_side(&d_turn, &Matrix3::identity()))
}

/// `x_B = T⁻¹ x_W` and its Jacobian with respect to `δ` of `T ⊞ δ`, 3×6. That with respect to `x_W` is `Rᵀ`.
#[inline]
#[must_use]
pub fn inverse_transform_with_jacobian<T: Real>(world_from_body: &Isometry3<T>, point_in_world: &Vector3<T>) -> (Vector3<T>, Matrix3x6<T>) {
    let body_from_world = world_from_body.rotation.inverse().to_rotation_matrix();
    let point_in_body = body_from_world * (point_in_world - world_from_body.translation.vector);
    (point_in_body, side_by_side(&so3::hat(&point_in_body), &-body_from_world.matrix()))
}

/// The screw motion `exp(ξ)`, `ξ = [φ ρ]` (rad, m).
#[must_use]
pub fn exp<T: Real>(screw: &Vector6<T>) -> Isometry3<T> {
    let (turn, along) = halves(screw);
    Isometry3::from_parts(Translation3::from(so3::right_jacobian(&-turn) * along), so3::exp(&turn))
}

/// The screw `ξ = [φ ρ]` of a pose, `‖φ‖ ≤ π`.
#[must_use]
pub fn log<T: Real>(pose: &Isometry3<T>) -> Vector6<T> {
    let turn = so3::log(&pose.rotation);
    joined(&turn, &(so3::right_jacobian_inverse(&-turn) * pose.translation.vector))
}

/// `Ad(T)`, 6×6, in the order `[φ ρ]`.
#[must_use]
pub fn adjoint<T: Real>(pose: &Isometry3<T>) -> Matrix6<T> {
    let rotation = pose.rotation.to_rotation_matrix().into_inner();
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 0).copy_from(&(so3::hat(&pose.translation.vector) * rotation));
    adjoint
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, numerical_jacobian};
    use nalgebra::Matrix4;
    use proptest::prelude::*;

    fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-limit..limit).prop_map(Vector3::from)
    }

    prop_compose! {
        // ‖φ‖ ≤ √3 · 1.7 < π
        fn screw()(turn in vector(1.7), along in vector(5.0), power in 0..9i32) -> Vector6<f64> {
            joined(&(turn * 10f64.powi(-power)), &along)
        }
    }

    proptest! {
        #[test]
        fn log_inverts_exp(xi in screw()) {
            prop_assert!((log(&exp(&xi)) - xi).norm() < 1e-12);
        }

        #[test]
        fn exp_is_the_matrix_exponential(xi in screw()) {
            let (turn, along) = halves(&xi);
            let mut twist = Matrix4::zeros();
            twist.fixed_view_mut::<3, 3>(0, 0).copy_from(&so3::hat(&turn));
            twist.fixed_view_mut::<3, 1>(0, 3).copy_from(&along);
            prop_assert!((exp(&xi).to_homogeneous() - twist.exp()).norm() < 1e-12);
        }

        #[test]
        fn adjoint_carries_a_screw_to_the_other_side(pose in screw(), xi in screw()) {
            let pose = exp(&pose);
            let (one, other) = (pose * exp(&xi) * pose.inverse(), exp(&(adjoint(&pose) * xi)));
            prop_assert!((one.to_homogeneous() - other.to_homogeneous()).norm() < 1e-11);
        }

        #[test]
        fn local_inverts_retract(pose in screw(), delta in screw()) {
            let pose = exp(&pose);
            let moved = retract(&pose, &delta);
            prop_assert!((local(&moved, &pose) - delta).norm() < 1e-12);
            prop_assert!((retract(&pose, &local(&moved, &pose)).to_homogeneous() - moved.to_homogeneous()).norm() < 1e-12);
        }

        #[test]
        fn transform_jacobians_match_central_differences(pose in screw(), point in vector(5.0)) {
            let pose = exp(&pose);
            let (moved, jacobian) = transform_with_jacobian(&pose, &point);
            prop_assert!((moved - (pose * nalgebra::Point3::from(point)).coords).norm() < 1e-12);
            let numerical = numerical_jacobian(1e-5, |delta| transform_with_jacobian(&retract(&pose, delta), &point).0);
            assert_close(&jacobian, &numerical, 1e-8);

            let (back, jacobian) = inverse_transform_with_jacobian(&pose, &moved);
            prop_assert!((back - point).norm() < 1e-12);
            let numerical = numerical_jacobian(1e-5, |delta| inverse_transform_with_jacobian(&retract(&pose, delta), &moved).0);
            assert_close(&jacobian, &numerical, 1e-8);
        }
    }

    #[test]
    fn a_quarter_of_a_screw_by_hand() {
        // Driving 1 m of arc while turning by π/2: radius 2/π, so the end is 2/π ahead and 2/π to the left.
        let quarter = core::f64::consts::FRAC_PI_2;
        let pose = exp(&Vector6::new(0.0, 0.0, quarter, 1.0, 0.0, 0.0));
        assert!((pose.translation.vector - Vector3::new(1.0, 1.0, 0.0) / quarter).norm() < 1e-15);
    }
}
