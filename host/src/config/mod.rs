//! Every number that may be tuned, as one file whose unknown keys are refused.

mod depth;
mod planes;

pub use depth::{DepthSection, DepthUseSection, Weighting};
pub use planes::PlanesSection;

use std::path::Path;

use libella_core::estimator::{EstimatorConfig, FirstSigma, StepBudget};
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
    /// Depth beside the images.
    pub depth: DepthSection,
    /// Reading of recordings.
    pub dataset: DatasetSection,
    /// Comparison with the truth.
    pub evaluation: EvaluationSection,
    /// Planes among the points of the map.
    pub planes: PlanesSection,
}

/// Numbers of the estimator, see [`EstimatorConfig`]; the defaults are those of the core.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EstimatorSection {
    /// Iterations of the solver per image at most. Default 4.
    pub iterations: u8,
    /// Factor on the white noise densities: what the datasheet leaves out (vibration, scale errors, sampling jitter). Default 4.0.
    pub imu_noise_inflation: f64,
    /// Factor on the random walks of the biases. Default 2.0.
    pub imu_walk_inflation: f64,
    /// How far from frame to frame the camera may be from where exact samples would have it, m: speed times the jitter of the
    /// stamps, flexing mounts. Default 0.001.
    pub position_jitter_m: f64,
    /// Largest angular rate that the gyro can read, rad/s: readings at the end of it are hardly trusted. Default 17.45 (1000 deg/s).
    pub gyro_range_rad_s: f64,
    /// Largest specific force that the accelerometer can read, m/s^2. Default 176.5 (18 g).
    pub accel_range_m_s2: f64,
    /// Magnitude of gravity, m/s². Default 9.81.
    pub gravity_m_s2: f64,
    /// Standard deviation of a corner's position, px. Default 0.4.
    pub sigma_px: f64,
    /// Where the Huber cost of an observation turns linear, in standard deviations. Default 2.0.
    pub huber: f64,
    /// Squared whitened residual over which an observation is taken out after solving : four standard deviations. Default 16.0.
    pub outlier_chi2: f64,
    /// A frame becomes a keyframe when its corners have moved this far since the last one, rotation apart, px. Default 20.0.
    pub keyframe_parallax_px: f64,
    /// Or when less than this share of its corners was seen by the last one. Default 0.6.
    pub keyframe_shared_ratio: f64,
    /// Or after this time with at least a quarter of that parallax, s. Default 1.0.
    pub keyframe_interval_s: f64,
    /// Inverse depth of a landmark before anything is known of it, 1/m. Default 0.3.
    pub inverse_depth_per_m: f64,
    /// Its standard deviation, 1/m; wide, so that motion decides. Default 3.0.
    pub inverse_depth_sigma_per_m: f64,
    /// The same while motion has told nothing yet, 1/m; narrow, or all points go to infinity and the body anywhere. Default 0.6.
    pub inverse_depth_guess_sigma_per_m: f64,
    /// Standard deviation of the velocity of a body found at rest, m/s. Default 0.02.
    pub rest_sigma_m_s: f64,
    /// Common displacement of the corners since the image stands still at which it moves, px. Default 0.25.
    pub rest_motion_px: f64,
    /// Corners that have to be seen for a pose to count as tracked; below, it coasts. Default 8.
    pub least_tracked: usize,
    /// Longest time without vision before tracking is lost, s. Default 5.0.
    pub longest_coast_s: f64,
    /// Shortest stretch of motion for initialisation, s. Default 1.2.
    pub shortest_initialisation_s: f64,
    /// Longest stretch of motion that the moving start looks back on, s. Default 4.0.
    pub longest_initialisation_s: f64,
    /// Time between the frames that the moving start uses, s. Default 0.18.
    pub initialisation_spacing_s: f64,
    /// Largest relative standard deviation of the scale that the moving start accepts. Default 0.15.
    pub initialisation_scale_sigma: f64,
    /// Uncertainty of the first state.
    pub first_sigma: FirstSigmaSection,
    /// How much depth counts.
    pub depth: DepthUseSection,
}

