//! Residuals and their Jacobians, one factor a file.

pub mod imu;
pub mod prior;
pub mod reprojection;
