//! Preintegration on the manifold.
//!
//! # Model
//! Between two instants i and j, in the frame of the body at i and without gravity,
//! ```text
//! ΔR = R_iᵀ R_j     Δv = R_iᵀ (v_j − v_i − g t)     Δp = R_iᵀ (p_j − p_i − v_i t − g t²/2)
//! ```
//! integrated by the midpoint rule: the rate and the specific force are the means of two neighbouring samples, the force is
//! turned by the attitude at the middle, so the error falls with the square of the interval:
//! ```text
//! M = ΔR Exp(ω Δt/2)    ΔR ← ΔR Exp(ω Δt)    Δp ← Δp + Δv Δt + M a Δt²/2    Δv ← Δv + M a Δt
//! ```
//! Errors and bias Jacobians live in the start frame (rotation on the LEFT of ΔR) while integrating (`covariance.rs` says why); the public
//! face is the perturbation used everywhere, on the right: `φ = ΔRᵀ θ`.
//!
//! # Bias
//! All is linearised at one bias. [`Preintegration::corrected`] moves the deltas to first order; once the bias has moved too far
//! ([`Preintegration::bias_is_beyond`]), integrate the stored samples anew.
//!
//! # Reference
//! Forster, Carlone, Dellaert, Scaramuzza, "On-Manifold Preintegration for Real-Time Visual-Inertial Odometry", TRO 2017.

use core::fmt;

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

use super::covariance::{ErrorCovariance, Transition, transition};
use super::interval::Interval;
use super::{ImuBias, ImuNoise, ImuSample, NavState};
use crate::lie::matrix::{of_rotation, product, sum};
use crate::lie::so3;
use crate::real::Real;
use crate::time::Span;

/// Why a sample was refused. The integral is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PreintegrationError {
    /// The second sample is not newer than the first; the difference is given.
    Stale(Span),
}

impl fmt::Display for PreintegrationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stale(by) => write!(f, "IMU sample is not newer than the one before it: difference {by}"),
        }
    }
}

impl core::error::Error for PreintegrationError {}

/// The integral of the samples between two instants, with its covariance and bias Jacobians.
///
/// # Example
/// ```
/// # use libella_core::imu::{ImuBias, ImuNoise, ImuSample, NavState, Preintegration};
/// # use libella_core::time::Timestamp;
/// # use nalgebra::Vector3;
/// let reading = |nanos| ImuSample {
///     stamp: Timestamp::from_nanos(nanos),
///     gyro_rad_s: Vector3::zeros(),
///     accel_m_s2: Vector3::new(1.0, 0.0, 9.81), // level, speeding up
/// };
/// let mut integral = Preintegration::<f64>::new(ImuBias::default());
/// integral.integrate(&ImuNoise::adis16448(), &reading(0), &reading(5_000_000))?;
/// let later = integral.predict(&NavState::origin(), &Vector3::new(0.0, 0.0, -9.81));
/// assert!((later.velocity_in_world - Vector3::new(0.005, 0.0, 0.0)).norm() < 1e-12);
/// # Ok::<(), libella_core::imu::PreintegrationError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preintegration<T: Real> {
    span: Span,
    bias: ImuBias<T>,
    rotation: UnitQuaternion<T>,
    velocity: Vector3<T>,
    position: Vector3<T>,
    /// `∂θ/∂b_g`, rotation on the left.
    d_theta_d_gyro: Matrix3<T>,
    /// `ΔRᵀ ∂θ/∂b_g`, the same on the right.
    d_rotation_d_gyro: Matrix3<T>,
    d_velocity_d_gyro: Matrix3<T>,
    d_velocity_d_accel: Matrix3<T>,
    d_position_d_gyro: Matrix3<T>,
    d_position_d_accel: Matrix3<T>,
    error: ErrorCovariance<T>,
}

impl<T: Real> Preintegration<T> {
    /// An empty integral, linearised at `bias`.
    #[must_use]
    pub fn new(bias: ImuBias<T>) -> Self {
        Self {
            span: Span::default(),
            bias,
            rotation: UnitQuaternion::identity(),
            velocity: Vector3::zeros(),
            position: Vector3::zeros(),
            d_theta_d_gyro: Matrix3::zeros(),
            d_rotation_d_gyro: Matrix3::zeros(),
            d_velocity_d_gyro: Matrix3::zeros(),
            d_velocity_d_accel: Matrix3::zeros(),
            d_position_d_gyro: Matrix3::zeros(),
            d_position_d_accel: Matrix3::zeros(),
            error: ErrorCovariance::zero(),
        }
    }

