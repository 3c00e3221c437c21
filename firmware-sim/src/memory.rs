//! All the memory that the estimator lives in.

use libella_core::estimator::{EstimatorConfig, Place};
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
/// Measured at 160x120 on the rendered V1_01 and V1_02 and on the real MH_01 (`accuracy`): ATE 0.14, 0.17 and 0.07 m. Neighbouring
/// settings scatter by half of that: 0.1 px gives 0.17, 0.15 and 0.11 m, 0.2 px 0.14, 0.24 and 0.07 m.
#[must_use]
pub fn settings(imu_noise: ImuNoise<f32>) -> EstimatorConfig<f32> {
    EstimatorConfig { imu_noise, keyframe_parallax_px: 4.6, sigma_px: 0.15, ..EstimatorConfig::default() }
}
