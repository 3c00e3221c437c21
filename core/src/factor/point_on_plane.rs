//! A landmark lies on a plane.
//!
//! # Model
//! Landmark `b / λ`, `b = (x, y, 1)`, in the camera `(R, c)` of its anchor; plane `nᵀX + d = 0` in world, fixed during a solution:
//! ```text
//! X = c + R b / λ      m = Rᵀ n      r = s (nᵀX + d)                           1×1, whitened by s = √β / σ
//! ∂r/∂[θ ρ] = s [(b/λ) × m   m]                                                1×6, motion of the anchor's camera in its own axes
//! ∂r/∂(x, y, λ) = s [m_x/λ   m_y/λ   −mᵀb/λ²]                                  1×3
//! ```
//! The distance is metric, as in Ji et al.: their `β = 0.1` beside residuals in pixels has no unit here, because everything is whitened, `σ`
//! being what a point on a real surface is off its plane.
//!
//! # Degeneracy
//! `λ → 0`: a point farther than 20 m says nothing of a plane, and no value is returned.

use nalgebra::Vector3;

use crate::real::Real;
use crate::window::CameraPose;

/// A plane as one landmark knows it: position counted from the origin of the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneTerm<T> {
    /// `n`, unit.
    pub normal_in_world: [T; 3],
    /// `d`, m.
    pub offset_m: T,
    /// `s`, 1/m; zero where the landmark is on no plane.
    pub inverse_sigma: T,
}

impl<T: Real> PlaneTerm<T> {
    /// No plane.
    pub const NONE: Self = Self { normal_in_world: [T::ZERO; 3], offset_m: T::ZERO, inverse_sigma: T::ZERO };

    /// Whether there is one.
    #[inline(always)]
    #[must_use]
    pub fn is_some(&self) -> bool {
        self.inverse_sigma > T::ZERO
    }

    /// `r`.
    #[must_use]
    pub fn residual(&self, camera: &CameraPose<T>, direction: &Vector3<T>, inverse_depth: T) -> Option<T> {
        if inverse_depth < T::of(LEAST_INVERSE_DEPTH) {
            return None;
        }
        let point = camera.center_in_world + camera.world_from_camera * direction / inverse_depth;
        Some((Vector3::from(self.normal_in_world).dot(&point) + self.offset_m) * self.inverse_sigma)
    }

    /// `r` at `camera`, its slopes at `first_camera`.
    #[must_use]
    pub fn linearize(
        &self,
        camera: &CameraPose<T>,
        first_camera: &CameraPose<T>,
        direction: &Vector3<T>,
        inverse_depth: T,
    ) -> Option<PlaneLinearization<T>> {
        let residual = self.residual(camera, direction, inverse_depth)?;
        let normal = first_camera.world_from_camera.tr_mul(&Vector3::from(self.normal_in_world)) * self.inverse_sigma;
        let point = direction / inverse_depth;
        let turn = point.cross(&normal);
        Some(PlaneLinearization {
            residual,
            d_residual_d_anchor: [turn.x, turn.y, turn.z, normal.x, normal.y, normal.z],
            d_residual_d_landmark: [normal.x / inverse_depth, normal.y / inverse_depth, -normal.dot(&point) / inverse_depth],
        })
    }
}

/// 1/m.
const LEAST_INVERSE_DEPTH: f64 = 0.05;

/// A whitened residual with its Jacobians.
#[derive(Debug, Clone, Copy)]
pub struct PlaneLinearization<T> {
    /// `r`.
    pub residual: T,
    /// With respect to `[θ ρ]` of the anchor's camera.
    pub d_residual_d_anchor: [T; 6],
    /// With respect to `(x, y, λ)`.
    pub d_residual_d_landmark: [T; 3],
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::PlaneTerm;
    use crate::factor::reprojection::CameraMount;
    use crate::imu::NavState;
    use crate::testing::{assert_close, numerical_jacobian};
    use crate::window::CameraPose;

    proptest! {
        #[test]
        fn jacobians_match_central_differences(
            rotation in prop::array::uniform3(-1.0f64..1.0), position in prop::array::uniform3(-2.0f64..2.0),
            normal in prop::array::uniform3(-1.0f64..1.0), x in -0.5f64..0.5, y in -0.4f64..0.4, inverse_depth in 0.1f64..1.0,
        ) {
            prop_assume!(Vector3::from(normal).norm() > 0.1);
            let mount = Isometry3::from_parts(Translation3::new(-0.02, -0.06, 0.01), UnitQuaternion::from_euler_angles(0.02, 0.1, 1.5));
            let moved = |delta: &SVector<f64, 6>| {
                let mut first = [0.0; 15];
                first[..3].copy_from_slice(&rotation);
                first[3..6].copy_from_slice(&position);
                let mut full = [0.0; 15];
                full[..6].copy_from_slice(delta.as_slice());
                CameraPose::of(&NavState::origin().retract(&first).retract(&full), &mount)
            };
            let term = PlaneTerm { normal_in_world: Vector3::from(normal).normalize().into(), offset_m: 0.7, inverse_sigma: 30.0 };
            let (camera, direction) = (moved(&SVector::zeros()), Vector3::new(x, y, 1.0));
            let linear = term.linearize(&camera, &camera, &direction, inverse_depth);
            prop_assume!(linear.is_some());
            let Some(linear) = linear else { return Ok(()) };
            let value = |camera: &CameraPose<f64>, direction: &Vector3<f64>, inverse_depth: f64| {
                SVector::<f64, 1>::new(term.residual(camera, direction, inverse_depth).unwrap_or(f64::NAN))
            };
            let by_body = CameraMount::new(&mount).d_camera_d_body(&camera);
            let row = SMatrix::<f64, 1, 6>::from_row_slice(&linear.d_residual_d_anchor);
            assert_close(&(row * SMatrix::<f64, 6, 6>::from_fn(|r, c| by_body[r][c])),
                &numerical_jacobian(1e-6, |d| value(&moved(d), &direction, inverse_depth)), 1e-6);
            assert_close(&SMatrix::<f64, 1, 3>::from_row_slice(&linear.d_residual_d_landmark),
                &numerical_jacobian(1e-6, |d: &SVector<f64, 3>| value(&camera, &(direction + Vector3::new(d[0], d[1], 0.0)), inverse_depth + d[2])), 1e-6);
        }
    }

    #[test]
    fn two_centimetres_off_cost_one_at_a_sigma_of_two() {
        // A camera at the origin that looks along world z, a wall 3 m ahead, a point at 3.02 m.
        let term = PlaneTerm { normal_in_world: [0.0, 0.0, 1.0], offset_m: -3.0, inverse_sigma: 50.0 };
        let value = term.residual(&CameraPose::default(), &Vector3::new(0.3, -0.2, 1.0), 1.0 / 3.02);
        assert!(value.is_some_and(|value: f64| (value - 1.0).abs() < 1e-9));
        assert_eq!(term.residual(&CameraPose::default(), &Vector3::z(), 0.0), None);
        assert!(!PlaneTerm::<f64>::NONE.is_some());
    }
}
