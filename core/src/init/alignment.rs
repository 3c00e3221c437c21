//! The moving start: velocity, gravity and scale by one linear solve, then the most likely motion.
//!
//! # Model
//! With the rotations known, camera `i` has its centre at `c_i = v₀ t_i + ½ g t_i² + α_i + R_i t_BC` in the first body frame,
//! and sees the point `X` along the unit vector `h_i`, so that
//! ```text
//! N_i (X − c_i) = 0        N_i = w_i (I − h_i h_iᵀ),   w_i = 1/(distance · σ)²
//! ```
//! is linear in `[X v₀ g]`, and metric because `α_i` is. Every `X` is eliminated, then `v₀`; gravity minimises what is left on
//! the sphere of known radius. Three rounds find the distances and weigh outliers down. The refinement then adds the biases.
//! The idea of the linear solve: Martinelli, Closed-form solution of visual-inertial structure from motion, IJCV 2014.
//!
//! # Degeneracy
//! Constant velocity leaves the scale free, a pure rotation all of it. Both are refused by the scale's own standard deviation,
//! pure rotation before that for lack of parallax.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::chain::{InertialLink, walk};
use super::config::{InitConfig, InitError};
use super::gravity::{gravity_of_known_magnitude, world_from_specific_force};
use super::gyro_bias::{GyroBias, cauchy, estimate_gyro_bias};
use super::median::Histogram;
use super::refinement::{Descent, LandmarkMemory, Motion, PARAMETERS, Pose, Poses, Problem};
use super::tracks::{Bearings, InitLandmark};
use crate::imu::{ImuBias, NavState};
use crate::lie::matrix::{product, transposed_product};
use crate::real::Real;
use crate::storage::blank::blank;

const ROUNDS: usize = 4;

/// How good the first states are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment<T: Real> {
    /// Gyro bias from the images alone, before everything was estimated together.
    pub epipolar: GyroBias<T>,
    /// Biases at the end; where the gyro's is far from the one integrated with, integrate anew and align once more.
    pub bias: ImuBias<T>,
    /// Standard deviations: gyro bias, rad/s; accelerometer bias, m/s²; first velocity, m/s.
    pub sigma_gyro_bias_rad_s: Vector3<T>,
    /// Of the accelerometer bias, m/s².
    pub sigma_accel_bias_m_s2: Vector3<T>,
    /// Of the first velocity in the first body frame, m/s.
    pub sigma_velocity_m_s: Vector3<T>,
    /// Of the direction of gravity about its two horizontal axes, rad.
    pub sigma_gravity_rad: T,
    /// Relative standard deviation of the distances travelled, from bearing noise and biases. White noise, scale and axis errors of
    /// the inertial samples come on top: on recorded motions the real error is about twice this after 2 s.
    pub scale_sigma: T,
    /// Length of the polyline through the positions, m.
    pub distance_m: T,
    /// Median displacement of the tracks beyond rotation, px.
    pub parallax_px: T,
    /// Median reprojection error (length of a two-dimensional error; 1.18 σ for normal noise), px.
    pub residual_px: T,
    /// Share of the observations that fit.
    pub inlier_ratio: T,
    /// Observations that took part.
    pub observations: usize,
    /// Magnitude of gravity when it is estimated freely, m/s², and its standard deviation.
    pub free_gravity_m_s2: T,
    /// Of the freely estimated magnitude, m/s².
    pub sigma_free_gravity_m_s2: T,
}

/// A moving start that is being computed. It may be left after any iteration and taken up again with the same problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovingStart<T: Real> {
    epipolar: GyroBias<T>,
    parallax_px: T,
    free_gravity_m_s2: T,
    sigma_free_gravity_m_s2: T,
    descent: Descent<T>,
}

blank!([T: Real] MovingStart<T> { epipolar, parallax_px, free_gravity_m_s2, sigma_free_gravity_m_s2, descent });

