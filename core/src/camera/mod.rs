//! Cameras: points in the camera frame (x right, y down, z forward) to pixels and back.

mod error;
mod kannala_brandt;
mod model;
mod monotone;
mod pinhole;
#[cfg(test)]
mod tests;

pub use error::CameraError;
use error::check_intrinsics;
pub use kannala_brandt::KannalaBrandt;
pub use model::CameraModel;
pub use pinhole::PinholeRadTan;

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

use crate::real::Real;

/// A central camera. Pixels are pixels of the level-0 image, the centre of the first pixel is (0, 0).
pub trait Camera<T: Real> {
    /// The pixel of a point, or `None` where the model does not hold (behind the camera, beyond the field of view).
    ///
    /// The pixel may lie outside the image.
    fn project(&self, point_in_camera: &Vector3<T>) -> Option<Vector2<T>>;
    /// The pixel and its Jacobian with respect to the point, 2×3, px/m.
    fn project_with_jacobian(&self, point_in_camera: &Vector3<T>) -> Option<(Vector2<T>, Matrix2x3<T>)>;
    /// The unit bearing of a pixel, or `None` where the inversion does not converge.
    fn unproject(&self, pixel: &Vector2<T>) -> Option<Vector3<T>>;
    /// Focal length of the paraxial image, px: what one radian near the axis is worth.
    fn focal_px(&self) -> T;
    /// Width and height of the image, px.
    fn size_px(&self) -> (u32, u32);

    /// The undistorted coordinates `(x/z, y/z)` of a pixel and their Jacobian with respect to the pixel, 2×2, 1/px.
    ///
    /// `None` where [`Self::unproject`] gives none, and 90° or more from the axis, where the coordinates are infinite.
    fn unproject_with_jacobian(&self, pixel: &Vector2<T>) -> Option<(Vector2<T>, Matrix2<T>)> {
        let bearing = self.unproject(pixel)?;
        if bearing.z <= T::default_epsilon() {
            return None;
        }
        let normalized = bearing.xy() / bearing.z;
        // By the inverse function theorem: at z = 1 the first two columns are d(pixel)/d(normalised).
        let (_, d_pixel_d_point) = self.project_with_jacobian(&normalized.push(T::one()))?;
        let inverse = d_pixel_d_point.fixed_view::<2, 2>(0, 0).into_owned().try_inverse()?;
        Some((normalized, inverse))
    }
}
