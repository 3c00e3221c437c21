//! Pinhole camera with radial-tangential distortion.

use crate::real::Real;

/// Pinhole camera with radial-tangential distortion, as OpenCV, Kalibr and EuRoC define it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinholeRadTan<T: Real> {
    /// Image width and height, px.
    pub size_px: (u32, u32),
    /// Focal lengths `fx fy`, px.
    pub focal_px: [T; 2],
    /// Principal point `cx cy`, px.
    pub center_px: [T; 2],
    /// `k1 k2 p1 p2`, dimensionless.
    pub distortion: [T; 4],
}
