//! A recorded flight in one block of bytes, read where it lies.
//!
//! # Layout
//! Little-endian, without padding:
//! ```text
//! magic      8  "libella2"
//! counts    12  u32 inertial samples, u32 images, u32 depth maps
//! sizes     16  u32 width, u32 height of an image (px); u32 columns, u32 rows of a depth map
//! camera    32  f32 fx fy cx cy k1 k2 p1 p2                          px, radial-tangential distortion
//! extrinsic 28  f32 qw qx qy qz tx ty tz                             body_from_camera, m
//! noise     16  f32 gyro, accelerometer density; gyro, accelerometer walk
//! samples   32 each: i64 stamp (ns), f32 gyro (rad/s) ×3, f32 accelerometer (m/s²) ×3
//! images    8 + width·height each: i64 stamp (ns), grey pixels row by row
//! depths    8 + 2·columns·rows each: i64 stamp of its image (ns), u16 depths row by row                 mm, 0 where unknown
//! ```
//! The values of a depth map stand for equal rectangles that together are the image.

use libella_core::camera::{CameraModel, PinholeRadTan};
use libella_core::image::ImageView;
use libella_core::imu::{ImuNoise, ImuSample};
use libella_core::time::Timestamp;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// First bytes of a recording.
pub const MAGIC: [u8; 8] = *b"libella2";
/// Bytes before the first sample.
pub const HEADER_BYTES: usize = 112;
/// Bytes of an inertial sample.
pub const SAMPLE_BYTES: usize = 32;
/// Values of a depth map at most: that much memory the firmware has for one.
pub const MOST_DEPTHS: usize = 20 * 15;

/// A recording, checked for its length.
#[derive(Debug, Clone, Copy)]
pub struct Replay<'a> {
    header: Header,
    samples: &'a [u8],
    images: &'a [u8],
    depths: &'a [u8],
}

/// What a recording says about itself.
#[derive(Debug, Clone, Copy)]
pub struct Header {
    /// Inertial samples.
    pub samples: usize,
    /// Images.
    pub images: usize,
    /// Depth maps.
    pub depths: usize,
    /// Width and height of the images, px.
    pub size_px: (usize, usize),
    /// Columns and rows of the depth maps.
    pub depth_size: (usize, usize),
    /// The 19 numbers of camera, extrinsics and noise.
    numbers: [f32; 19],
}

fn word(bytes: &[u8], at: usize) -> Option<[u8; 4]> {
    bytes.get(at..)?.first_chunk().copied()
}

fn stamp(bytes: &[u8]) -> Option<Timestamp> {
    Some(Timestamp::from_nanos(i64::from_le_bytes(*bytes.first_chunk()?)))
}

impl Header {
    /// Reads the first [`HEADER_BYTES`] bytes; `None` when they are not those of a recording.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<Self> {
        if bytes.first_chunk() != Some(&MAGIC) {
            return None;
        }
        let count = |at| Some(u32::from_le_bytes(word(bytes, at)?) as usize);
        let mut numbers = [0.0; 19];
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = f32::from_le_bytes(word(bytes, 36 + 4 * k)?);
        }
        let (depths, depth_size) = (count(16)?, (count(28)?, count(32)?));
        let is_map = depth_size.0 >= 2 && depth_size.1 >= 2 && depth_size.0.checked_mul(depth_size.1)? <= MOST_DEPTHS;
        if depths > 0 && !is_map {
            return None;
        }
        Some(Self { samples: count(8)?, images: count(12)?, depths, size_px: (count(20)?, count(24)?), depth_size, numbers })
    }

    /// Bytes of the whole recording; `None` for more than can be addressed.
    #[must_use]
    pub fn total_bytes(&self) -> Option<usize> {
        let samples = self.samples.checked_mul(SAMPLE_BYTES)?;
        let images = self.images.checked_mul(self.image_bytes()?)?;
        self.depths.checked_mul(self.depth_bytes()?)?.checked_add(images)?.checked_add(samples)?.checked_add(HEADER_BYTES)
    }

    fn image_bytes(&self) -> Option<usize> {
        self.size_px.0.checked_mul(self.size_px.1)?.checked_add(8)
    }

    fn depth_bytes(&self) -> Option<usize> {
        self.depth_size.0.checked_mul(self.depth_size.1)?.checked_mul(2)?.checked_add(8)
    }
}

impl<'a> Replay<'a> {
    /// Reads a recording; `None` when it is none, or cut off.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        let header = Header::read(bytes)?;
        let (samples, rest) = bytes.get(HEADER_BYTES..header.total_bytes()?)?.split_at_checked(header.samples * SAMPLE_BYTES)?;
        let (images, depths) = rest.split_at_checked(header.images * header.image_bytes()?)?;
        Some(Self { header, samples, images, depths })
    }

    /// What it says about itself.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The camera that took the images.
    #[must_use]
    pub fn camera(&self) -> CameraModel<f32> {
        let [fx, fy, cx, cy, k1, k2, p1, p2, ..] = self.header.numbers;
        let (width, height) = self.header.size_px;
        CameraModel::PinholeRadTan(PinholeRadTan {
            size_px: (width as u32, height as u32),
            focal_px: [fx, fy],
            center_px: [cx, cy],
            distortion: [k1, k2, p1, p2],
        })
    }

    /// `T_BC`.
    #[must_use]
    pub fn body_from_camera(&self) -> Isometry3<f32> {
        let [_, _, _, _, _, _, _, _, w, x, y, z, tx, ty, tz, ..] = self.header.numbers;
        Isometry3::from_parts(Translation3::new(tx, ty, tz), UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)))
    }

    /// Noise densities of the inertial sensor.
    #[must_use]
    pub fn imu_noise(&self) -> ImuNoise<f32> {
        let [.., gyro_noise_density, accel_noise_density, gyro_random_walk, accel_random_walk] = self.header.numbers;
        ImuNoise { gyro_noise_density, accel_noise_density, gyro_random_walk, accel_random_walk }
    }

    /// An inertial sample; `None` beyond the last.
    #[must_use]
    pub fn sample(&self, index: usize) -> Option<ImuSample<f32>> {
        let bytes = self.samples.get(index.checked_mul(SAMPLE_BYTES)?..)?;
        let vector = |at: usize| {
            let number = |k: usize| Some(f32::from_le_bytes(word(bytes, at + 4 * k)?));
            Some(Vector3::new(number(0)?, number(1)?, number(2)?))
        };
        Some(ImuSample { stamp: stamp(bytes)?, gyro_rad_s: vector(8)?, accel_m_s2: vector(20)? })
    }

    /// An image with its time; `None` beyond the last.
    #[must_use]
    pub fn image(&self, index: usize) -> Option<(Timestamp, ImageView<'a>)> {
        let (width, height) = self.header.size_px;
        let length = self.header.image_bytes()?;
        let bytes = self.images.get(index.checked_mul(length)?..)?.get(..length)?;
        Some((stamp(bytes)?, ImageView::new(bytes.get(8..)?, width, height, width).ok()?))
    }

    /// A depth map with the time of its image, its values in mm row by row; `None` beyond the last.
    #[must_use]
    pub fn depth(&self, index: usize) -> Option<(Timestamp, impl Iterator<Item = u16> + 'a)> {
        let length = self.header.depth_bytes()?;
        let bytes = self.depths.get(index.checked_mul(length)?..)?.get(..length)?;
        let (values, _) = bytes.get(8..)?.as_chunks();
        Some((stamp(bytes)?, values.iter().map(|value| u16::from_le_bytes(*value))))
    }
}
