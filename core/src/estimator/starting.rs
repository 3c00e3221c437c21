//! From the first data to a window that stands.
//!
//! At rest, gravity and the gyro bias are read off the inertial samples and one frame is enough. In motion, frames are
//! collected at a fixed spacing until velocity, gravity and scale can be told from them together.
//!

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{Estimator, FrameOutcome, Health, StepBudget, Waiting};
use crate::camera::Camera;
use crate::imu::{ImuBias, NavState, Preintegration};
use crate::init::{MAX_INIT_FRAMES, RestConfig, detect_rest};
use crate::real::Real;
use crate::solve::add_initial;
use crate::time::Timestamp;

/// Iterations of the first solution at least: it starts farther away than any later one.
const FIRST_ITERATIONS: u8 = 12;
/// Cost per observation that the first solution may leave: 0.75 where noise alone is left, 0.8 in the worst of the recordings.
const MOST_FIRST_COST: f64 = 0.85;
/// Standard deviation of the position and yaw of the first frame, which define the world, m and rad.
const GAUGE_SIGMA: f64 = 1e-2;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    pub(super) fn step_starting(&mut self, budget: StepBudget) -> FrameOutcome {
        // What is being computed goes before what was refused when it began.
        let started = if self.attempt.is_under_way() { Err(Waiting::Computation) } else { self.start_at_once(budget) };
        match started.or_else(|_| self.start_moving(budget)) {
            Ok(()) => FrameOutcome::Initialised,
            Err(waiting) => {
                self.health = Health::Initialising(waiting);
                if waiting != Waiting::Computation {
                    self.attempt.end();
                    self.space_frames();
                }
                FrameOutcome::Initialising(waiting)
            }
        }
    }

    /// The starts that are cheap.
    fn start_at_once(&mut self, budget: StepBudget) -> Result<(), Waiting> {
        if self.start_at_rest() {
            return Ok(());
        }
        self.start_with_depth.map_or(Err(Waiting::Tracks), |start| start(self, budget))
    }

    /// Keeps frames apart while the window fills. A full window is thinned out, so that it spans more and more time, up to
    /// the longest stretch; then the oldest frame goes.
    fn space_frames(&mut self) {
        // A small window keeps its frames farther apart, or it would never span the shortest stretch.
        #[allow(clippy::cast_precision_loss)]
        let least = self.config.shortest_initialisation_s / T::of((FRAMES.min(MAX_INIT_FRAMES) - 3) as f64);
        let spacing_s = self.config.initialisation_spacing_s.max(least);
        let frames = &self.window.frames;
        let crowded = matches!(frames.as_slice(), [.., third, second, _] if (second.stamp - third.stamp).as_seconds::<T>() < spacing_s);
        if crowded {
            let index = frames.len() - 2;
            self.drop_frame(index);
        }
        while self.window.frames.len() >= FRAMES.min(MAX_INIT_FRAMES) {
            let index = self.most_crowded().unwrap_or(0);
            self.drop_frame(index);
        }
    }

    /// The frame whose neighbours are closest to each other, as long as the window may still span more time.
    fn most_crowded(&self) -> Option<usize> {
        let frames = self.window.frames.as_slice();
        let (first, last) = (frames.first()?, frames.last()?);
        if (last.stamp - first.stamp).as_seconds::<T>() > self.config.longest_initialisation_s {
            return None;
        }
        // The newest two stay: they set the spacing.
        let inner = frames.get(..frames.len().saturating_sub(1))?.windows(3).enumerate();
        inner.min_by_key(|(_, three)| three[2].stamp - three[0].stamp).map(|(i, _)| i + 1)
    }

    fn start_at_rest(&mut self) -> bool {
        let Some(newest) = self.window.frames.last().map(|frame| frame.stamp) else { return false };
        let config = RestConfig { imu_noise: self.config.imu_noise, gravity_m_s2: self.config.gravity_m_s2, ..RestConfig::default() };
        let Some((first, displacement_px)) = self.displacement_since(newest, config.minimum_span_s) else { return false };
        let from = self.window.frames[first].stamp;
        let Ok(rest) = detect_rest(&config, self.inertial.between(from, newest), Some(displacement_px)) else { return false };
        while self.window.frames.len() > 1 {
            self.drop_frame(0);
        }
        let Some(frame) = self.window.frames.first_mut() else { return false };
        frame.state = rest.state;
        frame.from_previous = Preintegration::new(rest.state.bias);
        frame.keyframe = true;
        frame.at_rest = true;
        let sigma = &self.config.first_sigma;
        let first = [
            rest.sigma_tilt_rad.max(T::of(0.005)),
            self.config.rest_sigma_m_s,
            rest.sigma_gyro_bias_rad_s.max(T::of(0.002)),
            sigma.accel_bias_m_s2,
        ];
        self.begin(&rest.state, first);
        true
    }

    /// How the image moved between the newest frame and the last one at least `span_s` before it, px.
    fn displacement_since(&self, newest: Timestamp, span_s: T) -> Option<(usize, T)> {
        let last = self.window.frames.len().checked_sub(1)?;
        let first = self.window.frames.iter().rposition(|frame| (newest - frame.stamp).as_seconds::<T>() >= span_s)?;
        let mut flow = self.no_flow();
        for landmark in &self.window.landmarks {
            if let (Some(before), Some(after)) = (landmark.point(first), landmark.point(last)) {
                flow.add(before, after);
            }
        }
        Some((first, flow.size()? * self.camera.focal_px()))
    }

    fn start_moving(&mut self, budget: StepBudget) -> Result<(), Waiting> {
        if !self.attempt.is_under_way() {
            let frames = self.window.frames.len();
            let (Some(first), Some(last)) = (self.window.frames.first(), self.window.frames.last()) else { return Err(Waiting::Tracks) };
            if frames < 5 || (last.stamp - first.stamp).as_seconds::<T>() < self.config.shortest_initialisation_s {
                return Err(Waiting::Tracks);
            }
            self.attempt.begin(first.state.bias);
        }
        self.align(budget)?;
        self.settle_start(budget)
    }

    /// Integrates the samples of all frames anew, linearised at `bias`.
    #[inline(never)]
    pub(super) fn integrate_at(&mut self, bias: ImuBias<T>) {
        for i in 1..self.window.frames.len() {
            let (from, to) = (self.window.frames[i - 1].stamp, self.window.frames[i].stamp);
            if self.inertial.covers(from, to) {
                self.window.frames[i].from_previous = self.inertial.integrate(&self.noise, bias, from, to);
            }
        }
    }

    /// Solves a window whose states were found roughly, and keeps it where everything agrees.
    pub(super) fn settle_start(&mut self, budget: StepBudget) -> Result<(), Waiting> {
        for frame in &mut self.window.frames {
            frame.keyframe = true;
        }
        for frame in self.window.frames.iter_mut().rev().take(super::sliding::RECENT) {
            frame.keyframe = false;
        }
        for landmark in &mut self.window.landmarks {
            landmark.active = false;
        }
        let sigma = self.config.first_sigma;
        let first = [sigma.tilt_rad, sigma.velocity_m_s, sigma.gyro_bias_rad_s, sigma.accel_bias_m_s2];
        let mut origin = self.window.frames[0].state;
        origin.bias.accel_m_s2 = Vector3::zeros();
        self.begin(&origin, first);
        for _ in 0..2 {
            self.activate_landmarks(true);
            self.solve(budget.iterations.max(FIRST_ITERATIONS));
        }
        // The whole window has to agree, or what came out means nothing: wrong extrinsics, wrong stamps.
        let bias = self.window.frames[0].state.bias;
        let agrees = self.tracked_landmarks() * 2 > self.followed_corners()
            && self.report.mean_cost < T::of(MOST_FIRST_COST)
            && self.is_plausible(&bias);
        if self.tracked_landmarks() < self.config.least_tracked || !agrees || self.diverged() {
            self.health = Health::Initialising(Waiting::Agreement);
            self.prior.clear();
            for frame in &mut self.window.frames {
                frame.keyframe = false;
            }
            return Err(Waiting::Agreement);
        }
        Ok(())
    }

    /// Makes the first frame's state the origin of the world: `sigma` of tilt, velocity, gyro bias, accelerometer bias.
    #[inline(never)]
    fn begin(&mut self, origin: &NavState<T>, sigma: [T; 4]) {
        let inverse = |value: T| T::one() / value;
        let gauge = T::of(1.0 / GAUGE_SIGMA);
        // Yaw is the rotation about the vertical, seen from the body.
        let vertical = origin.world_from_body.inverse() * Vector3::z();
        let along = vertical * vertical.transpose();
        let rotation = along * gauge + (Matrix3::identity() - along) * inverse(sigma[0]);
        let mut root = SMatrix::<T, 15, 15>::zeros();
        root.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        for axis in 0..3 {
            root[(3 + axis, 3 + axis)] = gauge;
            root[(6 + axis, 6 + axis)] = inverse(sigma[1]);
            root[(9 + axis, 9 + axis)] = inverse(sigma[2]);
            root[(12 + axis, 12 + axis)] = inverse(sigma[3]);
        }
        add_initial(&mut self.prior, &mut self.workspace, origin, &root);
        self.blind_since = None;
        self.health = Health::Tracking;
    }
}
