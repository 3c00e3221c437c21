//! Corners followed from image to image, with ids that never repeat.

mod observation;

pub use observation::{Observation, TrackId};
