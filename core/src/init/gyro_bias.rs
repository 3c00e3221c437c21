//! The gyro bias from images alone: epipolar planes do not depend on how far the camera moved.
//!
//! # Model
//! Frames `i`, `j` see a landmark along `f_i`, `f_j`. With the right rotation every `n = f_i × R_ij(b_g) f_j` is across the
//! translation `t`, so that (Kneip and Lynen, ICCV 2013)
//! ```text
//! R_ij(b_g) = R_CB ΔR_ij(b_g) R_BC          min over b_g of  Σ_ij λ_min( Σ_k w_k n_k n_kᵀ )
//! r_k = t · n_k / |t × f_i|                 1×1, rad: the angle of f_i off its epipolar plane
//! ∂r/∂δφ = ((t × f_i)ᵀ R) × f_jᵀ (−1)       1×3, δφ = R_CB φ_ij δb_g;    ∂r/∂δt = nᵀ B(t)   1×2
//! ```
//! Gauss-Newton over `b_g` with every direction `t_ij` eliminated (variable projection). Outliers are weighted down by
//! Cauchy's kernel on the median residual. Pairs are 1, 2 and 4 frames apart.
//!
//! # Degeneracy
//! Without parallax `n` has no preferred plane. There the rotation alone must align the bearings, `n → 0`; this residual takes
//! part in every pair, weighted as if the parallax were one common error of its own size, so that it only counts where there is none.

use nalgebra::{Isometry3, Matrix2, Matrix3, Matrix3x2, UnitQuaternion, Vector2, Vector3};

use super::chain::{InertialLink, walk};
use super::config::{InitConfig, InitError};
use super::median::Histogram;
use super::tracks::{Bearings, InitLandmark, across};
use crate::imu::ImuBias;
use crate::lie::matrix::{of_rotation, product, transposed_product};
use crate::lie::so3;
use crate::real::Real;
use crate::storage::blank::blank;

const STRIDES: [usize; 3] = [1, 2, 4];
const ITERATIONS: usize = 28;
/// Wide pairs join once neighbours have removed most of the bias.
const NEIGHBOURS_ONLY: usize = 4;
/// Tracks that a pair needs: two for the direction, three for the rotation, and some to spare.
const MINIMUM_SHARED: usize = 8;
/// Tracks and pairs of tracks that a direction is first sought with; two good ones among a fifth of outliers are certain.
const SAMPLE: usize = 40;
const HYPOTHESES: usize = 16;
/// Squared sine below which a bearing is too close to the translation to say much about its plane.
const NEAR_EPIPOLE: f64 = 0.01;

/// The gyro bias and how far to trust it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GyroBias<T: Real> {
    /// The bias, rad/s.
    pub gyro_rad_s: Vector3<T>,
    /// Its standard deviation along each axis, rad/s.
    pub sigma_rad_s: Vector3<T>,
    /// Median distance of the observations from their epipolar planes, px.
    pub residual_px: T,
    /// Share of the observations within three standard deviations of their epipolar planes.
    pub inlier_ratio: T,
    /// Pairs of frames that took part.
    pub pairs: usize,
}

blank!([T: Real] GyroBias<T> { gyro_rad_s, sigma_rad_s, residual_px, inlier_ratio, pairs });

/// Two frames and the direction from one to the other.
#[derive(Clone, Copy)]
struct Pair<T: Real> {
    first: usize,
    second: usize,
    /// In the camera of the first frame; zero until found.
    translation: Vector3<T>,
    /// Rotation of the cameras and its derivative by the gyro bias, on the right.
    rotation: Matrix3<T>,
    d_rotation: Matrix3<T>,
    /// What the direction's step is found from once the bias has moved: inverse information, gradient, coupling.
    eliminated: (Matrix2<T>, Vector2<T>, Matrix3x2<T>),
}

