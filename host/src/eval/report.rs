//! All error figures of a trajectory at once.

use libella_core::time::Span;
use nalgebra::Isometry3;
use serde::Serialize;

use super::{RelativeError, Statistics, Trajectory, align, associate, metric_from, position_errors_m, relative_errors};
use crate::config::EvaluationSection;
use crate::fault::{Fault, FaultKind};

/// The error of a trajectory.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Estimated poses that have a truth to compare with.
    pub matched_poses: usize,
    /// Estimated poses that have none.
    pub unmatched_poses: usize,
    /// Length of the true path over the matched poses, m.
    pub path_length_m: f64,
    /// Position error after alignment by a rigid transform, RMSE, m.
    pub ate_rmse_m: f64,
    /// The same error in more numbers, m.
    pub ate_m: Statistics,
    /// The factor on the estimate that would have fitted best.
    pub scale: f64,
    /// `100 |scale − 1|`.
    pub scale_error_percent: f64,
    /// The pose from which on the scale of every stretch of 2 s is right within 10 %, ns; see [`metric_from`].
    pub metric_from_ns: Option<i64>,
    /// Relative errors over several distances.
    pub rpe: Vec<RelativeError>,
    /// Error of each matched pose: stamp (ns) and distance (m).
    #[serde(skip)]
    pub errors: Vec<(i64, f64)>,
    /// The rigid transform that was applied.
    #[serde(skip)]
    pub truth_from_estimate: Isometry3<f64>,
}

/// Compares an estimate with the truth.
///
/// # Errors
/// When the two share no time.
pub fn evaluate(estimate: &Trajectory, truth: &Trajectory, options: &EvaluationSection) -> Result<Evaluation, Fault> {
    #[allow(clippy::cast_possible_truncation)]
    let pairs = associate(estimate, truth, Span::from_nanos((options.max_truth_gap_s * 1e9) as i64));
    let positions: Vec<_> = pairs.iter().map(|pair| (pair.estimate.translation.vector, pair.truth.translation.vector)).collect();
    let nothing = || Fault::new(FaultKind::NoResult, "estimate and truth share no time", "check that both use the same clock and unit");
    let alignment = align(&positions).ok_or_else(nothing)?;
    let errors_m = position_errors_m(&pairs, &alignment);
    let ate_m = Statistics::of(&errors_m).ok_or_else(nothing)?;
    let path = positions.iter().zip(positions.iter().skip(1)).map(|(a, b)| (b.1 - a.1).norm()).sum();
    Ok(Evaluation {
        matched_poses: pairs.len(),
        unmatched_poses: estimate.poses().len() - pairs.len(),
        path_length_m: path,
        ate_rmse_m: ate_m.rmse,
        ate_m,
        scale: alignment.scale,
        scale_error_percent: 100.0 * (alignment.scale - 1.0).abs(),
        metric_from_ns: metric_from(&pairs).map(|stamp| stamp.as_nanos()),
        rpe: relative_errors(&pairs, &options.rpe_distances_m),
        errors: pairs.iter().map(|pair| pair.stamp.as_nanos()).zip(errors_m).collect(),
        truth_from_estimate: alignment.truth_from_estimate,
    })
}
