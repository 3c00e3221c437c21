//! What is known of a whole flight once it is over.
//!
//! ```text
//! estimator ─ Glance ─▶ record ─▶ FlightRecord ─▶ smooth ─ keyframes, tracks ─▶ bundle ─▶ states ─▶ between ─▶ smooth trajectory
//! ```

mod between;
pub mod bundle;
mod record;
mod smooth;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

pub use between::SmoothPose;
pub use record::{Epoch, EpochFrame, FlightRecord, FrameState, Glance, Recorder, SeenCorner};
pub use smooth::{EpochReport, Progress, Smooth, smooth};
