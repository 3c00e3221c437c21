//! Cameras: points in the camera frame (x right, y down, z forward) to pixels and back.

mod kannala_brandt;
mod pinhole;

pub use kannala_brandt::KannalaBrandt;
pub use pinhole::PinholeRadTan;

use nalgebra::{Matrix2x3, Vector2, Vector3};

use crate::real::Real;

/// A central camera. Pixels are pixels of the level-0 image, the centre of the first pixel is (0, 0).
pub trait Camera<T: Real> {
    /// The pixel of a point, or `None` where the model does not hold (behind the camera, beyond the field of view).
    fn project(&self, point_in_camera: &Vector3<T>) -> Option<Vector2<T>>;
    /// The pixel and its Jacobian with respect to the point, 2×3, px/m.
    fn project_with_jacobian(&self, point_in_camera: &Vector3<T>) -> Option<(Vector2<T>, Matrix2x3<T>)>;
    /// The unit bearing of a pixel, or `None` where the inversion does not converge.
    fn unproject(&self, pixel: &Vector2<T>) -> Option<Vector3<T>>;
    /// Focal length of the paraxial image, px: what one radian near the axis is worth.
    fn focal_px(&self) -> T;
    /// Width and height of the image, px.
    fn size_px(&self) -> (u32, u32);
}

/// Any of the supported cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraModel<T: Real> {
    /// Pinhole with radial-tangential distortion.
    PinholeRadTan(PinholeRadTan<T>),
    /// Equidistant fisheye.
    KannalaBrandt(KannalaBrandt<T>),
}
