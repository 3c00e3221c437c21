//! What comes in becomes a frame of the window.

use nalgebra::{Vector2, Vector3};

use super::{Estimator, InputError};
use crate::camera::Camera;
use crate::image::{ImageView, PyramidPair};
use crate::imu::{ImuSample, Preintegration};
use crate::real::Real;
use crate::time::Timestamp;
use crate::track::Observation;
use crate::window::{CommonFlow, Frame, NormalizedPoint};

/// A corner that moved by this many times what ends stillness moved by itself.
const STRAY: f64 = 8.0;

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
        if self.open_frame(stamp)? {
            for observation in observations {
                self.observe(observation);
            }
            self.close_frame();
        }
        (self.newest_image, self.pending) = (Some(stamp), true);
        Ok(())
    }

    /// Follows the corners into a new image. The pixels are read during the call only; the pyramids must be the same in every
    /// call. Push inertial samples past the image first.
    ///
    /// # Errors
    /// When the image does not fit the camera, is not newer than the last one, or inertial samples do not reach it; nothing changes then.
    pub fn push_image<const BYTES: usize>(
        &mut self,
        stamp: Timestamp,
        image: &ImageView<'_>,
        pyramids: &mut PyramidPair<BYTES>,
    ) -> Result<(), InputError> {
        let (width, height) = self.camera.size_px();
        let (given, expected) = ((image.width(), image.height()), (width as usize, height as usize));
        if given != expected {
            return Err(InputError::WrongImageSize { given, expected });
        }
        let joins = self.open_frame(stamp)?;
        let rotation = self.last_image.map(|last| {
            let bias = self.window.frames.last().map_or_else(Vector3::zeros, |frame| frame.state.bias.gyro_rad_s);
            let camera = self.settings.body_from_camera.rotation;
            camera.inverse() * self.inertial.rotation(&bias, last, stamp).inverse() * camera
        });
        if self.front_end.process(image, pyramids, &self.camera, rotation).is_err() {
            if joins {
                self.window.frames.pop();
            }
            return Err(InputError::PyramidTooSmall { bytes: BYTES });
        }
        self.last_image = Some(stamp);
        if joins {
            for i in 0..self.front_end.tracks().len() {
                let Some(observation) = self.front_end.observations::<T>().nth(i) else { break };
                self.observe(&observation);
            }
            self.close_frame();
        }
        (self.newest_image, self.pending) = (Some(stamp), true);
        Ok(())
    }

    fn observe(&mut self, observation: &Observation<T>) {
        let Some(point) = self.normalize(&observation.pixel) else { return };
        if let Some(before) = self.window.observe(observation.track, point) {
            self.image_motion.add(&before, &point);
        }
    }

    fn close_frame(&mut self) {
        let newest = self.window.frames.len() - 1;
        self.stillness.update(&self.image_motion, self.window.frames[newest].stamp, self.rest_motion());
        self.window.landmarks.retain(|landmark| landmark.active || landmark.is_seen_in(newest));
    }

    /// Appends an empty frame whose state is predicted from the one before; `false` where the image is left out of the window.
    fn open_frame(&mut self, stamp: Timestamp) -> Result<bool, InputError> {
        if let Some(last) = self.newest_image.filter(|last| stamp <= *last) {
            return Err(InputError::Stale(last - stamp));
        }
        let from = self.window.frames.last().map_or(stamp, |last| last.stamp);
        if !self.inertial.covers(from, stamp) {
            return Err(InputError::MissingImu(stamp));
        }
        if self.leaves_out(stamp) {
            return Ok(false);
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
        self.image_motion = self.no_flow();
        // There is room: made above.
        let _ = self.window.frames.push(frame);
        Ok(true)
    }

    /// The common displacement that ends stillness, on the plane `z = 1`.
    fn rest_motion(&self) -> T {
        self.config.rest_motion_px / self.camera.focal_px()
    }

    /// Sums for how an image as a whole moves, corners that move by themselves left out.
    pub(super) fn no_flow(&self) -> CommonFlow<T> {
        CommonFlow::within(self.rest_motion() * T::of(STRAY))
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
