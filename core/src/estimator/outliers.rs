//! After a solution: which observations and landmarks it contradicts.

use super::Estimator;
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::solve::Geometry;
use crate::window::{DepthPrior, DepthSource, Landmark};

/// Inverse depths that a landmark may have, 1/m: noise makes far ones pass infinity.
const LEAST_INVERSE_DEPTH: f64 = -0.5;
const MOST_INVERSE_DEPTH: f64 = 20.0;
/// Observations, seen exactly, that the mean cost starts with: a handful of real ones says little.
const EXACT_OBSERVATIONS: f64 = 20.0;

/// What became of the observations.
struct Tally<T> {
    removed: usize,
    kept: T,
    cost: T,
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// Takes out observations that the solution contradicts, and landmarks that have lost their meaning.
    pub(super) fn remove_outliers(&mut self) {
        let newest = self.window.frames.len().saturating_sub(1);
        let geometry = &self.workspace.geometry;
        let prior = &self.settings.depth_prior;
        let mut tally = Tally { removed: 0, kept: T::ZERO, cost: T::ZERO };
        for landmark in self.window.landmarks.iter_mut().filter(|landmark| landmark.active) {
            // The corners know better: the next map may try again.
            if landmark.depth_source == DepthSource::Given
                && landmark.given.residual(landmark.inverse_depth).abs() > self.config.depth.gate_sigma
            {
                landmark.depth_source = DepthSource::Usual;
            }
            let contradicted = contradictions(landmark, geometry, self.config.outlier_chi2, &self.settings.kernel, &mut tally);
            for frame in (0..=newest).filter(|frame| contradicted >> frame & 1 == 1) {
                landmark.forget(frame, &geometry.camera_poses);
            }
            let lost_in_newest = contradicted >> newest & 1 == 1;
            if lost_in_newest || landmark.observations() < 2 || has_impossible_depth(landmark, geometry, prior) {
                landmark.active = false;
                landmark.condemned = true;
            }
        }
        self.report.outliers = tally.removed;
        self.report.mean_cost = tally.cost / (tally.kept + T::of(EXACT_OBSERVATIONS));
        for landmark in self.window.landmarks.iter().filter(|landmark| landmark.condemned) {
            self.front_end.drop_tracks(|track| track.id == landmark.track);
        }
        self.window.landmarks.retain(|landmark| !landmark.condemned);
    }
}

/// The frames, by bits, whose observations lie farther from the landmark than `gate` (squared, whitened).
fn contradictions<T: Real, const FRAMES: usize, const PAIRS: usize>(
    landmark: &Landmark<T, FRAMES>,
    geometry: &Geometry<T, FRAMES, PAIRS>,
    gate: T,
    kernel: &Kernel<T>,
    tally: &mut Tally<T>,
) -> u32 {
    let direction = landmark.direction();
    let mut contradicted = 0_u32;
    for (frame, point) in landmark.seen() {
        let residual = geometry.residual(landmark.anchor(), frame, &direction, landmark.inverse_depth, point);
        match residual.map(|residual| residual.norm_squared()).filter(|squared| *squared < gate) {
            Some(squared) => {
                tally.kept += T::one();
                tally.cost += kernel.rho(squared) * T::of(0.5);
            }
            None => contradicted |= 1 << frame,
        }
    }
    tally.removed += contradicted.count_ones() as usize;
    contradicted
}

/// Whether the inverse depth is one that no point has, and known well. Where the body hardly moved noise alone can do that, and it goes back to the usual
/// one.
fn has_impossible_depth<T: Real, const FRAMES: usize, const PAIRS: usize>(
    landmark: &mut Landmark<T, FRAMES>,
    geometry: &Geometry<T, FRAMES, PAIRS>,
    prior: &DepthPrior<T>,
) -> bool {
    if landmark.inverse_depth > T::of(LEAST_INVERSE_DEPTH) && landmark.inverse_depth < T::of(MOST_INVERSE_DEPTH) {
        return false;
    }
    landmark.inverse_depth = prior.mean;
    landmark.is_told(&geometry.camera_poses, prior)
}