    /// Adds the interval between two neighbouring samples (midpoint rule). Readings that are not finite make the integral so.
    ///
    /// # Errors
    /// `Stale` when `to` is not newer than `from`.
    pub fn integrate(&mut self, noise: &ImuNoise<T>, from: &ImuSample<T>, to: &ImuSample<T>) -> Result<(), PreintegrationError> {
        let interval = to.stamp - from.stamp;
        if interval <= Span::default() {
            return Err(PreintegrationError::Stale(interval));
        }
        let dt = interval.as_seconds::<T>();
        let half = T::of(0.5);
        let phi = ((from.gyro_rad_s + to.gyro_rad_s) * half - self.bias.gyro_rad_s) * dt;
        let force = (from.accel_m_s2 + to.accel_m_s2) * half - self.bias.accel_m_s2;

        let turn = Interval::new(&phi);
        let mid = self.rotation * turn.half;
        let mid_matrix = *mid.to_rotation_matrix().matrix();
        let gain = mid_matrix * force * dt;
        let (end_by_gyro, mid_by_gyro) = turn.bias_to_rotation(&phi, &mid_matrix);
        let step = Transition { dt, velocity_gain: gain, rotation_by_gyro: end_by_gyro * -dt, velocity_by_accel: mid_matrix * -dt };
        self.error.propagate(&step, noise);

        // Jacobians: v' = v − [u]× (θ + Aₘ b_g) + C b_a, p' = p + Δt/2 (v + v')
        let half_dt = dt * half;
        let bent = self.d_theta_d_gyro - mid_by_gyro * half_dt;
        let velocity_step = -(so3::hat(&gain) * bent);
        self.d_position_d_gyro += self.d_velocity_d_gyro * dt + velocity_step * half_dt;
        self.d_position_d_accel += self.d_velocity_d_accel * dt + step.velocity_by_accel * half_dt;
        self.d_velocity_d_gyro += velocity_step;
        self.d_velocity_d_accel += step.velocity_by_accel;
        self.d_theta_d_gyro += step.rotation_by_gyro;

        self.position += self.velocity * dt + gain * half_dt;
        self.velocity += gain;
        self.rotation = mid * turn.half;
        self.rotation.renormalize_fast();
        self.d_rotation_d_gyro = self.end_from_start() * self.d_theta_d_gyro;
        self.span = self.span + interval;
        Ok(())
    }

    /// Appends an integral that starts where this one ends; its deltas are first moved to this one's bias, to first order.
    ///
    /// Exact where the two biases agree: covariance and Jacobians are those of one long integration.
    pub fn append(&mut self, later: &Self) {
        let (later_rotation, later_velocity, later_position) = later.corrected(&self.bias);
        let turn = of_rotation(&self.rotation);
        let span = later.span_s();
        let velocity = turn * later_velocity;
        let position = turn * later_position;
        let d_theta = product(&turn, &later.d_theta_d_gyro);
        let d_velocity = [product(&turn, &later.d_velocity_d_gyro), product(&turn, &later.d_velocity_d_accel)];
        let d_position = [product(&turn, &later.d_position_d_gyro), product(&turn, &later.d_position_d_accel)];
        let carry = transition(span, [&velocity, &position], &d_theta, [&d_position[0], &d_position[1]], [&d_velocity[0], &d_velocity[1]]);
        self.error = self.error.compose(&carry, &turn, &later.error);

        let add = |to: &mut Matrix3<T>, what: &Matrix3<T>| *to = sum(to, what);
        let turned = |delta: &Vector3<T>| product(&so3::hat(delta), &self.d_theta_d_gyro);
        let (by_position, by_velocity) = (turned(&position), turned(&velocity));
        add(&mut self.d_position_d_gyro, &sum(&(self.d_velocity_d_gyro * span - by_position), &d_position[0]));
        add(&mut self.d_position_d_accel, &sum(&(self.d_velocity_d_accel * span), &d_position[1]));
        add(&mut self.d_velocity_d_gyro, &(d_velocity[0] - by_velocity));
        add(&mut self.d_velocity_d_accel, &d_velocity[1]);
        add(&mut self.d_theta_d_gyro, &d_theta);

        self.position += self.velocity * span + position;
        self.velocity += velocity;
        self.rotation *= later_rotation;
        self.rotation.renormalize_fast();
        self.d_rotation_d_gyro = self.end_from_start() * self.d_theta_d_gyro;
        self.span = self.span + later.span;
    }

