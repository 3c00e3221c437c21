//! Relative pose error over stretches of a given length, by the definition of `evo_rpe --all_pairs --delta_unit m`.
//!
//! # Model
//! With the length `l` of the estimated path up to each pose, in steps between poses that have a truth, every pose `i` is paired with the
//! later pose nearest to the distance `d` along it, of equally near ones the first, where that is within a tenth of `d`:
//! ```text
//! j(i) = argmin over j > i of |l_j − l_i − d|          kept where |l_j − l_i − d| ≤ 0.1 d
//! E = Δ_truth⁻¹ Δ_estimate,  Δ = T_i⁻¹ T_j             error: ‖p(E)‖ (m), ‖Log R(E)‖ (deg)
//! ```
//! No alignment enters: `E` stays the same whatever world each of the two is in. References: Sturm et al., "A benchmark for the evaluation
//! of RGB-D SLAM systems", IROS 2012; Grupp, "evo: Python package for the evaluation of odometry and SLAM", 2017.

use serde::Serialize;

use super::{Matched, Statistics};

/// How far the length of a stretch may be from the distance, as a share of it: evo's default.
const TOLERANCE: f64 = 0.1;

/// Errors over one distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RelativeError {
    /// Length of the stretches along the estimated path, within a tenth, m.
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

/// Relative errors over each distance that the estimated path is long enough for.
#[must_use]
pub fn relative_errors(pairs: &[Matched], distances_m: &[f64]) -> Vec<RelativeError> {
    let mut travelled_m = Vec::with_capacity(pairs.len());
    let mut length = 0.0;
    for (index, pair) in pairs.iter().enumerate() {
        if let Some(before) = index.checked_sub(1).and_then(|before| pairs.get(before)) {
            length += (pair.estimate.translation.vector - before.estimate.translation.vector).norm();
        }
        travelled_m.push(length);
    }
    distances_m.iter().filter_map(|distance| over(pairs, &travelled_m, *distance)).collect()
}

fn over(pairs: &[Matched], travelled_m: &[f64], distance_m: f64) -> Option<RelativeError> {
    let (mut translations_m, mut rotations_deg) = (Vec::new(), Vec::new());
    for (index, start) in pairs.iter().enumerate() {
        let Some(end) = travelled_m.get(index..).and_then(|ahead| end_of(ahead, distance_m)).and_then(|steps| pairs.get(index + steps))
        else {
            continue;
        };
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

/// How many poses after the first the stretch ends, where it ends near enough.
fn end_of(travelled_m: &[f64], distance_m: f64) -> Option<usize> {
    let (begun, ahead) = travelled_m.split_first()?;
    // Lengths grow, so that the nearest is the first one there or the last one before, and the first of those as long as it.
    let first_from = |length: f64| ahead.partition_point(|travelled| travelled - begun < length);
    let reached = first_from(distance_m);
    let before = reached.checked_sub(1).and_then(|last| ahead.get(last)).map(|travelled| first_from(travelled - begun));
    let off = |end: &usize| ahead.get(*end).map(|travelled| (travelled - begun - distance_m).abs());
    let candidates = before.into_iter().chain([reached]).filter_map(|end| Some((off(&end)?, end)));
    let (off, end) = candidates.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (off <= TOLERANCE * distance_m).then_some(end + 1)
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
        let found = relative_errors(&pairs, &[1.02, 2.04, 5.0]);
        // Of 2.04 m those of 15 steps too that the end of the path leaves, but not those of 14; 5 m is longer than all of it.
        assert_eq!(found.iter().map(|error| error.pairs).collect::<Vec<_>>(), [25, 18]);
        assert!((found[0].translation_rmse_m - 0.02).abs() < 1e-12 && (found[0].translation_rmse_percent - 2.0 / 1.02).abs() < 1e-9);
        assert!(((found[1].translation_rmse_m / 0.04).powi(2) * 18.0 - (17.0 + 0.9375_f64.powi(2))).abs() < 1e-9);
        assert!(found.iter().all(|error| error.rotation_rmse_deg < 1e-6));
    }

    #[test]
    fn stretches_end_at_the_nearest_pose_and_of_equals_at_the_first() {
        let travelled = [0.0, 0.0, 0.5, 0.95, 0.95, 1.05, 1.05, 1.5];
        assert_eq!(end_of(&travelled, 1.0), Some(3)); // 0.95 and 1.05 are equally near
        assert_eq!(end_of(&travelled, 1.02), Some(5));
        assert_eq!(end_of(&travelled[1..], 0.5), Some(1));
        assert_eq!((end_of(&travelled, 0.7), end_of(&travelled, 1.7), end_of(&travelled[7..], 1.0)), (None, None, None));
        assert_eq!(end_of(&travelled, 1.6), Some(7)); // 1.5 is within a tenth, and nothing comes after
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