impl<T: Real> MovingStart<T> {
    /// The gyro bias and the linear solution. `landmarks` needs a place per landmark; surplus landmarks are left out.
    ///
    /// # Errors
    /// The reason for which there are no states yet, see [`InitError`].
    #[inline(never)]
    pub fn begin<B: Bearings<T>, const FRAMES: usize>(
        problem: &Problem<'_, T, B, FRAMES>,
        landmarks: &mut [InitLandmark<T>],
    ) -> Result<Self, InitError<T>> {
        let Problem { config, body_from_camera, links, bearings } = *problem;
        let frames = links.len() + 1;
        if !(3..=FRAMES).contains(&frames) {
            return Err(InitError::Frames(frames));
        }
        let landmarks = problem.records(landmarks);
        for landmark in landmarks.iter_mut() {
            *landmark = InitLandmark::default();
        }
        let is_long = |landmark: &usize| (0..frames).filter(|&frame| bearings.bearing(*landmark, frame).is_some()).count() >= 3;
        let long = (0..landmarks.len()).filter(is_long).count();
        if long < config.minimum_tracks {
            return Err(InitError::Tracks(long));
        }
        let start = links.first().map_or_else(Vector3::zeros, |link| link.bias.gyro_rad_s);
        let epipolar = estimate_gyro_bias::<FRAMES, _, _>(config, body_from_camera, links, &start, bearings, landmarks)?;
        let accel_m_s2 = links.first().map_or_else(Vector3::zeros, |link| link.bias.accel_m_s2);
        let still = Motion {
            velocity: Vector3::zeros(),
            gravity: Vector3::z() * config.gravity_m_s2,
            bias: ImuBias { gyro_rad_s: epipolar.gyro_rad_s, accel_m_s2 },
            drift: Vector3::zeros(),
        };
        choose(bearings, frames, landmarks);
        let used = landmarks.iter().filter(|landmark| landmark.is_used).count();
        if used < config.minimum_tracks {
            return Err(InitError::Tracks(used));
        }
        let parallax_px = parallax(problem, &still, landmarks) * config.focal_px;
        if parallax_px < config.minimum_parallax_px || !parallax_px.is_usable() {
            return Err(InitError::Parallax(parallax_px));
        }
        let linear = align_linearly(problem, &still.bias, landmarks).ok_or(InitError::Numerical)?;
        Ok(Self {
            epipolar,
            parallax_px,
            free_gravity_m_s2: linear.free_gravity_m_s2,
            sigma_free_gravity_m_s2: linear.sigma_free_gravity_m_s2,
            descent: Descent::new(linear.motion, config.maximum_iterations),
        })
    }

    /// Refines for `iterations` at most; whether that is over. The equations of landmarks for which `memory` has no place are
    /// summed up twice.
    ///
    /// # Errors
    /// [`InitError::Numerical`].
    pub fn refine<B: Bearings<T>, const FRAMES: usize>(
        &mut self,
        problem: &Problem<'_, T, B, FRAMES>,
        landmarks: &mut [InitLandmark<T>],
        memory: &mut [LandmarkMemory<T>],
        iterations: usize,
    ) -> Result<bool, InitError<T>> {
        problem.descend(&mut self.descent, problem.records(landmarks), memory, iterations).ok_or(InitError::Numerical)?;
        Ok(self.descent.is_over())
    }

