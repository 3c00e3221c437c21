//! From the first data to a window that stands.

use super::{Estimator, FrameOutcome, Health, StepBudget, Waiting};
use crate::real::Real;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    pub(super) fn step_starting(&mut self, _budget: StepBudget) -> FrameOutcome {
        self.health = Health::Initialising(Waiting::Tracks);
        FrameOutcome::Initialising(Waiting::Tracks)
    }
}
