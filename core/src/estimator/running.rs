//! One image while the window stands: triangulate, solve, clean, slide.

use super::{Estimator, FrameOutcome, Health, StepBudget};
use crate::factor::reprojection;
use crate::real::Real;
use crate::solve::optimize;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    pub(super) fn step_running(&mut self, budget: StepBudget) -> FrameOutcome {
        self.mark_rest();
        self.activate_landmarks();
        self.solve(budget.iterations);
        self.report.tracked = self.tracked_landmarks();
        if self.diverged() {
            return self.lose();
        }
        let blind = self.followed_corners() < self.config.least_tracked;
        let Some(stamp) = self.window.frames.last().map(|frame| frame.stamp) else { return FrameOutcome::NoFrame };
        if blind {
            let since = *self.blind_since.get_or_insert(stamp);
            if (stamp - since).as_seconds::<T>() > self.config.longest_coast_s {
                return self.lose();
            }
        } else {
            self.blind_since = None;
        }
        self.health = if blind { Health::Degraded } else { Health::Tracking };
        let kept = self.slide();
        match (blind, kept) {
            (true, _) => FrameOutcome::Coasted,
            (false, true) => FrameOutcome::NewKeyframe,
            (false, false) => FrameOutcome::Tracked,
        }
    }

    /// Solves the window, then refines bearings and takes outliers out.
    pub(super) fn solve(&mut self, iterations: u8) {
        self.report.solver = optimize(&mut self.window, &self.prior, &mut self.workspace, &self.settings, iterations);
        self.update_covariance();
        let poses = &self.workspace.geometry.camera_poses;
        for landmark in self.window.landmarks.iter_mut().filter(|landmark| landmark.active) {
            landmark.refine(poses);
        }
        self.remove_outliers();
    }

    /// Gives a depth to landmarks that have seen enough parallax.
    pub(super) fn activate_landmarks(&mut self) {
        self.workspace.geometry.update(&self.window.frames, &self.settings);
        let poses = &self.workspace.geometry.camera_poses;
        for landmark in self.window.landmarks.iter_mut().filter(|landmark| !landmark.active && landmark.observations() > 1) {
            let Some((inverse_depth, information)) = landmark.triangulate(poses) else { continue };
            // λ/σ_λ: how many standard deviations the point is from infinity.
            if inverse_depth > T::ZERO && inverse_depth * information.root() > self.config.depth_significance {
                landmark.inverse_depth = inverse_depth;
                landmark.active = true;
                landmark.refine(poses);
            }
        }
    }

    /// Takes out observations that the solution contradicts, and landmarks that have lost their meaning.
    fn remove_outliers(&mut self) {
        let gate = self.config.outlier_chi2;
        let newest = self.window.frames.len().saturating_sub(1);
        let geometry = &self.workspace.geometry;
        let mut removed = 0;
        for landmark in self.window.landmarks.iter_mut().filter(|landmark| landmark.active) {
            let anchor = landmark.anchor();
            let direction = landmark.direction();
            let inverse_depth = landmark.inverse_depth;
            let mut contradicted = 0_u32;
            for (frame, point) in landmark.seen().filter(|(frame, _)| *frame != anchor) {
                let agrees = reprojection::residual(geometry.pair(anchor, frame), &direction, inverse_depth, point)
                    .is_some_and(|residual| residual.norm_squared() < gate);
                if !agrees {
                    contradicted |= 1 << frame;
                }
            }
            removed += contradicted.count_ones() as usize;
            let lost_in_newest = contradicted >> newest & 1 == 1;
            for frame in (0..=newest).filter(|frame| contradicted >> frame & 1 == 1) {
                landmark.forget(frame);
            }
            if lost_in_newest || landmark.observations() < 2 || !(inverse_depth > T::of(1e-3) && inverse_depth < T::of(20.0)) {
                landmark.active = false;
                landmark.condemned = true;
            }
        }
        self.report.outliers = removed;
        for landmark in self.window.landmarks.iter().filter(|landmark| landmark.condemned) {
            self.front_end.drop_tracks(|track| track.id == landmark.track);
        }
        self.window.landmarks.retain(|landmark| !landmark.condemned);
    }

    /// Landmarks with a depth that the newest frame sees.
    pub(super) fn tracked_landmarks(&self) -> usize {
        let newest = self.window.frames.len().saturating_sub(1);
        self.window.landmarks.iter().filter(|landmark| landmark.active && landmark.is_seen_in(newest)).count()
    }

    /// Corners of the newest frame that an older one saw too.
    fn followed_corners(&self) -> usize {
        let newest = self.window.frames.len().saturating_sub(1);
        self.window.landmarks.iter().filter(|landmark| landmark.is_seen_in(newest) && landmark.observations() > 1).count()
    }

    fn update_covariance(&mut self) {
        if let Some(covariance) = self.workspace.newest_pose_covariance(self.window.frames.len()) {
            self.pose_covariance = covariance;
        }
    }

    /// At rest when neither the image nor the inertial samples move.
    fn mark_rest(&mut self) {
        let frames = &mut self.window.frames;
        let Some((newest, before)) = frames.split_last_mut() else { return };
        let Some(previous) = before.last() else { return };
        let bias = &newest.state.bias;
        let (mut turning, mut pushing, mut count) = (T::ZERO, T::ZERO, T::ZERO);
        for (_, sample) in self.inertial.pairs(previous.stamp, newest.stamp) {
            turning += (sample.gyro_rad_s - bias.gyro_rad_s).norm_squared();
            let excess = (sample.accel_m_s2 - bias.accel_m_s2).norm() - self.config.gravity_m_s2;
            pushing += excess * excess;
            count += T::one();
        }
        let still = count > T::ZERO && (turning / count).root() < T::of(0.02) && (pushing / count).root() < T::of(0.3);
        newest.at_rest = still && self.image_motion_px < T::of(0.3);
    }

    fn diverged(&self) -> bool {
        let Some(newest) = self.window.frames.last() else { return true };
        let state = &newest.state;
        !(state.is_finite()
            && state.velocity_in_world.norm() < T::of(100.0)
            && state.bias.gyro_rad_s.norm() < T::of(1.0)
            && state.bias.accel_m_s2.norm() < T::of(3.0))
    }

    fn lose(&mut self) -> FrameOutcome {
        self.reset();
        self.health = Health::Lost;
        FrameOutcome::Lost
    }
}
