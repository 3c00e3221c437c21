//! A depth map with the place that it was taken from: what it says of points and surfaces in world.
//!
//! # Model
//! With the source's common factor `s` and its inverse depth `λ`, a value of the map is the point, and its distance from a plane through it is
//! known to
//! ```text
//! x_W = T_WC (s/λ) K⁻¹ (i, j, 1)          σ_n = |nᵀ(x_W − c_W)| σ
//! ```
//! `σ` of `ln λ`, `c_W` the camera, `n` the surface's normal: what counts is how far the camera is from the *plane*, not from the point, because depth
//! moves a point along its ray. `s` is the factor between the source and this world, whatever the scale of either: it adds nothing here.

use libella_core::camera::{Camera, CameraModel};
use libella_core::depth::{DepthSample, DepthView, normal};
use nalgebra::{Isometry3, Vector2, Vector3};

/// Half the distance, on the image plane at focal length 1, between the values that a normal is taken from: 12 cm to either side at 3 m.
const NORMAL_REACH: f64 = 0.04;

/// The error of a normal, rad, per standard deviation of the logarithm of the depths that it is taken from: measured on `indoor` in rendered rooms.
const NORMAL_PER_SIGMA: f64 = 1.5;
/// A normal whose error is beyond this, rad, about each axis, says nothing: of those within, 19 of 20 are within 15° of the truth.
const MOST_NORMAL_SIGMA: f64 = 0.107;

/// A depth map and its place.
#[derive(Debug, Clone, Copy)]
pub struct DepthLook<'a> {
    /// What the source says.
    pub map: DepthView<'a>,
    /// The camera of the image.
    pub camera: &'a CameraModel<f64>,
    /// `T_WC`.
    pub world_from_camera: Isometry3<f64>,
    /// Factor from the source's depths to metres of this world.
    pub scale: f64,
}

/// What a map says along one ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthReading {
    /// Where in the image, raw px.
    pub pixel: Vector2<f64>,
    /// In world, m.
    pub point_in_world: Vector3<f64>,
    /// Depth along the optical axis, m.
    pub depth_m: f64,
    /// Standard deviation of its logarithm.
    pub sigma_log: f64,
    /// The source's own doubt `u`.
    pub uncertainty: f64,
}

impl DepthReading {
    /// Whether normals from such depths are sure.
    #[must_use]
    pub fn tells_normals(&self) -> bool {
        NORMAL_PER_SIGMA * self.sigma_log <= MOST_NORMAL_SIGMA
    }
}

