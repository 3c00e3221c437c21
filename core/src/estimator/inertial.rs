//! Inertial samples waiting for their image, and those of the window, for integrating anew.

use nalgebra::{UnitQuaternion, Vector3};

use super::InputError;
use crate::imu::{ImuBias, ImuNoise, ImuSample, Preintegration};
use crate::lie::so3;
use crate::real::Real;
use crate::storage::ring::Ring;
use crate::time::{Span, Timestamp};

/// Longest time between two samples that still counts as continuous.
const LONGEST_INTERVAL: Span = Span::from_millis(40);

/// The newest `SAMPLES` samples, oldest first.
#[derive(Debug)]
pub struct InertialHistory<T: Real, const SAMPLES: usize> {
    samples: Ring<ImuSample<T>, SAMPLES>,
}

impl<T: Real, const SAMPLES: usize> Default for InertialHistory<T, SAMPLES> {
    fn default() -> Self {
        let nothing = ImuSample { stamp: Timestamp::from_nanos(0), gyro_rad_s: Vector3::zeros(), accel_m_s2: Vector3::zeros() };
        Self { samples: Ring::filled_with(nothing) }
    }
}

impl<T: Real, const SAMPLES: usize> InertialHistory<T, SAMPLES> {
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

    /// The samples of an interval, side by side.
    pub fn between(&mut self, from: Timestamp, to: Timestamp) -> &[ImuSample<T>] {
        let all: &[ImuSample<T>] = self.samples.make_contiguous();
        let first = all.partition_point(|sample| sample.stamp < from);
        let end = all.partition_point(|sample| sample.stamp <= to);
        all.get(first..end).unwrap_or(&[])
    }

    /// Samples of the closed interval, those at its ends interpolated, in neighbouring pairs.
    pub fn pairs(&self, from: Timestamp, to: Timestamp) -> impl Iterator<Item = (ImuSample<T>, ImuSample<T>)> + '_ {
        self.samples.iter().zip(self.samples.iter().skip(1)).filter(move |(a, b)| b.stamp > from && a.stamp < to).map(move |(a, b)| {
            let start = if a.stamp < from { ImuSample::interpolate(a, b, from) } else { *a };
            let end = if b.stamp > to { ImuSample::interpolate(a, b, to) } else { *b };
            (start, end)
        })
    }

    /// The integral over an interval, linearised at `bias`; empty where samples are missing.
    #[must_use]
    pub fn integrate(&self, noise: &ImuNoise<T>, bias: ImuBias<T>, from: Timestamp, to: Timestamp) -> Preintegration<T> {
        let mut integral = Preintegration::new(bias);
        for (start, end) in self.pairs(from, to) {
            // Over a gap the rate between two samples is a guess: ten times the noise.
            let is_gap = (end.stamp - start.stamp).as_nanos() > LONGEST_INTERVAL.as_nanos();
            let noise = if is_gap { &noise.scaled(T::of(10.0)) } else { noise };
            // Pairs come in order, each newer than the last, so none is refused.
            let _ = integral.integrate(noise, &start, &end);
        }
        integral
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
