//! Every number that may be tuned, as one file whose unknown keys are refused.

use std::path::Path;

use libella_core::estimator::{EstimatorConfig, StepBudget};
use libella_core::imu::ImuNoise;
use libella_core::real::Real;
use serde::{Deserialize, Serialize};

use crate::fault::{Fault, FaultKind, read_text};

/// The default configuration as a commented file; every key of [`Config`] stands in it with its unit.
pub const DEFAULT_TOML: &str = include_str!("default.toml");

/// The number type of the estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scalar {
    /// Single precision, as on a microcontroller.
    F32,
    /// Double precision.
    #[default]
    F64,
}

/// The whole configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Seed of everything random. Default 0.
    pub seed: u64,
    /// Number type of the estimator. Default `f64`.
    pub scalar: Scalar,
    /// The estimator.
    pub estimator: EstimatorSection,
    /// The inertial unit.
    pub imu: ImuSection,
    /// Reading of recordings.
    pub dataset: DatasetSection,
    /// Comparison with the truth.
    pub evaluation: EvaluationSection,
}

/// Numbers of the estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EstimatorSection {
    /// Magnitude of gravity, m/s². Default 9.81.
    pub gravity_m_s2: f64,
    /// Standard deviation of a corner's position, px. Default 1.
    pub sigma_px: f64,
    /// Iterations of the solver per image at most. Default 4.
    pub iterations: u8,
}

/// How the inertial unit's noise is used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuSection {
    /// Factor on the white noise of the calibration file, dimensionless. Default 1.
    pub white_noise_factor: f64,
    /// Factor on the bias random walk of the calibration file, dimensionless. Default 1.
    pub random_walk_factor: f64,
}

/// How recordings are read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DatasetSection {
    /// Images decoded ahead of the estimator at most. Default 8.
    pub images_ahead: usize,
    /// A longer pause between inertial samples is reported, ms. Default 50.
    pub max_imu_gap_ms: f64,
    /// A longer pause between images is reported, ms. Default 500.
    pub max_image_gap_ms: f64,
    /// A corner of a corner recording that was away for a frame or more returns under a new track id. Default true.
    pub reacquired_corner_is_new: bool,
}

/// How an estimate is compared with the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvaluationSection {
    /// The truth is not interpolated over longer pauses, s. Default 0.1.
    pub max_truth_gap_s: f64,
    /// Path lengths over which relative errors are taken, m. Default 1, 2, 5, 10, 20, 50.
    pub rpe_distances_m: Vec<f64>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            scalar: Scalar::F64,
            estimator: EstimatorSection::default(),
            imu: ImuSection::default(),
            dataset: DatasetSection::default(),
            evaluation: EvaluationSection::default(),
        }
    }
}

impl Default for EstimatorSection {
    fn default() -> Self {
        let core = EstimatorConfig::<f64>::default();
        Self { gravity_m_s2: core.gravity_m_s2, sigma_px: core.sigma_px, iterations: StepBudget::default().iterations }
    }
}

impl Default for ImuSection {
    fn default() -> Self {
        Self { white_noise_factor: 1.0, random_walk_factor: 1.0 }
    }
}

impl Default for DatasetSection {
    fn default() -> Self {
        Self { images_ahead: 8, max_imu_gap_ms: 50.0, max_image_gap_ms: 500.0, reacquired_corner_is_new: true }
    }
}

impl Default for EvaluationSection {
    fn default() -> Self {
        Self { max_truth_gap_s: 0.1, rpe_distances_m: vec![1.0, 2.0, 5.0, 10.0, 20.0, 50.0] }
    }
}

impl Config {
    /// Reads a configuration file; keys that it leaves out keep their defaults.
    ///
    /// # Errors
    /// When the file is absent, is no TOML, has an unknown key, or a value out of range.
    pub fn read(path: &Path) -> Result<Self, Fault> {
        let text = read_text(path, "`libella config` prints a file to start from").map_err(as_configuration)?;
        Self::parse(&text).map_err(|fault| fault.at(path))
    }

    /// The configuration in a text.
    ///
    /// # Errors
    /// When it is no TOML, has an unknown key, or a value out of range.
    pub fn parse(text: &str) -> Result<Self, Fault> {
        let config: Self = toml::from_str(text).map_err(|error| {
            let what = error.message().replace('\n', " ");
            let mut fault = Fault::new(FaultKind::Configuration, what, "`libella config` lists every key with its unit and default");
            fault.line = error.span().map(|span| 1 + text.bytes().take(span.start).filter(|byte| *byte == b'\n').count() as u64);
            fault
        })?;
        config.check()?;
        Ok(config)
    }

