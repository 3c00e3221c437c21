//! Borrowed pixels and their pyramid.

mod pyramid;
mod view;

pub use pyramid::PyramidPair;
pub use view::{ImageView, ImageViewError};