fn residual<T: Real>(translation: &Vector3<T>, f_first: &Vector3<T>, normal: &Vector3<T>) -> (T, T) {
    let sine = (translation.cross(f_first).norm_squared() + T::of(NEAR_EPIPOLE)).root();
    (translation.dot(normal) / sine, sine)
}

/// What one pair says about the bias once its direction is eliminated.
struct PairEquations<T: Real> {
    information: Matrix3<T>,
    gradient: Vector3<T>,
}

impl<T: Real> Pair<T> {
    /// `r`, and its derivative by the direction, 2×1 in the basis given.
    fn residual(&self, f_first: &Vector3<T>, normal: &Vector3<T>) -> (T, T) {
        residual(&self.translation, f_first, normal)
    }

    fn d_residual_d_translation(&self, basis: &Matrix3x2<T>, f_first: &Vector3<T>, normal: &Vector3<T>) -> Vector2<T> {
        let (residual, sine) = self.residual(f_first, normal);
        basis.tr_mul(&(normal + f_first * (residual * self.translation.dot(f_first) / sine))) / sine
    }

    /// Replaces the direction by the best of a few that two tracks alone determine, `n_a × n_b`, if that is better.
    #[inline(never)]
    fn sample_translation<B: Bearings<T>>(&mut self, bearings: &B, scale: T) {
        let mut sample = [(Vector3::zeros(), Vector3::zeros()); SAMPLE];
        let total = shared(bearings, self.first, self.second).count();
        if total < MINIMUM_SHARED {
            return;
        }
        let stride = total.div_ceil(SAMPLE);
        let mut count = 0;
        for (slot, (f_first, f_second)) in sample.iter_mut().zip(shared(bearings, self.first, self.second).step_by(stride)) {
            *slot = (f_first, f_first.cross(&(self.rotation * f_second)));
            count += 1;
        }
        let sample = &sample[..count];
        // Every track lowers the cost by one at most: a direction that cannot come below `limit` any more is given up.
        let cost = |translation: &Vector3<T>, limit: T| {
            let mut sum = T::ZERO;
            let mut remaining = T::of(count as f64);
            for (f_first, normal) in sample {
                let (residual, _) = residual(translation, f_first, normal);
                sum -= cauchy(residual * residual / (scale * scale));
                remaining -= T::one();
                // Sums of this length are rounded by less than the margin.
                if sum - remaining > limit + T::of(1e-3) {
                    break;
                }
            }
            sum
        };
        let mut best = (T::ZERO, self.translation);
        if self.translation != Vector3::zeros() {
            best.0 = cost(&self.translation, T::ZERO);
        }
        for hypothesis in 0..HYPOTHESES {
            let (Some((_, a)), Some((_, b))) = (sample.get(hypothesis * 7 % count), sample.get((hypothesis * 13 + count / 2) % count))
            else {
                continue;
            };
            let across_both = a.cross(b);
            let length = across_both.norm();
            if length > T::of(1e-3) * a.norm() * b.norm() && length > T::ZERO {
                let translation = across_both / length;
                let cost = cost(&translation, best.0);
                if cost < best.0 {
                    best = (cost, translation);
                }
            }
        }
        self.translation = best.1;
    }

    /// Two Gauss-Newton steps of the direction for the present rotation.
    #[inline(never)]
    fn fit_translation<B: Bearings<T>>(&mut self, bearings: &B, scale: T) -> Option<()> {
        for _ in 0..2 {
            let basis = across(&self.translation);
            let (mut information, mut gradient) = (Matrix2::<T>::identity(), Vector2::<T>::zeros());
            for (f_first, f_second) in shared(bearings, self.first, self.second) {
                let normal = f_first.cross(&(self.rotation * f_second));
                let (residual, _) = self.residual(&f_first, &normal);
                let slope = self.d_residual_d_translation(&basis, &f_first, &normal);
                let weight = redescending(residual, scale);
                information += slope * slope.transpose() * weight;
                gradient += slope * (residual * weight);
            }
            let turn = -(information.try_inverse()? * gradient);
            self.turn_translation(&turn);
        }
        self.translation.iter().all(|value| value.is_usable()).then_some(())
    }

