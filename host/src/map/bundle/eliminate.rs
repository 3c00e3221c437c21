//! Landmarks eliminated from the normal equations, and found again from a step.
//!
//! # Model
//! ```text
//! C = Σ w J_lᵀ J_l = L Lᵀ     g = Σ w J_lᵀ r     W_i = w J_iᵀ J_l     Y_i = W_i L⁻ᵀ     e = L⁻¹ g
//! V_ij ← V_ij − Y_i Y_jᵀ      b_i ← b_i − Y_i e      (Schur complement)
//! δl = −L⁻ᵀ (e + Σ Y_iᵀ θ_i)
//! ```
//! `i` and `j` are the cameras that see the landmark and the plane that it is on, `θ` their motions.

use nalgebra::{Matrix3, SVector, Vector2, Vector3};

use super::Bundle;
use super::normal::{Coupling, Normal};
use super::planes::{PlaneBlocks, PlaneCoupling};
use super::sparse::{Band, Pose};

/// The landmarks, and `Y` of each view.
pub(super) struct Eliminated {
    landmarks: Vec<EliminatedLandmark>,
    views: Vec<Coupling>,
}

/// `L⁻¹`, `e`, and `Y` of its plane.
struct EliminatedLandmark {
    inverse: Matrix3<f64>,
    e: Vector3<f64>,
    on_plane: Option<(usize, PlaneCoupling)>,
}

impl Bundle {
    /// Takes the landmarks out of the poses and planes.
    pub(super) fn eliminate(
        &self,
        normal: &Normal,
        damping: f64,
        band: &mut Band,
        gradient: &mut [SVector<f64, 6>],
        planes: &mut PlaneBlocks,
    ) -> Eliminated {
        let mut eliminated =
            Eliminated { landmarks: Vec::with_capacity(normal.landmarks.len()), views: Vec::with_capacity(normal.views.len()) };
        for landmark in &normal.landmarks {
            let damped = landmark.hessian + Matrix3::from_diagonal(&(landmark.hessian.diagonal() * damping));
            let inverse = damped.cholesky().and_then(|factor| factor.l().solve_lower_triangular(&Matrix3::identity()));
            // A landmark that nothing is known of stays where it is and says nothing.
            let inverse = inverse.unwrap_or_else(Matrix3::zeros);
            let e = inverse * landmark.gradient;
            let begin = eliminated.views.len();
            for (i, coupling) in &normal.views[landmark.views.clone()] {
                let y = coupling * inverse.transpose();
                gradient[*i] -= y * e;
                eliminated.views.push(y);
                for ((j, _), other) in normal.views[landmark.views.clone()].iter().zip(&eliminated.views[begin..]) {
                    subtract_product(&mut band.0[self.structure.place(*i, *j)], &y, other);
                }
            }
            let on_plane = landmark.on_plane.map(|(plane, coupling)| {
                let y = coupling * inverse.transpose();
                planes.gradient[plane] -= y * e;
                planes.own[plane] -= y * y.transpose();
                for ((i, _), other) in normal.views[landmark.views.clone()].iter().zip(&eliminated.views[begin..]) {
                    *planes.by_pose_mut(plane, *i) -= y * other.transpose();
                }
                (plane, y)
            });
            eliminated.landmarks.push(EliminatedLandmark { inverse, e, on_plane });
        }
        eliminated
    }
}

/// `block ← block − a bᵀ`.
#[inline]
fn subtract_product(block: &mut Pose, a: &Coupling, b: &Coupling) {
    for c in 0..6 {
        let (x, y, z) = (b[(c, 0)], b[(c, 1)], b[(c, 2)]);
        for r in 0..6 {
            block[(r, c)] -= a[(r, 0)] * x + a[(r, 1)] * y + a[(r, 2)] * z;
        }
    }
}

/// The steps of the landmarks, by index.
pub(super) fn back_substitute(
    normal: &Normal,
    eliminated: &Eliminated,
    keyframes: &[[f64; 15]],
    planes: &[[f64; 2]],
) -> Vec<(usize, Vector3<f64>)> {
    let cameras: Vec<_> = normal
        .camera_by_body
        .iter()
        .zip(keyframes)
        .map(|(by_body, step)| by_body * SVector::<f64, 6>::from_column_slice(&step[..6]))
        .collect();
    let steps = normal.landmarks.iter().zip(&eliminated.landmarks).map(|(landmark, EliminatedLandmark { inverse, e, on_plane })| {
        let mut whitened = *e;
        for ((i, _), y) in normal.views[landmark.views.clone()].iter().zip(&eliminated.views[landmark.views.clone()]) {
            whitened += y.tr_mul(&cameras[*i]);
        }
        if let Some((plane, y)) = on_plane {
            whitened += y.tr_mul(&Vector2::from(planes[*plane]));
        }
        (landmark.index, -inverse.tr_mul(&whitened))
    });
    steps.collect()
}
