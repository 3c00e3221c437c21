//! Which way is down.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::lie::matrix::symmetric_eigen;
use crate::real::Real;

/// The shortest rotation `R_WB` that takes a measured specific force (body frame, any length) to `+z`: its rotation
/// vector is horizontal, so that it adds no yaw.
///
/// Upside down, where every horizontal axis is as short, it turns by π about the body's x axis. `None` for a
/// vector without direction.
#[must_use]
pub fn world_from_specific_force<T: Real>(specific_force: &Vector3<T>) -> Option<UnitQuaternion<T>> {
    let norm = specific_force.norm();
    if !(norm.is_usable() && norm > T::of(1e-6)) {
        return None;
    }
    let up = specific_force / norm;
    let across = (up.x * up.x + up.y * up.y).root();
    if across < T::of(1e-12) {
        let upright = up.z > T::ZERO;
        let (w, x) = if upright { (T::one(), T::ZERO) } else { (T::ZERO, T::one()) };
        return Some(UnitQuaternion::new_unchecked(Quaternion::new(w, x, T::ZERO, T::ZERO)));
    }
    // Half the angle between `up` and z: the larger of its cosine and sine comes from 1 ± z without cancellation, the other from
    // across = 2 sin cos. 1 − cos² of a small angle would leave an f32 no digit of the sine.
    let half = T::of(0.5);
    let larger = ((T::one() + up.z.abs()) * half).root();
    let smaller = across * half / larger;
    let (w, sine_half) = if up.z > T::ZERO { (larger, smaller) } else { (smaller, larger) };
    // Axis up × z = (y, −x, 0) / |across|
    let quaternion = Quaternion::new(w, up.y / across * sine_half, -up.x / across * sine_half, T::ZERO);
    Some(UnitQuaternion::new_normalize(quaternion))
}

/// The global minimum of `gᵀA g − 2cᵀg` over `‖g‖ = magnitude`, for symmetric `A`.
///
/// # Model
/// Stationary points satisfy `(A + λI) g = c`. With `A = QΛQᵀ`, `y = Qᵀc`, the minimum has `λ > −Λ_min`, where
/// `‖g(λ)‖² = Σ yᵢ²/(Λᵢ + λ)²` falls from infinity to zero: one root, found by bisection.
///
/// # Errors
/// `None` when a number is not finite or `c` is zero.
#[must_use]
pub fn gravity_of_known_magnitude<T: Real>(information: &Matrix3<T>, right: &Vector3<T>, magnitude: T) -> Option<Vector3<T>> {
    let eigen = symmetric_eigen(information)?;
    let values = eigen.eigenvalues;
    let y = eigen.eigenvectors.tr_mul(right);
    let (weakest, smallest) = values.argmin();
    let length = right.norm();
    if !(length.is_usable() && length > T::ZERO && smallest.is_usable() && magnitude > T::ZERO) {
        return None;
    }
    // Shifted multiplier μ = λ + Λ_min > 0; at the bounds ‖g‖ is above and below the magnitude.
    let excess = values.add_scalar(-smallest);
    let mut low = (y[weakest].abs() / magnitude).max(length / magnitude * T::default_epsilon());
    let mut high = length / magnitude;
    let at = |shift: T| y.zip_map(&excess, |y, excess| y / (excess + shift));
    for _ in 0..64 {
        let middle = (low + high) * T::of(0.5);
        if at(middle).norm_squared() > magnitude * magnitude {
            low = middle;
        } else {
            high = middle;
        }
    }
    let gravity = eigen.eigenvectors * at((low + high) * T::of(0.5));
    let norm = gravity.norm();
    (norm.is_usable() && norm > T::ZERO).then(|| gravity * (magnitude / norm))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        (-1.0..1.0, -1.0..1.0, -1.0..1.0_f64)
            .prop_filter_map("short", |(x, y, z)| (x * x + y * y + z * z > 1e-2).then(|| Vector3::new(x, y, z)))
    }

    proptest! {
        #[test]
        fn specific_force_points_up_and_no_yaw_is_added(force in direction()) {
            let rotation = world_from_specific_force(&force).ok_or(TestCaseError::fail("none"))?;
            prop_assert!((rotation * force.normalize() - Vector3::z()).norm() < 1e-12);
            prop_assert!(rotation.scaled_axis().z.abs() < 1e-12);
            let narrow = world_from_specific_force(&force.cast::<f32>()).ok_or(TestCaseError::fail("none"))?;
            // Some thirty roundings of 6e-8 each: two normalisations, a quaternion and its product.
            prop_assert!((narrow * force.cast::<f32>().normalize() - Vector3::z()).norm() < 32.0 * f32::EPSILON);
        }

        #[test]
        fn minimum_on_the_sphere_beats_every_other_point(
            a in direction(), b in direction(), c in direction(), other in direction()
        ) {
            let information = a * a.transpose() * 3.0 + b * b.transpose();
            let cost = |g: &Vector3<f64>| (g.transpose() * information * g)[0] - 2.0 * c.dot(g);
            let best = gravity_of_known_magnitude(&information, &c, 9.81).ok_or(TestCaseError::fail("none"))?;
            prop_assert!((best.norm() - 9.81).abs() < 1e-9);
            let other = other.normalize() * 9.81;
            prop_assert!(cost(&best) <= cost(&other) + 1e-9 * cost(&other).abs());
        }
    }

    #[test]
    fn upside_down_and_nearly_so_are_regular() {
        for x in [0.0, 1e-20, 1e-10, 1e-5] {
            let force = Vector3::new(x, -x, -9.81_f64);
            let turned = world_from_specific_force(&force).map(|rotation| rotation * force);
            assert!(turned.is_some_and(|up| (up - Vector3::z() * force.norm()).norm() < 1e-9), "{x}: {turned:?}");
        }
        assert_eq!(world_from_specific_force(&Vector3::<f64>::zeros()), None);
        assert_eq!(world_from_specific_force(&Vector3::new(f64::NAN, 0.0, 1.0)), None);
    }
}
