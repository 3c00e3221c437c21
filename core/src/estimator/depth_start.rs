//! The start in motion with depths given: metric at once.
//!
//! # Model
//! Attitude comes from the mean specific force and the gyro, so that gravity can be taken off; what is missing is the first velocity `v`
//! and the bias `b` of the gyro. A landmark of the oldest frame with its given depth is a point `X` in world; frame `j`, `Δt` later, is
//! at `p_j + v Δt` with `p_j` integrated from rest, and turned by `b Δt` less than the gyro says. Its camera sees `X` at `(x, y)`:
//! ```text
//! Y = R_CB R_jᵀ (X − c_j)      Z = Y − R_CB R_jᵀ Δt v − [Y]× R_CB Δt b
//! Z_x − x Z_z = 0,   likewise for y                                     two rows a corner, linear in v and b
//! ```
//! Rows are divided by the depth `Y_z`. The window's solver then finds tilt, velocities, biases and depths together, with the depths as
//! priors; the same checks as for the start without depth decide whether that means anything.

use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{Estimator, StepBudget, Waiting};
use crate::imu::NavState;
use crate::init::world_from_specific_force;
use crate::lie::matrix::{of_rotation, product};
use crate::lie::so3::{self, hat};
use crate::real::Real;
use crate::window::{CameraPose, DepthSource, Frame, Landmark};

/// Landmarks with a given depth that the first and the last frame see, at least.
const LEAST_GIVEN: usize = 20;
/// Where a corner's residual begins to count less, on the plane `z = 1`: a depth that is wrong by a fifth at 1 m/s after 0.2 s.
const ROBUST: f64 = 0.02;
/// Weight on the square of the gyro bias (rad/s)² beside those of residuals on the plane `z = 1`: a corner's noise over 0.1 rad/s.
const BIAS_WEIGHT: f64 = 1e-4;
/// Share of the motion of the corners, rotation apart, that given depths may leave unexplained: 0.15 with depths good to that share, about
/// 0.7 with any.
const MOST_UNEXPLAINED: f64 = 0.4;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    pub(super) fn begin_with_depth(&mut self, budget: StepBudget) -> Result<(), Waiting> {
        let frames = self.window.frames.as_slice();
        let [first, .., last] = frames else { return Err(Waiting::Tracks) };
        let span_s = (last.stamp - first.stamp).as_seconds::<T>();
        // A body at rest starts from rest, which tells more.
        let moves = self.stillness.lasted_s(last.stamp) == T::ZERO;
        if frames.len() < 3 || span_s < self.config.depth.shortest_start_s || !moves {
            return Err(Waiting::Tracks);
        }
        let newest = frames.len() - 1;
        let usable = |landmark: &&Landmark<T, FRAMES>| {
            landmark.anchor() == 0 && landmark.is_seen_in(newest) && landmark.depth_source == DepthSource::Given
        };
        if self.window.landmarks.iter().filter(usable).count() < LEAST_GIVEN {
            return Err(Waiting::Tracks);
        }
        let Some(mut origin) = self.upright(frames) else { return Err(Waiting::Gravity) };
        let mut states = [NavState::origin(); FRAMES];
        chain(&mut states, origin, frames, &self.settings.gravity_in_world);
        let given = self.window.landmarks.iter().filter(usable);
        let Some((velocity, gyro_bias)) = first_motion(given, frames, &states[..frames.len()], &self.settings.body_from_camera) else {
            return Err(Waiting::Tracks);
        };
        origin.velocity_in_world = velocity;
        origin.bias.gyro_rad_s = gyro_bias;
        self.integrate_at(origin.bias);
        chain(&mut states, origin, &self.window.frames, &self.settings.gravity_in_world);
        for (frame, state) in self.window.frames.iter_mut().zip(&states) {
            frame.state = *state;
        }
        self.settle_start(budget)
    }

    /// Level with the mean specific force of the window, at rest in the origin.
    fn upright(&self, frames: &[Frame<T>]) -> Option<NavState<T>> {
        let (first, last) = (frames.first()?, frames.last()?);
        let (mut force, mut count, mut turned) = (Vector3::zeros(), T::ZERO, UnitQuaternion::identity());
        for (sample, next) in self.inertial.pairs(first.stamp, last.stamp) {
            force += turned * sample.accel_m_s2;
            count += T::one();
            turned *= so3::exp(&(sample.gyro_rad_s * (next.stamp - sample.stamp).as_seconds::<T>()));
        }
        if count == T::ZERO {
            return None;
        }
        let up = force / count;
        // Far from gravity it is not the vertical that was measured.
        if (up.norm() - self.config.gravity_m_s2).abs() > self.config.gravity_m_s2 * T::of(0.3) {
            return None;
        }
        let world_from_body = world_from_specific_force(&up)?;
        Some(NavState { world_from_body, ..NavState::origin() })
    }
}

