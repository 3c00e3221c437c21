//! The sliding window: recent frames, keyframes, and the landmarks they see.

mod depth;
mod flow;
mod frame;
mod geometry;
mod landmark;
mod policy;

pub use depth::{DepthKnowledge, DepthPrior, DepthSource, GivenDepth};
pub use flow::{CommonFlow, Stillness};
pub use frame::Frame;
pub use geometry::CameraPose;
pub use landmark::{Landmark, NormalizedPoint};
pub use policy::Covisibility;

use heapless::Vec;
use nalgebra::Vector3;

use crate::imu::NavState;
use crate::real::Real;
use crate::storage::blank::{Blank, blank};
use crate::track::TrackId;

/// Frames from the oldest to the newest, and landmarks in no particular order.
#[derive(Debug)]
pub struct Window<T: Real, const FRAMES: usize, const POINTS: usize> {
    /// Where the positions of the frames are counted from, in world, whole m: it follows the body, because `f32` holds
    /// positions to 0.06 µm a metre away, but to 60 µm a kilometre away.
    pub origin_in_world: Vector3<T>,
    /// Oldest first. Each holds the inertial integral from its predecessor.
    pub frames: Vec<Frame<T>, FRAMES>,
    /// What the frames see.
    pub landmarks: Vec<Landmark<T, FRAMES>, POINTS>,
}

blank!([T: Real, const FRAMES: usize, const POINTS: usize] Window<T, FRAMES, POINTS> { origin_in_world, frames, landmarks };
    FRAMES >= 4 && FRAMES <= 32, "a window holds 4 to 32 frames");

impl<T: Real, const FRAMES: usize, const POINTS: usize> Default for Window<T, FRAMES, POINTS> {
    fn default() -> Self {
        Self::BLANK
    }
}

impl<T: Real, const FRAMES: usize, const POINTS: usize> Window<T, FRAMES, POINTS> {
    /// Forgets everything.
    pub fn clear(&mut self) {
        self.origin_in_world = Vector3::zeros();
        self.frames.clear();
        self.landmarks.clear();
    }

    /// Moves the origin by whole metres towards the newest frame where that is more than a metre away. Whole, because then no
    /// position that comes nearer to it is rounded.
    pub fn follow(&mut self) {
        let Some(newest) = self.frames.last() else { return };
        let step = newest.state.position_in_world.map(|value| value.round());
        if step.amax() <= T::one() || !step.iter().all(|value| value.is_usable()) {
            return;
        }
        self.origin_in_world += step;
        for frame in &mut self.frames {
            frame.state.position_in_world -= step;
            if let Some(first) = &mut frame.linearization {
                first.position_in_world -= step;
            }
        }
        for plane in self.landmarks.iter_mut().map(|landmark| &mut landmark.plane) {
            plane.offset_m += Vector3::from(plane.normal_in_world).dot(&step);
        }
    }

    /// The state of one of the frames, its position counted from the origin of the world.
    #[must_use]
    pub fn in_world(&self, state: &NavState<T>) -> NavState<T> {
        NavState { position_in_world: state.position_in_world + self.origin_in_world, ..*state }
    }

    /// Notes that the newest frame sees `track` at `point`, and returns where the frame before saw it. A new landmark is
    /// made where none has this track; without room it takes the place of the lost one that was seen least, or the
    /// observation is dropped where none is lost.
    pub fn observe(&mut self, track: TrackId, point: NormalizedPoint<T>) -> Option<NormalizedPoint<T>> {
        let newest = self.frames.len().checked_sub(1)?;
        if let Some(landmark) = self.landmarks.iter_mut().find(|landmark| landmark.track == track) {
            landmark.observe(newest, point);
            return landmark.point(newest.checked_sub(1)?).copied();
        }
        let landmark = Landmark::new(track, newest, point);
        if let Err(landmark) = self.landmarks.push(landmark) {
            // Two frames back: the tracks of this image may not all have been read yet.
            let is_lost = |known: &Landmark<T, FRAMES>| !known.is_seen_in(newest) && !known.is_seen_in(newest.saturating_sub(1));
            let least = self.landmarks.iter_mut().filter(|known| is_lost(known)).min_by_key(|known| known.observations());
            if let Some(place) = least {
                *place = landmark;
            }
        }
        None
    }

    /// Removes frame `index` and every observation made in it; landmarks anchored there move to their next frame.
    /// The inertial integral of the following frame is left as it is: join it first.
    pub fn remove_frame(&mut self, index: usize, camera_poses: &[CameraPose<T>]) {
        if index >= self.frames.len() {
            return;
        }
        for landmark in &mut self.landmarks {
            landmark.remove_frame(index, camera_poses);
        }
        self.frames.remove(index);
        self.landmarks.retain(|landmark| landmark.observations() > 0);
    }

    /// Number of landmarks that frame `index` sees.
    #[must_use]
    #[allow(clippy::cast_possible_truncation)] // no window holds as many
    pub fn seen_in(&self, index: usize) -> u32 {
        self.landmarks.iter().filter(|landmark| landmark.is_seen_in(index)).count() as u32
    }

    /// Index of the newest keyframe before `before`.
    #[must_use]
    pub fn last_keyframe(&self, before: usize) -> Option<usize> {
        self.frames.iter().take(before).rposition(|frame| frame.keyframe)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
