//! One reading of the inertial measurement unit.

use nalgebra::Vector3;

use crate::real::Real;
use crate::time::Timestamp;

/// A raw reading in the body frame, biases included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample<T: Real> {
    /// When it was taken.
    pub stamp: Timestamp,
    /// Angular rate of the body, rad/s.
    pub gyro_rad_s: Vector3<T>,
    /// Specific force on the body, m/s² (at rest: 9.81 upwards).
    pub accel_m_s2: Vector3<T>,
}

impl<T: Real> ImuSample<T> {
    /// The reading at `stamp`, interpolated linearly between two samples; outside of them the nearer one.
    #[must_use]
    pub fn interpolate(earlier: &Self, later: &Self, stamp: Timestamp) -> Self {
        let whole = (later.stamp - earlier.stamp).as_nanos();
        let part = (stamp - earlier.stamp).as_nanos().clamp(0, whole.max(0));
        #[allow(clippy::cast_precision_loss)]
        let ratio = if whole > 0 { T::of(part as f64 / whole as f64) } else { T::ZERO };
        Self {
            stamp,
            gyro_rad_s: earlier.gyro_rad_s.lerp(&later.gyro_rad_s, ratio),
            accel_m_s2: earlier.accel_m_s2.lerp(&later.accel_m_s2, ratio),
        }
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.gyro_rad_s.iter().chain(self.accel_m_s2.iter()).all(|value| value.is_usable())
    }
}