/// The states of all frames, integrated from the first.
fn chain<T: Real>(states: &mut [NavState<T>], origin: NavState<T>, frames: &[Frame<T>], gravity_in_world: &Vector3<T>) {
    let mut state = origin;
    for (i, (out, frame)) in states.iter_mut().zip(frames).enumerate() {
        if i > 0 {
            state = frame.from_previous.predict(&state, gravity_in_world);
        }
        *out = state;
    }
}

/// The velocity of the first frame, in world, and the bias of the gyro, by robust linear least squares over all corners of landmarks with
/// a given depth; `None` where they do not explain how the corners move.
fn first_motion<'a, T: Real, const FRAMES: usize>(
    landmarks: impl Iterator<Item = &'a Landmark<T, FRAMES>> + Clone,
    frames: &[Frame<T>],
    from_rest: &[NavState<T>],
    body_from_camera: &Isometry3<T>,
) -> Option<(Vector3<T>, Vector3<T>)> {
    let camera_from_body = of_rotation(&body_from_camera.rotation.inverse());
    let mut cameras = [CameraPose::default(); FRAMES];
    for (camera, state) in cameras.iter_mut().zip(from_rest) {
        *camera = CameraPose::of(state, body_from_camera);
    }
    let anchor = &cameras[0];
    let mut found = SVector::<T, 6>::zeros();
    let (mut motion, mut unexplained) = (T::ZERO, T::ZERO);
    for pass in 0..4 {
        // Biases are small: without parallax nothing else tells them from a motion.
        let mut normal = SMatrix::<T, 6, 6>::from_diagonal(&SVector::from_fn(|i, _| T::of(if i < 3 { 0.0 } else { BIAS_WEIGHT })));
        let mut right = SVector::<T, 6>::zeros();
        (motion, unexplained) = (T::ZERO, T::ZERO);
        for landmark in landmarks.clone() {
            let ray = anchor.world_from_camera * landmark.direction();
            let point = anchor.center_in_world + ray / landmark.given.inverse_depth;
            for (frame, seen) in landmark.seen().filter(|(frame, _)| *frame > 0) {
                let (camera, at) = (cameras.get(frame)?, frames.get(frame)?);
                let seconds = (at.stamp - frames[0].stamp).as_seconds::<T>();
                let camera_from_world = camera.world_from_camera.transpose();
                let y = camera_from_world * (point - camera.center_in_world);
                if y.z < T::of(0.05) {
                    continue;
                }
                let (by_velocity, by_bias) = (camera_from_world * seconds, product(&hat(&y), &camera_from_body) * seconds);
                for (axis, coordinate) in [seen.x, seen.y].into_iter().enumerate() {
                    let slope = |by: &Matrix3<T>| (by.row(axis) - by.row(2) * coordinate).transpose() / y.z;
                    let (by_velocity, by_bias) = (slope(&by_velocity), slope(&by_bias));
                    let row = SVector::<T, 6>::from_fn(|i, _| if i < 3 { by_velocity[i] } else { by_bias[i - 3] });
                    let value = (y[axis] - coordinate * y.z) / y.z;
                    let residual = (value - row.dot(&found)).abs();
                    let weight = if pass == 0 { T::one() } else { (T::of(ROBUST) / residual.max(T::of(1e-9))).min(T::one()) };
                    motion += (value - by_bias.dot(&found.fixed_rows::<3>(3))).abs();
                    unexplained += residual;
                    for (column, at) in row.iter().enumerate() {
                        let mut sums = normal.column_mut(column);
                        sums += row * *at * weight;
                    }
                    right += row * (value * weight);
                }
            }
        }
        found = normal.cholesky()?.solve(&right);
    }
    if unexplained < motion * T::of(MOST_UNEXPLAINED) && found.iter().all(|value| value.is_usable()) {
        Some((found.fixed_rows::<3>(0).into_owned(), found.fixed_rows::<3>(3).into_owned()))
    } else {
        None
    }
}
