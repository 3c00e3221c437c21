//! Extrinsic rotation, time offset, gyro bias and lens, jointly from the epipolar planes of all pairs.
//!
//! # Model
//! The gyro tells the camera's rotation over a pair, `R = Xᵀ B X` with `X = R_BC` and `B = Q₂ᵀ Q₁` from its integral at the stamps plus
//! the offset. Gauss-Newton over `[δX b τ κ]` on what [`plane`](super::plane) says about every pair, through
//! ```text
//! R ← Exp(θ) R      ∂θ/∂δX = R − I,   ∂θ/∂b = Xᵀ Q₂ᵀ (S₂ − S₁),   ∂θ/∂τ = Xᵀ (B ω₁ − ω₂)      3×3, 3×3, 3×1
//! ```
//!
//! # Uncertainty
//! Corners repeat in many pairs and share what the model leaves out. The covariance is therefore the larger of `H⁻¹` and
//! `H⁻¹ (Σ_c G_c G_cᵀ) H⁻¹`, with the gradients `G_c`, and those of what noise may feign, summed over stretches of the recording.

use std::collections::{BTreeMap, BTreeSet};

use libella_core::camera::CameraModel;
use libella_core::lie::so3;
use libella_core::robust::stats;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::gyro::{Gyro, Path};
use super::lens::{Deviation, Lens, PARAMETERS, Ray};
use super::pairs::Pair;
use super::plane::{Plane, View};

/// Number of parameters.
pub(super) const STATES: usize = 7 + PARAMETERS;
/// Sum of weighted products of slopes.
pub(super) type Information = SMatrix<f64, STATES, STATES>;
/// Sum of weighted slopes, downhill.
pub(super) type Gradient = SVector<f64, STATES>;

const ROTATION: usize = 0;
const BIAS: usize = 3;
const OFFSET: usize = 6;
/// Where the lens begins.
pub(super) const LENS: usize = 7;

const ITERATIONS: usize = 14;
/// Iterations before which directions are sought anew.
const SEEDED: [usize; 4] = [0, 2, 4, 8];
/// What is known beforehand, wide: rotation and bias of the coarse alignment, rad and rad/s, its offset, s, and the lens.
const PRIOR_SIGMA: [f64; STATES] = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.2, 0.3, 0.3, 0.1, 0.1, 0.2];
/// A parameter that is held.
const HELD_SIGMA: f64 = 1e-7;
/// Corners are not located better than this, px.
const LEAST_SIGMA_PX: f64 = 0.05;
/// Length of a stretch whose errors may all be related, s: a few of the longest pairs.
const CLUSTER_S: f64 = 2.0;

/// What the fit seeks.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// `R_BC`.
    pub body_from_camera: UnitQuaternion<f64>,
    pub bias: Vector3<f64>,
    pub offset_s: f64,
    pub lens: Deviation,
}

/// The state found and how well it is known.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub state: State,
    covariance: Information,
    /// Robust standard deviation of the epipolar error, px.
    pub residual_px: f64,
    /// Displacement beyond rotation below which 90 % of the corners of the longest pairs are, px.
    pub parallax_px: f64,
    pub pairs: usize,
}

impl Fit {
    /// Standard deviation of the offset, s.
    pub fn offset_sigma_s(&self) -> f64 {
        self.covariance[(OFFSET, OFFSET)].max(0.0).sqrt()
    }

    /// Covariance of the rotation, camera frame, rad².
    pub fn rotation_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(ROTATION, ROTATION).into_owned()
    }

    /// Standard deviation of a parameter of the lens.
    pub fn lens_sigma(&self, parameter: usize) -> f64 {
        self.covariance[(LENS + parameter, LENS + parameter)].max(0.0).sqrt()
    }
}

