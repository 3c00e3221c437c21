//! One image while the window stands: triangulate, solve, clean, slide.

use nalgebra::Vector3;

use super::{Estimator, FrameOutcome, Health, StepBudget};
use crate::imu::ImuBias;
use crate::real::Real;
use crate::solve::optimize;
use crate::window::{DepthSource, Frame};

/// A bias farther from zero than this many of its first standard deviations is no bias, but a contradiction between camera and
/// inertial samples.
const MOST_SIGMA: f64 = 4.0;
/// Cost per observation kept above which the solution contradicts the corners; 0.75 where noise alone is left.
const MOST_MEAN_COST: f64 = 2.0;
/// How many times faster than one at rest a body has to seem to move before its direction is believed.
const MOVING_SIGMA: f64 = 5.0;
/// How long the image has to stand still before the body counts as resting: turning points of a motion are shorter.
const REST_SETTLES_S: f64 = 0.3;
/// Images in a row that the solution may contradict before it counts as lost: half a second at 20 Hz.
const MOST_CONTRADICTIONS: u8 = 10;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    pub(super) fn step_running(&mut self, budget: StepBudget) -> FrameOutcome {
        self.mark_rest();
        self.integrate_anew();
        self.activate_landmarks(self.poses_are_known());
        self.solve(budget.iterations);
        self.report.tracked = self.tracked_landmarks();
        self.contradictions = if self.contradicted() { self.contradictions.saturating_add(1) } else { 0 };
        if self.diverged() || self.contradictions >= MOST_CONTRADICTIONS {
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
        // Corners without a depth tell of rotation only, which is all that a body at rest needs.
        let at_rest = self.window.frames.last().is_some_and(|newest| newest.at_rest);
        let coasting = blind || (self.report.tracked < self.config.least_tracked && !at_rest);
        self.health = if coasting { Health::Degraded } else { Health::Tracking };
        let kept = self.slide();
        match (coasting, kept) {
            (true, _) => FrameOutcome::Coasted,
            (false, true) => FrameOutcome::NewKeyframe,
            (false, false) => FrameOutcome::Tracked,
        }
    }

    /// Solves the window and takes outliers out.
    pub(super) fn solve(&mut self, iterations: u8) {
        self.report.solver = optimize(&mut self.window, &self.prior, &mut self.workspace, &self.settings, iterations);
        self.pose_covariance = self.workspace.newest_pose_covariance;
        self.remove_outliers();
    }

    /// Lets landmarks that three images have seen take part.
    ///
    /// Where the poses are known, each joins once its depth is known to the usual one. Where they are not, all join at the usual depth, which is a guess
    /// until motion tells better: depths told by wrong poses would keep them wrong, and a small motion backwards with all points
    /// behind the camera explains corners as well as the true one.
    pub(super) fn activate_landmarks(&mut self, poses_are_known: bool) {
        self.workspace.geometry.update(&self.window.frames, &self.settings);
        let way_is_known = self.way_is_known();
        let poses = &self.workspace.geometry.camera_poses;
        let prior = &self.settings.depth_prior;
        for landmark in self.window.landmarks.iter_mut().filter(|landmark| landmark.active && landmark.depth_source == DepthSource::Guessed)
        {
            if way_is_known && landmark.is_told(poses, prior) {
                landmark.depth_source = DepthSource::Usual;
            }
        }
        for landmark in self.window.landmarks.iter_mut().filter(|landmark| !landmark.active && landmark.observations() > 2) {
            if landmark.depth_source == DepthSource::Given {
                landmark.inverse_depth = landmark.given.inverse_depth;
                landmark.active = true;
                if poses_are_known {
                    let _ = landmark.refine(poses, &self.settings.prior_on(landmark));
                }
                continue;
            }
            landmark.inverse_depth = prior.mean;
            landmark.depth_source = if poses_are_known { DepthSource::Usual } else { DepthSource::Guessed };
            if poses_are_known {
                let found = landmark.triangulate(poses).filter(|found| *found > T::ZERO && *found < T::of(2.0));
                landmark.inverse_depth = found.unwrap_or(prior.mean);
                let information = landmark.refine(poses, &self.settings.prior_on(landmark));
                landmark.active = information.is_some_and(|information| prior.is_surpassed_by(information));
            } else {
                landmark.active = true;
            }
        }
    }

    /// Whether poses are good enough to tell depths: they have been, or the body moves faster than its velocity may be wrong.
    fn poses_are_known(&self) -> bool {
        let moves = |newest: &Frame<T>| newest.state.velocity_in_world.norm() > self.config.rest_sigma_m_s * T::of(MOVING_SIGMA);
        self.tracked_landmarks() >= self.config.least_tracked || self.window.frames.last().is_some_and(moves)
    }

    /// Whether the way across the window is known better than to its own length, and so tells depths.
    ///
    /// A body that hardly moved may seem to have moved ten times as far with all points ten times as far away; depths told by that would
    /// keep it so, until the scale is that of the flight. Known to half its length does for large windows too, but six frames at 160
    /// pixels then keep a guessed scale: 0.50 m of 9.5 m flown instead of 0.09 m.
    fn way_is_known(&self) -> bool {
        let (Some(first), Some(last)) = (self.window.frames.first(), self.window.frames.last()) else { return false };
        let way = (last.state.position_in_world - first.state.position_in_world).norm();
        let variance = (3..6).fold(T::ZERO, |sum, axis| sum + self.pose_covariance[(axis, axis)]);
        variance < way * way
    }

    /// Landmarks with a depth that the newest frame sees.
    pub(super) fn tracked_landmarks(&self) -> usize {
        let newest = self.window.frames.len().saturating_sub(1);
        self.window.landmarks.iter().filter(|landmark| landmark.active && landmark.is_seen_in(newest)).count()
    }

    /// Corners of the newest frame that an older one saw too.
    pub(super) fn followed_corners(&self) -> usize {
        let newest = self.window.frames.len().saturating_sub(1);
        self.window.landmarks.iter().filter(|landmark| landmark.is_seen_in(newest) && landmark.observations() > 1).count()
    }

    /// Whether the solution explains the corners badly: far more than noise is left, or most of them were taken out; or explains
    /// them by biases that no sensor of this kind has.
    fn contradicted(&self) -> bool {
        self.report.mean_cost > T::of(MOST_MEAN_COST)
            || self.report.outliers > self.report.tracked + 20
            || self.window.frames.last().is_some_and(|newest| !self.is_plausible(&newest.state.bias))
    }

    /// Whether biases are within what was expected of them at the start.
    pub(super) fn is_plausible(&self, bias: &ImuBias<T>) -> bool {
        let sigma = &self.config.first_sigma;
        bias.gyro_rad_s.norm() < sigma.gyro_bias_rad_s * T::of(MOST_SIGMA)
            && bias.accel_m_s2.norm() < sigma.accel_bias_m_s2 * T::of(MOST_SIGMA)
    }

    /// Integrates the samples of a frame anew where the bias has moved too far for the first-order correction.
    fn integrate_anew(&mut self) {
        for i in 1..self.window.frames.len() {
            let [before, frame] = &mut self.window.frames[i - 1..=i] else { continue };
            let bias = before.state.bias;
            let moved = frame.from_previous.bias_is_beyond(&bias, T::of(0.002), T::of(0.05));
            if moved && self.inertial.covers(before.stamp, frame.stamp) {
                frame.from_previous = self.inertial.integrate(&self.noise, bias, before.stamp, frame.stamp);
            }
        }
    }

    /// At rest when neither the image nor the inertial samples move.
    fn mark_rest(&mut self) {
        let frames = &mut self.window.frames;
        let Some((newest, before)) = frames.split_last_mut() else { return };
        let Some(previous) = before.last() else { return };
        let bias = newest.state.bias;
        let (mut rate, mut force, mut count) = (Vector3::zeros(), Vector3::zeros(), T::ZERO);
        for (_, sample) in self.inertial.pairs(previous.stamp, newest.stamp) {
            rate += sample.gyro_rad_s - bias.gyro_rad_s;
            force += sample.accel_m_s2 - bias.accel_m_s2;
            count += T::one();
        }
        if count == T::ZERO {
            return;
        }
        // Means over the interval: running motors shake a body that rests.
        let turning = (rate / count).norm();
        let pushing = ((force / count).norm() - self.config.gravity_m_s2).abs();
        let still = self.stillness.lasted_s(newest.stamp) > T::of(REST_SETTLES_S);
        newest.at_rest = still && turning < T::of(0.02) && pushing < T::of(0.3);
    }

    pub(super) fn diverged(&self) -> bool {
        let Some(newest) = self.window.frames.last() else { return true };
        let state = &newest.state;
        !(state.is_finite()
            && state.velocity_in_world.norm() < T::of(50.0)
            && state.bias.gyro_rad_s.norm() < T::of(1.0)
            && state.bias.accel_m_s2.norm() < T::of(3.0))
    }

    fn lose(&mut self) -> FrameOutcome {
        self.reset();
        self.health = Health::Lost;
        FrameOutcome::Lost
    }
}
