//! Extrinsic rotation, time offset, gyro bias and lens, jointly from the epipolar planes of all pairs.
//!
//! # Model
//! The gyro tells the camera's rotation over a pair, `R = Xᵀ Q₂ᵀ Q₁ X` with `X = R_BC` and `Q` the gyro's integral at the stamps plus the
//! offset. A static corner seen along `f₁`, `f₂` lies in one plane with the translation `t`:
//! ```text
//! g = R f₁       r = tᵀ (g × f₂)/s          s² = (|t × g|² + |t × f₂|²)/2
//! R ← Exp(θ) R   ∂r/∂θ  = g × (f₂ × t)/s    1×3
//!                ∂θ/∂δX = R − I,   ∂θ/∂b = Xᵀ Q₂ᵀ (S₂ − S₁),   ∂θ/∂τ = Xᵀ (B ω₁ − ω₂)
//!                ∂r/∂f₁ = Rᵀ (f₂ × t)/s,   ∂r/∂f₂ = (t × g)/s,   ∂r/∂t = (g × f₂)ᵀ B(t)/s
//! ```
//! Gauss-Newton over `[δX b τ κ]`, every direction `t` eliminated. Where there is no parallax the direction could explain anything; so the
//! whole of `g × f₂` takes part too, with the parallax as one error of its own size that all pairs have in common.
//!
//! # Uncertainty
//! Corners repeat in many pairs and share what the model leaves out. The covariance is therefore the larger of `H⁻¹` and
//! `H⁻¹ (Σ_c G_c G_cᵀ) H⁻¹`, with the gradients `G_c` summed over stretches of the recording.

use std::collections::BTreeMap;

use libella_core::camera::CameraModel;
use libella_core::lie::so3;
use libella_core::robust::stats;
use libella_core::track::two_view::{BearingPair, TwoViewConfig, reject_outliers};
use nalgebra::{Matrix2, Matrix3, Matrix3x2, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::gyro::{Gyro, Path};
use super::lens::{Deviation, Lens, PARAMETERS};
use super::pairs::Pair;

const STATES: usize = 7 + PARAMETERS;
type Information = SMatrix<f64, STATES, STATES>;
type Gradient = SVector<f64, STATES>;

const ROTATION: usize = 0;
const BIAS: usize = 3;
const OFFSET: usize = 6;
const LENS: usize = 7;

const ITERATIONS: usize = 14;
/// Iterations after which directions are sought anew.
const SEEDED: [usize; 4] = [0, 2, 4, 8];
/// What is known beforehand, wide: rotation and bias of the coarse alignment, rad and rad/s, its offset, s, and the lens.
const PRIOR_SIGMA: [f64; STATES] = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.2, 0.3, 0.3, 0.1, 0.1, 0.2];
/// A parameter that is held.
const HELD_SIGMA: f64 = 1e-7;
/// Corners are not located better than this, px.
const LEAST_SIGMA_PX: f64 = 0.1;
/// Length of a stretch whose errors may all be related, s: a few of the longest pairs.
const CLUSTER_S: f64 = 2.0;
/// Squared sine below which a bearing is too close to the translation to say much about its plane.
const NEAR_EPIPOLE: f64 = 0.0025;

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

/// Equations of one pair and the direction in it.
struct Plane {
    direction: Vector3<f64>,
    /// Inverse information, gradient and coupling of the direction, to follow the state's step.
    eliminated: (Matrix2<f64>, Vector2<f64>, SMatrix<f64, STATES, 2>),
}

/// Bearings of a pair and their derivatives by the lens.
struct Rays {
    bearings: Vec<[Vector3<f64>; 2]>,
    slopes: Vec<[[Vector3<f64>; PARAMETERS]; 2]>,
}

