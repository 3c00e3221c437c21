//! `sensor_msgs/Imu`, `sensor_msgs/Image` and `sensor_msgs/CompressedImage`.

use image::{DynamicImage, ImageBuffer};
use libella_core::imu::ImuSample;
use libella_core::time::Timestamp;
use nalgebra::Vector3;

use super::fields::{Encoding, Fields};
use crate::dataset::{GrayImage, decode};

/// The kinds of messages that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Content {
    Imu,
    Image,
    CompressedImage,
}

impl Content {
    /// By the name of the type in ROS 1 or ROS 2.
    pub(super) fn of(name: &str) -> Option<Self> {
        match name.replace("/msg/", "/").as_str() {
            "sensor_msgs/Imu" => Some(Self::Imu),
            "sensor_msgs/Image" => Some(Self::Image),
            "sensor_msgs/CompressedImage" => Some(Self::CompressedImage),
            _ => None,
        }
    }
}

/// The time in the header of any of them.
pub(super) fn stamp(encoding: Encoding, message: &[u8]) -> Option<Timestamp> {
    Fields::new(encoding, message)?.header()
}

/// A `sensor_msgs/Imu`: header, orientation (4, covariance 9), angular velocity (3, 9), linear acceleration (3, 9).
pub(super) fn imu(encoding: Encoding, message: &[u8]) -> Option<ImuSample<f64>> {
    let mut fields = Fields::new(encoding, message)?;
    let stamp = fields.header()?;
    fields.f64s::<13>()?;
    let gyro_rad_s = Vector3::from(fields.f64s::<3>()?);
    fields.f64s::<9>()?;
    let accel_m_s2 = Vector3::from(fields.f64s::<3>()?);
    Some(ImuSample { stamp, gyro_rad_s, accel_m_s2 })
}

/// The grey pixels of an image message, made from colours as those of an image file are.
///
/// # Errors
/// What is wrong with it.
pub(super) fn image(content: Content, encoding: Encoding, message: &[u8]) -> Result<GrayImage, String> {
    const CUT_OFF: &str = "the message is cut off or of another type than it says";
    let mut fields = Fields::new(encoding, message).ok_or(CUT_OFF)?;
    fields.header().ok_or(CUT_OFF)?;
    if content == Content::CompressedImage {
        let format = fields.string().ok_or(CUT_OFF)?;
        let data = fields.list().ok_or(CUT_OFF)?;
        return decode::gray(data).map_err(|reason| format!("format `{}`: {reason}", format.escape_debug()));
    }
    let (height, width) = (fields.u32().ok_or(CUT_OFF)?, fields.u32().ok_or(CUT_OFF)?);
    let name = fields.string().ok_or(CUT_OFF)?;
    let is_big_endian = fields.u8().ok_or(CUT_OFF)? != 0;
    let step = fields.u32().ok_or(CUT_OFF)?;
    let data = fields.list().ok_or(CUT_OFF)?;
    let pixel_bytes: usize = match name {
        "mono8" | "8UC1" => 1,
        "mono16" | "16UC1" => 2,
        "rgb8" | "bgr8" | "8UC3" => 3,
        "rgba8" | "bgra8" | "8UC4" => 4,
        _ => return Err(format!("encoding `{}` is not supported, only mono8, mono16, rgb8, bgr8, rgba8, bgra8", name.escape_debug())),
    };
    let rows = rows(data, [width, height, step], pixel_bytes)
        .ok_or_else(|| format!("{} bytes are no image of {width}x{height} {name} with {step} bytes a row", data.len()))?;
    let swapped = |pixel: &mut [u8]| {
        if name.starts_with(['b', '8']) {
            pixel.swap(0, 2)
        }
    };
    let image = match pixel_bytes {
        1 => ImageBuffer::from_raw(width, height, rows).map(DynamicImage::ImageLuma8),
        2 => {
            let word = if is_big_endian { u16::from_be_bytes } else { u16::from_le_bytes };
            let words = rows.as_chunks::<2>().0.iter().map(|bytes| word(*bytes)).collect();
            ImageBuffer::from_raw(width, height, words).map(DynamicImage::ImageLuma16)
        }
        3 => {
            let mut rows = rows;
            rows.chunks_exact_mut(3).for_each(swapped);
            ImageBuffer::from_raw(width, height, rows).map(DynamicImage::ImageRgb8)
        }
        _ => {
            let mut rows = rows;
            rows.chunks_exact_mut(4).for_each(swapped);
            ImageBuffer::from_raw(width, height, rows).map(DynamicImage::ImageRgba8)
        }
    };
    image.map(GrayImage::from).ok_or_else(|| CUT_OFF.to_owned())
}

