//! Why a calibration was refused.

use core::fmt;

use crate::real::Real;

/// Why a calibration was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum CameraError {
    /// The image, whose width and height are given, has no pixels.
    EmptyImage(u32, u32),
    /// A focal length is zero or negative.
    FocalLength,
    /// A focal length, the principal point or a distortion coefficient is infinite or not a number.
    NotFinite,
}

impl fmt::Display for CameraError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EmptyImage(width, height) => write!(f, "image of {width} x {height} px is empty"),
            Self::FocalLength => f.write_str("focal length must be positive"),
            Self::NotFinite => f.write_str("camera intrinsics must be finite numbers"),
        }
    }
}

impl core::error::Error for CameraError {}

pub(super) fn check_intrinsics<T: Real>(
    size_px: (u32, u32),
    focal_px: &[T; 2],
    center_px: &[T; 2],
    distortion: &[T; 4],
) -> Result<(), CameraError> {
    if size_px.0 == 0 || size_px.1 == 0 {
        return Err(CameraError::EmptyImage(size_px.0, size_px.1));
    }
    if !focal_px.iter().chain(center_px).chain(distortion).all(|value| value.is_usable()) {
        return Err(CameraError::NotFinite);
    }
    if focal_px.iter().any(|focal| *focal <= T::ZERO) {
        return Err(CameraError::FocalLength);
    }
    Ok(())
}