    /// Moves the direction along with a step of the bias.
    fn follow(&mut self, step: &Vector3<T>) {
        let (inverse, gradient, coupling) = &self.eliminated;
        let turn = -(inverse * (gradient + coupling.tr_mul(step)));
        self.turn_translation(&turn);
    }

    fn turn_translation(&mut self, turn: &Vector2<T>) {
        let longest = T::of(0.3);
        let length = turn.norm();
        let shortened = if length > longest { turn * (longest / length) } else { *turn };
        let moved = self.translation + across(&self.translation) * shortened;
        if self.translation != Vector3::zeros() {
            self.translation = moved.normalize();
        }
    }

    #[inline(never)]
    fn equations<B: Bearings<T>>(&mut self, bearings: &B, scale: T, sigma: T, residuals: &mut Histogram) -> Option<PairEquations<T>> {
        let basis: Matrix3x2<T> = across(&self.translation);
        let (mut h_bb, mut g_b) = (Matrix3::<T>::zeros(), Vector3::<T>::zeros());
        let (mut h_bt, mut h_tt, mut g_t) = (Matrix3x2::<T>::zeros(), Matrix2::<T>::zeros(), Vector2::<T>::zeros());
        let (mut parallaxes, mut count) = (Histogram::new(), 0_usize);
        for (f_first, f_second) in shared(bearings, self.first, self.second) {
            let normal = f_first.cross(&(self.rotation * f_second));
            let (residual, sine) = self.residual(&f_first, &normal);
            residuals.add(residual);
            parallaxes.add(normal.norm());
            count += 1;
            let arm = self.rotation.tr_mul(&self.translation.cross(&f_first));
            let d_bias = self.d_rotation.tr_mul(&-arm.cross(&f_second)) / sine;
            let d_translation = self.d_residual_d_translation(&basis, &f_first, &normal);
            let weight = redescending(residual, scale);
            h_bb += d_bias * d_bias.transpose() * weight;
            h_bt += d_bias * d_translation.transpose() * weight;
            h_tt += d_translation * d_translation.transpose() * weight;
            g_b += d_bias * (residual * weight);
            g_t += d_translation * (residual * weight);
        }
        if count < MINIMUM_SHARED {
            return None;
        }
        // A direction is known to a radian at least.
        let inverse = (h_tt + Matrix2::identity()).try_inverse()?;
        self.eliminated = (inverse, g_t, h_bt);
        let mut information = h_bb - h_bt * inverse * h_bt.transpose();
        let mut gradient = g_b - h_bt * inverse * g_t;

        let noise = sigma * sigma * T::of(2.0);
        let parallax: T = parallaxes.quantile(0.5)?;
        let parallax_squared = parallax * parallax;
        let common = (parallax_squared - noise).max(T::ZERO) * T::of(10.0 * f64::from(u16::try_from(count).unwrap_or(u16::MAX)));
        let information_each = T::one() / common.max(noise);
        let kernel = (parallax_squared * T::of(4.0)).max(noise);
        for (f_first, f_second) in shared(bearings, self.first, self.second) {
            let normal = f_first.cross(&(self.rotation * f_second));
            let weight = cauchy(normal.norm_squared() / kernel) * information_each;
            let d_bias = -(so3::hat(&f_first) * self.rotation * so3::hat(&f_second)) * self.d_rotation;
            information += d_bias.tr_mul(&d_bias) * weight;
            gradient += d_bias.tr_mul(&normal) * weight;
        }
        Some(PairEquations { information, gradient })
    }
}

