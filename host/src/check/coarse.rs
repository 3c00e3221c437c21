//! Rotation of the camera from images alone, and how it compares with the gyro at any offset in time.
//!
//! # Model
//! With the camera's rate `ω_c` from each pair of images and the gyro's mean rate `ω_g(τ)` over the same interval shifted by `τ`,
//! both without their means (so that no bias matters),
//! ```text
//! C(τ) = Σ w ω_c ω_gᵀ = U Σ Vᵀ        ρ(τ) = (σ₁ + σ₂ + σ₃) / √(Σ w|ω_c|² Σ w|ω_g|²)
//! ```
//! `ρ` is the correlation after the best orthogonal alignment `N = U Vᵀ`; it needs neither extrinsics nor unit nor handedness, and
//! its maximum over `τ` is the offset in time. An alignment `H` that is assumed has `ρ_H = tr(Hᵀ C)/√(...)`.
//!
//! # Degeneracy
//! Rotation about one axis leaves `N` free about it (`σ₂ = σ₃ = 0`): compare `ρ_H` of what is assumed with `ρ`, never `H` with `N`.

use libella_core::lie::so3;
use libella_core::robust::stats;
use libella_core::track::two_view::{BearingPair, TwoViewConfig, reject_outliers};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::gyro::Gyro;
use super::lens::Lens;
use super::pairs::Pair;

/// Offsets are sought this far, s, in steps of this.
const FARTHEST_S: f64 = 1.0;
const STEP_S: f64 = 0.005;
/// Uncertainty left to the refinement of a rotation that a first alignment has found, rad.
const REFINED_SIGMA_RAD: f32 = 0.05;

/// Rotation of the camera over one pair.
#[derive(Debug, Clone, Copy)]
struct Turn {
    seconds: [f64; 2],
    /// Mean rate of the camera in its own frame, rad/s.
    rate: Vector3<f64>,
    weight: f64,
}

/// How image rotation and gyro fit together.
#[derive(Debug, Clone)]
pub(super) struct Coarse {
    /// Time to add to the camera's stamps, s.
    pub offset_s: f64,
    /// `C`, normalised so that the correlation of an alignment `H` is `tr(Hᵀ C)`.
    covariance: Matrix3<f64>,
    /// Correlation after the best alignment, 0 to 1.
    pub correlation: f64,
    /// Rate of the camera over that of the gyro.
    pub scale: f64,
    /// Root mean square of the camera's and the gyro's rate about their means, rad/s.
    pub rms: [f64; 2],
    mean: [Vector3<f64>; 2],
}

impl Coarse {
    /// The best `camera_from_gyro`, orthogonal, of either handedness.
    pub fn best(&self) -> Matrix3<f64> {
        let svd = self.covariance.svd(true, true);
        match (svd.u, svd.v_t) {
            (Some(u), Some(v_t)) => u * v_t,
            _ => Matrix3::identity(),
        }
    }

    /// Correlation under an assumed `camera_from_gyro`.
    pub fn correlation_of(&self, camera_from_gyro: &Matrix3<f64>) -> f64 {
        (camera_from_gyro.transpose() * self.covariance).trace()
    }

    /// The gyro's bias under an assumed alignment, rad/s.
    pub fn bias(&self, camera_from_gyro: &Matrix3<f64>) -> Vector3<f64> {
        self.mean[1] - camera_from_gyro.transpose() * self.mean[0]
    }
}

