//! What the estimator saw in one image: corners, how far they are, where they are.

use libella_core::camera::Camera;
use libella_core::plane::PlaneClass;
use libella_core::profile::Desktop;
use libella_core::real::Real;
use libella_core::time::Timestamp;
use libella_core::track::TrackId;
use libella_core::window::CameraPose;
use nalgebra::Vector3;

use crate::calibration::Rig;
use crate::dataset::GrayImage;
use crate::network::DepthMap;
use crate::planes::PlaneFinder;

/// A corner in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Its name while it is followed.
    pub track: TrackId,
    /// Where it is, raw px.
    pub pixel: [f64; 2],
    /// Its depth along the optical axis, m, once it is known.
    pub depth_m: Option<f64>,
    /// Where it is in the estimator's world, m, once its depth is known.
    pub point_in_world: Option<Vector3<f64>>,
    /// What the plane is that it lies on, where it lies on a steady one.
    pub plane: Option<PlaneClass>,
}

/// An image as the estimator saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The image, where there is one.
    pub image: Option<GrayImage>,
    /// The corners that the newest frame sees.
    pub corners: Vec<Corner>,
    /// Its depth, where something gave one.
    pub depth: Option<DepthMap>,
}

/// The newest frame of an estimator, if it is the one of `stamp`.
pub(super) fn of<T: Real>(
    estimator: &Desktop<T>,
    rig: &Rig,
    stamp: Timestamp,
    image: Option<GrayImage>,
    planes: Option<&PlaneFinder>,
) -> View {
    let window = estimator.window();
    let body_from_camera = rig.body_from_camera_as::<T>();
    let camera_poses: Vec<CameraPose<T>> = window.frames.iter().map(|frame| CameraPose::of(&frame.state, &body_from_camera)).collect();
    let newest = window.frames.last().zip(camera_poses.last()).filter(|(frame, _)| frame.stamp == stamp);
    let Some((_, camera_pose)) = newest else { return View { image, corners: Vec::new(), depth: None } };
    let index = camera_poses.len() - 1;
    let corners = window.landmarks.iter().filter_map(|landmark| {
        let seen = landmark.point(index)?;
        let pixel = rig.camera.project(&Vector3::new(seen.x.as_f64(), seen.y.as_f64(), 1.0))?;
        let point = landmark.position_in_world(&camera_poses);
        let depth = point.map(|point| (camera_pose.world_from_camera.transpose() * (point - camera_pose.center_in_world)).z.as_f64());
        let point_in_world = point.map(|point| (point + window.origin_in_world).map(Real::as_f64));
        Some(Corner {
            track: landmark.track,
            pixel: [pixel.x, pixel.y],
            depth_m: depth.filter(|depth| *depth > 0.0),
            point_in_world,
            plane: point_in_world.and_then(|point| planes?.class_at(&point)),
        })
    });
    View { image, corners: corners.collect(), depth: None }
}
