//! Preintegration on the manifold.

use core::fmt;

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

use super::{ImuBias, ImuNoise, ImuSample};
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
            Self::Stale(by) => write!(f, "IMU sample is older than the one before it by {by}"),
        }
    }
}

impl core::error::Error for PreintegrationError {}

/// The integral (skeleton, filled by its owner).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preintegration<T: Real> {
    span_s: T,
    bias: ImuBias<T>,
    rotation: UnitQuaternion<T>,
    velocity: Vector3<T>,
    position: Vector3<T>,
    d_rotation_d_gyro: Matrix3<T>,
}

impl<T: Real> Preintegration<T> {
    /// An empty integral, linearised at `bias`.
    #[must_use]
    pub fn new(bias: ImuBias<T>) -> Self {
        Self {
            span_s: T::ZERO,
            bias,
            rotation: UnitQuaternion::identity(),
            velocity: Vector3::zeros(),
            position: Vector3::zeros(),
            d_rotation_d_gyro: Matrix3::zeros(),
        }
    }

    /// Adds the interval between two neighbouring samples (midpoint rule).
    ///
    /// # Errors
    /// `Stale` when `to` is not newer than `from`.
    pub fn integrate(&mut self, _noise: &ImuNoise<T>, _from: &ImuSample<T>, _to: &ImuSample<T>) -> Result<(), PreintegrationError> {
        Ok(())
    }

    /// Appends an integral that starts where this one ends; its deltas are first moved to this one's bias.
    pub fn append(&mut self, _later: &Self) {}

    /// Length in seconds.
    pub fn span_s(&self) -> T {
        self.span_s
    }

    /// The bias at which it was linearised.
    pub fn bias(&self) -> &ImuBias<T> {
        &self.bias
    }

    /// `(ΔR, Δv, Δp)` with the first-order correction for `bias`.
    pub fn corrected(&self, _bias: &ImuBias<T>) -> (UnitQuaternion<T>, Vector3<T>, Vector3<T>) {
        (self.rotation, self.velocity, self.position)
    }

    /// `∂Log ΔR/∂b_g` (right perturbation of ΔR), 3×3.
    pub fn d_rotation_d_gyro(&self) -> &Matrix3<T> {
        &self.d_rotation_d_gyro
    }

    /// Covariance of `[δφ δp δv δb_g δb_a]`, 15×15.
    pub fn covariance(&self) -> SMatrix<T, 15, 15> {
        SMatrix::zeros()
    }
}
