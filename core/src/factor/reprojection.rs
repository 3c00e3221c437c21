//! A landmark is seen where it projects.
//!
//! # Model
//! Landmark `b / λ`, `b = (x, y, 1)`, in the camera of its anchor `a`, seen in frame `j` at the undistorted point `z`, standard
//! deviation `1/s`:
//! ```text
//! X   = R_ja b + λ t_ja                       (the point in camera j, times λ)
//! r   = s (X_xy / X_z − z)                                                    2×1, whitened
//! P   = s/X_z [1 0 −X_x/X_z; 0 1 −X_y/X_z]                                    2×3
//! ∂r/∂θ_j = P [X]×      ∂r/∂ρ_j = −λ P                                         2×3, 2×3
//! ∂r/∂(x, y) = P R_ja [e₁ e₂]      ∂r/∂λ = P t_ja                              2×2, 2×1
//! ```
//! The anchor sees it too, `r = s (b_xy − z)`, whatever the poses ([`at_anchor`]).
//!
//! `(θ, ρ)` turn and move the camera in its own axes. The residual depends on the relative pose alone, so what it says
//! of the anchor is the same row `e = [∂r/∂θ_j ∂r/∂ρ_j]` carried over by the adjoint of `T_ja`:
//! ```text
//! ∂r/∂[θ_a ρ_a] = −(M eᵀ)ᵀ     M = [R_jaᵀ  −R_jaᵀ [t_ja]×; 0  R_jaᵀ]           6×6
//! ```
//! Sums over landmarks are therefore formed with six columns a pair of frames, and carried over to the anchor
//! ([`PairGeometry::carry_to_anchor`]) and from camera to body ([`CameraMount::d_camera_d_body`]) once a pair.
//!
//! # Degeneracy
//! `X_z → 0`: no value is returned below a twentieth of the depth at the anchor. `λ = 0` is regular.

use nalgebra::{Isometry3, Matrix3, Vector2, Vector3};

use crate::lie::matrix::of_rotation;
use crate::lie::so3::hat;
use crate::real::Real;
use crate::storage::blank::blank;
use crate::storage::blocks::{Block, zero_block};
use crate::window::{CameraPose, NormalizedPoint};

/// What two cameras at two poses have in common for all landmarks.
#[derive(Debug, Clone, Copy)]
pub struct PairGeometry<T: Real> {
    /// `R_ja`.
    pub target_from_anchor: Matrix3<T>,
    /// `t_ja`, m.
    pub translation_in_target: Vector3<T>,
}

