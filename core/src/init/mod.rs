//! The first states: from a short window of inertial samples and bearings to gravity, velocity, biases and metric scale.
//!
//! ```text
//! ImuSample ──▶ stillness ─ Rest ───────────────────────────────────────────┐
//! Preintegration ─ InertialLink ─▶ gyro_bias ─▶ alignment ─▶ refinement ─────┴─▶ NavState
//! Bearings ──────────────────────────┴───────────┴────────────┘
//! ```
//! The moving start reads `K` frames, `K − 1` links between neighbours, and the bearings of the tracks. Between
//! neighbouring frames the inertial samples are trusted exactly, so that the whole motion has 14 parameters: the first
//! velocity, the direction of gravity, both biases and a growth of the accelerometer's. Every landmark is eliminated from the normal equations.

mod alignment;
mod chain;
mod config;
mod gravity;
mod gyro_bias;
mod median;
mod refinement;
mod stillness;
mod tracks;

#[cfg(test)]
mod tests;

pub use alignment::{Alignment, MovingStart, initialise_moving};
pub use chain::{InertialLink, MAX_INIT_FRAMES};
pub use config::{InitConfig, InitError};
pub use gravity::{gravity_of_known_magnitude, world_from_specific_force};
pub use gyro_bias::{GyroBias, estimate_gyro_bias};
pub use refinement::{LandmarkMemory, Problem};
pub use stillness::{Motion, Rest, RestConfig, detect_rest};
pub use tracks::{Bearings, InitLandmark};
