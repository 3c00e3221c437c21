//! The one place that knows the order of events.

mod attempt;
mod biases;
mod config;
mod depth;
mod depth_start;
mod inertial;
mod input;
mod keeper;
mod outliers;
mod output;
mod place;
mod planes;
mod running;
mod sliding;
mod starting;

pub use config::{DepthConfig, EstimatorConfig, FirstSigma, PlaneConfig};
pub use keeper::{KeeperConfig, Look, PlaneKeeper};
pub use output::{DepthReport, FrameOutcome, Health, InputError, StateEstimate, StepBudget, StepReport, Waiting};
pub use place::Place;

use nalgebra::{Isometry3, SMatrix, Vector3};

use self::attempt::Attempt;
use self::inertial::InertialHistory;
use crate::camera::{Camera, CameraModel};
use crate::depth::ScaleTracker;
use crate::factor::prior::Prior;
use crate::factor::reprojection::CameraMount;
use crate::imu::ImuNoise;
use crate::init::InitLandmark;
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::solve::{Settings, Workspace};
use crate::storage::blank::{Blank, blank};
use crate::time::Timestamp;
use crate::track::{FrontEnd, FrontEndConfig};
use crate::window::{CommonFlow, DepthPrior, Stillness, Window};

/// One way to start, on the frames that are there.
type Start<E> = fn(&mut E, StepBudget) -> Result<(), Waiting>;

/// Corners to follow at a time.
const TARGET_TRACKS: usize = 200;

/// Monocular visual-inertial odometry over a sliding window of `FRAMES` frames and at most `POINTS` landmarks;
/// `PAIRS = FRAMES (FRAMES + 1) / 2` blocks of the normal equations, `SAMPLES` inertial samples.
///
/// Push samples and images in the order of time, inertial samples past the image first; call [`Self::step`] after
/// every image; read [`Self::state`].
#[derive(Debug)]
pub struct Estimator<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize> {
    config: EstimatorConfig<T>,
    camera: CameraModel<T>,
    noise: ImuNoise<T>,
    settings: Settings<T>,
    inertial: InertialHistory<T, SAMPLES>,
    window: Window<T, FRAMES, POINTS>,
    prior: Prior<T, FRAMES, PAIRS>,
    workspace: Workspace<T, FRAMES, PAIRS>,
    health: Health,
    pose_covariance: SMatrix<T, 6, 6>,
    /// A frame was pushed and not yet worked on.
    pending: bool,
    /// The newest frame saw so little that its pose rests on inertial samples.
    blind_since: Option<Timestamp>,
    /// How the image as a whole moved since the one before.
    image_motion: CommonFlow<T>,
    /// Since when the image stands still.
    stillness: Stillness<T>,
    /// Images in a row that contradicted the solution.
    contradictions: u8,
    report: StepReport<T>,
    /// Corners of the images that were pushed.
    front_end: FrontEnd<POINTS>,
    last_image: Option<Timestamp>,
    /// The newest image since the last reset, in the window or left out of it.
    newest_image: Option<Timestamp>,
    init_landmarks: [InitLandmark<T>; POINTS],
    /// The start in motion that is being computed.
    attempt: Attempt<T>,
    /// The factor on the depths that are given.
    depth_scale: ScaleTracker<T>,
    /// What the depth map of the pending frame did.
    depth_report: Option<DepthReport<T>>,
    /// The start with depths, once there are any: who pushes none does not carry its code.
    start_with_depth: Option<Start<Self>>,
}

blank!([T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize]
Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES> {
    config,
    camera,
    noise,
    settings,
    inertial,
    window,
    prior,
    workspace,
    health,
    pose_covariance,
    pending,
    blind_since,
    image_motion,
    stillness,
    contradictions,
    report,
    front_end,
    last_image,
    newest_image,
    init_landmarks,
    attempt,
    depth_scale,
    depth_report,
    start_with_depth,
});

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// An estimator that waits for its first data. `body_from_camera` is the pose of the camera in the body (IMU) frame.
    #[must_use]
    pub fn new(config: EstimatorConfig<T>, camera: CameraModel<T>, body_from_camera: Isometry3<T>) -> Self {
        let mut made = Self::BLANK;
        made.configure(config, camera, body_from_camera);
        made
    }

    /// Makes a blank estimator one that waits for its first data.
    fn configure(&mut self, config: EstimatorConfig<T>, camera: CameraModel<T>, body_from_camera: Isometry3<T>) {
        self.config = config;
        self.camera = camera;
        self.noise = config.inflated_noise();
        self.settings = Settings {
            gravity_in_world: Vector3::new(T::ZERO, T::ZERO, -config.gravity_m_s2),
            body_from_camera,
            mount: CameraMount::new(&body_from_camera),
            kernel: Kernel::huber(config.huber * config.huber),
            depth_prior: DepthPrior::new(config.inverse_depth_per_m, config.inverse_depth_sigma_per_m),
            guessed_depth_prior: DepthPrior::new(config.inverse_depth_per_m, config.inverse_depth_guess_sigma_per_m),
            rest_sigma_m_s: config.rest_sigma_m_s,
            position_jitter_m: config.position_jitter_m,
            behind_camera_cost: T::of(100.0),
        };
        self.inertial.set_range(config.gyro_range_rad_s, config.accel_range_m_s2);
        self.health = Health::Initialising(Waiting::Imu);
        self.report = StepReport::default();
        self.front_end.configure(front_end_config(&camera));
        self.depth_scale = config.depth.tracker();
        self.depth_report = None;
    }

    /// Works on the frame that was pushed last: initialises, or solves and slides the window.
    pub fn step(&mut self, budget: StepBudget) -> FrameOutcome {
        if !self.pending {
            return FrameOutcome::NoFrame;
        }
        self.pending = false;
        self.report = StepReport { depth: self.depth_report.take(), ..StepReport::default() };
        if let [.., before, newest] = self.window.frames.as_slice() {
            self.report.saturated = self.inertial.saturated(before.stamp, newest.stamp);
        }
        match self.health {
            Health::Initialising(_) | Health::Lost => self.step_starting(budget),
            Health::Tracking | Health::Degraded => self.step_running(budget),
        }
    }

    /// The newest state, once initialised.
    #[must_use]
    pub fn state(&self) -> Option<StateEstimate<T>> {
        if !matches!(self.health, Health::Tracking | Health::Degraded) {
            return None;
        }
        let newest = self.window.frames.last()?;
        let state = self.window.in_world(&newest.state);
        Some(StateEstimate { stamp: newest.stamp, state, pose_covariance: self.pose_covariance })
    }

    /// How it goes.
    #[must_use]
    pub fn health(&self) -> Health {
        self.health
    }

    /// What the last step did.
    #[must_use]
    pub fn report(&self) -> &StepReport<T> {
        &self.report
    }

    /// The frames and landmarks being estimated, for showing.
    #[must_use]
    pub fn window(&self) -> &Window<T, FRAMES, POINTS> {
        &self.window
    }

    /// Forgets every frame and landmark and initialises anew with the next data.
    pub fn reset(&mut self) {
        self.window.clear();
        self.prior.clear();
        self.depth_scale = self.config.depth.tracker();
        self.attempt.end();
        self.newest_image = None;
        self.pending = false;
        self.blind_since = None;
        self.health = Health::Initialising(Waiting::Tracks);
    }
}

fn front_end_config<T: Real>(camera: &CameraModel<T>) -> FrontEndConfig {
    let (width, height) = camera.size_px();
    FrontEndConfig::for_image(width as usize, height as usize, TARGET_TRACKS)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