blank!([T: Real] PairGeometry<T> { target_from_anchor, translation_in_target });

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

    /// `M e`, see the module: a gradient with respect to the target's camera becomes minus that of the anchor's.
    #[inline]
    #[must_use]
    pub fn carry_to_anchor(&self, e: &[T; 6]) -> [T; 6] {
        let (turn, shift) = (Vector3::new(e[0], e[1], e[2]), Vector3::new(e[3], e[4], e[5]));
        let turned = self.target_from_anchor.tr_mul(&(turn + shift.cross(&self.translation_in_target)));
        let shifted = self.target_from_anchor.tr_mul(&shift);
        [turned.x, turned.y, turned.z, shifted.x, shifted.y, shifted.z]
    }

    /// `Mᵀ x`: what a motion of the anchor's camera is in the axes of the target's.
    #[inline]
    #[must_use]
    pub fn carry_to_target(&self, x: &[T; 6]) -> [T; 6] {
        let turned = self.target_from_anchor * Vector3::new(x[0], x[1], x[2]);
        let shifted = self.target_from_anchor * Vector3::new(x[3], x[4], x[5]) + self.translation_in_target.cross(&turned);
        [turned.x, turned.y, turned.z, shifted.x, shifted.y, shifted.z]
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

blank!([T: Real] CameraMount<T> { camera_from_body, lever_in_camera });

impl<T: Real> CameraMount<T> {
    /// From the extrinsic calibration.
    #[must_use]
    pub fn new(body_from_camera: &Isometry3<T>) -> Self {
        let camera_from_body = of_rotation(&body_from_camera.rotation.inverse());
        Self { camera_from_body, lever_in_camera: camera_from_body * body_from_camera.translation.vector }
    }

    /// `∂[θ ρ]/∂[δφ δp]` of a camera at `camera`, 6×6: `θ = R_CB δφ`, `ρ = R_CW δp − [c]× θ` with `c = R_CB t_BC`.
    #[must_use]
    pub fn d_camera_d_body(&self, camera: &CameraPose<T>) -> Block<T, 6> {
        let lever = -(hat(&self.lever_in_camera) * self.camera_from_body);
        let mut out = zero_block();
        for r in 0..3 {
            for c in 0..3 {
                out[r][c] = self.camera_from_body[(r, c)];
                out[r + 3][c] = lever[(r, c)];
                out[r + 3][c + 3] = camera.world_from_camera[(c, r)];
            }
        }
        out
    }
}

/// A whitened residual with its Jacobians.
#[derive(Debug, Clone, Copy)]
pub struct ReprojectionLinearization<T: Real> {
    /// 2×1.
    pub residual: [T; 2],
    /// Two rows of six: with respect to `[θ ρ]` of the target's camera.
    pub d_residual_d_target: [[T; 6]; 2],
    /// Two rows of three: with respect to `(x, y, λ)`.
    pub d_residual_d_landmark: [[T; 3]; 2],
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

/// The whitened residual at `pair` with its Jacobians at `pair_at_first_estimate`. `None` where the landmark is not in front
/// of the camera.
#[inline(always)]
pub fn linearize<T: Real>(
    pair: &PairGeometry<T>,
    pair_at_first_estimate: &PairGeometry<T>,
    direction: &Vector3<T>,
    inverse_depth: T,
    point: &NormalizedPoint<T>,
) -> Option<ReprojectionLinearization<T>> {
    let value = residual(pair, direction, inverse_depth, point)?;
    let ray = pair_at_first_estimate.transform(direction, inverse_depth);
    if ray.z < T::of(0.05) {
        return None;
    }
    let s = point.inverse_sigma;
    let inverse_z = T::one() / ray.z;
    let (x, y) = (ray.x * inverse_z, ray.y * inverse_z);
    let scale = s * inverse_z;
    let shift = -scale * inverse_depth;
    let (rotation, t) = (&pair_at_first_estimate.target_from_anchor, &pair_at_first_estimate.translation_in_target);
    let o = T::ZERO;
    // P [r₁ r₂ t]: both rows of a column.
    let slope = |column: [T; 3]| [scale * (column[0] - x * column[2]), scale * (column[1] - y * column[2])];
    let by_x = slope([rotation[(0, 0)], rotation[(1, 0)], rotation[(2, 0)]]);
    let by_y = slope([rotation[(0, 1)], rotation[(1, 1)], rotation[(2, 1)]]);
    let by_depth = slope([t.x, t.y, t.z]);
    Some(ReprojectionLinearization {
        residual: [value.x, value.y],
        d_residual_d_target: [
            [s * x * y, -s * (T::one() + x * x), s * y, shift, o, -shift * x],
            [s * (T::one() + y * y), -s * x * y, -s * x, o, shift, -shift * y],
        ],
        d_residual_d_landmark: [[by_x[0], by_y[0], by_depth[0]], [by_x[1], by_y[1], by_depth[1]]],
    })
}

/// The whitened residual in the anchor itself; its slope along `(x, y)` is the point's `inverse_sigma`.
#[inline]
pub fn at_anchor<T: Real>(direction: &Vector3<T>, point: &NormalizedPoint<T>) -> Vector2<T> {
    Vector2::new((direction.x - point.x) * point.inverse_sigma, (direction.y - point.y) * point.inverse_sigma)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3};
    use proptest::prelude::*;

    use super::{CameraMount, PairGeometry, at_anchor, linearize, residual};
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
            let linear = linearize(&at, &at, &direction, inverse_depth, &point);
            prop_assume!(linear.is_some());
            let Some(linear) = linear else { return Ok(()) };
            let at_point = |pair: &PairGeometry<f64>, direction: &Vector3<f64>, depth: f64| {
                residual(pair, direction, depth, &point).unwrap_or_else(Vector2::zeros)
            };
            let value = |pair: &PairGeometry<f64>, depth: f64| at_point(pair, &direction, depth);
            prop_assert!((value(&at, inverse_depth) - Vector2::from(linear.residual)).norm() < 1e-12);
            // From motions of the cameras to motions of the bodies.
            let in_body = |rows: [[f64; 6]; 2], state: &NavState<f64>| {
                let by_body = CameraMount::new(&mount()).d_camera_d_body(&CameraPose::of(state, &mount()));
                SMatrix::<f64, 2, 6>::from_fn(|r, c| rows[r][c]) * SMatrix::<f64, 6, 6>::from_fn(|r, c| by_body[r][c])
            };
            let d_anchor = linear.d_residual_d_target.map(|row| at.carry_to_anchor(&row).map(|value| -value));
            assert_close(&in_body(d_anchor, &anchor),
                &numerical_jacobian(1e-6, |d| value(&pair(&target, &moved(&anchor, d)), inverse_depth)), 1e-6);
            assert_close(&in_body(linear.d_residual_d_target, &target),
                &numerical_jacobian(1e-6, |d| value(&pair(&moved(&target, d), &anchor), inverse_depth)), 1e-6);
            assert_close(&SMatrix::<f64, 2, 3>::from_fn(|r, c| linear.d_residual_d_landmark[r][c]),
                &numerical_jacobian(1e-6, |d: &SVector<f64, 3>| at_point(&at, &Vector3::new(x + d[0], y + d[1], 1.0), inverse_depth + d[2])), 1e-6);
            assert_close(&(SMatrix::<f64, 2, 2>::identity() * point.inverse_sigma),
                &numerical_jacobian(1e-6, |d: &SVector<f64, 2>| at_anchor(&Vector3::new(x + d[0], y + d[1], 1.0), &point)), 1e-6);
        }

        /// `xᵀ (M e) = (Mᵀ x)ᵀ e`.
        #[test]
        fn gradients_and_motions_are_carried_by_transposes(e in prop::array::uniform6(-1.0f64..1.0), x in prop::array::uniform6(-1.0f64..1.0)) {
            let at = pair(&state([0.25, -0.1, 0.4], [0.3, 0.1, 0.35]), &state([0.3, -0.2, 0.1], [0.1, 0.2, 0.3]));
            let dot = |a: [f64; 6], b: [f64; 6]| a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>();
            prop_assert!((dot(x, at.carry_to_anchor(&e)) - dot(at.carry_to_target(&x), e)).abs() < 1e-12);
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
