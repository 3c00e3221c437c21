//! What the start reads of the images, and what it says about the landmarks.

use nalgebra::{Matrix3x2, Vector3};

use crate::real::Real;
use crate::storage::blank::blank;

/// The bearings of tracks in the frames of the window.
///
/// Implemented for `(landmark_count, closure)`; the closure maps `(landmark, frame)` to a unit vector in the camera frame.
/// It is called some hundred times per observation.
pub trait Bearings<T: Real> {
    /// Number of landmarks.
    fn landmark_count(&self) -> usize;
    /// The unit vector towards a landmark in the camera of a frame; `None` where it was not seen.
    fn bearing(&self, landmark: usize, frame: usize) -> Option<Vector3<T>>;
}

impl<T: Real, F: Fn(usize, usize) -> Option<Vector3<T>>> Bearings<T> for (usize, F) {
    fn landmark_count(&self) -> usize {
        self.0
    }
    fn bearing(&self, landmark: usize, frame: usize) -> Option<Vector3<T>> {
        (self.1)(landmark, frame)
    }
}

/// One landmark of the start: scratch memory while it runs, a result afterwards.
///
/// The point lies at `bearing_in_anchor / inverse_distance_per_m` in the camera of frame `anchor`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InitLandmark<T: Real> {
    /// Frame that the landmark is expressed in.
    pub anchor: u8,
    /// Whether the landmark took part and its point may be used.
    pub is_used: bool,
    /// Estimated unit vector towards it in the camera of the anchor.
    pub bearing_in_anchor: Vector3<T>,
    /// Inverse of its distance from that camera, 1/m; zero or slightly negative for points very far away.
    pub inverse_distance_per_m: T,
    /// Standard deviation of the inverse distance given the motion, 1/m.
    pub sigma_inverse_distance_per_m: T,
    /// Bit `i` is set when the observation in frame `i` was rejected as an outlier.
    pub rejected_frames: u32,
    /// Before the step on trial.
    pub(super) previous: (Vector3<T>, T),
}

blank!([T: Real] InitLandmark<T> {
    anchor,
    is_used,
    bearing_in_anchor,
    inverse_distance_per_m,
    sigma_inverse_distance_per_m,
    rejected_frames,
    previous,
});

impl<T: Real> Default for InitLandmark<T> {
    fn default() -> Self {
        Self {
            anchor: 0,
            is_used: false,
            bearing_in_anchor: Vector3::z(),
            inverse_distance_per_m: T::ZERO,
            sigma_inverse_distance_per_m: T::ZERO,
            rejected_frames: 0,
            previous: (Vector3::z(), T::ZERO),
        }
    }
}

impl<T: Real> InitLandmark<T> {
    pub(super) fn is_rejected(&self, frame: usize) -> bool {
        frame >= 32 || self.rejected_frames & (1 << frame) != 0
    }
}

/// Two unit vectors that span the plane across the unit vector `axis`.
pub(super) fn across<T: Real>(axis: &Vector3<T>) -> Matrix3x2<T> {
    // Duff et al., Building an Orthonormal Basis, Revisited (JCGT 2017): regular for every direction.
    let sign = if axis.z < T::ZERO { -T::one() } else { T::one() };
    let a = -T::one() / (sign + axis.z);
    let b = axis.x * axis.y * a;
    Matrix3x2::new(T::one() + sign * axis.x * axis.x * a, b, sign * b, sign + axis.y * axis.y * a, -sign * axis.x, -axis.y)
}
