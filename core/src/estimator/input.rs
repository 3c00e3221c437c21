//! What comes in becomes a frame of the window.

use nalgebra::Vector2;

use super::{Estimator, InputError};
use crate::camera::Camera;
use crate::imu::{ImuSample, Preintegration};
use crate::real::Real;
use crate::time::Timestamp;
use crate::track::Observation;
use crate::window::{Frame, NormalizedPoint};

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// Stores one inertial sample.
    ///
    /// # Errors
    /// When the sample is not finite, not newer than the last, or no room is left; nothing changes then.
    pub fn push_imu(&mut self, sample: ImuSample<T>) -> Result<(), InputError> {
        self.inertial.push(sample, self.window.frames.last().map(|frame| frame.stamp))
    }

    /// Takes the corners of a new image from a front end of the caller's own. Push inertial samples past the image first.
    ///
    /// # Errors
    /// When the image is not newer than the last one, or inertial samples do not reach it; nothing changes then.
    pub fn push_tracks(&mut self, stamp: Timestamp, observations: &[Observation<T>]) -> Result<(), InputError> {
        self.open_frame(stamp)?;
        let (mut moved, mut shared) = (T::ZERO, 0_u32);
        let focal = self.camera.focal_px();
        for observation in observations {
            let Some(point) = self.normalize(&observation.pixel) else { continue };
            if let Some(before) = self.window.observe(observation.track, point) {
                let (dx, dy) = (point.x - before.x, point.y - before.y);
                moved += (dx * dx + dy * dy).root() * focal;
                shared += 1;
            }
        }
        self.image_motion_px = if shared > 0 { moved / T::of(f64::from(shared)) } else { T::of(1e3) };
        let newest = self.window.frames.len() - 1;
        self.window.landmarks.retain(|landmark| landmark.active || landmark.is_seen_in(newest));
        self.pending = true;
        Ok(())
    }

    /// Appends an empty frame whose state is predicted from the one before.
    fn open_frame(&mut self, stamp: Timestamp) -> Result<(), InputError> {
        if let Some(last) = self.window.frames.last() {
            if stamp <= last.stamp {
                return Err(InputError::Stale(last.stamp - stamp));
            }
        }
        let from = self.window.frames.last().map_or(stamp, |last| last.stamp);
        if !self.inertial.covers(from, stamp) {
            return Err(InputError::MissingImu(stamp));
        }
        while self.window.frames.is_full() {
            self.make_room();
        }
        let frame = match self.window.frames.last() {
            Some(last) => {
                let integral = self.inertial.integrate(&self.noise, last.state.bias, last.stamp, stamp);
                Frame::new(stamp, integral.predict(&last.state, &self.settings.gravity_in_world), integral)
            }
            None => {
                let state = crate::imu::NavState::origin();
                Frame::new(stamp, state, Preintegration::new(state.bias))
            }
        };
        // There is room: made above.
        let _ = self.window.frames.push(frame);
        Ok(())
    }

    /// A raw pixel on the plane `z = 1`, with its standard deviation there.
    fn normalize(&self, pixel: &Vector2<T>) -> Option<NormalizedPoint<T>> {
        let (point, jacobian) = self.camera.unproject_with_jacobian(pixel)?;
        let area = jacobian.determinant().abs();
        // Beyond about 75 degrees from the axis the plane stretches without bound.
        if !(point.norm_squared() < T::of(14.0) && area > T::ZERO) {
            return None;
        }
        Some(NormalizedPoint { x: point.x, y: point.y, inverse_sigma: T::one() / (self.config.sigma_px * area.root()) })
    }
}
