//! Inertial samples, their noise, and their integral between two images.

mod bias;
mod covariance;
mod interval;
mod noise;
mod preintegration;
mod sample;
mod state;
pub mod stretch;
#[cfg(test)]
pub(crate) mod testing;

pub use bias::ImuBias;
pub use noise::ImuNoise;
pub use preintegration::{Preintegration, PreintegrationError};
pub use sample::ImuSample;
pub use state::NavState;
pub use stretch::ImuRange;
