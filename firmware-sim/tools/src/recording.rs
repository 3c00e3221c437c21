//! Writes what [`Replay`](libella_firmware_sim::replay::Replay) reads.

use libella_core::camera::PinholeRadTan;
use libella_core::imu::{ImuNoise, ImuSample};
use libella_core::time::Timestamp;
use libella_firmware_sim::replay::{HEADER_BYTES, MAGIC};
use nalgebra::Isometry3;

/// The head of a recording with this many samples and images.
#[must_use]
pub fn header(
    camera: &PinholeRadTan<f64>,
    body_from_camera: &Isometry3<f64>,
    noise: &ImuNoise<f64>,
    samples: usize,
    images: usize,
) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    for count in [samples as u32, images as u32, camera.size_px.0, camera.size_px.1] {
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