impl DepthLook<'_> {
    /// Where the camera is, m.
    #[must_use]
    pub fn center_in_world(&self) -> Vector3<f64> {
        self.world_from_camera.translation.vector
    }

    /// Value `(i, j)` of the map.
    #[must_use]
    pub fn value(&self, i: usize, j: usize) -> Option<DepthReading> {
        let sample = self.map.value::<f64>(i, j)?;
        let pixel = self.map.pixel(i, j);
        let (ray, _) = self.camera.unproject_with_jacobian(&pixel)?;
        Some(self.reading(pixel, &ray, &sample))
    }

    /// What the map says where a point in world is seen, with the depth that the point itself has, m.
    #[must_use]
    pub fn towards(&self, point_in_world: &Vector3<f64>) -> Option<(DepthReading, f64)> {
        let point_in_camera = self.world_from_camera.inverse_transform_point(&(*point_in_world).into()).coords;
        if point_in_camera.z <= 0.05 {
            return None;
        }
        let pixel = self.camera.project(&point_in_camera)?;
        let sample = self.map.sample(&pixel)?;
        let ray = point_in_camera.xy() / point_in_camera.z;
        Some((self.reading(pixel, &ray, &sample), point_in_camera.z))
    }

    fn reading(&self, pixel: Vector2<f64>, ray: &Vector2<f64>, sample: &DepthSample<f64>) -> DepthReading {
        let depth_m = self.scale / sample.inverse_depth;
        let point_in_camera = Vector3::new(ray.x, ray.y, 1.0) * depth_m;
        DepthReading {
            pixel,
            point_in_world: self.world_from_camera.transform_point(&point_in_camera.into()).coords,
            depth_m,
            sigma_log: sample.sigma_log,
            uncertainty: sample.uncertainty,
        }
    }

    /// The normal in world at value `(i, j)`, turned towards the camera.
    #[must_use]
    pub fn normal(&self, i: usize, j: usize) -> Option<Vector3<f64>> {
        let step_px = (self.map.pixel::<f64>(1, 0) - self.map.pixel::<f64>(0, 0)).x;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // between 1 and 64
        let shift = (NORMAL_REACH * self.camera.focal_px() / step_px).round().clamp(1.0, 64.0) as usize;
        Some(self.world_from_camera.rotation * normal(&self.map, self.camera, (i, j), shift)?)
    }

    /// The same of the value nearest to a reading; `None` where the depths are not good enough for a normal.
    #[must_use]
    pub fn sure_normal(&self, reading: &DepthReading) -> Option<Vector3<f64>> {
        if !reading.tells_normals() {
            return None;
        }
        let (width, height) = self.map.size();
        let (first, second) = (self.map.pixel::<f64>(0, 0), self.map.pixel::<f64>(1, 1));
        let place = |axis: usize, count: usize| {
            let at = ((reading.pixel[axis] - first[axis]) / (second[axis] - first[axis])).round();
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss)]
            (0.0..count as f64).contains(&at).then_some(at as usize)
        };
        self.normal(place(0, width)?, place(1, height)?)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use libella_core::camera::PinholeRadTan;
    use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

    use super::*;

    const SIZE: (usize, usize) = (40, 30);

    fn camera() -> CameraModel<f64> {
        CameraModel::PinholeRadTan(PinholeRadTan {
            size_px: (320, 240),
            focal_px: [200.0; 2],
            center_px: [160.0, 120.0],
            distortion: [0.0; 4],
        })
    }

    /// What a camera at `center` that looks along `x` is told of the wall `x = at_m`; the source's depths are half of ours.
    pub fn at_wall<R>(at_m: f64, center: [f64; 3], sigma_log: f32, tell: impl FnOnce(&DepthLook<'_>) -> R) -> R {
        let axes = Matrix3::from_columns(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        #[allow(clippy::cast_possible_truncation)]
        let inverse = [(2.0 / (at_m - center[0])) as f32; SIZE.0 * SIZE.1];
        let (sigmas, doubts) = ([sigma_log; SIZE.0 * SIZE.1], [0.1; SIZE.0 * SIZE.1]);
        let map = DepthView::new(SIZE, [8.0; 2], [4.0; 2], &inverse, &sigmas, &doubts).unwrap();
        let world_from_camera = Isometry3::from_parts(Vector3::from(center).into(), rotation);
        tell(&DepthLook { map, camera: &camera(), world_from_camera, scale: 2.0 })
    }

    #[test]
    fn a_wall_is_where_it_is_and_looks_at_the_camera() {
        at_wall(2.0, [0.5, 0.0, 1.0], 0.05, |look| {
            let reading = look.value(10, 20).unwrap();
            assert!((reading.point_in_world.x - 2.0).abs() < 1e-6 && (reading.depth_m - 1.5).abs() < 1e-6);
            // Left of the middle, and below it.
            assert!(reading.point_in_world.y > 0.0 && reading.point_in_world.z < 1.0);
            assert!((look.normal(10, 20).unwrap() + Vector3::x()).norm() < 1e-5);
        });
    }

    #[test]
    fn a_point_is_asked_for_where_it_is_seen() {
        let before = Vector3::new(1.5, 0.2, 1.1);
        at_wall(2.0, [0.5, 0.0, 1.0], 0.05, |look| {
            let (reading, depth_m) = look.towards(&before).unwrap();
            assert!((reading.depth_m - 1.5).abs() < 1e-6 && (depth_m - 1.0).abs() < 1e-12);
            assert!((look.sure_normal(&reading).unwrap() + Vector3::x()).norm() < 1e-5);
            assert_eq!(look.towards(&Vector3::new(-1.0, 0.0, 1.0)), None, "behind the camera");
            assert_eq!(look.towards(&Vector3::new(1.0, 5.0, 1.0)), None, "outside of the image");
        });
        at_wall(2.0, [0.5, 0.0, 1.0], 0.1, |look| {
            let (reading, _) = look.towards(&before).unwrap();
            assert_eq!(look.sure_normal(&reading), None, "10 % of noise say nothing of a normal");
        });
    }
}
