//! Corners followed from image to image, with ids that never repeat.

pub mod detect;
pub mod flow;
mod front_end;
mod observation;
mod table;
#[cfg(test)]
mod tests;
pub mod two_view;

pub use front_end::{FrontEnd, FrontEndConfig, FrontEndReport};
pub use observation::{Observation, TrackId};
pub use table::{Track, TrackTable};
