//! The transform that lays an estimate onto the truth.
//!
//! # Model
//! For paired positions `e_i` (estimate) and `t_i` (truth)
//! ```text
//! min Σ ‖t_i − (s R e_i + p)‖²        R ∈ SO(3), s = 1 or s > 0
//! H = Σ (t_i − t̄)(e_i − ē)ᵀ = U D Vᵀ      R = U diag(1, 1, det(U Vᵀ)) Vᵀ
//! s = tr(D diag(1, 1, det(U Vᵀ))) / Σ ‖e_i − ē‖²          p = t̄ − s R ē
//! ```
//! Reference: Umeyama, "Least-squares estimation of transformation parameters between two point patterns", PAMI 1991.
//!
//! # Degeneracy
//! All points on one line leave the turn about it undetermined; the errors that remain are the same for any choice.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A rigid transform, and the scale that would have fitted better than 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// Maps the estimate's world to that of the truth; the scale is not applied in it.
    pub truth_from_estimate: Isometry3<f64>,
    /// The best factor on the estimate's positions; 1 where they do not move.
    pub scale: f64,
}

/// Aligns pairs `(estimate, truth)` of positions; `None` for no pair at all.
#[must_use]
pub fn align(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Alignment> {
    if pairs.is_empty() {
        return None;
    }
    let count = pairs.len() as f64;
    let mean_estimate = pairs.iter().map(|pair| pair.0).sum::<Vector3<f64>>() / count;
    let mean_truth = pairs.iter().map(|pair| pair.1).sum::<Vector3<f64>>() / count;
    let mut covariance = Matrix3::zeros();
    let mut spread = 0.0;
    for (estimate, truth) in pairs {
        covariance += (truth - mean_truth) * (estimate - mean_estimate).transpose();
        spread += (estimate - mean_estimate).norm_squared();
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_transposed)) = (svd.u, svd.v_t) else { return None };
    // nalgebra orders the singular values from the largest down: the mirror goes to the weakest direction.
    let sign = if (u * v_transposed).determinant() < 0.0 { -1.0 } else { 1.0 };
    let signs = Vector3::new(1.0, 1.0, sign);
    let rotation = u * Matrix3::from_diagonal(&signs) * v_transposed;
    let scale = if spread > 0.0 { svd.singular_values.dot(&signs) / spread } else { 1.0 };
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let translation = Translation3::from(mean_truth - rotation * mean_estimate);
    Some(Alignment { truth_from_estimate: Isometry3::from_parts(translation, rotation), scale })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn curve() -> Vec<Vector3<f64>> {
        (0..40).map(|i| f64::from(i) * 0.2).map(|t| Vector3::new(t.sin(), (1.7 * t).cos(), 0.3 * t)).collect()
    }

    #[test]
    fn a_known_similarity_is_found_again() {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -1.9, 1.1));
        let offset = Vector3::new(3.0, -2.0, 0.5);
        let pairs: Vec<_> = curve().into_iter().map(|point| (point, rotation * point * 1.07 + offset)).collect();
        let found = align(&pairs).unwrap();
        assert!((found.scale - 1.07).abs() < 1e-12);
        assert!(found.truth_from_estimate.rotation.angle_to(&rotation) < 1e-7);
    }

    #[test]
    fn no_small_change_of_the_transform_lowers_the_error() {
        let pairs: Vec<_> = curve()
            .into_iter()
            .enumerate()
            .map(|(i, point)| (point, point + Vector3::new((i * i) as f64 % 3.0, 0.0, (i % 5) as f64) * 0.1))
            .collect();
        let best = align(&pairs).unwrap().truth_from_estimate;
        let cost = |pose: &Isometry3<f64>| {
            pairs.iter().map(|(e, t)| (t - (pose.rotation * e + pose.translation.vector)).norm_squared()).sum::<f64>()
        };
        for axis in 0..3 {
            for step in [-1e-4, 1e-4] {
                let mut direction = Vector3::zeros();
                direction[axis] = step;
                let turned = best * UnitQuaternion::from_scaled_axis(direction);
                let moved = Translation3::from(direction) * best;
                assert!(cost(&turned) > cost(&best) && cost(&moved) > cost(&best), "axis {axis} step {step}");
            }
        }
    }

    #[test]
    fn a_plane_is_never_mirrored() {
        let pairs: Vec<_> = curve().into_iter().map(|p| (Vector3::new(p.x, p.y, 0.0), Vector3::new(-p.x, p.y, 0.0))).collect();
        let rotation = align(&pairs).unwrap().truth_from_estimate.rotation.to_rotation_matrix();
        assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-12);
    }
}
