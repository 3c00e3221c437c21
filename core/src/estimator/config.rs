//! Every number that may be tuned, with its unit and default.

use crate::depth::{ScaleTracker, Weighting};
use crate::imu::ImuNoise;
use crate::real::Real;
use crate::storage::blank::blank;

/// Configuration of the estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorConfig<T: Real> {
    /// Noise densities of the inertial measurement unit, from its datasheet or an Allan plot.
    pub imu_noise: ImuNoise<T>,
    /// Factor on the white noise densities: what the datasheet leaves out (vibration, scale errors, sampling jitter).
    pub imu_noise_inflation: T,
    /// Factor on the random walks of the biases.
    pub imu_walk_inflation: T,
    /// How far from frame to frame the camera may be from where exact samples would have it, m: speed times the jitter of the
    /// stamps, flexing mounts.
    pub position_jitter_m: T,
    /// Largest angular rate that the gyro can read, rad/s: readings at the end of it are hardly trusted.
    pub gyro_range_rad_s: T,
    /// Largest specific force that the accelerometer can read, m/s².
    pub accel_range_m_s2: T,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: T,
    /// Standard deviation of a corner's position, px.
    pub sigma_px: T,
    /// Where the Huber cost of an observation turns linear, in standard deviations.
    pub huber: T,
    /// Squared whitened residual over which an observation is taken out after solving: four standard deviations.
    pub outlier_chi2: T,
    /// A frame becomes a keyframe when its corners have moved this far since the last one, rotation apart, px.
    pub keyframe_parallax_px: T,
    /// Or when less than this share of its corners was seen by the last one.
    pub keyframe_shared_ratio: T,
    /// Or after this time with at least a quarter of that parallax, s.
    pub keyframe_interval_s: T,
    /// Inverse depth of a landmark before anything is known of it, 1/m.
    pub inverse_depth_per_m: T,
    /// Its standard deviation, 1/m; wide, so that motion decides.
    pub inverse_depth_sigma_per_m: T,
    /// The same while motion has told nothing yet, 1/m; narrow, or all points go to infinity and the body anywhere.
    pub inverse_depth_guess_sigma_per_m: T,
    /// Standard deviation of the velocity of a body found at rest, m/s.
    pub rest_sigma_m_s: T,
    /// Common displacement of the corners since the image stands still at which it moves, px.
    pub rest_motion_px: T,
    /// Corners that have to be seen for a pose to count as tracked; below, it coasts.
    pub least_tracked: usize,
    /// Longest time without vision before tracking is lost, s.
    pub longest_coast_s: T,
    /// Shortest stretch of motion for initialisation, s.
    pub shortest_initialisation_s: T,
    /// Longest stretch of motion that the moving start looks back on, s.
    pub longest_initialisation_s: T,
    /// Time between the frames that the moving start uses, s.
    pub initialisation_spacing_s: T,
    /// Largest relative standard deviation of the scale that the moving start accepts.
    pub initialisation_scale_sigma: T,
    /// How depth that someone else tells is used.
    pub depth: DepthConfig<T>,
    /// How planes that someone else finds are used.
    pub planes: PlaneConfig<T>,
    /// Standard deviations of the first state: tilt (rad), velocity (m/s), gyro bias (rad/s), accelerometer bias (m/s²).
    pub first_sigma: FirstSigma<T>,
}

blank!([T: Real] EstimatorConfig<T> {
    imu_noise,
    imu_noise_inflation,
    imu_walk_inflation,
    position_jitter_m,
    gyro_range_rad_s,
    accel_range_m_s2,
    gravity_m_s2,
    sigma_px,
    huber,
    outlier_chi2,
    keyframe_parallax_px,
    keyframe_shared_ratio,
    keyframe_interval_s,
    inverse_depth_per_m,
    inverse_depth_sigma_per_m,
    inverse_depth_guess_sigma_per_m,
    depth,
    planes,
    rest_sigma_m_s,
    rest_motion_px,
    least_tracked,
    longest_coast_s,
    shortest_initialisation_s,
    longest_initialisation_s,
    initialisation_spacing_s,
    initialisation_scale_sigma,
    first_sigma,
});

/// How depth that someone else tells is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthConfig<T: Real> {
    /// How much a depth counts beside the corners.
    pub weighting: Weighting<T>,
    /// Standard deviation of the logarithm of the source's factor before anything is known of it. Below `image_scale_sigma` the source is
    /// taken at its word, see [`ScaleTracker`].
    pub scale_sigma: T,
    /// How far that logarithm walks in a second.
    pub scale_walk_per_root_s: T,
    /// To what one image tells it.
    pub image_scale_sigma: T,
    /// A depth farther from what the corners say than this many standard deviations is given up.
    pub gate_sigma: T,
    /// Shortest stretch of motion for a start with depths, s. What tells that they are wrong grows with its square: an acceleration of 1 m/s²
    /// is 2 cm after 0.2 s, 4.5 cm after 0.3 s.
    pub shortest_start_s: T,
}

