//! What several tests need.

pub mod flight; // a recording through the estimator, and what it said
pub mod folder; // small recordings on disk
pub mod motion; // flights that halt on the way
pub mod pack; // recordings in other formats
pub mod pictures; // images that need no file
pub mod plane_truth; // planes of a room that is known
pub mod recordings; // the shared recordings
pub mod room; // a textured room and a rig that moves through it
pub mod tolerance; // bounds by scalar

pub use folder::*;