/// Standard deviations of the first state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FirstSigmaSection {
    /// Angle between the estimated and the true vertical, rad. Default 0.1.
    pub tilt_rad: f64,
    /// Velocity, m/s. Default 0.5.
    pub velocity_m_s: f64,
    /// Bias of the angular rate, rad/s. Default 0.05.
    pub gyro_bias_rad_s: f64,
    /// Bias of the specific force, m/s². Default 0.15.
    pub accel_bias_m_s2: f64,
}

/// How recordings are read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DatasetSection {
    /// Images left out at the beginning, as though the camera had been switched on later. Default 0.
    pub skip_images: usize,
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
            depth: DepthSection::default(),
            dataset: DatasetSection::default(),
            evaluation: EvaluationSection::default(),
            planes: PlanesSection::default(),
        }
    }
}

impl Default for EstimatorSection {
    fn default() -> Self {
        let core = EstimatorConfig::<f64>::default();
        Self {
            iterations: StepBudget::default().iterations,
            imu_noise_inflation: core.imu_noise_inflation,
            imu_walk_inflation: core.imu_walk_inflation,
            position_jitter_m: core.position_jitter_m,
            gyro_range_rad_s: core.gyro_range_rad_s,
            accel_range_m_s2: core.accel_range_m_s2,
            gravity_m_s2: core.gravity_m_s2,
            sigma_px: core.sigma_px,
            huber: core.huber,
            outlier_chi2: core.outlier_chi2,
            keyframe_parallax_px: core.keyframe_parallax_px,
            keyframe_shared_ratio: core.keyframe_shared_ratio,
            keyframe_interval_s: core.keyframe_interval_s,
            inverse_depth_per_m: core.inverse_depth_per_m,
            inverse_depth_sigma_per_m: core.inverse_depth_sigma_per_m,
            inverse_depth_guess_sigma_per_m: core.inverse_depth_guess_sigma_per_m,
            rest_sigma_m_s: core.rest_sigma_m_s,
            rest_motion_px: core.rest_motion_px,
            least_tracked: core.least_tracked,
            longest_coast_s: core.longest_coast_s,
            shortest_initialisation_s: core.shortest_initialisation_s,
            longest_initialisation_s: core.longest_initialisation_s,
            initialisation_spacing_s: core.initialisation_spacing_s,
            initialisation_scale_sigma: core.initialisation_scale_sigma,
            first_sigma: FirstSigmaSection::default(),
            depth: DepthUseSection::default(),
        }
    }
}

impl Default for FirstSigmaSection {
    fn default() -> Self {
        let FirstSigma { tilt_rad, velocity_m_s, gyro_bias_rad_s, accel_bias_m_s2 } = EstimatorConfig::<f64>::default().first_sigma;
        Self { tilt_rad, velocity_m_s, gyro_bias_rad_s, accel_bias_m_s2 }
    }
}