/// The pixels without what pads the rows.
fn rows(data: &[u8], [width, height, step]: [u32; 3], pixel_bytes: usize) -> Option<Vec<u8>> {
    let [width, height, step] = [width, height, step].map(|value| usize::try_from(value).unwrap_or(usize::MAX));
    let row = width.checked_mul(pixel_bytes)?;
    if row == 0 || height == 0 || row > step || data.len() < step.checked_mul(height - 1)?.checked_add(row)? {
        return None;
    }
    Some(data.chunks(step).take(height).filter_map(|line| line.get(..row)).flatten().copied().collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A ROS 1 image with two bytes of padding a row.
    fn message(width: u32, height: u32, name: &str, step: u32, data: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0; 12];
        bytes.extend([0; 4]);
        bytes.extend(height.to_le_bytes());
        bytes.extend(width.to_le_bytes());
        bytes.extend(u32::try_from(name.len()).unwrap().to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.push(0);
        bytes.extend(step.to_le_bytes());
        bytes.extend(u32::try_from(data.len()).unwrap().to_le_bytes());
        bytes.extend(data);
        bytes
    }

    fn read(width: u32, height: u32, name: &str, step: u32, data: &[u8]) -> Result<Vec<u8>, String> {
        image(Content::Image, Encoding::Ros1, &message(width, height, name, step, data)).map(|image| image.pixels)
    }

    #[test]
    fn every_encoding_becomes_grey() {
        assert_eq!(read(2, 2, "mono8", 3, &[1, 2, 0, 3, 4, 0]).unwrap(), [1, 2, 3, 4]);
        // The last row may end without its padding.
        assert_eq!(read(2, 2, "8UC1", 3, &[1, 2, 0, 3, 4]).unwrap(), [1, 2, 3, 4]);
        assert_eq!(read(1, 1, "mono16", 2, &[0, 128]).unwrap(), [128]);
        // Luma weighs green most and blue least: the order of the channels shows.
        let gray = |name: &str, data: &[u8]| read(1, 1, name, 4, data).unwrap()[0];
        let (red, blue) = (gray("rgb8", &[200, 0, 0]), gray("rgb8", &[0, 0, 200]));
        assert!(red > 2 * blue && blue > 0, "{red} {blue}");
        assert_eq!((gray("bgr8", &[0, 0, 200]), gray("bgr8", &[200, 0, 0])), (red, blue));
        assert_eq!((gray("bgra8", &[0, 0, 200, 255]), gray("rgba8", &[200, 0, 0, 255])), (red, red));
    }

    #[test]
    fn images_that_are_none_are_refused_with_the_reason() {
        for (given, word) in [
            (read(2, 2, "bayer_rggb8", 2, &[0; 4]), "bayer_rggb8"),
            (read(2, 2, "mono8", 1, &[0; 4]), "4 bytes are no image of 2x2"),
            (read(2, 3, "mono8", 2, &[0; 4]), "no image"),
            (read(0, 3, "mono8", 2, &[0; 4]), "no image"),
            (read(u32::MAX, u32::MAX, "rgba8", u32::MAX, &[0; 4]), "no image"),
        ] {
            let reason = given.unwrap_err();
            assert!(reason.contains(word), "{reason}");
        }
        let whole = message(2, 2, "mono8", 2, &[1, 2, 3, 4]);
        for end in 0..whole.len() {
            assert!(image(Content::Image, Encoding::Ros1, &whole[..end]).is_err());
        }
    }
}