/// Fits the state to all pairs; the lens is held at its start unless `free_lens`.
pub(super) fn fit(pairs: &[Pair], gyro: &Gyro, camera: &CameraModel<f64>, start: &State, free_lens: bool) -> Option<Fit> {
    let mut state = start.clone();
    let prior: [f64; STATES] = std::array::from_fn(|k| if k < LENS || free_lens { PRIOR_SIGMA[k] } else { HELD_SIGMA });
    let mut planes: Vec<Plane> = pairs
        .iter()
        .map(|_| Plane { direction: Vector3::z(), eliminated: (Matrix2::zeros(), Vector2::zeros(), SMatrix::zeros()) })
        .collect();
    let mut scale = 2.0 / Lens::new(camera, &state.lens).focal_px();
    let mut rays: Vec<Rays> = Vec::new();
    let mut last = None;
    for iteration in 0..ITERATIONS {
        let lens = Lens::new(camera, &state.lens);
        if rays.is_empty() || free_lens {
            rays = pairs.iter().map(|pair| trace(pair, &lens, free_lens.then(|| lens.neighbours(&state.lens)).as_ref())).collect();
        }
        let path = gyro.path(&state.bias);
        let mut information = Information::zeros();
        let mut gradient = Gradient::zeros();
        for (k, sigma) in prior.iter().enumerate() {
            information[(k, k)] = 1.0 / (sigma * sigma);
        }
        gradient -= deviation(start, &state).component_mul(&information.diagonal());
        let mut clusters: BTreeMap<i64, Gradient> = BTreeMap::new();
        let (mut residuals, mut parallaxes, mut used) = (Vec::new(), Vec::new(), 0);
        let longest = pairs.iter().map(Pair::span_s).fold(0.0, f64::max);
        for ((pair, plane), rays) in pairs.iter().zip(&mut planes).zip(&rays) {
            let Some((rotation, d_rotation)) = rotation_of(&path, &state, pair) else { continue };
            if SEEDED.contains(&iteration) {
                plane.direction = seed(rays, &rotation, lens.focal_px()).unwrap_or(plane.direction);
            }
            let Some((h, g)) = equations(plane, rays, &rotation, &d_rotation, scale, pairs.len(), free_lens, &mut residuals) else { continue };
            information += h;
            gradient += g;
            *clusters.entry((pair.seconds[0] / CLUSTER_S).floor() as i64).or_insert_with(Gradient::zeros) += g;
            used += 1;
            if pair.span_s() > 0.7 * longest {
                parallaxes.extend(rays.bearings.iter().map(|[first, second]| (rotation * first).cross(second).norm() * lens.focal_px()));
            }
        }
        let factor = information.cholesky()?;
        let step = factor.solve(&gradient);
        if used < 10 || !step.iter().all(|value| value.is_finite()) {
            return None;
        }
        // One direction of a few is far from the truth at first; steps beyond these would lose all.
        let shorten = (0.2 / step.fixed_rows::<3>(ROTATION).norm()).min(0.05 / step[OFFSET].abs()).min(0.2 / step.fixed_rows::<PARAMETERS>(LENS).norm());
        let step = step * shorten.min(1.0);
        state.body_from_camera *= so3::exp(&step.fixed_rows::<3>(ROTATION).into_owned());
        state.bias += step.fixed_rows::<3>(BIAS);
        state.offset_s += step[OFFSET];
        state.lens += step.fixed_rows::<PARAMETERS>(LENS);
        planes.iter_mut().for_each(|plane| plane.follow(&step));
        let median = stats::median(&mut residuals.iter().map(|r| r.abs()).collect::<Vec<f64>>())?;
        scale = (stats::SIGMA_PER_MAD * median).max(LEAST_SIGMA_PX / lens.focal_px());
        let inverse = factor.inverse();
        let meat = clusters.values().fold(Information::zeros(), |sum, g| sum + g * g.transpose());
        let sandwich = inverse * meat * inverse;
        // The larger of both, parameter by parameter; correlations are those of the larger trace.
        let mut covariance = if sandwich.trace() > inverse.trace() { sandwich } else { inverse };
        for k in 0..STATES {
            covariance[(k, k)] = sandwich[(k, k)].max(inverse[(k, k)]);
        }
        let parallax_px = stats::quantile(&mut parallaxes, 0.9).unwrap_or(0.0);
        last = Some((covariance, scale * lens.focal_px(), parallax_px, used));
        let small = step.fixed_rows::<3>(ROTATION).norm() < 1e-6 && step[OFFSET].abs() < 1e-6 && step.fixed_rows::<PARAMETERS>(LENS).norm() < 1e-5;
        if small && iteration > SEEDED[3] {
            break;
        }
    }
    last.map(|(covariance, residual_px, parallax_px, pairs)| Fit { state, covariance, residual_px, parallax_px, pairs })
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

fn trace(pair: &Pair, lens: &Lens, neighbours: Option<&[Lens; PARAMETERS]>) -> Rays {
    let mut rays = Rays { bearings: Vec::with_capacity(pair.pixels.len()), slopes: Vec::new() };
    for pixels in &pair.pixels {
        let (Some(first), Some(second)) = (lens.bearing(&pixels[0]), lens.bearing(&pixels[1])) else { continue };
        let bearings = [first, second];
        if let Some(neighbours) = neighbours {
            let slope = |end: usize| {
                let mut slopes = [Vector3::zeros(); PARAMETERS];
                for (slope, lens) in slopes.iter_mut().zip(neighbours) {
                    *slope = Lens::slope(&bearings[end], &lens.bearing(&pixels[end])?);
                }
                Some(slopes)
            };
            let (Some(first), Some(second)) = (slope(0), slope(1)) else { continue };
            rays.slopes.push([first, second]);
        }
        rays.bearings.push(bearings);
    }
    rays
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

/// The direction that most corners agree on.
fn seed(rays: &Rays, rotation: &Matrix3<f64>, focal_px: f64) -> Option<Vector3<f64>> {
    let mut seen: Vec<BearingPair> = rays
        .bearings
        .iter()
        .map(|[first, second]| BearingPair {
            rotated: (rotation * first).map(|value| value as f32),
            current: second.map(|value| value as f32),
            is_inlier: true,
        })
        .collect();
    // Without an uncertainty of the rotation, which is what is being sought.
    let found = reject_outliers(&mut seen, &TwoViewConfig { threshold_px: 2.0, ..TwoViewConfig::DEFAULT }, focal_px as f32, 1e-4)?;
    let direction = found.direction.map(f64::from);
    (direction.norm() > 0.5).then(|| direction.normalize())
}

/// Two directions across a unit vector.
fn across(direction: &Vector3<f64>) -> Matrix3x2<f64> {
    let helper = if direction.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let first = direction.cross(&helper).normalize();
    Matrix3x2::from_columns(&[first, direction.cross(&first)])
}

impl Plane {
    fn turn(&mut self, by: &Vector2<f64>) {
        let length = by.norm();
        let by = if length > 0.3 { by * (0.3 / length) } else { *by };
        let moved = self.direction + across(&self.direction) * by;
        if moved.norm() > 0.1 && moved.iter().all(|value| value.is_finite()) {
            self.direction = moved.normalize();
        }
    }

    /// Moves the direction along with a step of the state.
    fn follow(&mut self, step: &Gradient) {
        let (inverse, gradient, coupling) = &self.eliminated;
        let by = inverse * (gradient - coupling.tr_mul(step));
        self.turn(&by);
        self.eliminated.1 = Vector2::zeros();
        self.eliminated.2 = SMatrix::zeros();
    }
}

/// Information and gradient (downhill) of one pair, its direction eliminated.
fn equations(
    plane: &mut Plane,
    rays: &Rays,
    rotation: &Matrix3<f64>,
    d_rotation: &SMatrix<f64, 3, 7>,
    scale: f64,
    pairs: usize,
    free_lens: bool,
    residuals: &mut Vec<f64>,
) -> Option<(Information, Gradient)> {
    let t = plane.direction;
    let basis = across(&t);
    let (mut h, mut g) = (Information::zeros(), Gradient::zeros());
    let (mut h_t, mut g_t, mut coupling) = (Matrix2::identity() / (scale * scale) * 1e-3, Vector2::zeros(), SMatrix::<f64, STATES, 2>::zeros());
    let mut parallaxes = Vec::with_capacity(rays.bearings.len());
    for (index, [first, second]) in rays.bearings.iter().enumerate() {
        let turned = rotation * first;
        let normal = turned.cross(second);
        parallaxes.push(normal.norm());
        let (arm, side) = (second.cross(&t), t.cross(&turned));
        let s = (0.5 * (arm.norm_squared() + side.norm_squared())).max(NEAR_EPIPOLE).sqrt();
        let r = t.dot(&normal) / s;
        residuals.push(r);
        let mut slope = Gradient::zeros();
        slope.fixed_rows_mut::<7>(0).copy_from(&(d_rotation.transpose() * turned.cross(&arm) / s));
        if free_lens && let Some(slopes) = rays.slopes.get(index) {
            let back = rotation.transpose() * arm;
            for k in 0..PARAMETERS {
                slope[LENS + k] = (back.dot(&slopes[0][k]) + side.dot(&slopes[1][k])) / s;
            }
        }
        let slope_t: Vector2<f64> = basis.transpose() * normal / s;
        // Geman and McClure's kernel: what is far off says nothing.
        let ratio = r / (2.0 * scale);
        let weight = 1.0 / (1.0 + ratio * ratio).powi(2) / (scale * scale);
        h.syger(weight, &slope, &slope, 1.0);
        g -= slope * (weight * r);
        h_t += slope_t * slope_t.transpose() * weight;
        g_t -= slope_t * (weight * r);
        coupling += slope * slope_t.transpose() * weight;
    }
    if rays.bearings.len() < 12 {
        return None;
    }
    h.fill_upper_triangle_with_lower_triangle();
    let inverse = h_t.try_inverse()?;
    h -= coupling * inverse * coupling.transpose();
    g -= coupling * inverse * g_t;
    plane.eliminated = (inverse, g_t, coupling);

    // The whole of g × f₂: tells the rotation where there is no parallax. Its median is √2.8 σ by noise of both corners alone; what it
    // exceeds that by is an error that all corners and, in the worst case, all pairs have in common.
    let parallax = stats::median(&mut parallaxes)?;
    let noise = scale * scale;
    let common = (parallax * parallax - 2.0 * noise).max(0.0) * (rays.bearings.len() * pairs) as f64;
    let each = 1.0 / common.max(noise);
    let kernel = (4.0 * parallax * parallax).max(4.0 * noise);
    let (mut h_whole, mut g_whole) = (Information::zeros(), Gradient::zeros());
    for (index, [first, second]) in rays.bearings.iter().enumerate() {
        let turned = rotation * first;
        let normal = turned.cross(second);
        let weight = each / (1.0 + normal.norm_squared() / kernel);
        let by_rotation = so3::hat(second) * so3::hat(&turned) * d_rotation;
        let mut slope = SMatrix::<f64, 3, STATES>::zeros();
        slope.fixed_view_mut::<3, 7>(0, 0).copy_from(&by_rotation);
        if free_lens && let Some(slopes) = rays.slopes.get(index) {
            for k in 0..PARAMETERS {
                slope.set_column(LENS + k, &((rotation * slopes[0][k]).cross(second) + turned.cross(&slopes[1][k])));
            }
        }
        h_whole += slope.transpose() * slope * weight;
        g_whole -= slope.transpose() * normal * weight;
    }
    Some((h + h_whole, g + g_whole))
}
