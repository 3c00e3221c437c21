//! Any of the supported cameras.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::{Camera, CameraError, KannalaBrandt, PinholeRadTan};
use crate::real::Real;
use crate::storage::blank::Blank;

/// Any of the supported cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraModel<T: Real> {
    /// Pinhole with radial-tangential distortion.
    PinholeRadTan(PinholeRadTan<T>),
    /// Equidistant fisheye.
    KannalaBrandt(KannalaBrandt<T>),
}

macro_rules! each {
    ($model:expr, $camera:ident => $result:expr) => {
        match $model {
            CameraModel::PinholeRadTan($camera) => $result,
            CameraModel::KannalaBrandt($camera) => $result,
        }
    };
}

impl<T: Real> CameraModel<T> {
    /// Whether the numbers can be those of a camera.
    ///
    /// # Errors
    /// An empty image, a focal length that is not positive, a number that is not finite.
    pub fn validate(&self) -> Result<(), CameraError> {
        each!(self, camera => camera.validate())
    }

    /// The same camera in another scalar.
    #[must_use]
    pub fn cast<U: Real>(&self) -> CameraModel<U> {
        match self {
            Self::PinholeRadTan(camera) => CameraModel::PinholeRadTan(camera.cast()),
            Self::KannalaBrandt(camera) => CameraModel::KannalaBrandt(camera.cast()),
        }
    }
}

impl<T: Real> Blank for CameraModel<T> {
    const BLANK: Self = Self::PinholeRadTan(Blank::BLANK);
}

impl<T: Real> From<PinholeRadTan<T>> for CameraModel<T> {
    fn from(camera: PinholeRadTan<T>) -> Self {
        Self::PinholeRadTan(camera)
    }
}

impl<T: Real> From<KannalaBrandt<T>> for CameraModel<T> {
    fn from(camera: KannalaBrandt<T>) -> Self {
        Self::KannalaBrandt(camera)
    }
}

impl<T: Real> Camera<T> for CameraModel<T> {
    #[inline]
    fn project(&self, point_in_camera: &Vector3<T>) -> Option<Vector2<T>> {
        each!(self, camera => camera.project(point_in_camera))
    }

    #[inline]
    fn project_with_jacobian(&self, point_in_camera: &Vector3<T>) -> Option<(Vector2<T>, Matrix2x3<T>)> {
        each!(self, camera => camera.project_with_jacobian(point_in_camera))
    }

    fn unproject(&self, pixel: &Vector2<T>) -> Option<Vector3<T>> {
        each!(self, camera => camera.unproject(pixel))
    }

    fn focal_px(&self) -> T {
        each!(self, camera => camera.focal_px())
    }

    fn size_px(&self) -> (u32, u32) {
        each!(self, camera => camera.size_px())
    }
}
