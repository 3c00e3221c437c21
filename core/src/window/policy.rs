//! Which frames stay.

use super::{CameraPose, Window};
use crate::real::Real;

/// What moved between two frames of the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covisibility<T> {
    /// Landmarks that both see.
    pub shared: usize,
    /// Landmarks that the later one sees.
    pub later: usize,
    /// Mean displacement of the shared corners that rotation does not explain, in units of the plane `z = 1`.
    pub parallax: T,
}

impl<T: Real, const FRAMES: usize, const POINTS: usize> Window<T, FRAMES, POINTS> {
    /// Compares frame `later` with frame `earlier`.
    #[must_use]
    pub fn covisibility(&self, earlier: usize, later: usize, camera_poses: &[CameraPose<T>]) -> Covisibility<T> {
        let mut found = Covisibility { shared: 0, later: 0, parallax: T::ZERO };
        let (Some(from), Some(to)) = (camera_poses.get(earlier), camera_poses.get(later)) else { return found };
        let (rotation, _) = CameraPose::target_from_anchor(to, from);
        let mut sum = T::ZERO;
        for landmark in &self.landmarks {
            let Some(there) = landmark.point(later) else { continue };
            found.later += 1;
            let Some(here) = landmark.point(earlier) else { continue };
            found.shared += 1;
            let turned = rotation * nalgebra::Vector3::new(here.x, here.y, T::one());
            if turned.z > T::of(0.1) {
                let (dx, dy) = (turned.x / turned.z - there.x, turned.y / turned.z - there.y);
                sum += (dx * dx + dy * dy).root();
            }
        }
        if found.shared > 0 {
            #[allow(clippy::cast_precision_loss)]
            {
                found.parallax = sum / T::of(found.shared as f64);
            }
        }
        found
    }
}
