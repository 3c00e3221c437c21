//! The one place that knows the order of events.

mod config;
mod output;

pub use config::EstimatorConfig;
pub use output::{FrameOutcome, Health, InputError, StateEstimate, StepBudget, Waiting};

use nalgebra::Isometry3;

use crate::camera::CameraModel;
use crate::image::{ImageView, PyramidPair};
use crate::imu::ImuSample;
use crate::real::Real;
use crate::time::Timestamp;
use crate::track::Observation;

/// Monocular visual-inertial odometry over a sliding window of `FRAMES` frames and at most `POINTS` landmarks;
/// `PAIRS = FRAMES (FRAMES + 1) / 2` blocks of the normal equations, `SAMPLES` pending inertial samples.
pub struct Estimator<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize> {
    config: EstimatorConfig<T>,
    camera: CameraModel<T>,
    body_from_camera: Isometry3<T>,
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// An estimator that waits for its first data.
    #[must_use]
    pub fn new(config: EstimatorConfig<T>, camera: CameraModel<T>, body_from_camera: Isometry3<T>) -> Self {
        Self { config, camera, body_from_camera }
    }

    /// Stores one inertial sample.
    ///
    /// # Errors
    /// When the sample is not finite, not newer than the last, or no room is left; nothing changes then.
    pub fn push_imu(&mut self, _sample: ImuSample<T>) -> Result<(), InputError> {
        Ok(())
    }

    /// Follows the corners into a new image. The pixels are read during the call only.
    ///
    /// # Errors
    /// When the image does not fit the camera or is not newer than the last one; nothing changes then.
    pub fn push_image<const BYTES: usize>(
        &mut self,
        _stamp: Timestamp,
        _image: &ImageView<'_>,
        _pyramids: &mut PyramidPair<BYTES>,
    ) -> Result<(), InputError> {
        Ok(())
    }

    /// Takes the corners of a new image from a front end of the caller's own.
    ///
    /// # Errors
    /// When the image is not newer than the last one; nothing changes then.
    pub fn push_tracks(&mut self, _stamp: Timestamp, _observations: &[Observation<T>]) -> Result<(), InputError> {
        Ok(())
    }

    /// Works on the frame that was pushed last: initialises, or solves and slides the window.
    pub fn step(&mut self, _budget: StepBudget) -> FrameOutcome {
        FrameOutcome::NoFrame
    }

    /// The newest state, once initialised.
    #[must_use]
    pub fn state(&self) -> Option<StateEstimate<T>> {
        let _ = (&self.config, &self.camera, &self.body_from_camera);
        None
    }

    /// How it goes.
    #[must_use]
    pub fn health(&self) -> Health {
        Health::Initialising(Waiting::Imu)
    }
}
