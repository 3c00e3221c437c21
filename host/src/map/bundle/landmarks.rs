//! Which landmarks take part, and where they are at first.

use libella_core::factor::reprojection::PairGeometry;
use libella_core::window::CameraPose;
use nalgebra::{Matrix3, Vector3};

use super::views::{from_world, residual, rows};
use super::{Bundle, BundleError, BundleSettings, Landmark};

/// Views that a landmark needs: with two, nothing tells a wrong one.
const LEAST_VIEWS: usize = 3;
/// Largest angle between two of its rays that a landmark needs, rad: at 458 px of focal length some 5 px, and with corners good to 0.4 px a
/// depth to a tenth. A point in world has no way to say that it may be anywhere beyond.
const LEAST_PARALLAX_RAD: f64 = 0.01;
/// Steps of a triangulation.
const STEPS: usize = 8;

impl Bundle {
    /// Places every landmark that does not take part by its views and the present poses; those that are seen well enough take part.
    ///
    /// # Errors
    /// When none is left.
    pub fn triangulate(&mut self) -> Result<(), BundleError> {
        let cameras = self.camera_poses();
        let pairs: Vec<_> = cameras.iter().map(from_world).collect();
        for landmark in self.landmarks.iter_mut().filter(|landmark| !landmark.used) {
            for view in &mut landmark.views {
                view.used = true;
            }
            if let Some(position) = placed(landmark, &cameras, &pairs, &self.settings) {
                landmark.position_in_world = position;
                judge(landmark, &cameras, &pairs, &self.settings);
            }
        }
        if self.landmarks.iter().any(|landmark| landmark.used) { Ok(()) } else { Err(BundleError::NoLandmarks) }
    }

    /// Judges all views of all landmarks anew by the present solution.
    pub fn judge(&mut self) {
        let cameras = self.camera_poses();
        let pairs: Vec<_> = cameras.iter().map(from_world).collect();
        for landmark in self.landmarks.iter_mut().filter(|landmark| landmark.used) {
            judge(landmark, &cameras, &pairs, &self.settings);
        }
    }
}

/// Takes views out that contradict the landmark, and the landmark where too little is left of it.
fn judge(landmark: &mut Landmark, cameras: &[CameraPose<f64>], pairs: &[PairGeometry<f64>], settings: &BundleSettings) {
    let at = landmark.position_in_world;
    let mut rays = Vec::with_capacity(landmark.views.len());
    for view in &mut landmark.views {
        let squared = pairs.get(view.keyframe).and_then(|pair| residual(pair, &at, &view.point)).map(|residual| residual.norm_squared());
        view.used = squared.is_some_and(|squared| squared < settings.outlier_chi2);
        if let Some(camera) = cameras.get(view.keyframe).filter(|_| view.used) {
            rays.push((at - camera.center_in_world).normalize());
        }
    }
    landmark.used = rays.len() >= LEAST_VIEWS && parallax_rad(&rays) >= LEAST_PARALLAX_RAD;
}

/// The largest angle between two of the directions. Views come in order and move on: the one farthest from the first, and the one
/// farthest from that.
fn parallax_rad(rays: &[Vector3<f64>]) -> f64 {
    let farthest = |from: &Vector3<f64>| {
        let angles = rays.iter().map(|ray| (ray.cross(from).norm().atan2(ray.dot(from)), ray));
        angles.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let second = rays.first().and_then(farthest);
    second.and_then(|(_, ray)| farthest(ray)).map_or(0.0, |(angle, _)| angle)
}

/// Where the rays come closest, then where the corners are explained best.
fn placed(
    landmark: &Landmark,
    cameras: &[CameraPose<f64>],
    pairs: &[PairGeometry<f64>],
    settings: &BundleSettings,
) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for view in &landmark.views {
        let camera = cameras.get(view.keyframe)?;
        let ray = (camera.world_from_camera * Vector3::new(view.point.x, view.point.y, 1.0)).normalize();
        let across = Matrix3::identity() - ray * ray.transpose();
        normal += across;
        right += across * camera.center_in_world;
    }
    let mut position = normal.cholesky()?.solve(&right);
    let mut cost = f64::INFINITY;
    for _ in 0..STEPS {
        let (mut hessian, mut gradient, mut now) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        for view in &landmark.views {
            let [x, y] = rows(pairs.get(view.keyframe)?, &position, &view.point)?;
            let squared = x.residual * x.residual + y.residual * y.residual;
            let weight = settings.kernel.weight(squared);
            now += settings.kernel.rho(squared);
            for row in [x, y] {
                let slope = Vector3::from(row.by_point);
                hessian += slope * slope.transpose() * weight;
                gradient += slope * (row.residual * weight);
            }
        }
        if now >= cost * (1.0 - 1e-6) || now.is_nan() {
            break;
        }
        cost = now;
        position -= hessian.cholesky()?.solve(&gradient);
    }
    position.iter().all(|value| value.is_finite()).then_some(position)
}