impl Default for DatasetSection {
    fn default() -> Self {
        Self { skip_images: 0, images_ahead: 8, max_imu_gap_ms: 50.0, max_image_gap_ms: 500.0, reacquired_corner_is_new: true }
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
        let (estimator, first) = (&self.estimator, &self.estimator.first_sigma);
        let positive = [
            ("estimator.imu_noise_inflation", estimator.imu_noise_inflation),
            ("estimator.imu_walk_inflation", estimator.imu_walk_inflation),
            ("estimator.position_jitter_m", estimator.position_jitter_m),
            ("estimator.gyro_range_rad_s", estimator.gyro_range_rad_s),
            ("estimator.accel_range_m_s2", estimator.accel_range_m_s2),
            ("estimator.gravity_m_s2", estimator.gravity_m_s2),
            ("estimator.sigma_px", estimator.sigma_px),
            ("estimator.huber", estimator.huber),
            ("estimator.outlier_chi2", estimator.outlier_chi2),
            ("estimator.keyframe_parallax_px", estimator.keyframe_parallax_px),
            ("estimator.keyframe_shared_ratio", estimator.keyframe_shared_ratio),
            ("estimator.keyframe_interval_s", estimator.keyframe_interval_s),
            ("estimator.inverse_depth_per_m", estimator.inverse_depth_per_m),
            ("estimator.inverse_depth_sigma_per_m", estimator.inverse_depth_sigma_per_m),
            ("estimator.inverse_depth_guess_sigma_per_m", estimator.inverse_depth_guess_sigma_per_m),
            ("estimator.rest_sigma_m_s", estimator.rest_sigma_m_s),
            ("estimator.rest_motion_px", estimator.rest_motion_px),
            ("estimator.longest_coast_s", estimator.longest_coast_s),
            ("estimator.shortest_initialisation_s", estimator.shortest_initialisation_s),
            ("estimator.longest_initialisation_s", estimator.longest_initialisation_s),
            ("estimator.initialisation_spacing_s", estimator.initialisation_spacing_s),
            ("estimator.initialisation_scale_sigma", estimator.initialisation_scale_sigma),
            ("estimator.first_sigma.tilt_rad", first.tilt_rad),
            ("estimator.first_sigma.velocity_m_s", first.velocity_m_s),
            ("estimator.first_sigma.gyro_bias_rad_s", first.gyro_bias_rad_s),
            ("estimator.first_sigma.accel_bias_m_s2", first.accel_bias_m_s2),
            ("depth.rate_hz", self.depth.rate_hz),
            ("depth.sigma_log", self.depth.sigma_log),
            ("dataset.max_imu_gap_ms", self.dataset.max_imu_gap_ms),
            ("dataset.max_image_gap_ms", self.dataset.max_image_gap_ms),
            ("evaluation.max_truth_gap_s", self.evaluation.max_truth_gap_s),
        ];
        let distances = self.evaluation.rpe_distances_m.iter().map(|distance| ("evaluation.rpe_distances_m", *distance));
        let counts = [
            ("estimator.iterations", f64::from(self.estimator.iterations)),
            ("dataset.images_ahead", self.dataset.images_ahead.min(1_000) as f64),
        ];
        for (key, value) in
            positive.into_iter().chain(estimator.depth.positive()).chain(distances).chain(counts).chain(self.planes.positive())
        {
            if !(value.is_finite() && value > 0.0) {
                return Err(Fault::new(FaultKind::Configuration, format!("`{key}` is {value}"), "give a positive number"));
            }
        }
        if estimator.depth.right_view_alpha > 1.0 {
            let what = format!("`estimator.depth.right_view_alpha` is {}", estimator.depth.right_view_alpha);
            return Err(Fault::new(FaultKind::Configuration, what, "give a share, above 0 and up to 1"));
        }
        if self.dataset.images_ahead > 1_000 {
            let what = format!("`dataset.images_ahead` is {}", self.dataset.images_ahead);
            return Err(Fault::new(FaultKind::Configuration, what, "1 to 1000: each image ahead is held in memory"));
        }
        if !(0.0..=1.0).contains(&self.planes.follow) {
            return Err(Fault::new(
                FaultKind::Configuration,
                format!("`planes.follow` is {}", self.planes.follow),
                "give a share of 0 to 1",
            ));
        }
        Ok(())
    }

