//! Which correspondences of two images contradict one rigid motion, given its rotation.
//!
//! # Model
//! With the bearing `f` in the first and `h` in the second camera frame, the rotation `R` of the second from the first and the
//! direction `t` of the first camera seen from the second, a static point fulfils
//! ```text
//! e = tᵀ (R f × h) / s = 0        s² = (‖t × R f‖² + ‖t × h‖²) / 2
//! ```
//! `e` is the angle (rad) between the bearings and a common epipolar plane. Two correspondences give `t ∝ (R f₁ × h₁) × (R f₂ × h₂)`:
//! that is the minimal sample. `s` is kept from zero near the epipole, where `e` means nothing.
//!
//! # Rotation error
//! The gyro's bias may be unknown (0.08 rad/s is 1.8 px per image), so the rotation is a measurement of standard deviation σ_R and not truth:
//! 1. When σ_R is worth more than half the threshold, the robust rotation that best aligns all bearings is a second candidate for `R`. It also absorbs
//!    the mean parallax of a sideways motion, `(ρ − ρ̄) A t` instead of `ρ A t`, which leaves the epipolar lines where they were.
//! 2. The best of both after sampling is refined in five degrees of freedom, `R ← Exp(δ) R`, `t ← t ⊞ τ`, with the prior `δ ~ N(0, σ_R²)`:
//! ```text
//! ∂e/∂δ = ((tᵀ R f) h − (fᵀRᵀ h) t)ᵀ / s  1×3        ∂e/∂τ = (R f × h)ᵀ B(t) / s  1×2
//! ```
//!
//! # Degeneracy
//! Without parallax every `R f × h` is short and all static points fit any `t`: they are all kept, as they should be.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::lie::so3;
use crate::storage::blank::blank;

/// What a static point may deviate by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoViewConfig {
    /// Largest epipolar error of an inlier, px. Default 1.
    pub threshold_px: f32,
    /// Most samples. Default 60.
    pub max_samples: u32,
    /// Seed of the sampling.
    pub seed: u32,
    /// Smallest share of inliers that is believed; below it nothing is rejected. Default 0.4.
    pub min_inlier_share: f32,
}

blank!([] TwoViewConfig { threshold_px, max_samples, seed, min_inlier_share });

impl TwoViewConfig {
    /// The defaults.
    pub const DEFAULT: Self = Self { threshold_px: 1.0, max_samples: 60, seed: 0x9e37_79b9, min_inlier_share: 0.4 };
}

impl Default for TwoViewConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Two bearings of one point, the first already rotated into the second camera frame by the predicted rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BearingPair {
    /// `R f`, unit.
    pub rotated: Vector3<f32>,
    /// `h`, unit.
    pub current: Vector3<f32>,
    /// Written by [`reject_outliers`].
    pub is_inlier: bool,
}

blank!([] BearingPair { rotated, current, is_inlier });

impl Default for BearingPair {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl BearingPair {
    /// A place for a pair.
    pub const EMPTY: Self = Self { rotated: Vector3::new(0.0, 0.0, 1.0), current: Vector3::new(0.0, 0.0, 1.0), is_inlier: true };
}

/// The motion that the inliers agree on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoView {
    /// Unit direction of the translation in the second camera frame; the sign is arbitrary.
    pub direction: Vector3<f32>,
    /// Correction to the predicted rotation, `R ← Exp(correction) R`, rad. Lateral translation may be part of it.
    pub rotation_correction: Vector3<f32>,
    /// Inliers.
    pub inliers: usize,
    /// Median angle between the bearings after the predicted rotation, in px.
    pub parallax_px: f32,
}

/// Fewer pairs than this cannot contradict each other.
const MIN_PAIRS: usize = 8;
/// `s` is not smaller than this, about 3 degrees.
const MIN_EPIPOLE_SINE: f32 = 0.05;

