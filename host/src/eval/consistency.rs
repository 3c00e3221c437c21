//! Whether the stated covariance agrees with the error made.
//!
//! # Model
//! Vision and inertial samples do not observe the position and the heading of the world, so the estimate is first moved
//! by a translation and a turn about the vertical that make its first pose agree with the truth. Then, with the rotation
//! perturbed on the right,
//! ```text
//! e = [ Log(R_estᵀ R_truth)   p_truth − p_est ]      ε = eᵀ P⁻¹ e      E[ε] = 6 for a consistent estimator
//! ```
//! The first pose has no error left in four of six directions and is left out.

use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

use super::Matched;

/// An estimate beside the truth, with what the estimator claims to know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseWithCovariance {
    /// Estimate and truth.
    pub matched: Matched,
    /// Covariance of `[δφ δp]` in the estimate's world, rad and m.
    pub covariance: SMatrix<f64, 6, 6>,
}

/// Normalised estimation error squared of every pose but the first; poses with a singular covariance are left out.
#[must_use]
pub fn pose_nees(poses: &[PoseWithCovariance]) -> Vec<f64> {
    pose_nees_of_each(poses).into_iter().flatten().collect()
}

/// The same, one entry per pose; nothing for the first and where the covariance is singular.
#[must_use]
pub fn pose_nees_of_each(poses: &[PoseWithCovariance]) -> Vec<Option<f64>> {
    let Some(first) = poses.first() else { return Vec::new() };
    let truth_from_estimate = heading_and_position(&first.matched);
    let others = poses.iter().skip(1).map(|pose| nees(pose, &truth_from_estimate));
    std::iter::once(None).chain(others).collect()
}

fn nees(pose: &PoseWithCovariance, truth_from_estimate: &Isometry3<f64>) -> Option<f64> {
    let estimate = truth_from_estimate * pose.matched.estimate;
    let turn = (estimate.rotation.inverse() * pose.matched.truth.rotation).scaled_axis();
    let shift = pose.matched.truth.translation.vector - estimate.translation.vector;
    let error = SVector::<f64, 6>::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
    let world: Matrix3<f64> = *truth_from_estimate.rotation.to_rotation_matrix().matrix();
    let mut turned = SMatrix::<f64, 6, 6>::identity();
    turned.fixed_view_mut::<3, 3>(3, 3).copy_from(&world);
    let covariance = turned * pose.covariance * turned.transpose();
    let whitened = covariance.cholesky()?.solve(&error);
    Some(error.dot(&whitened))
}

/// The transform of four degrees of freedom that makes the positions agree and, as far as possible, the rotations.
fn heading_and_position(pair: &Matched) -> Isometry3<f64> {
    // R = Rz(ψ) minimises the angle to R_truth R_estᵀ where ψ is twice the angle of its quaternion's (w, z) part.
    let whole = pair.truth.rotation * pair.estimate.rotation.inverse();
    let heading = 2.0 * whole.k.atan2(whole.w);
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading);
    Isometry3::from_parts(Translation3::from(pair.truth.translation.vector - rotation * pair.estimate.translation.vector), rotation)
}

#[cfg(test)]
mod tests {
    use libella_core::time::Timestamp;

    use super::*;

    fn pose(estimate: Isometry3<f64>, truth: Isometry3<f64>) -> PoseWithCovariance {
        let covariance = SMatrix::from_diagonal(&SVector::<f64, 6>::new(1e-4, 4e-4, 9e-4, 1e-2, 4e-2, 9e-2));
        PoseWithCovariance { matched: Matched { stamp: Timestamp::default(), estimate, truth }, covariance }
    }

    #[test]
    fn a_one_sigma_error_on_each_axis_counts_six_in_any_world() {
        let estimate = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.9));
        let off = Isometry3::from_parts(
            Translation3::from(estimate.translation.vector + Vector3::new(0.1, 0.2, 0.3)),
            estimate.rotation * UnitQuaternion::from_scaled_axis(Vector3::new(0.01, 0.02, 0.03)),
        );
        for heading in [0.0, 1.0, -2.5] {
            let world = Isometry3::new(Vector3::new(5.0, -7.0, 1.0), Vector3::new(0.0, 0.0, heading));
            let found = pose_nees(&[pose(estimate, world * estimate), pose(estimate, world * off)]);
            assert_eq!(found.len(), 1);
            assert!((found[0] - 6.0).abs() < 1e-9, "{found:?}");
        }
    }
}
