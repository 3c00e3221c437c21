//! Absolute trajectory error: how far the aligned estimate lies from the truth.

use libella_core::time::{Span, Timestamp};
use nalgebra::Isometry3;
use serde::Serialize;

use super::{Alignment, Trajectory};

/// An estimated pose and the truth at the same instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matched {
    /// When.
    pub stamp: Timestamp,
    /// The estimate, in its own world.
    pub estimate: Isometry3<f64>,
    /// The truth, interpolated.
    pub truth: Isometry3<f64>,
}

/// Pairs every estimated pose with the truth interpolated at its stamp; poses where there is no truth are left out.
#[must_use]
pub fn associate(estimate: &Trajectory, truth: &Trajectory, max_gap: Span) -> Vec<Matched> {
    let poses = estimate.poses().iter();
    poses
        .filter_map(|pose| Some(Matched { stamp: pose.stamp, estimate: pose.world_from_body, truth: truth.at(pose.stamp, max_gap)? }))
        .collect()
}

/// Distances between aligned estimate and truth, m.
#[must_use]
pub fn position_errors_m(pairs: &[Matched], alignment: &Alignment) -> Vec<f64> {
    let aligned = |pair: &Matched| (alignment.truth_from_estimate * pair.estimate).translation.vector;
    pairs.iter().map(|pair| (pair.truth.translation.vector - aligned(pair)).norm()).collect()
}

/// A sample in a few numbers, in the unit of the sample.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Statistics {
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

impl Statistics {
    /// Of the given values; `None` for none.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let count = sorted.len() as f64;
        Some(Self {
            rmse: (sorted.iter().map(|value| value * value).sum::<f64>() / count).sqrt(),
            mean: sorted.iter().sum::<f64>() / count,
            median: percentile(&sorted, 0.5)?,
            p95: percentile(&sorted, 0.95)?,
            max: *sorted.last()?,
        })
    }
}

/// Linear interpolation between the order statistics.
pub(crate) fn percentile(sorted: &[f64], fraction: f64) -> Option<f64> {
    let place = fraction * sorted.len().checked_sub(1)? as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let (low, high) = (*sorted.get(place.floor() as usize)?, *sorted.get(place.ceil() as usize)?);
    Some(low + (high - low) * place.fract())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_a_known_sample() {
        let found = Statistics::of(&[4.0, 1.0, 2.0, 3.0]).unwrap();
        assert_eq!((found.rmse, found.mean, found.median, found.max), (7.5_f64.sqrt(), 2.5, 2.5, 4.0));
        // 95 % of the way through three intervals: 0.85 into the last.
        assert!((found.p95 - 3.85).abs() < 1e-12);
        assert!(Statistics::of(&[]).is_none());
    }
}
