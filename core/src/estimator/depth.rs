//! What a depth map says becomes the priors of landmarks.

use nalgebra::{Vector2, Vector3};

use super::{DepthReport, Estimator, Health, InputError};
use crate::camera::Camera;
use crate::depth::{DepthSample, DepthView, Verdict};
use crate::real::Real;
use crate::time::Timestamp;
use crate::track::TrackId;
use crate::window::{CameraPose, DepthKnowledge, DepthSource, GivenDepth, Landmark};

/// Standard deviation of `ln λ` below which motion has told a depth well enough to judge others by.
const TOLD_SIGMA_LOG: f64 = 0.05;
impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// Takes the depth map of an image that was pushed, best before its [`step`](Self::step). The values are read during the call only.
    ///
    /// A map of an image that is left out while a start is computed is left out as well.
    ///
    /// # Errors
    /// When the window has no image of this time any more; nothing changes then.
    pub fn push_depth(&mut self, stamp: Timestamp, map: &DepthView<'_>) -> Result<(), InputError> {
        let camera = self.camera;
        self.take_depths(stamp, |_, corner| map.sample(&camera.project(&Vector3::new(corner.x, corner.y, T::one()))?))
    }

    /// The same for single corners, by the identity of their tracks; what is no positive number is unknown.
    ///
    /// # Errors
    /// When the window has no image of this time any more; nothing changes then.
    pub fn push_depths(&mut self, stamp: Timestamp, depths: &[(TrackId, DepthSample<T>)]) -> Result<(), InputError> {
        self.take_depths(stamp, |track, _| depths.iter().find(|(known, _)| *known == track).map(|(_, sample)| *sample))
    }

    fn take_depths(&mut self, stamp: Timestamp, sample: impl Fn(TrackId, &Vector2<T>) -> Option<DepthSample<T>>) -> Result<(), InputError> {
        let Some(frame) = self.window.frames.iter().rposition(|frame| frame.stamp == stamp) else {
            if self.attempt.is_under_way() && self.newest_image == Some(stamp) {
                return Ok(());
            }
            return Err(InputError::NoSuchImage(stamp));
        };
        let sample = |track: TrackId, corner: &Vector2<T>| sample(track, corner).filter(DepthSample::is_usable);
        self.workspace.geometry.update_camera_poses(&self.window.frames, &self.settings);
        let poses = &self.workspace.geometry.camera_poses[..self.window.frames.len()];
        let verdict = {
            let (mut log_ratios, mut log_depths) = ([T::ZERO; POINTS], [T::ZERO; POINTS]);
            let told = self.window.landmarks.iter().filter(|landmark| landmark.active).filter_map(|landmark| {
                let point = landmark.point(frame)?;
                let given = sample(landmark.track, &Vector2::new(point.x, point.y))?;
                Some((given.inverse_depth, told_by_motion(landmark, frame, poses)?))
            });
            let mut count = 0;
            for ((ratio, depth), (given, told)) in log_ratios.iter_mut().zip(&mut log_depths).zip(told) {
                (*ratio, *depth) = ((given / told).ln(), -told.ln());
                count += 1;
            }
            self.depth_scale.update(stamp, &mut log_ratios[..count], &mut log_depths[..count])
        };
        // What is not known of the common factor is one error of all of them: shared out, so that together they do not claim to know it.
        // A start has nothing else to go by.
        let starting = matches!(self.health, Health::Initialising(_) | Health::Lost);
        let sharing = if starting { T::ZERO } else { T::of(f64::from(self.window.seen_in(frame))) };
        let common = self.depth_scale.sigma_log() * self.depth_scale.sigma_log() * sharing;
        let mut given = 0;
        if verdict == Verdict::NoDepth {
            // What the source said before deserves no more.
            for landmark in self.window.landmarks.iter_mut().filter(|landmark| landmark.depth_source == DepthSource::Given) {
                landmark.depth_source = DepthSource::Usual;
            }
        }
        if verdict == Verdict::Believed {
            for landmark in &mut self.window.landmarks {
                let Some(point) = landmark.point(frame) else { continue };
                let Some(sample) = sample(landmark.track, &Vector2::new(point.x, point.y)) else { continue };
                let sample = self.depth_scale.apply(&sample);
                let Some(sigma_log) = self.config.depth.weighting.sigma_log(&sample) else { continue };
                let ray = Vector3::new(point.x, point.y, T::one());
                let here = GivenDepth {
                    inverse_depth: sample.inverse_depth,
                    inverse_sigma_log: T::one() / (sigma_log * sigma_log + common).root(),
                };
                if let Some(there) = in_anchor(landmark, frame, &ray, &here, poses) {
                    landmark.give(there);
                    given += 1;
                }
            }
        }
        self.start_with_depth = Some(Self::begin_with_depth);
        let (scale, sigma_log_scale) = (self.depth_scale.scale(), self.depth_scale.sigma_log());
        self.depth_report = Some(DepthReport { given, scale, sigma_log_scale, verdict });
        Ok(())
    }
}

/// The inverse depth along the axis of `frame` that the corners alone tell, where they tell it well.
fn told_by_motion<T: Real, const FRAMES: usize>(landmark: &Landmark<T, FRAMES>, frame: usize, poses: &[CameraPose<T>]) -> Option<T> {
    let mut trial = *landmark;
    let information = trial.refine(poses, &DepthKnowledge::none())?;
    let least = T::of(1.0 / TOLD_SIGMA_LOG);
    if !(trial.inverse_depth > T::ZERO && trial.inverse_depth * information.root() > least) {
        return None;
    }
    let (rotation, translation) = CameraPose::target_from_anchor(poses.get(frame)?, poses.get(landmark.anchor())?);
    let z = (rotation * trial.direction() + translation * trial.inverse_depth).z;
    if z > T::of(0.05) { Some(trial.inverse_depth / z) } else { None }
}

/// What is known of the inverse depth along `ray` of `frame`, as knowledge of that in the anchor.
fn in_anchor<T: Real, const FRAMES: usize>(
    landmark: &Landmark<T, FRAMES>,
    frame: usize,
    ray: &Vector3<T>,
    given: &GivenDepth<T>,
    poses: &[CameraPose<T>],
) -> Option<GivenDepth<T>> {
    if frame == landmark.anchor() {
        return Some(*given);
    }
    let (rotation, translation) = CameraPose::target_from_anchor(poses.get(landmark.anchor())?, poses.get(frame)?);
    given.seen_from((rotation * ray).z, translation.z)
}