    /// Length, exact.
    #[must_use]
    pub fn span(&self) -> Span {
        self.span
    }

    /// Length in seconds.
    #[must_use]
    pub fn span_s(&self) -> T {
        self.span.as_seconds()
    }

    /// The bias at which it was linearised.
    #[must_use]
    pub fn bias(&self) -> &ImuBias<T> {
        &self.bias
    }

    /// `(ΔR, Δv, Δp)` with the first-order correction for `bias`; m/s and m in the start frame.
    ///
    /// `ΔR(b) = Exp(J_θ δb) ΔR = ΔR Exp(ΔRᵀ J_θ δb)`.
    #[must_use]
    pub fn corrected(&self, bias: &ImuBias<T>) -> (UnitQuaternion<T>, Vector3<T>, Vector3<T>) {
        let gyro = bias.gyro_rad_s - self.bias.gyro_rad_s;
        let accel = bias.accel_m_s2 - self.bias.accel_m_s2;
        (
            so3::exp(&(self.d_theta_d_gyro * gyro)) * self.rotation,
            self.velocity + self.d_velocity_d_gyro * gyro + self.d_velocity_d_accel * accel,
            self.position + self.d_position_d_gyro * gyro + self.d_position_d_accel * accel,
        )
    }

    /// Whether `bias` lies farther from the linearisation than the given distances (rad/s, m/s²), so that the first-order correction
    /// should give way to integrating anew. A bias that is not finite counts as beyond.
    #[must_use]
    pub fn bias_is_beyond(&self, bias: &ImuBias<T>, gyro_rad_s: T, accel_m_s2: T) -> bool {
        let near = |a: &Vector3<T>, b: &Vector3<T>, limit: T| (a - b).norm_squared() <= limit * limit;
        !(near(&bias.gyro_rad_s, &self.bias.gyro_rad_s, gyro_rad_s) && near(&bias.accel_m_s2, &self.bias.accel_m_s2, accel_m_s2))
    }

    /// The state at the end, from the one at the start, whose bias it takes over; gravity as `(0, 0, −9.81)` in a world with z up.
    #[must_use]
    pub fn predict(&self, state: &NavState<T>, gravity_in_world: &Vector3<T>) -> NavState<T> {
        let (rotation, velocity, position) = self.corrected(&state.bias);
        let span = self.span_s();
        let fall = gravity_in_world * span;
        NavState {
            world_from_body: state.world_from_body * rotation,
            position_in_world: state.position_in_world
                + (state.velocity_in_world + fall * T::of(0.5)) * span
                + state.world_from_body * position,
            velocity_in_world: state.velocity_in_world + fall + state.world_from_body * velocity,
            bias: state.bias,
        }
    }

    /// `∂Log ΔR/∂b_g` (right perturbation of ΔR), 3×3.
    #[must_use]
    pub fn d_rotation_d_gyro(&self) -> &Matrix3<T> {
        &self.d_rotation_d_gyro
    }

    /// `∂θ/∂b_g` (left perturbation of ΔR, that is in the start frame), 3×3.
    #[must_use]
    pub fn d_theta_d_gyro(&self) -> &Matrix3<T> {
        &self.d_theta_d_gyro
    }

    /// `∂Δv/∂b_g`, 3×3, m/s per rad/s.
    #[must_use]
    pub fn d_velocity_d_gyro(&self) -> &Matrix3<T> {
        &self.d_velocity_d_gyro
    }

    /// `∂Δv/∂b_a`, 3×3, m/s per m/s².
    #[must_use]
    pub fn d_velocity_d_accel(&self) -> &Matrix3<T> {
        &self.d_velocity_d_accel
    }

    /// `∂Δp/∂b_g`, 3×3, m per rad/s.
    #[must_use]
    pub fn d_position_d_gyro(&self) -> &Matrix3<T> {
        &self.d_position_d_gyro
    }

    /// `∂Δp/∂b_a`, 3×3, m per m/s².
    #[must_use]
    pub fn d_position_d_accel(&self) -> &Matrix3<T> {
        &self.d_position_d_accel
    }

    /// Covariance of `[δφ δp δv δb_g δb_a]`, true minus integrated, 15×15; rotation on the right, the biases' share is the random walk alone.
    #[must_use]
    pub fn covariance(&self) -> SMatrix<T, 15, 15> {
        self.error.dense(&self.end_from_start())
    }

    fn end_from_start(&self) -> Matrix3<T> {
        self.rotation.to_rotation_matrix().matrix().transpose()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
