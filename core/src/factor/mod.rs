//! factor.

pub mod imu;
