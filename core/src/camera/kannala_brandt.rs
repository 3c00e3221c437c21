//! Equidistant fisheye camera.

use crate::real::Real;

/// Fisheye camera of Kannala and Brandt with four coefficients, as OpenCV (`fisheye`), Kalibr (`equidistant`) and TUM-VI define it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KannalaBrandt<T: Real> {
    /// Image width and height, px.
    pub size_px: (u32, u32),
    /// Focal lengths `fx fy`, px.
    pub focal_px: [T; 2],
    /// Principal point `cx cy`, px.
    pub center_px: [T; 2],
    /// `k1 k2 k3 k4`, dimensionless.
    pub distortion: [T; 4],
}
