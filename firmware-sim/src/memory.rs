//! All the memory that the estimator lives in.

use libella_core::estimator::{DepthConfig, EstimatorConfig, Place, PlaneConfig};
use libella_core::imu::ImuNoise;
use libella_core::profile::{Micro, MicroPyramids};

use crate::replay::Replay;

/// Bytes of the estimator and of the pyramids that it reads.
pub const BYTES: usize = size_of::<Micro>() + size_of::<MicroPyramids>();

/// Makes the estimator for a recording where it will live: it is as large as most of the memory, so it must not exist twice.
#[inline(never)]
pub fn build<'a>(place: &'a mut Place<Micro>, replay: &Replay<'_>) -> &'a mut Micro {
    place.make(settings(replay.imu_noise()), replay.camera(), replay.body_from_camera())
}

/// Settings for 160 pixels across: a keyframe after the same angle as on 752, and corners as sharp as averaging leaves them.
///
/// Measured at 160x120 with planes on the rendered V1_01 and V1_02 and on the real MH_01 (`accuracy`): ATE 0.13, 0.24 and 0.03 m. Neighbouring
/// settings scatter by half of that: 0.12 px gives 0.13, 0.21 and 0.05 m, 0.18 px 0.22, 0.17 and 0.04 m. A start with depths comes after 0.2 s:
/// over 0.4 s six frames are so far apart that corners are lost between them, 0.167 instead of 0.108 m in the replay.
#[must_use]
pub fn settings(imu_noise: ImuNoise<f32>) -> EstimatorConfig<f32> {
    let planes = PlaneConfig { theta_m: 0.1, sigma_m: 0.04, ..PlaneConfig::default() };
    let depth = DepthConfig { shortest_start_s: 0.2, ..DepthConfig::default() };
    EstimatorConfig { imu_noise, keyframe_parallax_px: 4.6, sigma_px: 0.15, depth, planes, ..EstimatorConfig::default() }
}