    /// Judges what was found and writes the states, for which `states` needs a place per frame.
    ///
    /// # Errors
    /// The reason for which there are no states yet, see [`InitError`].
    #[inline(never)]
    pub fn finish<B: Bearings<T>, const FRAMES: usize>(
        &self,
        problem: &Problem<'_, T, B, FRAMES>,
        landmarks: &mut [InitLandmark<T>],
        states: &mut [NavState<T>],
    ) -> Result<Alignment<T>, InitError<T>> {
        let Problem { config, links, .. } = *problem;
        if states.len() <= links.len() {
            return Err(InitError::Frames(links.len() + 1));
        }
        let refined = problem.conclude(&self.descent, problem.records(landmarks)).ok_or(InitError::Numerical)?;
        let (scale_sigma, distance_m) = scale(&refined.motion, &refined.covariance, links);
        // A free scale is a valley that the descent slides along without an end.
        if scale_sigma > config.maximum_scale_sigma || !scale_sigma.is_usable() || !refined.is_converged {
            return Err(InitError::Excitation(scale_sigma));
        }
        if refined.median_residual_px > config.maximum_median_residual * config.sigma_px * T::of(1.1774)
            || refined.inlier_ratio < config.minimum_inlier_ratio
        {
            return Err(InitError::Agreement(refined.median_residual_px, refined.inlier_ratio));
        }
        let off = (self.free_gravity_m_s2 - config.gravity_m_s2).abs();
        if off > config.maximum_gravity_error_m_s2 + self.sigma_free_gravity_m_s2 * T::of(3.0) {
            return Err(InitError::Gravity(self.free_gravity_m_s2));
        }
        write_states(&refined.motion, links, states).ok_or(InitError::Numerical)?;
        let sigma = refined.covariance.diagonal().map(|variance| variance.max(T::ZERO).root());
        Ok(Alignment {
            epipolar: self.epipolar,
            bias: refined.motion.bias,
            sigma_velocity_m_s: sigma.fixed_rows::<3>(0).into_owned(),
            sigma_gravity_rad: sigma[3].max(sigma[4]),
            sigma_accel_bias_m_s2: sigma.fixed_rows::<3>(5).into_owned(),
            sigma_gyro_bias_rad_s: sigma.fixed_rows::<3>(8).into_owned(),
            scale_sigma,
            distance_m,
            parallax_px: self.parallax_px,
            residual_px: refined.median_residual_px,
            inlier_ratio: refined.inlier_ratio,
            observations: refined.observations,
            free_gravity_m_s2: self.free_gravity_m_s2,
            sigma_free_gravity_m_s2: self.sigma_free_gravity_m_s2,
        })
    }
}

/// First states of a moving body, from at most `FRAMES` frames, in one go; the stack that it takes grows with `FRAMES`.
///
/// The world is level with its origin at the first body and no yaw added there. What `landmarks`, `memory` and `states` need room for
/// is said at [`MovingStart`].
///
/// # Errors
/// The reason for which there are no states yet, see [`InitError`].
pub fn initialise_moving<const FRAMES: usize, T: Real, B: Bearings<T>>(
    problem: &Problem<'_, T, B, FRAMES>,
    landmarks: &mut [InitLandmark<T>],
    memory: &mut [LandmarkMemory<T>],
    states: &mut [NavState<T>],
) -> Result<Alignment<T>, InitError<T>> {
    let mut start = MovingStart::begin(problem, landmarks)?;
    start.refine(problem, landmarks, memory, usize::MAX)?;
    start.finish(problem, landmarks, states)
}

/// Takes the landmarks with three good bearings; the first good frame becomes the anchor.
fn choose<T: Real, B: Bearings<T>>(bearings: &B, frames: usize, landmarks: &mut [InitLandmark<T>]) {
    for (index, landmark) in landmarks.iter_mut().enumerate() {
        let mask = *landmark;
        let mut good =
            (0..frames).filter(|&frame| !mask.is_rejected(frame)).filter_map(|frame| Some((frame, bearings.bearing(index, frame)?)));
        if let Some((anchor, bearing)) = good.next() {
            #[allow(clippy::cast_possible_truncation)] // a window holds at most 32 frames
            {
                landmark.anchor = anchor as u8;
            }
            landmark.bearing_in_anchor = bearing;
            landmark.is_used = good.count() >= 2;
        }
    }
}

