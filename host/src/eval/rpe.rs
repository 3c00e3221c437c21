//! Relative pose error over stretches of a given length.
//!
//! # Model
//! From every pose `i` to the first pose `j` at which the true path since `i` has reached the distance, with
//! relative motions `Δ = T_i⁻¹ T_j`:
//! ```text
//! E = Δ_truth⁻¹ Δ_estimate        error: ‖p(E)‖ (m), ‖Log R(E)‖ (deg)
//! ```
//! No alignment enters. Reference: Geiger et al., "Are we ready for autonomous driving?", CVPR 2012.

use serde::Serialize;

use super::{Matched, Statistics};

/// Errors over one distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RelativeError {
    /// Length of the stretches, m.
    pub distance_m: f64,
    /// Number of stretches.
    pub pairs: usize,
    /// RMSE of the relative position, m.
    pub translation_rmse_m: f64,
    /// Median error of the relative position, m.
    pub translation_median_m: f64,
    /// RMSE of the relative position over the distance, percent.
    pub translation_rmse_percent: f64,
    /// RMSE of the relative rotation, degrees.
    pub rotation_rmse_deg: f64,
}

/// Relative errors over each distance that the true path is long enough for.
#[must_use]
pub fn relative_errors(pairs: &[Matched], distances_m: &[f64]) -> Vec<RelativeError> {
    let mut travelled = Vec::with_capacity(pairs.len());
    let mut length = 0.0;
    for (index, pair) in pairs.iter().enumerate() {
        if let Some(before) = index.checked_sub(1).and_then(|before| pairs.get(before)) {
            length += (pair.truth.translation.vector - before.truth.translation.vector).norm();
        }
        travelled.push(length);
    }
    distances_m.iter().filter_map(|distance| over(pairs, &travelled, *distance)).collect()
}

fn over(pairs: &[Matched], travelled: &[f64], distance_m: f64) -> Option<RelativeError> {
    let (mut translations_m, mut rotations_deg) = (Vec::new(), Vec::new());
    for (start, begun) in pairs.iter().zip(travelled) {
        let end = travelled.partition_point(|length| *length < begun + distance_m);
        let Some(end) = pairs.get(end) else { break };
        let error = (start.truth.inverse() * end.truth).inverse() * (start.estimate.inverse() * end.estimate);
        translations_m.push(error.translation.vector.norm());
        rotations_deg.push(error.rotation.angle().to_degrees());
    }
    let (translation, rotation) = (Statistics::of(&translations_m)?, Statistics::of(&rotations_deg)?);
    Some(RelativeError {
        distance_m,
        pairs: translations_m.len(),
        translation_rmse_m: translation.rmse,
        translation_median_m: translation.median,
        translation_rmse_percent: 100.0 * translation.rmse / distance_m,
        rotation_rmse_deg: rotation.rmse,
    })
}

#[cfg(test)]
mod tests {
    use libella_core::time::Timestamp;
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    #[test]
    fn a_scaled_straight_line_errs_by_the_scale() {
        let at = |i: i32, scale: f64| Isometry3::new(Vector3::new(f64::from(i) * 0.125 * scale, 0.0, 0.0), Vector3::zeros());
        let pairs: Vec<_> =
            (0..33).map(|i| Matched { stamp: Timestamp::from_nanos(i64::from(i)), estimate: at(i, 1.02), truth: at(i, 1.0) }).collect();
        let found = relative_errors(&pairs, &[1.0, 2.0, 5.0]);
        assert_eq!(found.iter().map(|error| error.pairs).collect::<Vec<_>>(), [25, 17]);
        assert!(found.iter().all(|error| (error.translation_rmse_percent - 2.0).abs() < 1e-9 && error.rotation_rmse_deg < 1e-6));
    }

    #[test]
    fn the_choice_of_world_does_not_matter() {
        let pose = |i: i32| {
            Isometry3::new(Vector3::new((f64::from(i) * 0.1).sin(), f64::from(i) * 0.05, 0.0), Vector3::new(0.0, f64::from(i) * 0.01, 0.2))
        };
        let world = Isometry3::new(Vector3::new(7.0, -3.0, 1.0), Vector3::new(0.3, 0.4, -2.0));
        let pairs: Vec<_> =
            (0..99).map(|i| Matched { stamp: Timestamp::from_nanos(i64::from(i)), estimate: world * pose(i), truth: pose(i) }).collect();
        assert!(relative_errors(&pairs, &[1.0]).iter().all(|error| error.pairs > 10 && error.translation_rmse_m < 1e-12));
    }
}
