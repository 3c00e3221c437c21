//! Depth that someone else tells: a network, a sensor, a simulator.
//!
//! # Model
//! A depth map gives `λ = 1/d` (1/m) at a raw pixel, with the standard deviation of `ln d`. Errors of neighbouring pixels, and of one
//! image after another, are the same error seen again: a landmark therefore takes one value, the best that it was given, and carries
//! it along as the prior of its inverse depth. That prior is the *virtual right view* of a pseudo RGB-D camera, `u_R = u_L − f b λ`, in
//! the landmark's anchor: `(u_R − û_R) / σ_R = (λ − λ_d) f b / σ_R`, see [`Weighting`].
//!
//! What all depths of a source have in common, a factor on the depth, is followed in time by [`ScaleTracker`].

mod map;
mod normals;
mod scale;
mod weighting;

pub use map::{DepthSample, DepthView, DepthViewError};
pub use normals::{NormalAverage, normal};
pub use scale::{Affine, ScaleTracker, Verdict, affine, mean_ratio};
pub use weighting::Weighting;