/// Median over the tracks of the angle between the first bearing and the one farthest from it, rotation removed, rad.
#[inline(never)]
fn parallax<T: Real, B: Bearings<T>, const FRAMES: usize>(
    problem: &Problem<'_, T, B, FRAMES>,
    motion: &Motion<T>,
    landmarks: &[InitLandmark<T>],
) -> T {
    let mut poses = Poses::<T, FRAMES>::empty();
    poses.fill(motion, problem.links, problem.body_from_camera);
    let mut angles = Histogram::new();
    for (index, landmark) in landmarks.iter().enumerate().filter(|(_, landmark)| landmark.is_used) {
        let Some(anchor) = poses.as_slice().get(usize::from(landmark.anchor)) else { continue };
        let reference = anchor.first_from_camera * landmark.bearing_in_anchor;
        let farthest =
            poses.as_slice().iter().enumerate().filter(|(frame, _)| !landmark.is_rejected(*frame)).fold(T::ZERO, |most, (frame, pose)| {
                let bearing = problem.bearings.bearing(index, frame);
                bearing.map_or(most, |f| most.max((pose.first_from_camera * f).cross(&reference).norm()))
            });
        angles.add(farthest);
    }
    angles.quantile(0.5).unwrap_or(T::ZERO)
}

struct Linear<T: Real> {
    motion: Motion<T>,
    free_gravity_m_s2: T,
    sigma_free_gravity_m_s2: T,
}

/// Normal equations of `[v₀ g]`.
struct Reduced<T: Real> {
    information: SMatrix<T, 6, 6>,
    right: SVector<T, 6>,
}

/// What a landmark's bearings say, its own position apart.
struct LandmarkEquations<T: Real> {
    own: Matrix3<T>,
    own_right: Vector3<T>,
    cross: SMatrix<T, 3, 6>,
}

/// The linear solve; leaves every landmark's direction and inverse distance behind.
#[inline(never)]
fn align_linearly<T: Real, B: Bearings<T>, const FRAMES: usize>(
    problem: &Problem<'_, T, B, FRAMES>,
    bias: &ImuBias<T>,
    landmarks: &mut [InitLandmark<T>],
) -> Option<Linear<T>> {
    let config = problem.config;
    // Without velocity and gravity the poses hold the known part of the centres.
    let at_rest = Motion { velocity: Vector3::zeros(), gravity: Vector3::zeros(), bias: *bias, drift: Vector3::zeros() };
    let (mut known, mut centres) = (Poses::<T, FRAMES>::empty(), Poses::<T, FRAMES>::empty());
    known.fill(&at_rest, problem.links, problem.body_from_camera);
    let mut solution: Option<Linear<T>> = None;
    for _ in 0..ROUNDS {
        let mut reduced = Reduced { information: SMatrix::zeros(), right: SVector::zeros() };
        for i in 0..3 {
            // Nobody moves at 30 m/s before the start.
            reduced.information[(i, i)] = T::of(1.0 / 900.0);
        }
        for (index, landmark) in landmarks.iter().enumerate().filter(|(_, landmark)| landmark.is_used) {
            let centres = solution.is_some().then_some(centres.as_slice());
            add_landmark(problem, known.as_slice(), centres, index, landmark, &mut reduced);
        }
        let linear = solve_reduced(&reduced, bias, config.gravity_m_s2)?;
        centres.fill(&linear.motion, problem.links, problem.body_from_camera);
        for (index, landmark) in landmarks.iter_mut().enumerate().filter(|(_, landmark)| landmark.is_used) {
            triangulate(problem, centres.as_slice(), index, landmark);
        }
        solution = Some(linear);
    }
    solution
}