/// Fits the state to all pairs of corners of a table; the lens is held at its start unless `free_lens`.
pub(super) fn fit(
    pairs: &[Pair],
    table: &[Vector2<f64>],
    gyro: &Gyro,
    camera: &CameraModel<f64>,
    start: &State,
    free_lens: bool,
) -> Option<Fit> {
    let mut state = start.clone();
    let prior: [f64; STATES] = std::array::from_fn(|k| if k < LENS || free_lens { PRIOR_SIGMA[k] } else { HELD_SIGMA });
    let mut planes: Vec<Plane> = pairs.iter().map(|_| Plane::default()).collect();
    let longest = pairs.iter().map(Pair::span_s).fold(0.0, f64::max);
    let mut used_corners = vec![false; table.len()];
    for place in pairs.iter().flat_map(|pair| pair.places.iter().flatten()) {
        if let Some(used) = used_corners.get_mut(*place) {
            *used = true;
        }
    }
    let trace = |lens: &Lens| -> Vec<Option<Ray>> {
        table.iter().zip(&used_corners).map(|(pixel, used)| used.then(|| lens.ray(pixel)).flatten()).collect()
    };
    let count = pairs.iter().map(stretch_of).collect::<BTreeSet<i64>>().len();
    let related = pairs.len() as f64 / count.max(1) as f64;
    let mut scale_px = 2.0;
    let mut rays = Vec::new();
    let mut near = Vec::new();
    let mut last = None;
    for iteration in 0..ITERATIONS {
        let lens = Lens::new(camera, &state.lens);
        if rays.is_empty() || free_lens {
            rays = trace(&lens);
            near = if free_lens { lens.neighbours(&state.lens).iter().map(trace).collect() } else { Vec::new() };
        }
        let path = gyro.path(&state.bias);
        let mut information = Information::from_diagonal(&Gradient::from_fn(|k, _| 1.0 / (prior[k] * prior[k])));
        let mut gradient = -deviation(start, &state).component_mul(&information.diagonal());
        let mut stretches: BTreeMap<i64, Stretch> = BTreeMap::new();
        let (mut residuals, mut parallaxes, mut used) = (Vec::new(), Vec::new(), 0);
        for (pair, plane) in pairs.iter().zip(&mut planes) {
            let Some((rotation, d_rotation)) = rotation_of(&path, &state, pair) else { continue };
            let view = View { rays: &rays, near: &near, rotation, d_rotation, scale_px, focal_px: lens.focal_px(), related };
            if SEEDED.contains(&iteration) {
                plane.seed(pair, &view);
            }
            let Some(said) = plane.equations(pair, &view, &mut residuals) else { continue };
            information += said.information;
            gradient += said.gradient;
            let stretch = stretches.entry(stretch_of(pair)).or_default();
            stretch.gradient += said.gradient;
            stretch.tilts += said.tilts;
            used += 1;
            if pair.span_s() > 0.7 * longest {
                parallaxes.extend(view.parallaxes_px(pair));
            }
        }
        let factor = information.cholesky()?;
        let step = factor.solve(&gradient);
        if used < 10 || !step.iter().all(|value| value.is_finite()) {
            return None;
        }
        // One direction of a few is far from the truth at first; steps beyond these would lose all.
        let (turn, lens_step) = (step.fixed_rows::<3>(ROTATION).norm(), step.fixed_rows::<PARAMETERS>(LENS).norm());
        let step = step * (0.2 / turn).min(0.05 / step[OFFSET].abs()).min(0.2 / lens_step).min(1.0);
        state.body_from_camera *= so3::exp(&step.fixed_rows::<3>(ROTATION).into_owned());
        state.bias += step.fixed_rows::<3>(BIAS);
        state.offset_s += step[OFFSET];
        state.lens += step.fixed_rows::<PARAMETERS>(LENS);
        planes.iter_mut().for_each(|plane| plane.follow(&step));
        scale_px =
            (stats::SIGMA_PER_MAD * stats::median(&mut residuals.iter().map(|r| r.abs()).collect::<Vec<f64>>())?).max(LEAST_SIGMA_PX);
        let parallax_px = stats::quantile(&mut parallaxes, 0.9).unwrap_or(0.0);
        last = Some((covariance(&factor.inverse(), stretches.values()), scale_px, parallax_px, used));
        if turn < 1e-6 && step[OFFSET].abs() < 1e-6 && lens_step < 1e-5 && iteration > SEEDED[3] {
            break;
        }
    }
    last.map(|(covariance, residual_px, parallax_px, pairs)| Fit { state, covariance, residual_px, parallax_px, pairs })
}

/// Sums over a stretch of the recording.
#[derive(Debug, Default)]
struct Stretch {
    gradient: Gradient,
    tilts: SMatrix<f64, STATES, 3>,
}

fn stretch_of(pair: &Pair) -> i64 {
    (pair.seconds[0] / CLUSTER_S).floor() as i64
}

/// The larger of what independent corners and what stretches of the recording say, parameter by parameter.
fn covariance<'a>(inverse: &Information, stretches: impl Iterator<Item = &'a Stretch>) -> Information {
    let meat = stretches.fold(Information::zeros(), |sum, stretch| {
        sum + stretch.gradient * stretch.gradient.transpose() + stretch.tilts * stretch.tilts.transpose()
    });
    let sandwich = inverse * meat * inverse;
    let mut covariance = if sandwich.trace() > inverse.trace() { sandwich } else { *inverse };
    for k in 0..STATES {
        covariance[(k, k)] = sandwich[(k, k)].max(inverse[(k, k)]);
    }
    covariance
}

/// How far the state has gone from the start.
fn deviation(start: &State, state: &State) -> Gradient {
    let mut gone = Gradient::zeros();
    gone.fixed_rows_mut::<3>(ROTATION).copy_from(&so3::log(&(start.body_from_camera.inverse() * state.body_from_camera)));
    gone.fixed_rows_mut::<3>(BIAS).copy_from(&(state.bias - start.bias));
    gone[OFFSET] = state.offset_s - start.offset_s;
    gone.fixed_rows_mut::<PARAMETERS>(LENS).copy_from(&(state.lens - start.lens));
    gone
}

/// `R` of a pair and its derivatives `∂θ/∂[δX b τ]`, 3×7.
fn rotation_of(path: &Path<'_>, state: &State, pair: &Pair) -> Option<(Matrix3<f64>, SMatrix<f64, 3, 7>)> {
    let (first, second) = path.between(pair.seconds[0] + state.offset_s, pair.seconds[1] + state.offset_s)?;
    let camera_from_body = state.body_from_camera.inverse().to_rotation_matrix().into_inner();
    let back = second.attitude.inverse().to_rotation_matrix().into_inner();
    let turned = back * first.attitude.to_rotation_matrix().into_inner();
    let rotation = camera_from_body * turned * camera_from_body.transpose();
    let mut slope = SMatrix::<f64, 3, 7>::zeros();
    slope.fixed_view_mut::<3, 3>(0, ROTATION).copy_from(&(rotation - Matrix3::identity()));
    slope.fixed_view_mut::<3, 3>(0, BIAS).copy_from(&(camera_from_body * back * (second.integral - first.integral)));
    slope.fixed_view_mut::<3, 1>(0, OFFSET).copy_from(&(camera_from_body * (turned * first.rate - second.rate)));
    Some((rotation, slope))
}
