//! Every number that may be tuned, with its unit and default.

use crate::imu::ImuNoise;
use crate::real::Real;

/// Configuration of the estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorConfig<T: Real> {
    /// Noise densities of the inertial measurement unit.
    pub imu_noise: ImuNoise<T>,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: T,
    /// Standard deviation of a corner's position, px.
    pub sigma_px: T,
}

impl<T: Real> Default for EstimatorConfig<T> {
    fn default() -> Self {
        Self { imu_noise: ImuNoise::adis16448(), gravity_m_s2: T::of(9.81), sigma_px: T::of(1.0) }
    }
}
