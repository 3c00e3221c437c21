//! One image in the window.

use crate::imu::{NavState, Preintegration};
use crate::real::Real;
use crate::time::Timestamp;

/// State of the body when an image was taken.
#[derive(Debug, Clone, Copy)]
pub struct Frame<T: Real> {
    /// Time of the image.
    pub stamp: Timestamp,
    /// Current estimate.
    pub state: NavState<T>,
    /// First estimate: where the prior was linearised, once the prior speaks of this frame.
    pub linearization: Option<NavState<T>>,
    /// Integral of the inertial samples from the previous frame of the window to this one.
    pub from_previous: Preintegration<T>,
    /// Whether it stays when it is no longer recent.
    pub keyframe: bool,
    /// Whether the body was found at rest.
    pub at_rest: bool,
}

impl<T: Real> Frame<T> {
    /// A recent frame.
    #[must_use]
    pub fn new(stamp: Timestamp, state: NavState<T>, from_previous: Preintegration<T>) -> Self {
        Self { stamp, state, linearization: None, from_previous, keyframe: false, at_rest: false }
    }

    /// Where Jacobians are evaluated: at the first estimate once the prior has one, else at the current one.
    #[inline]
    #[must_use]
    pub fn linearization_point(&self) -> &NavState<T> {
        self.linearization.as_ref().unwrap_or(&self.state)
    }
}
