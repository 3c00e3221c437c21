//! Inertial samples waiting for their image, and those of the window, for integrating anew.

use nalgebra::{UnitQuaternion, Vector3};

use super::InputError;
use crate::imu::{ImuBias, ImuNoise, ImuSample, Preintegration};
use crate::lie::so3;
use crate::real::Real;
use crate::storage::blank::blank;
use crate::storage::ring::Ring;
use crate::time::{Span, Timestamp};

/// Longest time between two samples that still counts as continuous.
const LONGEST_INTERVAL: Span = Span::from_millis(40);

/// A reading this near the end of the range counts as cut off, in shares of the range.
const SATURATED: f64 = 0.995;
/// What a reading that was cut off leaves unsaid, in multiples of the white noise.
const SATURATED_NOISE: f64 = 100.0;

/// The newest `SAMPLES` samples, oldest first.
#[derive(Debug)]
pub struct InertialHistory<T: Real, const SAMPLES: usize> {
    samples: Ring<ImuSample<T>, SAMPLES>,
    /// Largest readings of the gyro (rad/s) and the accelerometer (m/s²).
    range: (T, T),
}

blank!([T: Real, const SAMPLES: usize] InertialHistory<T, SAMPLES> { samples, range });

impl<T: Real, const SAMPLES: usize> Default for InertialHistory<T, SAMPLES> {
    fn default() -> Self {
        let nothing = ImuSample { stamp: Timestamp::from_nanos(0), gyro_rad_s: Vector3::zeros(), accel_m_s2: Vector3::zeros() };
        Self { samples: Ring::filled_with(nothing), range: (T::of(1e30), T::of(1e30)) }
    }
}

impl<T: Real, const SAMPLES: usize> InertialHistory<T, SAMPLES> {
    /// The sensor's readings end at `gyro_rad_s` and `accel_m_s2`.
    pub fn set_range(&mut self, gyro_rad_s: T, accel_m_s2: T) {
        self.range = (gyro_rad_s, accel_m_s2);
    }

    /// Whether one of the readings is at the end of its range: the truth lies somewhere beyond.
    fn is_saturated(&self, sample: &ImuSample<T>) -> bool {
        sample.gyro_rad_s.amax() >= self.range.0 * T::of(SATURATED) || sample.accel_m_s2.amax() >= self.range.1 * T::of(SATURATED)
    }

    /// Samples of an interval that are at the end of the range.
    #[must_use]
    pub fn saturated(&self, from: Timestamp, to: Timestamp) -> usize {
        self.samples.iter().filter(|sample| sample.stamp > from && sample.stamp <= to && self.is_saturated(sample)).count()
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
            let cut_off = self.is_saturated(&start) || self.is_saturated(&end);
            let noise = if cut_off { &noise.with_white_scaled(T::of(SATURATED_NOISE)) } else { noise };
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
