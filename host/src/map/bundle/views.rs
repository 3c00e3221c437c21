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
