//! Writes what [`Replay`](libella_firmware_sim::replay::Replay) reads.

use libella_core::camera::PinholeRadTan;
use libella_core::imu::{ImuNoise, ImuSample};
use libella_core::time::Timestamp;
use libella_firmware_sim::replay::{HEADER_BYTES, MAGIC};
use nalgebra::Isometry3;

/// Columns and rows of a depth map.
pub const DEPTH_SIZE: (usize, usize) = (20, 15);

/// The head of a recording with this many samples, images and depth maps.
#[must_use]
pub fn header(
    camera: &PinholeRadTan<f64>,
    body_from_camera: &Isometry3<f64>,
    noise: &ImuNoise<f64>,
    samples: usize,
    images: usize,
    depths: usize,
) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    let (columns, rows) = DEPTH_SIZE;
    for count in [samples as u32, images as u32, depths as u32, camera.size_px.0, camera.size_px.1, columns as u32, rows as u32] {
        bytes.extend(count.to_le_bytes());
    }
    let (q, t) = (body_from_camera.rotation.quaternion(), body_from_camera.translation.vector);
    let noise = [noise.gyro_noise_density, noise.accel_noise_density, noise.gyro_random_walk, noise.accel_random_walk];
    let camera = camera.focal_px.into_iter().chain(camera.center_px).chain(camera.distortion);
    for number in camera.chain([q.w, q.i, q.j, q.k, t.x, t.y, t.z]).chain(noise) {
        bytes.extend((number as f32).to_le_bytes());
    }
    debug_assert_eq!(bytes.len(), HEADER_BYTES);
    bytes
}

/// One inertial sample.
#[must_use]
pub fn sample(sample: &ImuSample<f64>) -> Vec<u8> {
    let mut bytes = sample.stamp.as_nanos().to_le_bytes().to_vec();
    for number in sample.gyro_rad_s.iter().chain(sample.accel_m_s2.iter()) {
        bytes.extend((*number as f32).to_le_bytes());
    }
    bytes
}

/// One image.
#[must_use]
pub fn image(stamp: Timestamp, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = stamp.as_nanos().to_le_bytes().to_vec();
    bytes.extend(pixels);
    bytes
}

/// One depth map, from depths in m; 0 is unknown.
#[must_use]
pub fn depth(stamp: Timestamp, depths_m: &[f64]) -> Vec<u8> {
    let mut bytes = stamp.as_nanos().to_le_bytes().to_vec();
    bytes.extend(depths_m.iter().flat_map(|depth| ((depth * 1000.0).round() as u16).to_le_bytes()));
    bytes
}
