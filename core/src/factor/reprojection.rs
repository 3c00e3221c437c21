//! A landmark is seen where it projects.
//!
//! # Model
//! Landmark `b / λ` in the camera of its anchor `a`, seen in frame `j` at the undistorted point `z`, standard deviation `1/s`:
//! ```text
//! X   = R_ja b + λ t_ja                       (the point in camera j, times λ)
//! r   = s (X_xy / X_z − z)                                                    2×1, whitened
//! P   = s/X_z [1 0 −X_x/X_z; 0 1 −X_y/X_z]                                    2×3
//! ∂r/∂φ_a = −P R_ja [b + λ c]× R_CB      ∂r/∂p_a =  λ P R_jW                  2×3 each
//! ∂r/∂φ_j =  P [X + λ c]× R_CB           ∂r/∂p_j = −λ P R_jW                  2×3 each
//! ∂r/∂λ   =  P t_ja                                                          2×1
//! ```
//! with `c = R_CB t_BC`, the camera's centre in the body, in camera axes. Rotations are perturbed on the right in the body,
//! positions in world.
//!
//! # Degeneracy
//! `X_z → 0`: no value is returned below a twentieth of the depth at the anchor. `λ = 0` is regular.

use nalgebra::{Isometry3, Matrix2x3, Matrix3, Vector2, Vector3};

use crate::lie::so3::hat;
use crate::real::Real;
use crate::window::{CameraPose, NormalizedPoint};

/// What two cameras at two poses have in common for all landmarks.
#[derive(Debug, Clone, Copy)]
pub struct PairGeometry<T: Real> {
    /// `R_ja`.
    pub target_from_anchor: Matrix3<T>,
    /// `t_ja`, m.
    pub translation_in_target: Vector3<T>,
}

impl<T: Real> Default for PairGeometry<T> {
    fn default() -> Self {
        Self { target_from_anchor: Matrix3::identity(), translation_in_target: Vector3::zeros() }
    }
}

impl<T: Real> PairGeometry<T> {
    /// From two camera poses in world.
    #[must_use]
    pub fn new(target: &CameraPose<T>, anchor: &CameraPose<T>) -> Self {
        let (target_from_anchor, translation_in_target) = CameraPose::target_from_anchor(target, anchor);
        Self { target_from_anchor, translation_in_target }
    }

    /// The landmark in the target's camera, times its inverse depth.
    #[inline(always)]
    fn transform(&self, direction: &Vector3<T>, inverse_depth: T) -> Vector3<T> {
        self.target_from_anchor * direction + self.translation_in_target * inverse_depth
    }
}

/// The camera in the body, in the form that the Jacobians need.
#[derive(Debug, Clone, Copy)]
pub struct CameraMount<T: Real> {
    /// `R_CB`.
    pub camera_from_body: Matrix3<T>,
    /// `R_CB t_BC`, m.
    pub lever_in_camera: Vector3<T>,
}

impl<T: Real> CameraMount<T> {
    /// From the extrinsic calibration.
    #[must_use]
    pub fn new(body_from_camera: &Isometry3<T>) -> Self {
        let camera_from_body = body_from_camera.rotation.inverse().to_rotation_matrix().into_inner();
        Self { camera_from_body, lever_in_camera: camera_from_body * body_from_camera.translation.vector }
    }
}

/// A whitened residual with its Jacobians; columns of the poses are `[δφ δp]`.
#[derive(Debug, Clone, Copy)]
pub struct ReprojectionLinearization<T: Real> {
    /// 2×1.
    pub residual: [T; 2],
    /// Two rows of six.
    pub d_residual_d_anchor: [[T; 6]; 2],
    /// Two rows of six.
    pub d_residual_d_target: [[T; 6]; 2],
    /// 2×1.
    pub d_residual_d_inverse_depth: [T; 2],
}