/// Marks the pairs that fit one rigid motion. `focal_px` converts px to rad, `rotation_sigma_rad` is the uncertainty of the
/// predicted rotation (per axis). `None`, with all pairs inliers, when the pairs are too few or agree on nothing.
pub fn reject_outliers(pairs: &mut [BearingPair], config: &TwoViewConfig, focal_px: f32, rotation_sigma_rad: f32) -> Option<TwoView> {
    for pair in pairs.iter_mut() {
        pair.is_inlier = true;
    }
    if pairs.len() < MIN_PAIRS || !(focal_px > 0.0) {
        return None;
    }
    let threshold = config.threshold_px / focal_px;
    let mut motion = Motion { correction: Vector3::zeros(), direction: Vector3::z() };
    let mut cost = search(pairs, &Matrix3::identity(), threshold, config, &mut motion.direction);
    if rotation_sigma_rad > 0.5 * threshold {
        let correction = align_rotation(pairs, threshold, rotation_sigma_rad);
        let mut direction = Vector3::z();
        let other = search(pairs, &rotation(&correction), threshold, config, &mut direction);
        if other < cost {
            (motion, cost) = (Motion { correction, direction }, other);
        }
    }
    // From a generous threshold to the one asked for, so that a rotation error of a few pixels is corrected before it is judged.
    for factor in [4.0, 2.0, 2.0, 1.0, 1.0] {
        let refined = motion.refine(pairs, threshold * factor, threshold, rotation_sigma_rad);
        let refined_cost = total_cost(pairs, &refined.rotation(), &refined.direction, threshold);
        if refined_cost <= cost {
            (motion, cost) = (refined, refined_cost);
        }
    }
    let rotation = motion.rotation();
    let mut inliers = 0;
    for pair in pairs.iter_mut() {
        let error = epipolar_error(&(rotation * pair.rotated), &pair.current, &motion.direction);
        pair.is_inlier = error * error <= threshold * threshold;
        inliers += usize::from(pair.is_inlier);
    }
    if (inliers as f32) < config.min_inlier_share * pairs.len() as f32 {
        for pair in pairs.iter_mut() {
            pair.is_inlier = true;
        }
        return None;
    }
    let parallax_px = rough_median(pairs) * focal_px;
    Some(TwoView { direction: motion.direction, rotation_correction: motion.correction, inliers, parallax_px })
}

/// The error of a pair whose first bearing is rotated, rad.
#[inline]
fn epipolar_error(rotated: &Vector3<f32>, current: &Vector3<f32>, direction: &Vector3<f32>) -> f32 {
    let (f, h) = (direction.dot(rotated), direction.dot(current));
    // ‖t × f‖² = 1 − (tᵀf)² for unit vectors.
    let square = (1.0 - 0.5 * (f * f + h * h)).max(MIN_EPIPOLE_SINE * MIN_EPIPOLE_SINE);
    direction.dot(&rotated.cross(current)) / crate::real::Real::root(square)
}

/// Truncated squared error of all pairs, in units of the squared threshold.
fn total_cost(pairs: &[BearingPair], rotation: &Matrix3<f32>, direction: &Vector3<f32>, threshold: f32) -> f32 {
    let scale = 1.0 / threshold;
    pairs
        .iter()
        .map(|pair| {
            let error = epipolar_error(&(rotation * pair.rotated), &pair.current, direction) * scale;
            (error * error).min(1.0)
        })
        .sum()
}

fn rotation(vector: &Vector3<f32>) -> Matrix3<f32> {
    so3::exp(vector).to_rotation_matrix().into_inner()
}

/// Small deterministic generator (xorshift).
struct Sampler(u32);

impl Sampler {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        ((u64::from(self.0) * bound as u64) >> 32) as usize
    }
}

/// Samples pairs of correspondences for the direction of the least truncated cost, which it returns.
fn search(pairs: &[BearingPair], rotation: &Matrix3<f32>, threshold: f32, config: &TwoViewConfig, direction: &mut Vector3<f32>) -> f32 {
    let mut sampler = Sampler(config.seed | 1);
    let mut best = total_cost(pairs, rotation, direction, threshold);
    let (mut samples, mut needed) = (0, config.max_samples);
    while samples < needed {
        samples += 1;
        let (Some(a), Some(b)) = (pairs.get(sampler.below(pairs.len())), pairs.get(sampler.below(pairs.len()))) else { break };
        let (f_a, f_b) = (rotation * a.rotated, rotation * b.rotated);
        let normal = f_a.cross(&a.current).cross(&f_b.cross(&b.current));
        let length = crate::real::Real::root(normal.norm_squared());
        // No parallax, or twice the same plane.
        if !(length > 1e-12) {
            continue;
        }
        let candidate = normal / length;
        let cost = total_cost(pairs, rotation, &candidate, threshold);
        if cost < best {
            best = cost;
            *direction = candidate;
            // 1 − cost/n is below the share of inliers w: stop when a good sample was missed with probability (1 − w²)ᵏ < 1 %.
            let share = 1.0 - cost / pairs.len() as f32;
            let bad = 1.0 - share * share;
            let (mut missed, mut count) = (1.0_f32, 0);
            while missed > 0.01 && count < config.max_samples {
                missed *= bad;
                count += 1;
            }
            needed = needed.min(count.max(5));
        }
    }
    best
}

