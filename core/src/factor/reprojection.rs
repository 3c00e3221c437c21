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
