//! The sensors: each gives what is due, as a driver hands over what its interrupt has left.

mod camera;
mod depth;
mod imu;

pub use camera::Camera;
pub use depth::{Depth, DepthMemory};
pub use imu::Imu;
