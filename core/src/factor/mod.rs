//! Residuals and their Jacobians, one factor a file.

pub mod imu;
pub mod point_on_plane;
pub mod prior;
pub mod reprojection;
