//! What the causal pass leaves behind for the map: which frames it kept, where they were, what they saw.
//!
//! An epoch lasts from one initialisation to the next loss: nothing ties two of them together, so each is a world of its own.

use std::collections::BTreeMap;

use libella_core::estimator::FrameOutcome;
use libella_core::imu::NavState;
use libella_core::time::Timestamp;
use libella_core::track::TrackId;
use libella_core::window::NormalizedPoint;

/// A corner as the estimator used it: undistorted, with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenCorner {
    /// Its name while it is followed.
    pub track: TrackId,
    /// Where it is on the plane `z = 1` of the camera.
    pub point: NormalizedPoint<f64>,
}

/// A frame of the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameState {
    /// Time of its image.
    pub stamp: Timestamp,
    /// The present estimate.
    pub state: NavState<f64>,
    /// Whether it stays when it is no longer recent.
    pub keyframe: bool,
    /// Whether the body was found at rest.
    pub at_rest: bool,
}

/// The window after one image was worked on.
#[derive(Debug, Clone, PartialEq)]
pub struct Glance {
    /// Time of the image.
    pub stamp: Timestamp,
    /// What became of it.
    pub outcome: FrameOutcome,
    /// Whether the states mean anything yet.
    pub initialised: bool,
    /// All frames, oldest first.
    pub frames: Vec<FrameState>,
    /// What the newest one sees.
    pub corners: Vec<SeenCorner>,
}

/// An image with a state.
#[derive(Debug, Clone, PartialEq)]
pub struct EpochFrame {
    /// What the window knew of it last.
    pub known: FrameState,
    /// What it sees.
    pub corners: Vec<SeenCorner>,
    /// Whether there was a pose as soon as it had been worked on: initialisation looks back on images that had none.
    pub causal: bool,
}

/// A stretch without a loss.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Epoch {
    /// Images in the order of time, those that initialisation looked back on included.
    pub frames: Vec<EpochFrame>,
}

/// A whole flight.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FlightRecord {
    /// In the order of time.
    pub epochs: Vec<Epoch>,
}

/// Gathers glances as they come.
#[derive(Debug, Default)]
pub struct Recorder {
    finished: Vec<Epoch>,
    current: BTreeMap<Timestamp, EpochFrame>,
    /// Corners of images that have no state yet.
    waiting: BTreeMap<Timestamp, Vec<SeenCorner>>,
}

impl Recorder {
    /// Takes in the window after one more image.
    pub fn add(&mut self, glance: Glance) {
        if matches!(glance.outcome, FrameOutcome::Initialised | FrameOutcome::Lost) {
            self.close();
        }
        self.waiting.insert(glance.stamp, glance.corners);
        // An image that has left the window without a state never gets one.
        if let Some(oldest) = glance.frames.first() {
            self.waiting = self.waiting.split_off(&oldest.stamp);
        }
        if !glance.initialised {
            return;
        }
        for known in glance.frames.into_iter().filter(|known| known.state.is_finite()) {
            if let Some(frame) = self.current.get_mut(&known.stamp) {
                frame.known = known;
            } else if let Some(corners) = self.waiting.remove(&known.stamp) {
                self.current.insert(known.stamp, EpochFrame { known, corners, causal: known.stamp == glance.stamp });
            }
        }
    }

    fn close(&mut self) {
        let frames: Vec<_> = std::mem::take(&mut self.current).into_values().collect();
        if !frames.is_empty() {
            self.finished.push(Epoch { frames });
        }
    }

    /// All of the flight.
    #[must_use]
    pub fn finish(mut self) -> FlightRecord {
        self.close();
        FlightRecord { epochs: self.finished }
    }
}

#[cfg(test)]
mod tests {
    use libella_core::estimator::Waiting;

    use super::*;

    fn at(k: i64) -> Timestamp {
        Timestamp::from_nanos(k * 50_000_000)
    }

    fn glance(outcome: FrameOutcome, frames: std::ops::RangeInclusive<i64>, keyframes: &[i64]) -> Glance {
        let newest = *frames.end();
        let state = |k| FrameState { stamp: at(k), state: NavState::origin(), keyframe: keyframes.contains(&k), at_rest: false };
        let initialised = !matches!(outcome, FrameOutcome::Initialising(_) | FrameOutcome::Lost);
        let point = NormalizedPoint { x: 0.0, y: 0.0, inverse_sigma: 400.0 };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let corners = vec![SeenCorner { track: TrackId(newest as u32), point }];
        Glance { stamp: at(newest), outcome, initialised, frames: frames.map(state).collect(), corners }
    }

    #[test]
    fn a_loss_ends_an_epoch_and_what_was_seen_before_the_start_belongs_to_it() {
        let mut recorder = Recorder::default();
        let waiting = FrameOutcome::Initialising(Waiting::Parallax);
        recorder.add(glance(waiting, 0..=0, &[]));
        recorder.add(glance(waiting, 0..=1, &[]));
        recorder.add(glance(waiting, 1..=2, &[]));
        recorder.add(glance(FrameOutcome::Initialised, 1..=3, &[1]));
        // Becomes a keyframe only when it is no longer recent.
        recorder.add(glance(FrameOutcome::NewKeyframe, 1..=4, &[1, 2]));
        recorder.add(glance(FrameOutcome::Lost, 5..=5, &[]));
        recorder.add(glance(FrameOutcome::Initialised, 6..=6, &[6]));
        let record = recorder.finish();
        let stamps = |epoch: &Epoch| epoch.frames.iter().map(|frame| frame.known.stamp).collect::<Vec<_>>();
        assert_eq!(record.epochs.iter().map(stamps).collect::<Vec<_>>(), [vec![at(1), at(2), at(3), at(4)], vec![at(6)]]);
        let keyframes: Vec<_> = record.epochs[0].frames.iter().map(|frame| frame.known.keyframe).collect();
        assert_eq!(keyframes, [true, true, false, false]);
        assert_eq!(record.epochs[0].frames.iter().map(|frame| frame.causal).collect::<Vec<_>>(), [false, false, true, true]);
        assert!(record.epochs[0].frames.iter().all(|frame| frame.known.stamp == at(i64::from(frame.corners[0].track.0))));
    }
}
