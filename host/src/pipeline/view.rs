//! What the estimator saw in one image, for eyes (corners, how far they are, where they are) and for the map.

use std::collections::BTreeMap;

use libella_core::camera::Camera;
use libella_core::estimator::{FrameOutcome, Health};
use libella_core::imu::{ImuBias, NavState};
use libella_core::plane::PlaneClass;
use libella_core::profile::Desktop;
use libella_core::real::Real;
use libella_core::time::Timestamp;
use libella_core::track::TrackId;
use libella_core::window::{CameraPose, NormalizedPoint};
use nalgebra::{Isometry3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use crate::calibration::Rig;
use crate::dataset::GrayImage;
use crate::map::{FrameState, Glance, SeenCorner};
use crate::network::DepthMap;
use crate::planes::{PlaneFinder, outline_in_image};

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

/// A steady plane, and where it is in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneInView {
    /// Its name in this run.
    pub id: usize,
    /// What it is in the room.
    pub class: PlaneClass,
    /// Corners of its extent in the estimator's world, m.
    pub polygon_in_world: Vec<Vector3<f64>>,
    /// Its outline in the image, raw px; empty where it is not in view, and where too few corners lie on it to say that nothing hides it.
    pub outline_px: Vec<[f64; 2]>,
}

/// An image as the estimator saw it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct View {
    /// The image, where there is one.
    pub image: Option<GrayImage>,
    /// The corners that the newest frame sees.
    pub corners: Vec<Corner>,
    /// Its depth, where something gave one.
    pub depth: Option<DepthMap>,
    /// Maps camera coordinates to the estimator's world, where the pose of the image is known.
    pub world_from_camera: Option<Isometry3<f64>>,
    /// The planes that are steady.
    pub planes: Vec<PlaneInView>,
}

/// Corners that must lie on a plane for its outline to be shown: without them it may be behind another.
const LEAST_CORNERS: usize = 3;

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
    let Some((_, camera_pose)) = newest else { return View { image, ..View::default() } };
    let index = camera_poses.len() - 1;
    let mut on_planes = BTreeMap::<usize, usize>::new();
    let corners = window.landmarks.iter().filter_map(|landmark| {
        let seen = landmark.point(index)?;
        let pixel = rig.camera.project(&Vector3::new(seen.x.as_f64(), seen.y.as_f64(), 1.0))?;
        let point = landmark.position_in_world(&camera_poses);
        let depth = point.map(|point| (camera_pose.world_from_camera.transpose() * (point - camera_pose.center_in_world)).z.as_f64());
        let point_in_world = point.map(|point| (point + window.origin_in_world).map(Real::as_f64));
        let plane = point_in_world.and_then(|point| planes?.plane_at(&point));
        if let Some((name, _)) = plane {
            *on_planes.entry(name).or_default() += 1;
        }
        Some(Corner {
            track: landmark.track,
            pixel: [pixel.x, pixel.y],
            depth_m: depth.filter(|depth| *depth > 0.0),
            point_in_world,
            plane: plane.map(|(_, class)| class),
        })
    });
    let corners = corners.collect();
    let rotation = Rotation3::from_matrix_unchecked(camera_pose.world_from_camera.map(Real::as_f64));
    let center = (camera_pose.center_in_world + window.origin_in_world).map(Real::as_f64);
    let world_from_camera = Isometry3::from_parts(center.into(), rotation.into());
    let planes = planes.into_iter().flat_map(PlaneFinder::steady).map(|(id, class, polygon_in_world)| {
        let is_seen = on_planes.get(&id).is_some_and(|corners| *corners >= LEAST_CORNERS);
        let outline = is_seen.then(|| outline_in_image(&polygon_in_world, &world_from_camera.inverse(), &rig.camera)).flatten();
        PlaneInView { id, class, polygon_in_world, outline_px: outline.unwrap_or_default() }
    });
    let known = estimator.state().is_some_and(|state| state.stamp == stamp);
    View { image, corners, depth: None, world_from_camera: known.then_some(world_from_camera), planes: planes.collect() }
}

/// The window of an estimator after the image of `stamp`.
pub(super) fn glance<T: Real>(estimator: &Desktop<T>, stamp: Timestamp, outcome: FrameOutcome) -> Glance {
    let window = estimator.window();
    let frames: Vec<_> = window
        .frames
        .iter()
        .map(|frame| FrameState {
            stamp: frame.stamp,
            state: in_f64(&window.in_world(&frame.state)),
            keyframe: frame.keyframe,
            at_rest: frame.at_rest,
        })
        .collect();
    let newest = frames.last().filter(|newest| newest.stamp == stamp).map(|_| frames.len() - 1);
    let corners = window.landmarks.iter().filter_map(|landmark| {
        let seen = landmark.point(newest?)?;
        let point = NormalizedPoint { x: seen.x.as_f64(), y: seen.y.as_f64(), inverse_sigma: seen.inverse_sigma.as_f64() };
        Some(SeenCorner { track: landmark.track, point })
    });
    let initialised = matches!(estimator.health(), Health::Tracking | Health::Degraded);
    Glance { stamp, outcome, initialised, corners: corners.collect(), frames }
}

/// The state in double precision.
pub(super) fn in_f64<T: Real>(state: &NavState<T>) -> NavState<f64> {
    let wide = |vector: &Vector3<T>| vector.map(Real::as_f64);
    let q = state.world_from_body.quaternion();
    NavState {
        world_from_body: UnitQuaternion::new_normalize(Quaternion::new(q.w.as_f64(), q.i.as_f64(), q.j.as_f64(), q.k.as_f64())),
        position_in_world: wide(&state.position_in_world),
        velocity_in_world: wide(&state.velocity_in_world),
        bias: ImuBias { gyro_rad_s: wide(&state.bias.gyro_rad_s), accel_m_s2: wide(&state.bias.accel_m_s2) },
    }
}