/// The weight of a bearing given where its landmark was found last.
fn weight<T: Real>(
    config: &InitConfig<T>,
    centres: Option<&[Pose<T>]>,
    landmark: &InitLandmark<T>,
    frame: usize,
    direction: &Vector3<T>,
) -> T {
    let sigma = config.sigma_rad();
    let found = centres.and_then(|centres| Some((centres.get(usize::from(landmark.anchor))?, centres.get(frame)?)));
    let Some((anchor, view)) = found else { return T::one() / (sigma * sigma) };
    let distance = T::one() / landmark.inverse_distance_per_m.max(T::of(0.01));
    let offset = anchor.first_from_camera * landmark.bearing_in_anchor * distance + anchor.centre - view.centre;
    let away = offset.norm().max(T::of(0.05));
    // Behind the camera counts as a right angle.
    let sine = if offset.dot(direction) > T::ZERO { offset.cross(direction).norm() / away } else { T::one() };
    let scale = sigma * away;
    cauchy(sine * sine / (sigma * sigma)) / (scale * scale)
}

#[inline(never)]
fn add_landmark<T: Real, B: Bearings<T>, const FRAMES: usize>(
    problem: &Problem<'_, T, B, FRAMES>,
    known: &[Pose<T>],
    centres: Option<&[Pose<T>]>,
    index: usize,
    landmark: &InitLandmark<T>,
    reduced: &mut Reduced<T>,
) {
    let mut own = LandmarkEquations { own: Matrix3::zeros(), own_right: Vector3::zeros(), cross: SMatrix::zeros() };
    for (frame, view) in known.iter().enumerate() {
        let Some(f) = (!landmark.is_rejected(frame)).then(|| problem.bearings.bearing(index, frame)).flatten() else { continue };
        let direction = view.first_from_camera * f;
        let block =
            (Matrix3::identity() - direction * direction.transpose()) * weight(problem.config, centres, landmark, frame, &direction);
        let right = block * view.centre;
        let time = view.time_s;
        let half_squared = time * time * T::of(0.5);
        own.own += block;
        own.own_right += right;
        let factors = [time, half_squared];
        for (row, &a) in factors.iter().enumerate() {
            let mut cross = own.cross.fixed_columns_mut::<3>(row * 3);
            cross -= block * a;
            let mut right_part = reduced.right.fixed_rows_mut::<3>(row * 3);
            right_part -= right * a;
            for (column, &b) in factors.iter().enumerate() {
                let mut part = reduced.information.fixed_view_mut::<3, 3>(row * 3, column * 3);
                part += block * (a * b);
            }
        }
    }
    // A faint pull to the origin (one part in a million) keeps points at infinity regular.
    let trace = own.own.trace();
    for i in 0..3 {
        own.own[(i, i)] += trace * T::of(1e-6);
    }
    if let Some(inverse) = own.own.try_inverse() {
        reduced.information -= transposed_product(&own.cross, &product(&inverse, &own.cross));
        reduced.right -= own.cross.tr_mul(&(inverse * own.own_right));
    }
}

#[inline(never)]
fn solve_reduced<T: Real>(reduced: &Reduced<T>, bias: &ImuBias<T>, gravity_m_s2: T) -> Option<Linear<T>> {
    let velocity_block = reduced.information.fixed_view::<3, 3>(0, 0).into_owned();
    let cross = reduced.information.fixed_view::<3, 3>(0, 3).into_owned();
    let inverse = velocity_block.cholesky()?.inverse();
    let velocity_right = reduced.right.fixed_rows::<3>(0).into_owned();
    let information = reduced.information.fixed_view::<3, 3>(3, 3) - transposed_product(&cross, &product(&inverse, &cross));
    let right = reduced.right.fixed_rows::<3>(3) - cross.tr_mul(&(inverse * velocity_right));
    let gravity = gravity_of_known_magnitude(&information, &right, gravity_m_s2)?;
    let velocity = inverse * (velocity_right - cross * gravity);
    let faint = Matrix3::identity() * T::of(1e-4);
    let covariance = (information + faint).try_inverse()?;
    let free = covariance * right;
    let magnitude = free.norm();
    let along = free / magnitude.max(T::of(1e-3));
    Some(Linear {
        motion: Motion { velocity, gravity, bias: *bias, drift: Vector3::zeros() },
        free_gravity_m_s2: magnitude,
        sigma_free_gravity_m_s2: along.dot(&(covariance * along)).max(T::ZERO).root(),
    })
}

