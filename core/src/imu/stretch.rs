//! The samples of a stretch of time become one integral.

use super::{ImuBias, ImuNoise, ImuSample, Preintegration};
use crate::real::Real;
use crate::storage::blank::blank;
use crate::time::{Span, Timestamp};

/// Longest time between two samples that still counts as continuous.
const LONGEST_INTERVAL: Span = Span::from_millis(40);
/// Over a gap the rate between two samples is a guess: noise in multiples of the usual.
const GAP_NOISE: f64 = 10.0;
/// A reading this near the end of the range counts as cut off, in shares of the range.
const SATURATED: f64 = 0.995;
/// What a reading that was cut off leaves unsaid, in multiples of the white noise.
const SATURATED_NOISE: f64 = 100.0;

/// The largest readings of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuRange<T> {
    /// Angular rate, rad/s.
    pub gyro_rad_s: T,
    /// Specific force, m/s².
    pub accel_m_s2: T,
}

blank!([T: Real] ImuRange<T> { gyro_rad_s, accel_m_s2 });

impl<T: Real> ImuRange<T> {
    /// Whether one of the readings is at the end of the range: the truth lies somewhere beyond.
    #[must_use]
    pub fn is_exceeded_by(&self, sample: &ImuSample<T>) -> bool {
        sample.gyro_rad_s.amax() >= self.gyro_rad_s * T::of(SATURATED) || sample.accel_m_s2.amax() >= self.accel_m_s2 * T::of(SATURATED)
    }
}

/// The part of the interval between two neighbouring samples that lies from `from` to `to`, its ends interpolated.
#[must_use]
pub fn clipped<T: Real>(a: &ImuSample<T>, b: &ImuSample<T>, from: Timestamp, to: Timestamp) -> Option<(ImuSample<T>, ImuSample<T>)> {
    if b.stamp <= from || a.stamp >= to {
        return None;
    }
    let start = if a.stamp < from { ImuSample::interpolate(a, b, from) } else { *a };
    let end = if b.stamp > to { ImuSample::interpolate(a, b, to) } else { *b };
    Some((start, end))
}

/// The integral over neighbouring pairs of samples, linearised at `bias`; pauses and readings at the end of the range are hardly trusted.
#[must_use]
pub fn integrate<T: Real>(
    pairs: impl Iterator<Item = (ImuSample<T>, ImuSample<T>)>,
    noise: &ImuNoise<T>,
    range: &ImuRange<T>,
    bias: ImuBias<T>,
) -> Preintegration<T> {
    let mut integral = Preintegration::new(bias);
    for (start, end) in pairs {
        extend(&mut integral, noise, range, &start, &end);
    }
    integral
}

// Out of line: the integral, a kilobyte, then stays in memory instead of being taken apart and put together again.
#[inline(never)]
fn extend<T: Real>(integral: &mut Preintegration<T>, noise: &ImuNoise<T>, range: &ImuRange<T>, start: &ImuSample<T>, end: &ImuSample<T>) {
    let is_gap = (end.stamp - start.stamp).as_nanos() > LONGEST_INTERVAL.as_nanos();
    let noise = if is_gap { &noise.scaled(T::of(GAP_NOISE)) } else { noise };
    let cut_off = range.is_exceeded_by(start) || range.is_exceeded_by(end);
    let noise = if cut_off { &noise.with_white_scaled(T::of(SATURATED_NOISE)) } else { noise };
    // Pairs come in order, each newer than the last, so none is refused.
    let _ = integral.integrate(noise, start, end);
}