/// Estimates the gyro bias, starting from `start_rad_s`, from at most `FRAMES` frames.
///
/// `landmarks` receives the observations that contradict most of their pairs in `rejected_frames`; the rest of it is untouched.
///
/// # Errors
/// `Frames` for fewer than three or too many frames, `Tracks` when fewer than two pairs share eight tracks, `Agreement` when most
/// observations stay far from their epipolar planes.
#[inline(never)]
pub fn estimate_gyro_bias<const FRAMES: usize, T: Real, B: Bearings<T>>(
    config: &InitConfig<T>,
    body_from_camera: &Isometry3<T>,
    links: &[InertialLink<T>],
    start_rad_s: &Vector3<T>,
    bearings: &B,
    landmarks: &mut [InitLandmark<T>],
) -> Result<GyroBias<T>, InitError<T>> {
    let frames = links.len() + 1;
    if !(3..=FRAMES).contains(&frames) {
        return Err(InitError::Frames(frames));
    }
    let body_from_camera = of_rotation(&body_from_camera.rotation);
    let camera_from_body = body_from_camera.transpose();
    let sigma = config.sigma_rad();
    // Both bearings of a pair are noisy.
    let least_scale = sigma * T::of(core::f64::consts::SQRT_2);
    let empty = Pair {
        first: 0,
        second: 0,
        translation: Vector3::zeros(),
        rotation: Matrix3::identity(),
        d_rotation: Matrix3::identity(),
        eliminated: (Matrix2::zeros(), Vector2::zeros(), Matrix3x2::zeros()),
    };
    let mut pairs = [const { heapless::Vec::<Pair<T>, FRAMES>::new() }; STRIDES.len()];
    for (pairs, stride) in pairs.iter_mut().zip(STRIDES) {
        for first in 0..frames.saturating_sub(stride) {
            // There are fewer than frames.
            let _ = pairs.push(Pair { first, second: first + stride, ..empty });
        }
    }
    // Orientation in the first body frame, and its derivative by the gyro bias.
    let mut turns = [(UnitQuaternion::identity(), Matrix3::zeros()); FRAMES];
    let prior = T::one() / (config.sigma_gyro_bias_rad_s * config.sigma_gyro_bias_rad_s);
    let mut bias = *start_rad_s;
    let mut scale = least_scale * T::of(3.0);
    let mut information = Matrix3::identity();
    let mut used = 0;
    let mut residuals = Histogram::new();
    for iteration in 0..ITERATIONS {
        walk(links, &ImuBias { gyro_rad_s: bias, accel_m_s2: Vector3::zeros() }, |frame, node| {
            if let Some(turn) = turns.get_mut(frame) {
                *turn = (node.first_from_body, node.d_rotation_d_gyro);
            }
        });
        information = Matrix3::identity() * prior;
        let mut gradient = bias * prior;
        residuals = Histogram::new();
        used = 0;
        let active = if iteration < NEIGHBOURS_ONLY { 1 } else { STRIDES.len() };
        for pair in pairs.iter_mut().take(active).flatten() {
            let (Some((first, d_first)), Some((second, d_second))) = (turns.get(pair.first), turns.get(pair.second)) else { continue };
            let between = of_rotation(&(first.inverse() * second));
            pair.rotation = product(&product(&camera_from_body, &between), &body_from_camera);
            pair.d_rotation = product(&camera_from_body, &(d_second - transposed_product(&between, d_first)));
            if iteration < NEIGHBOURS_ONLY + 4 || iteration % 3 == 0 {
                pair.sample_translation(bearings, scale);
            }
            if pair.fit_translation(bearings, scale).is_none() {
                continue;
            }
            if let Some(equations) = pair.equations(bearings, scale, sigma, &mut residuals) {
                information += equations.information;
                gradient += equations.gradient;
                used += 1;
            }
        }
        if used < 2 {
            return Err(InitError::Tracks(0));
        }
        let median: T = residuals.quantile(0.5).ok_or(InitError::Tracks(0))?;
        scale = (median * T::of(1.4826)).max(least_scale);
        let mut step = information.cholesky().ok_or(InitError::Numerical)?.solve(&-gradient);
        let length = step.norm();
        if !length.is_usable() {
            return Err(InitError::Numerical);
        }
        let longest = T::of(0.1);
        if length > longest {
            step *= longest / length;
        }
        bias += step;
        pairs.iter_mut().take(active).flatten().for_each(|pair| pair.follow(&step));
        if length < T::of(2e-4) && iteration > NEIGHBOURS_ONLY {
            break;
        }
    }
    let inlier_ratio = vote::<FRAMES, _, _>(&pairs, bearings, landmarks, scale.max(least_scale) * T::of(3.0));
    let residual_px = residuals.quantile::<T>(0.5).ok_or(InitError::Tracks(0))? * config.focal_px;
    // An observation takes part in up to one pair per stride on each side: count its information once.
    let covariance = information.try_inverse().ok_or(InitError::Numerical)? * T::of(STRIDES.len() as f64);
    if residual_px > config.maximum_median_residual * config.sigma_px * T::of(1.5) || inlier_ratio < config.minimum_inlier_ratio {
        return Err(InitError::Agreement(residual_px, inlier_ratio));
    }
    Ok(GyroBias {
        gyro_rad_s: bias,
        sigma_rad_s: covariance.diagonal().map(|v| v.max(T::ZERO).root()),
        residual_px,
        inlier_ratio,
        pairs: used,
    })
}