    /// What the estimator reads of it, for an inertial unit of the given noise.
    #[must_use]
    pub fn estimator_config<T: Real>(&self, noise: &ImuNoise<f64>) -> EstimatorConfig<T> {
        let (estimator, first) = (&self.estimator, &self.estimator.first_sigma);
        EstimatorConfig {
            imu_noise: ImuNoise {
                gyro_noise_density: T::of(noise.gyro_noise_density),
                accel_noise_density: T::of(noise.accel_noise_density),
                gyro_random_walk: T::of(noise.gyro_random_walk),
                accel_random_walk: T::of(noise.accel_random_walk),
            },
            imu_noise_inflation: T::of(estimator.imu_noise_inflation),
            imu_walk_inflation: T::of(estimator.imu_walk_inflation),
            position_jitter_m: T::of(estimator.position_jitter_m),
            gyro_range_rad_s: T::of(estimator.gyro_range_rad_s),
            accel_range_m_s2: T::of(estimator.accel_range_m_s2),
            gravity_m_s2: T::of(estimator.gravity_m_s2),
            sigma_px: T::of(estimator.sigma_px),
            huber: T::of(estimator.huber),
            outlier_chi2: T::of(estimator.outlier_chi2),
            keyframe_parallax_px: T::of(estimator.keyframe_parallax_px),
            keyframe_shared_ratio: T::of(estimator.keyframe_shared_ratio),
            keyframe_interval_s: T::of(estimator.keyframe_interval_s),
            inverse_depth_per_m: T::of(estimator.inverse_depth_per_m),
            inverse_depth_sigma_per_m: T::of(estimator.inverse_depth_sigma_per_m),
            inverse_depth_guess_sigma_per_m: T::of(estimator.inverse_depth_guess_sigma_per_m),
            rest_sigma_m_s: T::of(estimator.rest_sigma_m_s),
            rest_motion_px: T::of(estimator.rest_motion_px),
            least_tracked: estimator.least_tracked,
            longest_coast_s: T::of(estimator.longest_coast_s),
            shortest_initialisation_s: T::of(estimator.shortest_initialisation_s),
            longest_initialisation_s: T::of(estimator.longest_initialisation_s),
            initialisation_spacing_s: T::of(estimator.initialisation_spacing_s),
            initialisation_scale_sigma: T::of(estimator.initialisation_scale_sigma),
            depth: estimator.depth.core(),
            planes: self.planes.for_core(),
            first_sigma: FirstSigma {
                tilt_rad: T::of(first.tilt_rad),
                velocity_m_s: T::of(first.velocity_m_s),
                gyro_bias_rad_s: T::of(first.gyro_bias_rad_s),
                accel_bias_m_s2: T::of(first.accel_bias_m_s2),
            },
        }
    }

    /// The bound of one step.
    #[must_use]
    pub fn budget(&self) -> StepBudget {
        StepBudget { iterations: self.estimator.iterations, ..StepBudget::default() }
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

    fn names(keys: serde_json::Map<String, serde_json::Value>) -> Vec<String> {
        let inner = keys.into_iter().map(|(key, value)| match value {
            serde_json::Value::Object(section) => names(section),
            _ => vec![key],
        });
        inner.flatten().collect()
    }

    #[test]
    fn the_printed_file_is_the_default_and_names_every_key() {
        assert_eq!(Config::parse(DEFAULT_TOML).unwrap(), Config::default());
        let serde_json::Value::Object(keys) = serde_json::to_value(Config::default()).unwrap() else { unreachable!() };
        for name in names(keys) {
            assert!(DEFAULT_TOML.lines().any(|line| line.starts_with(&format!("{name} = "))), "{name} is missing");
        }
    }

    #[test]
    fn the_default_configuration_is_that_of_the_core() {
        assert_eq!(Config::default().estimator_config::<f64>(&ImuNoise::adis16448()), EstimatorConfig::default());
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line() {
        let fault = Config::parse("seed = 1\n\n[estimator]\nsigma_pixels = 1.0\n").unwrap_err();
        assert_eq!((fault.kind, fault.line), (FaultKind::Configuration, Some(4)));
        assert!(fault.what.contains("sigma_pixels"), "{fault}");
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for text in [
            "[estimator]\nsigma_px = -1.0",
            "[estimator]\ngravity_m_s2 = nan",
            "[dataset]\nimages_ahead = 0",
            "[depth]\nrate_hz = 0",
            "[estimator.depth]\nright_view_alpha = 1.1",
            "[estimator.depth]\nweighting = \"any\"",
        ] {
            assert_eq!(Config::parse(text).unwrap_err().kind, FaultKind::Configuration, "{text}");
        }
    }
}
