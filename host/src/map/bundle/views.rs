//! A landmark of the world in a camera.
//!
//! # Model
//! The core's reprojection with the world as anchor: direction `x`, inverse depth 1, `X = R_CW x + t_CW`. The residual depends on `X`
//! alone, and a motion `ρ` of the camera in its own axes moves `X` by `−ρ`, so
//! ```text
//! ∂r/∂x = −∂r/∂ρ R_CW                                                       2×3
//! ```
//! The virtual right camera stands `b` to the right, `X' = X − b e₁`, and sees the column `u' = u − b / D` where the network tells the
//! depth `D` at the column `u`. Its row says nothing that the left one does not. It turns with the left camera, hence
//! ```text
//! r' = √α s' (X'_x / X'_z − u')      ∂r'/∂θ = ∂r'/∂θ' + b e₁ × ∂r'/∂ρ'      1×1, 1×3
//! ```
//!
//! # Degeneracy
//! Nearer than 5 cm, or behind the camera: no value.

use libella_core::factor::reprojection::{self, PairGeometry};
use libella_core::window::{CameraPose, NormalizedPoint};
use nalgebra::{Vector2, Vector3};

/// What the virtual right camera sees of a corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RightView {
    /// `x / z` in the right camera.
    pub x: f64,
    /// One over its standard deviation.
    pub inverse_sigma: f64,
}

impl RightView {
    /// From a corner and the depth that a network tells there, `None` where that is no positive number; `inverse_sigma_depth` is one over the
    /// standard deviation of the depth, 1/m.
    #[must_use]
    pub fn from_depth(point: &NormalizedPoint<f64>, baseline_m: f64, depth_m: f64, inverse_sigma_depth: f64) -> Option<Self> {
        let usable = depth_m.is_finite() && depth_m > 0.0 && inverse_sigma_depth.is_finite() && inverse_sigma_depth > 0.0;
        // ∂u'/∂D = b / D²; the corner's own noise adds to it.
        let variance = (baseline_m / (depth_m * depth_m * inverse_sigma_depth)).powi(2) + point.inverse_sigma.powi(-2);
        usable.then(|| Self { x: point.x - baseline_m / depth_m, inverse_sigma: variance.sqrt().recip() })
    }
}

/// Rows of a factor: residual, `∂/∂[θ ρ]` of the camera, `∂/∂x` of the landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    pub residual: f64,
    pub by_camera: [f64; 6],
    pub by_point: [f64; 3],
}

/// The world seen from a camera.
pub(super) fn from_world(camera: &CameraPose<f64>) -> PairGeometry<f64> {
    PairGeometry::new(camera, &CameraPose::default())
}

/// The same seen from the virtual right camera.
fn to_the_right(pair: &PairGeometry<f64>, baseline_m: f64) -> PairGeometry<f64> {
    PairGeometry { translation_in_target: pair.translation_in_target - Vector3::x() * baseline_m, ..*pair }
}

/// The whitened residual of a corner.
pub(super) fn residual(pair: &PairGeometry<f64>, landmark: &Vector3<f64>, point: &NormalizedPoint<f64>) -> Option<Vector2<f64>> {
    reprojection::residual(pair, landmark, 1.0, point)
}

/// The corner as two rows.
pub(super) fn rows(pair: &PairGeometry<f64>, landmark: &Vector3<f64>, point: &NormalizedPoint<f64>) -> Option<[Row; 2]> {
    let linear = reprojection::linearize(pair, pair, landmark, 1.0, point)?;
    let row = |axis: usize| {
        let by_camera = linear.d_residual_d_target[axis];
        let by_point = -pair.target_from_anchor.tr_mul(&Vector3::new(by_camera[3], by_camera[4], by_camera[5]));
        Row { residual: linear.residual[axis], by_camera, by_point: by_point.into() }
    };
    Some([row(0), row(1)])
}

fn in_the_right(right: &RightView, point: &NormalizedPoint<f64>, weight: f64) -> NormalizedPoint<f64> {
    NormalizedPoint { x: right.x, y: point.y, inverse_sigma: right.inverse_sigma * weight.sqrt() }
}

/// The whitened residual of the virtual right view, `α` included.
pub(super) fn right_residual(
    pair: &PairGeometry<f64>,
    landmark: &Vector3<f64>,
    point: &NormalizedPoint<f64>,
    right: &RightView,
    (baseline_m, weight): (f64, f64),
) -> Option<f64> {
    let seen = in_the_right(right, point, weight);
    reprojection::residual(&to_the_right(pair, baseline_m), landmark, 1.0, &seen).map(|both| both.x)
}

