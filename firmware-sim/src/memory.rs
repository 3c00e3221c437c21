//! All the memory that the estimator lives in.

use core::mem::MaybeUninit;

use libella_core::estimator::EstimatorConfig;
use libella_core::profile::{Micro, MicroPyramids};

use crate::replay::Replay;

/// Bytes of the estimator and of the pyramids that it reads.
pub const BYTES: usize = size_of::<Micro>() + size_of::<MicroPyramids>();

/// Builds the estimator for a recording where it will live.
///
/// It is as large as most of the memory, so it must not exist twice. The place is a reference that nothing else knows of, and the
/// constructor a call of its own: then the compiler has the constructor write straight to the place.
#[inline(never)]
pub fn build<'a>(place: &'a mut MaybeUninit<Micro>, replay: &Replay<'_>) -> &'a mut Micro {
    place.write(estimator(replay))
}

#[inline(never)]
fn estimator(replay: &Replay<'_>) -> Micro {
    let config = EstimatorConfig { imu_noise: replay.imu_noise(), ..EstimatorConfig::default() };
    Micro::new(config, replay.camera(), replay.body_from_camera())
}
