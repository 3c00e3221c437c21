//! Inertial samples waiting for their image, and those of the window, for integrating anew.

use nalgebra::{UnitQuaternion, Vector3};

use super::InputError;
use crate::imu::{ImuBias, ImuNoise, ImuRange, ImuSample, Preintegration, stretch};
use crate::lie::so3;
use crate::real::Real;
use crate::storage::blank::blank;
use crate::storage::ring::Ring;
use crate::time::Timestamp;

/// The newest `SAMPLES` samples, oldest first.
#[derive(Debug)]
pub struct InertialHistory<T: Real, const SAMPLES: usize> {
    samples: Ring<ImuSample<T>, SAMPLES>,
    range: ImuRange<T>,
}

blank!([T: Real, const SAMPLES: usize] InertialHistory<T, SAMPLES> { samples, range });

impl<T: Real, const SAMPLES: usize> Default for InertialHistory<T, SAMPLES> {
    fn default() -> Self {
        let nothing = ImuSample { stamp: Timestamp::from_nanos(0), gyro_rad_s: Vector3::zeros(), accel_m_s2: Vector3::zeros() };
        Self { samples: Ring::filled_with(nothing), range: ImuRange { gyro_rad_s: T::of(1e30), accel_m_s2: T::of(1e30) } }
    }
}

impl<T: Real, const SAMPLES: usize> InertialHistory<T, SAMPLES> {
    /// The sensor's readings end at `gyro_rad_s` and `accel_m_s2`.
    pub fn set_range(&mut self, gyro_rad_s: T, accel_m_s2: T) {
        self.range = ImuRange { gyro_rad_s, accel_m_s2 };
    }

    /// Samples of an interval that are at the end of the range.
    #[must_use]
    pub fn saturated(&self, from: Timestamp, to: Timestamp) -> usize {
        self.samples.iter().filter(|sample| sample.stamp > from && sample.stamp <= to && self.range.is_exceeded_by(sample)).count()
    }

    /// Adds a sample; the oldest makes room once it lies before `integrated_until`.
    pub fn push(&mut self, sample: ImuSample<T>, integrated_until: Option<Timestamp>) -> Result<(), InputError> {
        if !sample.is_finite() {
            return Err(InputError::NotFinite(sample.stamp));
        }
        if let Some(last) = self.samples.last()
            && sample.stamp <= last.stamp
        {
            return Err(InputError::Stale(last.stamp - sample.stamp));
        }
        if self.samples.is_full() {
            // The second-oldest has to cover the start of what is still to be integrated.
            let second = self.samples.get(1).map(|sample| sample.stamp);
            let free = match (second, integrated_until) {
                (Some(second), Some(until)) => second <= until,
                _ => true,
            };
            if !free {
                return Err(InputError::Full);
            }
            self.samples.pop();
        }
        self.samples.push(sample).map_err(|_| InputError::Full)
    }

    /// Whether samples reach from `from` to `to`.
    #[must_use]
    pub fn covers(&self, from: Timestamp, to: Timestamp) -> bool {
        match (self.samples.first(), self.samples.last()) {
            (Some(first), Some(last)) => first.stamp <= from && last.stamp >= to,
            _ => false,
        }
    }

    /// Samples after `from`, up to `to`.
    #[must_use]
    pub fn count(&self, from: Timestamp, to: Timestamp) -> usize {
        self.samples.iter().filter(|sample| sample.stamp > from && sample.stamp <= to).count()
    }

    /// The samples of an interval, side by side.
    pub fn between(&mut self, from: Timestamp, to: Timestamp) -> &[ImuSample<T>] {
        let all: &[ImuSample<T>] = self.samples.make_contiguous();
        let first = all.partition_point(|sample| sample.stamp < from);
        let end = all.partition_point(|sample| sample.stamp <= to);
        all.get(first..end).unwrap_or(&[])
    }

    /// Samples of the closed interval, those at its ends interpolated, in neighbouring pairs.
    pub fn pairs(&self, from: Timestamp, to: Timestamp) -> impl Iterator<Item = (ImuSample<T>, ImuSample<T>)> + '_ {
        self.samples.iter().zip(self.samples.iter().skip(1)).filter_map(move |(a, b)| stretch::clipped(a, b, from, to))
    }

    /// The integral over an interval, linearised at `bias`; empty where samples are missing.
    #[must_use]
    pub fn integrate(&self, noise: &ImuNoise<T>, bias: ImuBias<T>, from: Timestamp, to: Timestamp) -> Preintegration<T> {
        stretch::integrate(self.pairs(from, to), noise, &self.range, bias)
    }

    /// The rotation over an interval as the gyro saw it, `R_from←to`, as far as samples reach.
    #[must_use]
    pub fn rotation(&self, gyro_bias_rad_s: &Vector3<T>, from: Timestamp, to: Timestamp) -> UnitQuaternion<T> {
        let mut rotation = UnitQuaternion::identity();
        for (start, end) in self.pairs(from, to) {
            let rate = (start.gyro_rad_s + end.gyro_rad_s) * T::of(0.5) - gyro_bias_rad_s;
            rotation *= so3::exp(&(rate * (end.stamp - start.stamp).as_seconds::<T>()));
        }
        rotation
    }
}
