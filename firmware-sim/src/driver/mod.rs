//! The sensors: each gives what is due, as a driver hands over what its interrupt has left.
//!
//! A depth map would be a third one beside them, polled after the camera.

mod camera;
mod imu;

pub use camera::Camera;
pub use imu::Imu;