/// The whitened residual, or `None` where the landmark is not in front of the camera.
#[inline]
pub fn residual<T: Real>(
    pair: &PairGeometry<T>,
    direction: &Vector3<T>,
    inverse_depth: T,
    point: &NormalizedPoint<T>,
) -> Option<Vector2<T>> {
    let ray = pair.transform(direction, inverse_depth);
    if ray.z < T::of(0.05) {
        return None;
    }
    let inverse_z = T::one() / ray.z;
    Some(Vector2::new((ray.x * inverse_z - point.x) * point.inverse_sigma, (ray.y * inverse_z - point.y) * point.inverse_sigma))
}

/// The whitened residual at `pair` with its Jacobians at `pair_at_first_estimate`; `target_at_first_estimate` is that
/// camera's pose. `None` where the landmark is not in front of the camera.
#[inline]
pub fn linearize<T: Real>(
    mount: &CameraMount<T>,
    pair: &PairGeometry<T>,
    pair_at_first_estimate: &PairGeometry<T>,
    target_at_first_estimate: &CameraPose<T>,
    direction: &Vector3<T>,
    inverse_depth: T,
    point: &NormalizedPoint<T>,
) -> Option<ReprojectionLinearization<T>> {
    let value = residual(pair, direction, inverse_depth, point)?;
    let ray = pair_at_first_estimate.transform(direction, inverse_depth);
    if ray.z < T::of(0.05) {
        return None;
    }
    let scale = point.inverse_sigma / ray.z;
    let (x, y) = (ray.x / ray.z, ray.y / ray.z);
    let o = T::ZERO;
    let projection = Matrix2x3::new(scale, o, -x * scale, o, scale, -y * scale);
    let through_anchor = projection * pair_at_first_estimate.target_from_anchor;
    let lever = mount.lever_in_camera * inverse_depth;
    let d_anchor_rotation = -(through_anchor * hat(&(direction + lever))) * mount.camera_from_body;
    let d_target_rotation = (projection * hat(&(ray + lever))) * mount.camera_from_body;
    let d_anchor_position = projection * target_at_first_estimate.world_from_camera.transpose() * inverse_depth;
    let d_inverse_depth = projection * pair_at_first_estimate.translation_in_target;
    let rows = |rotation: &Matrix2x3<T>, position: &Matrix2x3<T>, sign: T| {
        let mut out = [[T::ZERO; 6]; 2];
        for (r, row) in out.iter_mut().enumerate() {
            for c in 0..3 {
                row[c] = rotation[(r, c)];
                row[c + 3] = position[(r, c)] * sign;
            }
        }
        out
    };
    Some(ReprojectionLinearization {
        residual: [value.x, value.y],
        d_residual_d_anchor: rows(&d_anchor_rotation, &d_anchor_position, T::one()),
        d_residual_d_target: rows(&d_target_rotation, &d_anchor_position, -T::one()),
        d_residual_d_inverse_depth: [d_inverse_depth.x, d_inverse_depth.y],
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, SVector, Translation3, UnitQuaternion, Vector2, Vector3};
    use proptest::prelude::*;

    use super::{CameraMount, PairGeometry, linearize, residual};
    use crate::imu::NavState;
    use crate::testing::{assert_close, numerical_jacobian};
    use crate::window::{CameraPose, NormalizedPoint};

    fn mount() -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::new(-0.02, -0.06, 0.01), UnitQuaternion::from_euler_angles(0.02, 0.1, 1.5))
    }

    fn state(rotation: [f64; 3], position: [f64; 3]) -> NavState<f64> {
        let mut delta = [0.0; 15];
        delta[..3].copy_from_slice(&rotation);
        delta[3..6].copy_from_slice(&position);
        NavState::origin().retract(&delta)
    }

    fn pair(target: &NavState<f64>, anchor: &NavState<f64>) -> PairGeometry<f64> {
        PairGeometry::new(&CameraPose::of(target, &mount()), &CameraPose::of(anchor, &mount()))
    }

    fn moved(state: &NavState<f64>, delta: &SVector<f64, 6>) -> NavState<f64> {
        let mut full = [0.0; 15];
        full[..6].copy_from_slice(delta.as_slice());
        state.retract(&full)
    }

    proptest! {
        #[test]
        fn jacobians_match_central_differences(
            rotation in prop::array::uniform3(-0.2f64..0.2), position in prop::array::uniform3(-0.5f64..0.5),
            x in -0.5f64..0.5, y in -0.4f64..0.4, inverse_depth in 0.0f64..0.8,
        ) {
            let (anchor, target) = (state([0.3, -0.2, 0.1], [0.1, 0.2, 0.3]), state(
                [0.3 + rotation[0], -0.2 + rotation[1], 0.1 + rotation[2]],
                [0.1 + position[0], 0.2 + position[1], 0.3 + position[2]],
            ));
            let direction = Vector3::new(x, y, 1.0);
            let point = NormalizedPoint { x: x + 0.01, y: y - 0.02, inverse_sigma: 300.0 };
            let at = pair(&target, &anchor);
            let target_pose = CameraPose::of(&target, &mount());
            let linear = linearize(&CameraMount::new(&mount()), &at, &at, &target_pose, &direction, inverse_depth, &point);
            prop_assume!(linear.is_some());
            let Some(linear) = linear else { return Ok(()) };
            let value = |pair: &PairGeometry<f64>, depth: f64| residual(pair, &direction, depth, &point).unwrap_or_else(Vector2::zeros);
            prop_assert!((value(&at, inverse_depth) - Vector2::from(linear.residual)).norm() < 1e-12);
            let rows = |rows: [[f64; 6]; 2]| nalgebra::SMatrix::<f64, 2, 6>::from_fn(|r, c| rows[r][c]);
            assert_close(&rows(linear.d_residual_d_anchor),
                &numerical_jacobian(1e-6, |d| value(&pair(&target, &moved(&anchor, d)), inverse_depth)), 1e-6);
            assert_close(&rows(linear.d_residual_d_target),
                &numerical_jacobian(1e-6, |d| value(&pair(&moved(&target, d), &anchor), inverse_depth)), 1e-6);
            assert_close(&Vector2::from(linear.d_residual_d_inverse_depth),
                &numerical_jacobian(1e-6, |d: &SVector<f64, 1>| value(&at, inverse_depth + d[0])), 1e-6);
        }

        #[test]
        fn what_projects_there_has_no_residual(x in -0.5f64..0.5, y in -0.4f64..0.4, depth in 1.0f64..10.0) {
            let (anchor, target) = (state([0.3, -0.2, 0.1], [0.1, 0.2, 0.3]), state([0.25, -0.1, 0.1], [0.3, 0.1, 0.35]));
            let in_world = anchor.pose() * mount() * nalgebra::Point3::new(x * depth, y * depth, depth);
            let seen = (target.pose() * mount()).inverse() * in_world;
            prop_assume!(seen.z > 0.3);
            let point = NormalizedPoint { x: seen.x / seen.z, y: seen.y / seen.z, inverse_sigma: 458.0 };
            let value = residual(&pair(&target, &anchor), &Vector3::new(x, y, 1.0), 1.0 / depth, &point);
            prop_assert!(value.is_some_and(|value| value.norm() < 1e-9));
        }
    }

    #[test]
    fn a_point_seen_one_sigma_off_costs_one() {
        // Both cameras at the origin, looking ahead; 0.01 off at a standard deviation of 0.01.
        let pair = PairGeometry::default();
        let point = NormalizedPoint { x: 0.11, y: 0.2, inverse_sigma: 100.0 };
        let value = residual(&pair, &Vector3::new(0.1, 0.2, 1.0), 0.5, &point);
        assert!(value.is_some_and(|value| (value - Vector2::new(-1.0, 0.0)).norm() < 1e-12));
    }
}
