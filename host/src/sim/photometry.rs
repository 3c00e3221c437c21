//! From radiance to grey values: exposure control, lens shading, shot and read noise, eight bits.
//!
//! # Model
//! ```text
//! g = gain · L · (1 − s r²)              r: distance from the centre, 1 at the corner
//! I = round(255 g + n),   n ~ N(0, σ_read² + k · 255 g)
//! ```
//! The gain follows the mean brightness of the last second by half, as automatic exposure does; it is a function of time alone.

use super::SimError;
use super::random::{Random, mix};

/// Lens and sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotometryConfig {
    /// Grey value at which a mean scene comes out, 20 to 200.
    pub target_grey: f64,
    /// How much of a change of brightness the exposure takes back, 0 (fixed gain) to 1.
    pub control: f64,
    /// Loss of light in the corners, 0 to 0.9.
    pub vignetting: f64,
    /// Noise in the dark, grey values, 0 to 20.
    pub read_noise: f64,
    /// Variance per grey value, 0 to 1: photons.
    pub shot_noise: f64,
}

impl Default for PhotometryConfig {
    fn default() -> Self {
        Self { target_grey: 165.0, control: 0.6, vignetting: 0.3, read_noise: 1.2, shot_noise: 0.02 }
    }
}

impl PhotometryConfig {
    /// No noise, no shading, fixed gain: radiance as it is.
    #[must_use]
    pub fn ideal() -> Self {
        Self { control: 0.0, vignetting: 0.0, read_noise: 0.0, shot_noise: 0.0, ..Self::default() }
    }
}

/// Mean radiance of an average scene; the gain is set for it.
const MEAN_RADIANCE: f32 = 0.27;
/// How many normal numbers are kept.
const TABLE: usize = 1 << 14;

#[derive(Debug, Clone)]
pub(super) struct Photometry {
    config: PhotometryConfig,
    seed: u64,
    shading: Vec<f32>,
    normals: Vec<f32>,
}

impl Photometry {
    pub(super) fn new(config: &PhotometryConfig, width: usize, height: usize, seed: u64) -> Result<Self, SimError> {
        SimError::check("photometry.target_grey", config.target_grey, 20.0, 200.0)?;
        SimError::check("photometry.control", config.control, 0.0, 1.0)?;
        SimError::check("photometry.vignetting", config.vignetting, 0.0, 0.9)?;
        SimError::check("photometry.read_noise", config.read_noise, 0.0, 20.0)?;
        SimError::check("photometry.shot_noise", config.shot_noise, 0.0, 1.0)?;
        let (cx, cy) = ((width as f32 - 1.0) * 0.5, (height as f32 - 1.0) * 0.5);
        let corner = cx * cx + cy * cy;
        let loss = config.vignetting as f32;
        let shading = (0..width * height)
            .map(|pixel| {
                let (x, y) = ((pixel % width) as f32 - cx, (pixel / width) as f32 - cy);
                255.0 * (1.0 - loss * (x * x + y * y) / corner)
            })
            .collect();
        let mut random = Random::new(seed, "sensor");
        let normals = (0..TABLE).map(|_| random.normal() as f32).collect();
        Ok(Self { config: *config, seed, shading, normals })
    }

    /// The gain at a time, from the mean radiance at several times of the last second.
    pub(super) fn gain(&self, mean_radiance: impl Fn(f64) -> f32, seconds: f64) -> f32 {
        let fixed = self.config.target_grey as f32 / 255.0 / MEAN_RADIANCE;
        if self.config.control == 0.0 {
            return fixed;
        }
        // On a fixed raster of time, each value fading in and out linearly: continuous, whatever the frame rate.
        let (raster, reach) = (0.25, 1.0);
        let (mut sum, mut weights) = (0.0, 0.0);
        let mut tick = ((seconds - reach) / raster).ceil();
        while tick * raster <= seconds {
            let age = seconds - tick * raster;
            let weight = (age / raster).min(1.0) * ((reach - age) / raster).min(1.0);
            if weight > 0.0 {
                sum += weight as f32 * mean_radiance(tick * raster);
                weights += weight as f32;
            }
            tick += 1.0;
        }
        let mean = if weights > 0.0 { sum / weights } else { mean_radiance(seconds) };
        fixed * (MEAN_RADIANCE / mean.max(0.02)).powf(self.config.control as f32)
    }

    /// The grey value of an exposed radiance; the noise is a function of seed, picture and pixel.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    pub(super) fn digitise(&self, exposed: f32, pixel: usize, index: u64) -> u8 {
        let grey = exposed * self.shading[pixel];
        let variance = (self.config.read_noise * self.config.read_noise) as f32 + self.config.shot_noise as f32 * grey.min(255.0);
        let noise = if variance > 0.0 {
            let draw = mix(self.seed ^ (index << 32) ^ pixel as u64) as usize & (TABLE - 1);
            variance.sqrt() * self.normals[draw]
        } else {
            0.0
        };
        // The cast saturates at 0 and 255.
        (grey + noise + 0.5) as u8
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_variance_of_the_model() {
        let config = PhotometryConfig { read_noise: 2.0, shot_noise: 0.05, vignetting: 0.0, ..PhotometryConfig::default() };
        let sensor = Photometry::new(&config, 200, 200, 3).unwrap();
        for grey in [60.0_f32, 180.0] {
            let values: Vec<f64> = (0..40_000).map(|pixel| f64::from(sensor.digitise(grey / 255.0, pixel, 7))).collect();
            let mean = values.iter().sum::<f64>() / 4e4;
            let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 4e4;
            // Rounding to whole grey values adds 1/12.
            let expected = 4.0 + 0.05 * f64::from(grey) + 1.0 / 12.0;
            assert!((mean - f64::from(grey)).abs() < 0.1, "{mean}");
            assert!((variance / expected - 1.0).abs() < 0.05, "{variance} {expected}");
        }
    }

    #[test]
    fn exposure_takes_back_part_of_a_change_and_never_leaps() {
        let sensor = Photometry::new(&PhotometryConfig::default(), 20, 20, 3).unwrap();
        let scene = |time: f64| if time < 5.0 { 0.2 } else { 0.6 };
        let gains: Vec<f32> = (0..200).map(|k| sensor.gain(scene, f64::from(k) * 0.05)).collect();
        assert!(gains.windows(2).all(|pair| (pair[1] / pair[0] - 1.0).abs() < 0.2), "{gains:?}");
        let ratio = gains[199] / gains[50];
        assert!((ratio - (1.0_f32 / 3.0).powf(0.6)).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn refuses_a_negative_noise() {
        let config = PhotometryConfig { read_noise: -1.0, ..PhotometryConfig::default() };
        let message = Photometry::new(&config, 20, 20, 3).err().unwrap().to_string();
        assert!(message.contains("read_noise") && message.contains("0 to 20"), "{message}");
    }
}