/// The virtual right view as a row.
pub(super) fn right_row(
    pair: &PairGeometry<f64>,
    landmark: &Vector3<f64>,
    point: &NormalizedPoint<f64>,
    right: &RightView,
    (baseline_m, weight): (f64, f64),
) -> Option<Row> {
    let [mut row, _] = rows(&to_the_right(pair, baseline_m), landmark, &in_the_right(right, point, weight))?;
    // e₁ × ρ
    let [.., y, z] = row.by_camera;
    row.by_camera[1] -= baseline_m * z;
    row.by_camera[2] += baseline_m * y;
    Some(row)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use libella_core::factor::reprojection::CameraMount;
    use libella_core::imu::NavState;
    use nalgebra::{Isometry3, UnitQuaternion};

    use super::*;

    const RIGHT: (f64, f64) = (0.1, 0.5);

    fn mount() -> Isometry3<f64> {
        Isometry3::from_parts(Vector3::new(-0.02, -0.06, 0.01).into(), UnitQuaternion::from_euler_angles(0.02, 0.1, 1.5))
    }

    fn scene() -> (NavState<f64>, Vector3<f64>, NormalizedPoint<f64>, RightView) {
        let mut delta = [0.0; 15];
        delta[..6].copy_from_slice(&[0.3, -0.2, 0.1, 0.4, -0.5, 0.6]);
        let state = NavState::origin().retract(&delta);
        let landmark = state.pose() * mount() * nalgebra::Point3::new(0.4, -0.3, 2.5);
        let point = NormalizedPoint { x: 0.17, y: -0.13, inverse_sigma: 800.0 };
        (state, landmark.coords, point, RightView { x: 0.12, inverse_sigma: 300.0 })
    }

    fn seen_from(state: &NavState<f64>) -> PairGeometry<f64> {
        from_world(&CameraPose::of(state, &mount()))
    }

    #[test]
    fn slopes_match_central_differences_through_the_body() {
        let (state, landmark, point, right) = scene();
        let values = |state: &NavState<f64>, landmark: &Vector3<f64>| {
            let pair = seen_from(state);
            let left = residual(&pair, landmark, &point).unwrap();
            [left.x, left.y, right_residual(&pair, landmark, &point, &right, RIGHT).unwrap()]
        };
        let pair = seen_from(&state);
        let [x, y] = rows(&pair, &landmark, &point).unwrap();
        let all = [x, y, right_row(&pair, &landmark, &point, &right, RIGHT).unwrap()];
        let by_body = CameraMount::new(&mount()).d_camera_d_body(&CameraPose::of(&state, &mount()));
        let step = 1e-6;
        for (k, row) in all.iter().enumerate() {
            assert!((row.residual - values(&state, &landmark)[k]).abs() < 1e-12);
            for i in 0..6 {
                let at = |step: f64| {
                    let mut delta = [0.0; 15];
                    delta[i] = step;
                    values(&state.retract(&delta), &landmark)[k]
                };
                let slope: f64 = (0..6).map(|c| row.by_camera[c] * by_body[c][i]).sum();
                assert!(((at(step) - at(-step)) / (2.0 * step) - slope).abs() < 1e-4, "{k} {i}");
            }
            for axis in 0..3 {
                let at = |step: f64| values(&state, &(landmark + Vector3::ith(axis, step)))[k];
                assert!(((at(step) - at(-step)) / (2.0 * step) - row.by_point[axis]).abs() < 1e-4, "{k} {axis}");
            }
        }
    }

    #[test]
    fn the_right_camera_sees_what_the_depth_says() {
        let (state, landmark, _, _) = scene();
        // The landmark is at (0.4, -0.3, 2.5) in the camera.
        let point = NormalizedPoint { x: 0.16, y: -0.12, inverse_sigma: 800.0 };
        let right = RightView::from_depth(&point, 0.1, 2.5, 4.0).unwrap();
        assert!((right.x - 0.12).abs() < 1e-15);
        // 0.25 m at 2.5 m: 0.1 · 0.25 / 6.25 = 0.004, beside 1/800.
        assert!((right.inverse_sigma - (0.004_f64.powi(2) + 800.0_f64.powi(-2)).sqrt().recip()).abs() < 1e-9);
        let at = |right| right_residual(&seen_from(&state), &landmark, &point, &right, (0.1, 1.0)).unwrap();
        assert!(at(right).abs() < 1e-9);
        // One standard deviation to the left, and α a quarter of it.
        let off = RightView { x: right.x - right.inverse_sigma.recip(), ..right };
        assert!((at(off) - 1.0).abs() < 1e-9);
        let weak = right_residual(&seen_from(&state), &landmark, &point, &off, (0.1, 0.25)).unwrap();
        assert!((weak - 0.5).abs() < 1e-9);
        for depth in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(RightView::from_depth(&point, 0.1, depth, 4.0), None);
        }
    }

    #[test]
    fn nothing_is_seen_behind_the_camera() {
        let (state, _, point, right) = scene();
        let behind = (state.pose() * mount() * nalgebra::Point3::new(0.1, 0.1, -1.0)).coords;
        let pair = seen_from(&state);
        assert!(residual(&pair, &behind, &point).is_none() && rows(&pair, &behind, &point).is_none());
        assert!(right_row(&pair, &behind, &point, &right, RIGHT).is_none());
    }
}
