//! A small image by averaging areas of a large one.

use libella_core::camera::{CameraModel, PinholeRadTan};
use libella_host::dataset::GrayImage;

/// Size of the images of [`Micro`](libella_core::profile::Micro), px.
pub const SIZE_PX: (usize, usize) = (160, 120);

/// The mean grey level of the area of every small pixel, rounded. Pixels that lie in two areas count in both, by their share.
#[must_use]
pub fn shrink(image: &GrayImage) -> Vec<u8> {
    let (width, height) = SIZE_PX;
    let (columns, rows) = (shares(image.width, width), shares(image.height, height));
    let mut narrow = vec![0.0_f32; width * image.height];
    for (row, out) in image.pixels.chunks_exact(image.width).zip(narrow.chunks_exact_mut(width)) {
        for (out, shares) in out.iter_mut().zip(&columns) {
            *out = shares.iter().map(|(x, share)| f32::from(row[*x]) * share).sum();
        }
    }
    let mut small = Vec::with_capacity(width * height);
    for shares in &rows {
        for x in 0..width {
            let mean: f32 = shares.iter().map(|(y, share)| narrow[y * width + x] * share).sum();
            small.push(mean.round() as u8);
        }
    }
    small
}

/// For each of `small` pixels the indices of the `large` ones that it covers, with their shares of its length.
fn shares(large: usize, small: usize) -> Vec<Vec<(usize, f32)>> {
    let ratio = large as f64 / small as f64;
    let cover = |k: usize| {
        let (from, to) = (k as f64 * ratio, (k + 1) as f64 * ratio);
        let last = (to.ceil() as usize).min(large);
        (from as usize..last).map(move |i| (i, ((to.min((i + 1) as f64) - from.max(i as f64)) / ratio) as f32)).collect()
    };
    (0..small).map(cover).collect()
}

/// The camera whose images [`shrink`] makes; `None` for a camera that is no pinhole.
#[must_use]
pub fn camera(large: &CameraModel<f64>) -> Option<PinholeRadTan<f64>> {
    let CameraModel::PinholeRadTan(large) = large else { return None };
    let scale = [SIZE_PX.0 as f64 / f64::from(large.size_px.0), SIZE_PX.1 as f64 / f64::from(large.size_px.1)];
    // The centre of pixel 0 is at 0, so that its area begins at −½.
    let center_px = [0, 1].map(|k| (large.center_px[k] + 0.5) * scale[k] - 0.5);
    let focal_px = [0, 1].map(|k| large.focal_px[k] * scale[k]);
    Some(PinholeRadTan { size_px: (SIZE_PX.0 as u32, SIZE_PX.1 as u32), focal_px, center_px, ..*large })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_and_the_camera_agrees() {
        // A grey level linear in x: the mean over an area is its value at the area's centre.
        let (width, height) = (752, 480);
        let pixels = (0..width * height).map(|i| ((i % width) / 4) as u8).collect();
        let small = shrink(&GrayImage { width, height, pixels });
        for (x, value) in small.iter().take(160).enumerate() {
            let center = (x as f64 + 0.5) * 4.7 - 0.5;
            assert!((f64::from(*value) - (center - 1.5) / 4.0).abs() < 0.76, "{x}: {value}");
        }
        let large = PinholeRadTan { size_px: (752, 480), focal_px: [400.0; 2], center_px: [375.5, 239.5], distortion: [0.0; 4] };
        // The middle of the image stays the middle.
        let small = camera(&CameraModel::PinholeRadTan(large)).map(|camera| (camera.center_px, camera.focal_px[1]));
        assert_eq!(small, Some(([79.5, 59.5], 100.0)));
    }

    #[test]
    fn every_pixel_counts_as_much_as_every_other() {
        for (large, small) in [(752, 160), (480, 120), (7, 3)] {
            let mut weights = vec![0.0_f32; large];
            for shares in shares(large, small) {
                assert!((shares.iter().map(|(_, share)| share).sum::<f32>() - 1.0).abs() < 1e-5);
                for (i, share) in shares {
                    weights[i] += share;
                }
            }
            assert!(weights.iter().all(|weight| (weight - small as f32 / large as f32).abs() < 1e-5));
        }
    }
}