/// How planes that someone else finds are used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneConfig<T: Real> {
    /// `β`, what the cost of being off a plane counts beside that of corners.
    pub weight: T,
    /// What a point of a real surface is off its plane, m.
    pub sigma_m: T,
    /// A landmark is on a plane up to this distance, m.
    pub theta_m: T,
}

blank!([T: Real] PlaneConfig<T> { weight, sigma_m, theta_m });

impl<T: Real> Default for PlaneConfig<T> {
    fn default() -> Self {
        Self { weight: T::of(0.1), sigma_m: T::of(0.02), theta_m: T::of(0.05) }
    }
}

/// Uncertainty of the first state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstSigma<T> {
    /// Angle between the estimated and the true vertical, rad.
    pub tilt_rad: T,
    /// Velocity, m/s.
    pub velocity_m_s: T,
    /// Bias of the angular rate, rad/s.
    pub gyro_bias_rad_s: T,
    /// Bias of the specific force, m/s².
    pub accel_bias_m_s2: T,
}

blank!([T: Real] FirstSigma<T> { tilt_rad, velocity_m_s, gyro_bias_rad_s, accel_bias_m_s2 });

blank!([T: Real] DepthConfig<T> { weighting, scale_sigma, scale_walk_per_root_s, image_scale_sigma, gate_sigma, shortest_start_s });

impl<T: Real> Default for DepthConfig<T> {
    fn default() -> Self {
        Self {
            weighting: Weighting::Calibrated { inflation: T::of(8.0) },
            scale_sigma: T::of(0.2),
            scale_walk_per_root_s: T::of(0.005),
            image_scale_sigma: T::of(0.1),
            gate_sigma: T::of(3.0),
            shortest_start_s: T::of(0.3),
        }
    }
}

impl<T: Real> DepthConfig<T> {
    /// A source of which nothing has been seen yet.
    #[must_use]
    pub fn tracker(&self) -> ScaleTracker<T> {
        ScaleTracker::new(self.scale_sigma, self.scale_walk_per_root_s, self.image_scale_sigma)
    }
}

impl<T: Real> Default for EstimatorConfig<T> {
    fn default() -> Self {
        Self {
            imu_noise: ImuNoise::adis16448(),
            imu_noise_inflation: T::of(4.0),
            imu_walk_inflation: T::of(2.0),
            position_jitter_m: T::of(1e-3),
            gyro_range_rad_s: T::of(17.45),
            accel_range_m_s2: T::of(176.5),
            gravity_m_s2: T::of(9.81),
            sigma_px: T::of(0.4),
            huber: T::of(2.0),
            outlier_chi2: T::of(16.0),
            keyframe_parallax_px: T::of(20.0),
            keyframe_shared_ratio: T::of(0.6),
            keyframe_interval_s: T::of(1.0),
            inverse_depth_per_m: T::of(0.3),
            inverse_depth_sigma_per_m: T::of(3.0),
            inverse_depth_guess_sigma_per_m: T::of(0.6),
            rest_sigma_m_s: T::of(0.02),
            rest_motion_px: T::of(0.25),
            least_tracked: 8,
            longest_coast_s: T::of(5.0),
            shortest_initialisation_s: T::of(1.2),
            longest_initialisation_s: T::of(4.0),
            initialisation_spacing_s: T::of(0.18),
            initialisation_scale_sigma: T::of(0.15),
            depth: DepthConfig::default(),
            planes: PlaneConfig::default(),
            first_sigma: FirstSigma {
                tilt_rad: T::of(0.1),
                velocity_m_s: T::of(0.5),
                gyro_bias_rad_s: T::of(0.05),
                accel_bias_m_s2: T::of(0.15),
            },
        }
    }
}

impl<T: Real> EstimatorConfig<T> {
    /// The noise model with its inflation.
    #[must_use]
    pub fn inflated_noise(&self) -> ImuNoise<T> {
        ImuNoise {
            gyro_noise_density: self.imu_noise.gyro_noise_density * self.imu_noise_inflation,
            accel_noise_density: self.imu_noise.accel_noise_density * self.imu_noise_inflation,
            gyro_random_walk: self.imu_noise.gyro_random_walk * self.imu_walk_inflation,
            accel_random_walk: self.imu_noise.accel_random_walk * self.imu_walk_inflation,
        }
    }
}
