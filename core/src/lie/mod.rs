//! Rotations, poses and directions: exp, log, ⊞, ⊟ and their Jacobians.

pub(crate) mod matrix;
pub mod s2;
pub mod se3;
pub mod so3;
