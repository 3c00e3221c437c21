//! Between C's structures and those of the core.

use core::ffi::CStr;

use libella_core::camera::{CameraModel, KannalaBrandt, PinholeRadTan};
use libella_core::estimator::{EstimatorConfig, FrameOutcome, Health, InputError, PlaneConfig, StateEstimate, Waiting};
use libella_core::imu::ImuNoise;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use libella_core::plane::{PlaneClass, PlaneId, TrackedPlane};

use crate::types::{
    LIBELLA_PLANE_CORNERS, LibellaConfig, LibellaHealth, LibellaLens, LibellaOutcome, LibellaPlane, LibellaPlaneClass, LibellaPose,
    LibellaProfile, LibellaStatus,
};

/// The camera of a configuration, its pose on the body and the settings; `None` where a number cannot be.
#[must_use]
pub fn settings(config: &LibellaConfig) -> Option<(EstimatorConfig<f32>, CameraModel<f32>, Isometry3<f32>)> {
    let LibellaConfig { focal_px, center_px, distortion, .. } = *config;
    let size_px = (config.width_px, config.height_px);
    let camera = if config.lens == LibellaLens::PinholeRadTan as u32 {
        CameraModel::PinholeRadTan(PinholeRadTan { size_px, focal_px, center_px, distortion })
    } else if config.lens == LibellaLens::KannalaBrandt as u32 {
        CameraModel::KannalaBrandt(KannalaBrandt { size_px, focal_px, center_px, distortion })
    } else {
        return None;
    };
    camera.validate().ok()?;
    let [w, x, y, z] = config.body_from_camera_wxyz;
    let quaternion = Quaternion::new(w, x, y, z);
    let noise = [config.gyro_noise_density, config.accel_noise_density, config.gyro_random_walk, config.accel_random_walk];
    let positive = |value: f32| value.is_finite() && value > 0.0;
    let is_possible = positive(quaternion.norm_squared())
        && config.camera_in_body_m.iter().all(|value| value.is_finite())
        && noise.into_iter().all(positive)
        && [config.gravity_m_s2, config.sigma_px, config.keyframe_parallax_px].into_iter().all(positive);
    let [tx, ty, tz] = config.camera_in_body_m;
    let [gyro_noise_density, accel_noise_density, gyro_random_walk, accel_random_walk] = noise;
    let imu_noise = ImuNoise { gyro_noise_density, accel_noise_density, gyro_random_walk, accel_random_walk };
    let LibellaConfig { gravity_m_s2, sigma_px, keyframe_parallax_px, .. } = *config;
    // Landmarks of small images are known to a decimetre, as in the firmware.
    let is_micro = config.profile == LibellaProfile::Micro as u32;
    let usual = PlaneConfig::default();
    let planes = if is_micro { PlaneConfig { theta_m: 0.1, sigma_m: 0.04, ..usual } } else { usual };
    let settings = EstimatorConfig { imu_noise, gravity_m_s2, sigma_px, keyframe_parallax_px, planes, ..EstimatorConfig::default() };
    let body_from_camera = Isometry3::from_parts(Translation3::new(tx, ty, tz), UnitQuaternion::new_normalize(quaternion));
    is_possible.then_some((settings, camera, body_from_camera))
}

/// A plane.
#[must_use]
pub fn plane<const CORNERS: usize>(id: PlaneId, known: &TrackedPlane<f32, CORNERS>) -> LibellaPlane {
    let mut corners_in_world_m = [[0.0; 3]; LIBELLA_PLANE_CORNERS];
    let mut corner_count = 0;
    for (place, corner) in corners_in_world_m.iter_mut().zip(known.polygon.corners()) {
        *place = known.plane.lift(*corner).into();
        corner_count += 1;
    }
    LibellaPlane {
        id: id.number(),
        class_: match known.class {
            PlaneClass::Floor => LibellaPlaneClass::Floor,
            PlaneClass::Ceiling => LibellaPlaneClass::Ceiling,
            PlaneClass::Wall => LibellaPlaneClass::Wall,
            PlaneClass::Table => LibellaPlaneClass::Table,
            _ => LibellaPlaneClass::OtherPlane,
        },
        normal_in_world: known.plane.normal_in_world.into_inner().into(),
        offset_m: known.plane.offset_m,
        support: known.inliers,
        corner_count,
        corners_in_world_m,
        first_seen_ns: known.first_seen.as_nanos(),
        last_seen_ns: known.last_seen.as_nanos(),
    }
}