/// The nearest point to all rays, as direction and inverse distance from the anchor.
#[inline(never)]
fn triangulate<T: Real, B: Bearings<T>, const FRAMES: usize>(
    problem: &Problem<'_, T, B, FRAMES>,
    centres: &[Pose<T>],
    index: usize,
    landmark: &mut InitLandmark<T>,
) {
    let Some(anchor) = centres.get(usize::from(landmark.anchor)) else { return };
    let (mut own, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let rays = |view: &Pose<T>, frame: usize| Some(view.first_from_camera * problem.bearings.bearing(index, frame)?);
    for (frame, view) in centres.iter().enumerate().filter(|(frame, _)| !landmark.is_rejected(*frame)) {
        let Some(direction) = rays(view, frame) else { continue };
        let first_round = landmark.inverse_distance_per_m == T::ZERO;
        let block = (Matrix3::identity() - direction * direction.transpose())
            * weight(problem.config, (!first_round).then_some(centres), landmark, frame, &direction);
        own += block;
        right += block * (view.centre - anchor.centre);
    }
    let trace = own.trace();
    for i in 0..3 {
        own[(i, i)] += trace * T::of(1e-6);
    }
    let Some(offset) = own.try_inverse().map(|inverse| anchor.first_from_camera.tr_mul(&(inverse * right))) else { return };
    let distance = offset.norm();
    let Some(bearing) = problem.bearings.bearing(index, usize::from(landmark.anchor)) else { return };
    let in_front = distance.is_usable() && distance > T::of(0.05) && offset.dot(&bearing) > distance * T::of(0.9);
    (landmark.bearing_in_anchor, landmark.inverse_distance_per_m) =
        if in_front { (offset / distance, T::one() / distance) } else { (bearing, T::of(0.02)) };
}

/// Relative standard deviation of the scale and the distance travelled.
///
/// The scale of a motion `p_i` is moved by `δp_i` by `δs = Σ (p_i − p̄)·δp_i / Σ |p_i − p̄|²`.
#[inline(never)]
fn scale<T: Real>(motion: &Motion<T>, covariance: &SMatrix<T, PARAMETERS, PARAMETERS>, links: &[InertialLink<T>]) -> (T, T) {
    let share = T::one() / T::of((links.len() + 1) as f64);
    let mut mean = Vector3::zeros();
    walk(links, &motion.bias, |_, node| mean += motion.position(node) * share);
    let (mut row, mut size, mut distance) = (SVector::<T, PARAMETERS>::zeros(), T::ZERO, T::ZERO);
    let mut previous = Vector3::zeros();
    walk(links, &motion.bias, |_, node| {
        let position = motion.position(node);
        let arm = position - mean;
        row += motion.d_position(node).tr_mul(&arm);
        size += arm.norm_squared();
        distance += (position - previous).norm();
        previous = position;
    });
    let row = row / size.max(T::of(1e-12));
    (row.dot(&(covariance * row)).max(T::ZERO).root(), distance)
}

#[inline(never)]
fn write_states<T: Real>(motion: &Motion<T>, links: &[InertialLink<T>], states: &mut [NavState<T>]) -> Option<()> {
    let world_from_first: UnitQuaternion<T> = world_from_specific_force(&-motion.gravity)?;
    let mut is_finite = true;
    walk(links, &motion.bias, |frame, node| {
        let Some(state) = states.get_mut(frame) else { return };
        *state = NavState {
            world_from_body: world_from_first * node.first_from_body,
            position_in_world: world_from_first * motion.position(node),
            velocity_in_world: world_from_first
                * (motion.velocity + motion.gravity * node.time_s + node.velocity + node.d_velocity_d_drift * motion.drift),
            bias: motion.bias,
        };
        is_finite &= state.is_finite();
    });
    is_finite.then_some(())
}
