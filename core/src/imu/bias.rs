//! The slowly varying offsets of an inertial measurement unit.

use nalgebra::Vector3;

use crate::real::Real;
use crate::storage::blank::blank;

/// What has to be subtracted from a raw reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuBias<T: Real> {
    /// Offset of the angular rate, rad/s.
    pub gyro_rad_s: Vector3<T>,
    /// Offset of the specific force, m/s².
    pub accel_m_s2: Vector3<T>,
}

blank!([T: Real] ImuBias<T> { gyro_rad_s, accel_m_s2 });

impl<T: Real> Default for ImuBias<T> {
    fn default() -> Self {
        Self { gyro_rad_s: Vector3::zeros(), accel_m_s2: Vector3::zeros() }
    }
}
