//! One reading of the inertial measurement unit.

use nalgebra::Vector3;

use crate::real::Real;
use crate::storage::blank::blank;
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

blank!([T: Real] ImuSample<T> { stamp, gyro_rad_s, accel_m_s2 });

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

#[cfg(test)]
mod tests {
    use super::*;

    fn at(nanos: i64, value: f64) -> ImuSample<f64> {
        ImuSample {
            stamp: Timestamp::from_nanos(nanos),
            gyro_rad_s: Vector3::new(value, -value, 0.5),
            accel_m_s2: Vector3::new(2.0 * value, 0.0, 9.81),
        }
    }

    #[test]
    fn interpolation_is_linear_and_keeps_the_stamp() {
        let (earlier, later) = (at(1_000, 1.0), at(2_000, 3.0));
        for (nanos, value) in [(1_000, 1.0), (1_250, 1.5), (1_999, 2.998), (2_000, 3.0)] {
            let between = ImuSample::interpolate(&earlier, &later, Timestamp::from_nanos(nanos));
            assert_eq!(between.stamp.as_nanos(), nanos);
            assert!((between.gyro_rad_s - at(nanos, value).gyro_rad_s).norm() < 1e-15);
            assert!((between.accel_m_s2 - at(nanos, value).accel_m_s2).norm() < 1e-14);
        }
    }

    #[test]
    fn outside_the_nearer_sample_counts() {
        let (earlier, later) = (at(1_000, 1.0), at(2_000, 3.0));
        for (nanos, near) in [(0, &earlier), (i64::MIN, &earlier), (9_000, &later), (i64::MAX, &later)] {
            let outside = ImuSample::interpolate(&earlier, &later, Timestamp::from_nanos(nanos));
            assert_eq!((outside.gyro_rad_s, outside.accel_m_s2), (near.gyro_rad_s, near.accel_m_s2));
        }
    }

    #[test]
    fn samples_of_one_instant_or_in_wrong_order_give_the_earlier() {
        let (first, second) = (at(1_000, 1.0), at(1_000, 3.0));
        assert_eq!(ImuSample::interpolate(&first, &second, first.stamp), first);
        let (late, early) = (at(2_000, 1.0), at(1_000, 3.0));
        assert_eq!(ImuSample::interpolate(&late, &early, late.stamp), late);
    }

    #[test]
    fn finite_means_all_six() {
        assert!(at(0, 1.0).is_finite());
        for axis in 0..3 {
            let (mut gyro, mut accel) = (at(0, 1.0), at(0, 1.0));
            gyro.gyro_rad_s[axis] = f64::NAN;
            accel.accel_m_s2[axis] = f64::NEG_INFINITY;
            assert!(!gyro.is_finite() && !accel.is_finite());
        }
    }
}