    /// Refuses values out of range.
    ///
    /// # Errors
    /// Names the first key whose value cannot be used.
    pub fn check(&self) -> Result<(), Fault> {
        let positive = [
            ("estimator.gravity_m_s2", self.estimator.gravity_m_s2),
            ("estimator.sigma_px", self.estimator.sigma_px),
            ("imu.white_noise_factor", self.imu.white_noise_factor),
            ("imu.random_walk_factor", self.imu.random_walk_factor),
            ("dataset.max_imu_gap_ms", self.dataset.max_imu_gap_ms),
            ("dataset.max_image_gap_ms", self.dataset.max_image_gap_ms),
            ("evaluation.max_truth_gap_s", self.evaluation.max_truth_gap_s),
        ];
        let distances = self.evaluation.rpe_distances_m.iter().map(|distance| ("evaluation.rpe_distances_m", *distance));
        let counts = [
            ("estimator.iterations", f64::from(self.estimator.iterations)),
            ("dataset.images_ahead", self.dataset.images_ahead.min(1_000) as f64),
        ];
        for (key, value) in positive.into_iter().chain(distances).chain(counts) {
            if !(value.is_finite() && value > 0.0) {
                return Err(Fault::new(FaultKind::Configuration, format!("`{key}` is {value}"), "give a positive number"));
            }
        }
        if self.dataset.images_ahead > 1_000 {
            let what = format!("`dataset.images_ahead` is {}", self.dataset.images_ahead);
            return Err(Fault::new(FaultKind::Configuration, what, "1 to 1000: each image ahead is held in memory"));
        }
        Ok(())
    }

    /// What the estimator reads of it, for an inertial unit of the given noise.
    #[must_use]
    #[allow(clippy::needless_update)]
    pub fn estimator_config<T: Real>(&self, noise: &ImuNoise<f64>) -> EstimatorConfig<T> {
        let (white, walk) = (self.imu.white_noise_factor, self.imu.random_walk_factor);
        EstimatorConfig {
            imu_noise: ImuNoise {
                gyro_noise_density: T::of(noise.gyro_noise_density * white),
                accel_noise_density: T::of(noise.accel_noise_density * white),
                gyro_random_walk: T::of(noise.gyro_random_walk * walk),
                accel_random_walk: T::of(noise.accel_random_walk * walk),
            },
            gravity_m_s2: T::of(self.estimator.gravity_m_s2),
            sigma_px: T::of(self.estimator.sigma_px),
            ..EstimatorConfig::default()
        }
    }

    /// The bound of one step.
    #[must_use]
    pub fn budget(&self) -> StepBudget {
        StepBudget { iterations: self.estimator.iterations }
    }
}

fn as_configuration(mut fault: Fault) -> Fault {
    fault.kind = FaultKind::Configuration;
    fault
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_printed_file_is_the_default_and_names_every_key() {
        assert_eq!(Config::parse(DEFAULT_TOML).unwrap(), Config::default());
        let serde_json::Value::Object(keys) = serde_json::to_value(Config::default()).unwrap() else { unreachable!() };
        let mut names: Vec<String> = Vec::new();
        for (key, value) in keys {
            match value {
                serde_json::Value::Object(section) => names.extend(section.keys().cloned()),
                _ => names.push(key),
            }
        }
        for name in names {
            assert!(DEFAULT_TOML.lines().any(|line| line.starts_with(&format!("{name} = "))), "{name} is missing");
        }
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line() {
        let fault = Config::parse("seed = 1\n\n[estimator]\nsigma_pixels = 1.0\n").unwrap_err();
        assert_eq!((fault.kind, fault.line), (FaultKind::Configuration, Some(4)));
        assert!(fault.what.contains("sigma_pixels"), "{fault}");
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for text in ["[estimator]\nsigma_px = -1.0", "[estimator]\ngravity_m_s2 = nan", "[dataset]\nimages_ahead = 0"] {
            assert_eq!(Config::parse(text).unwrap_err().kind, FaultKind::Configuration, "{text}");
        }
    }
}