/// Compares the turns of the camera with the gyro over all offsets.
pub(super) fn align(pairs: &[Pair], lens: &Lens, gyro: &Gyro) -> Option<Coarse> {
    let mut turns: Vec<Turn> = pairs.iter().filter_map(|pair| turn(pair, lens)).collect();
    if turns.len() < 20 {
        return None;
    }
    let path = gyro.path(&Vector3::zeros());
    let rate_of = |turn: &Turn, offset: f64| {
        let (first, second) = path.between(turn.seconds[0] + offset, turn.seconds[1] + offset)?;
        // Not the angle of the turn: that of rates in a wrong unit would wrap at half a turn.
        Some((second.angle - first.angle) / (turn.seconds[1] - turn.seconds[0]))
    };
    let correlate = |turns: &[Turn], offset: f64| {
        let (mut weight, mut sum) = (0.0, [Vector3::zeros(); 2]);
        let (mut square, mut cross, mut count) = ([0.0; 2], Matrix3::zeros(), 0);
        for turn in turns {
            let Some(rate) = rate_of(turn, offset) else { continue };
            let (camera, w) = (turn.rate, turn.weight);
            weight += w;
            count += 1;
            sum = [sum[0] + camera * w, sum[1] + rate * w];
            square = [square[0] + w * camera.norm_squared(), square[1] + w * rate.norm_squared()];
            cross += camera * rate.transpose() * w;
        }
        // At the rim of the recording a few turns may agree by chance.
        if weight <= 0.0 || 2 * count < turns.len() {
            return None;
        }
        let mean = sum.map(|sum| sum / weight);
        let square: [f64; 2] = std::array::from_fn(|k| (square[k] / weight - mean[k].norm_squared()).max(0.0));
        let covariance = cross / weight - mean[0] * mean[1].transpose();
        let norm = (square[0] * square[1]).sqrt();
        if norm <= 1e-12 {
            return None;
        }
        let singular = covariance.singular_values().sum();
        Some(Coarse {
            offset_s: offset,
            covariance: covariance / norm,
            correlation: singular / norm,
            scale: singular / square[1],
            rms: square.map(f64::sqrt),
            mean,
        })
    };
    let mut best: Option<Coarse> = None;
    for round in 0..3 {
        let steps = (FARTHEST_S / STEP_S) as i32;
        let center = best.as_ref().map_or(0.0, |best| best.offset_s);
        let range = if round == 0 { -steps..=steps } else { -10..=10 };
        best =
            range.filter_map(|k| correlate(&turns, center + f64::from(k) * STEP_S)).max_by(|a, b| a.correlation.total_cmp(&b.correlation));
        let found = best.as_ref()?;
        // Turns that contradict the alignment count less the next time.
        let alignment = found.best() * found.scale;
        let residual =
            |turn: &Turn| Some(((turn.rate - found.mean[0]) - alignment * (rate_of(turn, found.offset_s)? - found.mean[1])).norm());
        let mut residuals: Vec<f64> = turns.iter().filter_map(residual).collect();
        let scale = 1.5 * stats::median(&mut residuals)?.max(1e-6);
        let weights: Vec<f64> = turns.iter().map(|turn| residual(turn).map_or(0.0, |r| 1.0 / (1.0 + (r / scale).powi(2)))).collect();
        for (turn, weight) in turns.iter_mut().zip(weights) {
            turn.weight = weight;
        }
    }
    let found = best?;
    // The top of the parabola through the three values around the maximum.
    let at = |k: f64| correlate(&turns, found.offset_s + k * STEP_S);
    let (Some(before), Some(here), Some(after)) = (at(-1.0), at(0.0), at(1.0)) else { return Some(found) };
    let curvature = 2.0 * here.correlation - before.correlation - after.correlation;
    let shift = if curvature > 1e-12 { (0.5 * (after.correlation - before.correlation) / curvature).clamp(-1.0, 1.0) } else { 0.0 };
    at(shift).or(Some(found))
}

/// The camera's rotation over a pair: the rotation that aligns the bearings best, refined with the motion it cannot explain.
fn turn(pair: &Pair, lens: &Lens) -> Option<Turn> {
    let bearings = pair.bearings(lens);
    let threshold = 1.0 / lens.focal_px();
    let rotation = align_bearings(&bearings, threshold)?;
    let mut seen: Vec<BearingPair> = bearings
        .iter()
        .map(|[first, second]| BearingPair {
            rotated: (rotation * first).map(|value| value as f32),
            current: second.map(|value| value as f32),
            is_inlier: true,
        })
        .collect();
    let found = reject_outliers(&mut seen, &TwoViewConfig::DEFAULT, lens.focal_px() as f32, REFINED_SIGMA_RAD)?;
    let second_from_first = so3::exp(&found.rotation_correction.map(f64::from)) * rotation;
    let rate = -so3::log(&second_from_first) / pair.span_s();
    rate.iter().all(|value| value.is_finite()).then_some(Turn { seconds: pair.seconds, rate, weight: 1.0 })
}

/// The rotation that takes the first bearings to the second, those that move otherwise weighted down.
fn align_bearings(bearings: &[[Vector3<f64>; 2]], threshold: f64) -> Option<UnitQuaternion<f64>> {
    if bearings.len() < 8 {
        return None;
    }
    let mut rotation = UnitQuaternion::identity();
    for _ in 0..8 {
        let mut errors: Vec<f64> = bearings.iter().map(|[first, second]| (rotation * first).cross(second).norm()).collect();
        let scale = 2.0 * stats::median(&mut errors)?.max(threshold);
        let (mut information, mut gradient) = (Matrix3::identity() * 1e-9, Vector3::zeros());
        for [first, second] in bearings {
            let turned = rotation * first;
            let error = turned.cross(second);
            let weight = 1.0 / (1.0 + error.norm_squared() / (scale * scale));
            information += (Matrix3::identity() - turned * turned.transpose()) * weight;
            gradient += error * weight;
        }
        rotation = so3::exp(&(information.try_inverse()? * gradient)) * rotation;
    }
    Some(UnitQuaternion::new_normalize(rotation.into_inner()))
}
