//! Where an estimator is made.

use nalgebra::Isometry3;

use super::{Estimator, EstimatorConfig};
use crate::camera::CameraModel;
use crate::real::Real;
use crate::storage::blank::Blank;

/// The memory of an estimator, before there is one: an estimator is as large as most of a small machine's memory and must not be put
/// together on the stack first.
///
/// All of it is zero, so that a `static` of it takes memory but no flash. It has the layout of the estimator itself.
///
/// # Example
/// ```
/// use libella_core::camera::PinholeRadTan;
/// use libella_core::estimator::{EstimatorConfig, Place};
/// use libella_core::profile::Micro;
/// use nalgebra::Isometry3;
/// static PLACE: std::sync::Mutex<Place<Micro>> = std::sync::Mutex::new(Place::new());
///
/// let camera = PinholeRadTan::new((160, 120), [106.0; 2], [79.5, 59.5], [0.0; 4])?;
/// let mut place = PLACE.lock().unwrap();
/// let estimator = place.make(EstimatorConfig::default(), camera.into(), Isometry3::identity());
/// assert!(estimator.state().is_none());
/// # Ok::<(), libella_core::camera::CameraError>(())
/// ```
#[derive(Debug)]
#[repr(transparent)]
pub struct Place<E>(E);

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Place<Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>>
{
    /// Zeros.
    #[must_use]
    pub const fn new() -> Self {
        Self(Estimator::BLANK)
    }

    /// Makes an estimator that waits for its first data, here. `body_from_camera` is the pose of the camera in the body (IMU) frame.
    ///
    /// One that was made here before is forgotten.
    #[inline(never)]
    pub fn make(
        &mut self,
        config: EstimatorConfig<T>,
        camera: CameraModel<T>,
        body_from_camera: Isometry3<T>,
    ) -> &mut Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES> {
        self.0 = Estimator::BLANK;
        self.0.configure(config, camera, body_from_camera);
        &mut self.0
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize> Default
    for Place<Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>>
{
    fn default() -> Self {
        Self::new()
    }
}
