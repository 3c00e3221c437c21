//! Borrowed pixels and their pyramid.

mod pyramid;
mod view;

pub use pyramid::{Level, MAX_LEVELS, MIN_LEVEL_PX, PyramidError, PyramidPair, pyramid_bytes};
pub use view::{ImageView, ImageViewError};
