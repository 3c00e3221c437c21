//! Simulated flights with exact truth: motion, inertial samples, corner tracks, pictures.
//!
//! ```text
//! MotionKind ─▶ Analytic ─┐                     ┌─▶ imu ─────▶ samples, true states ─┐
//!                         ├─▶ Trajectory ─▶ Flight                                   ├─▶ Recording
//! EuRoC csv ──▶ Spline ───┘          │          └─▶ features ─▶ tracks ──────────────┘
//!             Scene, Movers ─▶ World (baked) ─▶ Renderer ─▶ images, depth ─▶ stream, EuRoC folder
//! ```
//! Everything is a function of a configuration and a seed. Single views of many rooms, for training a network, come from [`rooms`].

pub mod euroc;
pub mod features;
pub mod imu;
pub mod random;
pub mod rooms;
pub mod scene;
pub mod spline;
pub mod trajectory;

mod asl;
mod error;
mod flight;
mod photometry;
mod render;
mod stream;
mod surface;
mod texture;

#[cfg(test)]
mod likeness_tests;
#[cfg(test)]
mod refusal_tests;

pub use asl::{AslOptions, planes_json, write_asl};
pub use error::SimError;
pub use features::FeatureConfig;
pub use flight::{Flight, ImuSource, RealMotionConfig};
pub use imu::ImuConfig;
pub use photometry::PhotometryConfig;
pub use render::{DepthMap, RenderConfig, Renderer, World};
pub use rooms::{RoomView, RoomsConfig, room_views};
pub use scene::{MOST_MOVERS, Mover, RoomConfig, Scene};
pub use stream::{Furnishing, ImageStream, MotionSource, RenderedFlight};
pub use trajectory::{AnalyticConfig, Motion, MotionKind, Trajectory};

use std::path::Path;

use libella_core::camera::CameraModel;
use libella_core::imu::{ImuNoise, ImuSample, NavState};
use libella_core::time::{Span, Timestamp};
use libella_core::track::Observation;
use nalgebra::{Isometry3, Vector3};

/// The stamp of the first instant of an analytic motion.
pub const EPOCH: Timestamp = Timestamp::from_nanos(1_000_000_000_000);

/// The corners seen in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// When the image was taken.
    pub stamp: Timestamp,
    /// Raw (distorted) pixels with track ids that never repeat.
    pub observations: Vec<Observation<f64>>,
}

/// The true state at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthState {
    /// When.
    pub stamp: Timestamp,
    /// Pose, velocity and biases.
    pub state: NavState<f64>,
}

/// Everything an estimator may read, and the truth.
#[derive(Debug, Clone)]
pub struct Recording {
    /// The camera of the observations.
    pub camera: CameraModel<f64>,
    /// `T_BC`.
    pub body_from_camera: Isometry3<f64>,
    /// Noise of the inertial samples, as simulated or as the datasheet of the recorded sensor says.
    pub imu_noise: ImuNoise<f64>,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: f64,
    /// Inertial samples in rising order of time.
    pub imu: Vec<ImuSample<f64>>,
    /// Images in rising order of time, 20 per second.
    pub frames: Vec<Frame>,
    /// True states at the inertial stamps that the motion covers; every image stamp is among them where it is an inertial stamp.
    pub truth: Vec<TruthState>,
}

/// A flight of an analytic motion through a furnished room.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationConfig {
    /// The motion.
    pub motion: AnalyticConfig,
    /// The inertial measurement unit.
    pub imu: ImuConfig,
    /// The corner tracks.
    pub features: FeatureConfig,
    /// Images per second; 1 to 200.
    pub frame_rate_hz: f64,
}

impl Default for SimulationConfig {
    fn default() -> Self {
        Self { motion: AnalyticConfig::default(), imu: ImuConfig::default(), features: FeatureConfig::default(), frame_rate_hz: 20.0 }
    }
}

/// Simulates tracks and inertial samples of an analytic motion.
///
/// # Errors
/// A parameter out of range, named with its range.
pub fn simulate(config: &SimulationConfig, seed: u64) -> Result<Recording, SimError> {
    simulate_with_landmarks(config, seed).map(|(recording, _)| recording)
}

/// [`simulate`], and the true landmarks by track id (m, in world).
///
/// # Errors
/// A parameter out of range, named with its range.
pub fn simulate_with_landmarks(config: &SimulationConfig, seed: u64) -> Result<(Recording, Vec<Vector3<f64>>), SimError> {
    let flight = Flight::analytic(&config.motion, &config.imu, config.frame_rate_hz, seed)?;
    let room = RoomConfig::vicon(&flight.path());
    flight.record(&room, &config.features, seed)
}

/// Simulates tracks on the recorded motion of a EuRoC folder (`mav0` or its parent), with the recorded inertial samples or
/// simulated ones. A motion that needs more than a Vicon room gets a hall.
///
/// # Errors
/// Files that cannot be read, or a parameter out of range.
pub fn real_motion(folder: &Path, config: &RealMotionConfig, seed: u64) -> Result<Recording, SimError> {
    let flight = Flight::recorded(folder, config, seed)?;
    let room = flight.fitting_room();
    flight.record(&room, &config.features, seed).map(|(recording, _)| recording)
}

/// Stamps from [`EPOCH`] on at a rate, both ends included.
#[must_use]
#[allow(clippy::cast_possible_truncation)]
pub fn regular_stamps(duration_s: f64, rate_hz: f64) -> Vec<Timestamp> {
    let interval_ns = 1e9 / rate_hz;
    let count = (duration_s * rate_hz + 1e-6).max(0.0) as i64;
    (0..=count).map(|k| EPOCH + Span::from_nanos((k as f64 * interval_ns).round() as i64)).collect()
}
