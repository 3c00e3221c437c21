//! What keeps wrong measurements from mattering: kernels, order statistics, sample consensus.

pub mod kernel;
pub mod ransac;
pub mod stats;
