//! A camera whose focal lengths, principal point and first distortion coefficient may be off.
//!
//! # Model
//! `κ = [ln fx, ln fy, cx/fx, cy/fy, k₁]`, each as the deviation from the stated calibration, dimensionless.

use libella_core::camera::{Camera, CameraModel};
use nalgebra::{Matrix3, SVector, Vector2, Vector3};

/// Number of parameters.
pub(super) const PARAMETERS: usize = 5;
/// Deviations by which derivatives are taken: large against rounding, small against curvature.
pub(super) const STEP: f64 = 1e-4;

/// Deviation from the stated calibration.
pub(super) type Deviation = SVector<f64, PARAMETERS>;

/// The camera with a deviation.
#[derive(Debug, Clone)]
pub(super) struct Lens {
    stated: CameraModel<f64>,
    camera: CameraModel<f64>,
}

impl Lens {
    pub fn new(stated: &CameraModel<f64>, deviation: &Deviation) -> Self {
        Self { stated: *stated, camera: deviate(stated, deviation) }
    }

    /// Unit bearing of a pixel.
    pub fn bearing(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        self.camera.unproject(pixel).filter(|bearing| bearing.iter().all(|value| value.is_finite()))
    }

    pub fn focal_px(&self) -> f64 {
        self.camera.focal_px()
    }

    /// Bearing and what a pixel is worth there.
    pub fn ray(&self, pixel: &Vector2<f64>) -> Option<Ray> {
        let (normalized, slope) = self.camera.unproject_with_jacobian(pixel)?;
        let point = normalized.push(1.0);
        let length = point.norm();
        let bearing = point / length;
        // ∂f/∂(a, b) = (I − f fᵀ)/|(a, b, 1)|
        let across = (Matrix3::identity() - bearing * bearing.transpose()) / length;
        let per_px = across.fixed_view::<3, 2>(0, 0) * slope;
        let usable = bearing.iter().chain(per_px.iter()).all(|value| value.is_finite());
        usable.then(|| Ray { bearing, spread: per_px * per_px.transpose() })
    }

    /// The lenses a step away in every parameter, for derivatives.
    pub fn neighbours(&self, deviation: &Deviation) -> [Self; PARAMETERS] {
        std::array::from_fn(|parameter| {
            let mut moved = *deviation;
            moved[parameter] += STEP;
            Self::new(&self.stated, &moved)
        })
    }
}

/// Where a corner is seen, and its uncertainty.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    /// Unit bearing.
    pub bearing: Vector3<f64>,
    /// `D Dᵀ` of its derivative by the pixel, rad²/px².
    pub spread: Matrix3<f64>,
}

fn deviate(stated: &CameraModel<f64>, by: &Deviation) -> CameraModel<f64> {
    let mut camera = *stated;
    let (focal, center, first) = match &mut camera {
        CameraModel::PinholeRadTan(model) => (&mut model.focal_px, &mut model.center_px, &mut model.distortion[0]),
        CameraModel::KannalaBrandt(model) => (&mut model.focal_px, &mut model.center_px, &mut model.distortion[0]),
    };
    for axis in 0..2 {
        center[axis] += by[2 + axis] * focal[axis];
        focal[axis] *= by[axis].exp();
    }
    *first += by[4];
    camera
}