/// The status of a refusal.
#[must_use]
pub fn status(result: Result<(), InputError>) -> LibellaStatus {
    match result {
        Ok(()) => LibellaStatus::Ok,
        Err(InputError::NotFinite(_)) => LibellaStatus::NotFinite,
        Err(InputError::Stale(_)) => LibellaStatus::Stale,
        Err(InputError::WrongImageSize { .. } | InputError::PyramidTooSmall { .. }) => LibellaStatus::BadImage,
        Err(InputError::MissingImu(_)) => LibellaStatus::MissingImu,
        Err(InputError::Full) => LibellaStatus::Full,
        Err(_) => LibellaStatus::Refused,
    }
}

/// The outcome of an image.
#[must_use]
pub fn outcome(outcome: FrameOutcome) -> LibellaOutcome {
    match outcome {
        FrameOutcome::NoFrame => LibellaOutcome::NoFrame,
        FrameOutcome::NeedImu => LibellaOutcome::WaitsForImu,
        FrameOutcome::Initialising(waiting) => match waiting {
            Waiting::Imu => LibellaOutcome::WaitsForImu,
            Waiting::Tracks => LibellaOutcome::WaitsForTracks,
            Waiting::Parallax => LibellaOutcome::WaitsForParallax,
            Waiting::Excitation => LibellaOutcome::WaitsForExcitation,
            Waiting::Gravity => LibellaOutcome::WaitsForGravity,
            Waiting::Agreement => LibellaOutcome::WaitsForAgreement,
            Waiting::Computation => LibellaOutcome::ComputesItsStart,
            _ => LibellaOutcome::Other,
        },
        FrameOutcome::Initialised => LibellaOutcome::Initialised,
        FrameOutcome::Tracked => LibellaOutcome::Tracked,
        FrameOutcome::NewKeyframe => LibellaOutcome::NewKeyframe,
        FrameOutcome::Coasted => LibellaOutcome::Coasted,
        FrameOutcome::Lost => LibellaOutcome::Lost,
        _ => LibellaOutcome::Other,
    }
}

/// How the estimator is.
#[must_use]
pub fn health(health: Health) -> LibellaHealth {
    match health {
        Health::Tracking => LibellaHealth::Tracking,
        Health::Degraded => LibellaHealth::Degraded,
        Health::Lost => LibellaHealth::Lost,
        _ => LibellaHealth::Initialising,
    }
}

/// The newest state.
#[must_use]
pub fn pose(estimate: &StateEstimate<f32>) -> LibellaPose {
    let state = &estimate.state;
    let array = |v: &Vector3<f32>| [v.x, v.y, v.z];
    let q = state.world_from_body.quaternion();
    let mut sigma = [0.0; 6];
    for (k, sigma) in sigma.iter_mut().enumerate() {
        *sigma = libella_core::real::Real::root(estimate.pose_covariance[(k, k)]);
    }
    LibellaPose {
        stamp_ns: estimate.stamp.as_nanos(),
        position_in_world_m: array(&state.position_in_world),
        world_from_body_wxyz: [q.w, q.i, q.j, q.k],
        velocity_in_world_m_s: array(&state.velocity_in_world),
        gyro_bias_rad_s: array(&state.bias.gyro_rad_s),
        accel_bias_m_s2: array(&state.bias.accel_m_s2),
        sigma,
    }
}

/// What a status means.
#[must_use]
pub fn status_text(status: u32) -> &'static CStr {
    match status {
        0 => c"done",
        1 => c"a pointer is null",
        2 => c"the memory is smaller than libella_size says",
        3 => c"the memory is not aligned to libella_alignment",
        4 => c"the handle was not made by libella_init",
        5 => c"a number of the configuration is unknown, not finite or out of range",
        6 => c"a reading is not a finite number",
        7 => c"a time stamp is not newer than the last of its kind",
        8 => c"width, height or stride of the image do not fit each other or the camera",
        9 => c"inertial samples do not reach the image: push samples past it first",
        10 => c"no room for more inertial samples before the next image, or for as many tracks",
        11 => c"there is no pose: not initialised, or lost",
        12 => c"refused",
        _ => c"unknown status",
    }
}