/// Marks observations that are outliers in more than half of their pairs; the share of inliers over all pairs.
fn vote<const FRAMES: usize, T: Real, B: Bearings<T>>(
    pairs: &[heapless::Vec<Pair<T>, FRAMES>],
    bearings: &B,
    landmarks: &mut [InitLandmark<T>],
    limit: T,
) -> T {
    let (mut inliers, mut total) = (0_u32, 0_u32);
    for (landmark, record) in (0..bearings.landmark_count()).zip(landmarks.iter_mut()) {
        let mut votes = [(0_u8, 0_u8); FRAMES];
        for pair in pairs.iter().flatten().filter(|pair| pair.translation != Vector3::zeros()) {
            let (Some(f_first), Some(f_second)) = (bearings.bearing(landmark, pair.first), bearings.bearing(landmark, pair.second)) else {
                continue;
            };
            let normal = f_first.cross(&(pair.rotation * f_second));
            let is_outlier = pair.residual(&f_first, &normal).0.abs() > limit;
            total += 1;
            inliers += u32::from(!is_outlier);
            for frame in [pair.first, pair.second] {
                if let Some((against, all)) = votes.get_mut(frame) {
                    *against += u8::from(is_outlier);
                    *all += 1;
                }
            }
        }
        record.rejected_frames =
            (0_u32..).zip(&votes).filter(|(_, (against, all))| against * 2 > *all).fold(0, |mask, (frame, _)| mask | 1 << frame);
    }
    T::of(f64::from(inliers) / f64::from(total.max(1)))
}

/// The bearings of the landmarks that both frames see.
fn shared<T: Real, B: Bearings<T>>(bearings: &B, first: usize, second: usize) -> impl Iterator<Item = (Vector3<T>, Vector3<T>)> + '_ {
    (0..bearings.landmark_count())
        .filter_map(move |landmark| Some((bearings.bearing(landmark, first)?, bearings.bearing(landmark, second)?)))
}

/// Weight of Geman and McClure's kernel, 1/rad².
fn redescending<T: Real>(residual: T, scale: T) -> T {
    let weight = cauchy(residual * residual / (scale * scale)) / scale;
    weight * weight
}

/// Weight of Cauchy's kernel with its knee at two standard deviations.
pub(super) fn cauchy<T: Real>(whitened_squared: T) -> T {
    T::one() / (T::one() + whitened_squared * T::of(0.25))
}
