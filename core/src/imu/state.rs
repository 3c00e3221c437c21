//! The state of the body at one instant: 15 degrees of freedom.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::ImuBias;
use crate::lie::so3;
use crate::real::Real;
use crate::storage::blank::blank;

/// Pose, velocity and biases of the body. Perturbation `[δφ δp δv δb_g δb_a]`: the rotation on the right, the rest additive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NavState<T: Real> {
    /// `R_WB`, maps body coordinates to world.
    pub world_from_body: UnitQuaternion<T>,
    /// `p_WB`, the body's origin in world, m.
    pub position_in_world: Vector3<T>,
    /// `v_WB`, m/s.
    pub velocity_in_world: Vector3<T>,
    /// Biases of the inertial measurement unit.
    pub bias: ImuBias<T>,
}

blank!([T: Real] NavState<T> { world_from_body, position_in_world, velocity_in_world, bias });

impl<T: Real> NavState<T> {
    /// At the origin, level, at rest, without bias.
    #[must_use]
    pub fn origin() -> Self {
        Self {
            world_from_body: UnitQuaternion::identity(),
            position_in_world: Vector3::zeros(),
            velocity_in_world: Vector3::zeros(),
            bias: ImuBias::default(),
        }
    }

    /// `T_WB`.
    #[must_use]
    pub fn pose(&self) -> Isometry3<T> {
        Isometry3::from_parts(Translation3::from(self.position_in_world), self.world_from_body)
    }

    /// `x ⊞ δ`, δ ordered `[δφ δp δv δb_g δb_a]`.
    #[must_use]
    pub fn retract(&self, delta: &[T; 15]) -> Self {
        let part = |i: usize| Vector3::new(delta[i], delta[i + 1], delta[i + 2]);
        let mut rotation = self.world_from_body * so3::exp(&part(0));
        rotation.renormalize_fast();
        Self {
            world_from_body: rotation,
            position_in_world: self.position_in_world + part(3),
            velocity_in_world: self.velocity_in_world + part(6),
            bias: ImuBias { gyro_rad_s: self.bias.gyro_rad_s + part(9), accel_m_s2: self.bias.accel_m_s2 + part(12) },
        }
    }

    /// `x ⊟ x₀`, such that `x₀ ⊞ (x ⊟ x₀) = x`.
    #[must_use]
    pub fn local(&self, from: &Self) -> [T; 15] {
        let mut delta = [T::ZERO; 15];
        let parts = [
            so3::log(&(from.world_from_body.inverse() * self.world_from_body)),
            self.position_in_world - from.position_in_world,
            self.velocity_in_world - from.velocity_in_world,
            self.bias.gyro_rad_s - from.bias.gyro_rad_s,
            self.bias.accel_m_s2 - from.bias.accel_m_s2,
        ];
        for (slot, part) in delta.chunks_exact_mut(3).zip(&parts) {
            slot.copy_from_slice(part.as_slice());
        }
        delta
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.world_from_body.coords.iter().all(|value| value.is_usable())
            && self.local(&Self::origin()).iter().skip(3).all(|value| value.is_usable())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu::testing::{Motion, Normal};
    use crate::testing::{assert_close, numerical_jacobian};
    use nalgebra::{SMatrix, SVector};

    #[test]
    fn retract_and_local_are_inverse() {
        let mut normal = Normal(7);
        for _ in 0..200 {
            let state = Motion::lively().state(3.0 * normal.draw());
            let delta: [f64; 15] = core::array::from_fn(|_| 0.8 * normal.draw());
            let back = state.retract(&delta).local(&state);
            // Beyond half a turn the shorter way round is the other one.
            if Vector3::new(delta[0], delta[1], delta[2]).norm() < core::f64::consts::PI {
                assert_close(&SVector::from(back), &SVector::from(delta), 1e-13);
            }
            let other = Motion::lively().state(3.0 * normal.draw());
            let there = state.retract(&other.local(&state));
            assert!(there.local(&other).iter().all(|x| x.abs() < 1e-13));
        }
    }

    #[test]
    fn nothing_added_is_nothing_changed() {
        let state = Motion::lively().state(0.7);
        assert_eq!(state.local(&state).map(f64::abs), [0.0; 15]);
        assert!(state.retract(&[0.0; 15]).local(&state).iter().all(|x| x.abs() < 1e-15));
    }

    #[test]
    fn rotation_is_perturbed_on_the_right_and_in_the_stated_order() {
        let state = Motion::lively().state(0.7);
        let moved = numerical_jacobian::<15, 15>(1e-6, |d| state.retract(&(*d).into()).local(&state).into());
        assert_close(&moved, &SMatrix::identity(), 1e-9);
        // A point fixed in the body moves by R [φ]× x.
        let point = nalgebra::Point3::new(0.3, -0.4, 1.2);
        let by_rotation = numerical_jacobian::<3, 15>(1e-6, |d| (state.retract(&(*d).into()).pose() * point).coords);
        let expected = -(state.world_from_body.to_rotation_matrix().matrix() * so3::hat(&point.coords));
        assert_close(&by_rotation.fixed_columns::<3>(0).into_owned(), &expected, 1e-8);
        assert_close(&by_rotation.fixed_columns::<3>(3).into_owned(), &SMatrix::identity(), 1e-8);
    }

    #[test]
    fn any_number_that_is_none_is_found() {
        assert!(Motion::lively().state(0.3).is_finite());
        for at in 0..15 {
            let mut delta = [0.0; 15];
            delta[at] = f64::NAN;
            assert!(!NavState::origin().retract(&delta).is_finite(), "{at}");
        }
    }
}
