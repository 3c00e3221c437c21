//! What the estimator reads of an image.

use nalgebra::Vector2;

use crate::real::Real;
use crate::storage::blank::Blank;

/// Names one physical corner for as long as it is followed; never used again afterwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct TrackId(pub u32);

impl Blank for TrackId {
    const BLANK: Self = Self(0);
}

/// One corner in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation<T: Real> {
    /// Which corner.
    pub track: TrackId,
    /// Where, in raw (distorted) pixels of the level-0 image.
    pub pixel: Vector2<T>,
}
