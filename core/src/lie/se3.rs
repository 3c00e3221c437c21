//! Rigid poses.