/// The rotation vector that aligns the bearings best when distance is ignored: Gauss-Newton with Cauchy weights that narrow down.
fn align_rotation(pairs: &[BearingPair], threshold: f32, sigma_rad: f32) -> Vector3<f32> {
    let mut correction = Vector3::zeros();
    for width in [16.0, 8.0, 4.0, 4.0] {
        let scale = width * threshold;
        let turn = rotation(&correction);
        let mut information = Matrix3::identity() * (1.0 / (sigma_rad * sigma_rad));
        let mut gradient = -correction / (sigma_rad * sigma_rad);
        for pair in pairs {
            let f = turn * pair.rotated;
            // h ≈ f + δ × f: the error across f is f × h, its Jacobian I − f fᵀ.
            let error = f.cross(&pair.current);
            let weight = 1.0 / (threshold * threshold * (1.0 + error.norm_squared() / (scale * scale)));
            information += (Matrix3::identity() - f * f.transpose()) * weight;
            gradient += error * weight;
        }
        let Some(inverse) = information.try_inverse() else { break };
        correction = so3::log(&(so3::exp(&(inverse * gradient)) * so3::exp(&correction)));
    }
    correction
}

#[derive(Debug, Clone, Copy)]
struct Motion {
    correction: Vector3<f32>,
    direction: Vector3<f32>,
}

impl Motion {
    fn rotation(&self) -> Matrix3<f32> {
        rotation(&self.correction)
    }

    /// One damped Gauss-Newton step on the pairs within `gate` (rad), errors whitened by half the threshold.
    fn refine(&self, pairs: &[BearingPair], gate: f32, threshold: f32, sigma_rad: f32) -> Self {
        let turn = self.rotation();
        let t = self.direction;
        let helper = if t.x * t.x < 0.5 { Vector3::x() } else { Vector3::y() };
        let first = t.cross(&helper);
        let first = first / crate::real::Real::root(first.norm_squared()).max(1e-6);
        let second = t.cross(&first);
        let weight = 4.0 / (threshold * threshold);
        let prior = 1.0 / (sigma_rad * sigma_rad).max(1e-12);
        let mut information = SMatrix::<f32, 5, 5>::zeros();
        let mut gradient = SVector::<f32, 5>::zeros();
        for axis in 0..3 {
            information[(axis, axis)] = prior;
            gradient[axis] = -prior * self.correction[axis];
        }
        // Directions that tell nothing stay where they are.
        information[(3, 3)] = 1.0;
        information[(4, 4)] = 1.0;
        for pair in pairs {
            let (f, h) = (turn * pair.rotated, pair.current);
            let error = epipolar_error(&f, &h, &t);
            if !(error * error < gate * gate) {
                continue;
            }
            let (tf, th) = (t.dot(&f), t.dot(&h));
            let s = crate::real::Real::root((1.0 - 0.5 * (tf * tf + th * th)).max(MIN_EPIPOLE_SINE * MIN_EPIPOLE_SINE));
            let d_rotation = (h * tf - t * f.dot(&h)) / s;
            let normal = f.cross(&h) / s;
            let jacobian = SVector::<f32, 5>::new(d_rotation.x, d_rotation.y, d_rotation.z, normal.dot(&first), normal.dot(&second));
            information += jacobian * (jacobian.transpose() * weight);
            gradient -= jacobian * (weight * error);
        }
        let Some(step) = information.cholesky().map(|factor| factor.solve(&gradient)) else { return *self };
        let moved = t + first * step[3] + second * step[4];
        let length = crate::real::Real::root(moved.norm_squared());
        if !(length > 0.5 && length < 2.0) {
            return *self;
        }
        let correction = so3::log(&(so3::exp(&Vector3::new(step[0], step[1], step[2])) * so3::exp(&self.correction)));
        Self { correction, direction: moved / length }
    }
}

/// The median angle between the bearings of the inliers, rad, to one part in 16 of its value: by bisection of the count.
fn rough_median(pairs: &[BearingPair]) -> f32 {
    let inliers = pairs.iter().filter(|pair| pair.is_inlier);
    let half = inliers.clone().count() / 2;
    let (mut low, mut high) = (0.0_f32, 0.5_f32);
    for _ in 0..16 {
        let middle = 0.5 * (low + high);
        let below = inliers.clone().filter(|pair| (pair.current - pair.rotated).norm_squared() < middle * middle).count();
        if below > half { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}
