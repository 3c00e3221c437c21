//! Camera poses in world, as matrices.

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::imu::NavState;
use crate::lie::matrix::{of_rotation, product};
use crate::real::Real;
use crate::storage::blank::blank;

/// `T_WC` as rotation matrix and centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPose<T: Real> {
    /// `R_WC`.
    pub world_from_camera: Matrix3<T>,
    /// `p_WC`, m.
    pub center_in_world: Vector3<T>,
}

blank!([T: Real] CameraPose<T> { world_from_camera, center_in_world });

impl<T: Real> Default for CameraPose<T> {
    fn default() -> Self {
        Self { world_from_camera: Matrix3::identity(), center_in_world: Vector3::zeros() }
    }
}

impl<T: Real> CameraPose<T> {
    /// The camera's pose when the body is at `state`.
    #[must_use]
    pub fn of(state: &NavState<T>, body_from_camera: &Isometry3<T>) -> Self {
        Self {
            world_from_camera: of_rotation(&(state.world_from_body * body_from_camera.rotation)),
            center_in_world: state.position_in_world + state.world_from_body * body_from_camera.translation.vector,
        }
    }

    /// `(R, t)` with `x_target = R x_anchor + t`.
    #[inline]
    #[must_use]
    pub fn target_from_anchor(target: &Self, anchor: &Self) -> (Matrix3<T>, Vector3<T>) {
        let camera_from_world = target.world_from_camera.transpose();
        (product(&camera_from_world, &anchor.world_from_camera), camera_from_world * (anchor.center_in_world - target.center_in_world))
    }
}
