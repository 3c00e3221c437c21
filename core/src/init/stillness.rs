//! The resting start: mean specific force is up, mean angular rate is the bias.
//!
//! # Model
//! A window of samples is cut into eight blocks. Vibration averages out of a block's mean, motion does not; so the body rests when
//! ```text
//! spread of the block means, gyro and accelerometer      < limit + 4 σ_d/√(block length)
//! spread of the samples                                  < vibration limit
//! ‖mean specific force‖ within the bias of gravity,  ‖mean rate‖ within the gyro bias,  image displacement small
//! ```
//! Then `R_WB` takes the mean specific force up, `b_g` is the mean rate, `v = 0`.
//!
//! # Degeneracy
//! Constant velocity without rotation feels like rest; only the images tell, so that the displacement should be given. The
//! accelerometer bias is not observable at rest: it tilts `R_WB` by `b_a/g`.

use nalgebra::{UnitQuaternion, Vector3};

use super::gravity::world_from_specific_force;
use crate::imu::{ImuBias, ImuNoise, ImuSample, NavState};
use crate::real::Real;

const BLOCKS: usize = 8;

/// Limits of what counts as rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestConfig<T: Real> {
    /// Noise densities of the inertial measurement unit.
    pub imu_noise: ImuNoise<T>,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: T,
    /// Shortest window, s.
    pub minimum_span_s: T,
    /// Spread of the angular rate's block means beyond noise, rad/s.
    pub gyro_spread_rad_s: T,
    /// Spread of the specific force's block means beyond noise, m/s².
    pub accel_spread_m_s2: T,
    /// Spread of single angular rates, rad/s: vibration.
    pub gyro_vibration_rad_s: T,
    /// Spread of single specific forces, m/s²: vibration.
    pub accel_vibration_m_s2: T,
    /// Largest gyro bias, rad/s.
    pub maximum_gyro_bias_rad_s: T,
    /// Standard deviation of the accelerometer bias, m/s²; the mean's magnitude may be off by five of it.
    pub sigma_accel_bias_m_s2: T,
    /// Largest mean displacement of the tracks over the window, px.
    pub maximum_displacement_px: T,
}

impl<T: Real> Default for RestConfig<T> {
    fn default() -> Self {
        Self {
            imu_noise: ImuNoise::adis16448(),
            gravity_m_s2: T::of(9.81),
            minimum_span_s: T::of(0.5),
            gyro_spread_rad_s: T::of(0.01),
            accel_spread_m_s2: T::of(0.05),
            gyro_vibration_rad_s: T::of(0.1),
            accel_vibration_m_s2: T::of(1.0),
            maximum_gyro_bias_rad_s: T::of(0.3),
            sigma_accel_bias_m_s2: T::of(0.1),
            maximum_displacement_px: T::of(1.0),
        }
    }
}

/// The state at rest and its standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest<T: Real> {
    /// Level, at the origin, without velocity; the gyro bias is measured, the accelerometer bias zero.
    pub state: NavState<T>,
    /// Of roll and pitch, rad: the unknown accelerometer bias over gravity, and noise.
    pub sigma_tilt_rad: T,
    /// Of the gyro bias, rad/s.
    pub sigma_gyro_bias_rad_s: T,
    /// Spread of the specific force's block means, m/s².
    pub accel_spread_m_s2: T,
    /// Spread of the angular rate's block means, rad/s.
    pub gyro_spread_rad_s: T,
}

/// Why the body does not count as at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Motion<T: Real> {
    /// The window is shorter than asked, s, or a number in it is not finite.
    Window(T),
    /// Spread of the angular rate, rad/s.
    Turning(T),
    /// Spread of the specific force, m/s².
    Accelerating(T),
    /// Magnitude of the mean specific force, m/s²: not gravity.
    SpecificForce(T),
    /// Displacement of the tracks, px.
    Image(T),
}

/// Decides whether the body rests over the window of `samples`, and states how it stands.
///
/// `displacement_px` is the mean displacement of the tracks over the same window, where images have arrived.
///
/// # Errors
/// The first sign of motion.
pub fn detect_rest<T: Real>(config: &RestConfig<T>, samples: &[ImuSample<T>], displacement_px: Option<T>) -> Result<Rest<T>, Motion<T>> {
    let span_s = match (samples.first(), samples.last()) {
        (Some(first), Some(last)) => T::of((last.stamp - first.stamp).as_nanos() as f64 * 1e-9),
        _ => T::ZERO,
    };
    if span_s < config.minimum_span_s || samples.len() < 4 * BLOCKS || !samples.iter().all(ImuSample::is_finite) {
        return Err(Motion::Window(span_s));
    }
    if let Some(px) = displacement_px.filter(|px| *px > config.maximum_displacement_px || !px.is_usable()) {
        return Err(Motion::Image(px));
    }
    let rate_hz = T::of((samples.len() - 1) as f64) / span_s;
    let length = samples.len() / BLOCKS;
    let block_root = T::of(length as f64).root();
    let gyro = Spread::of(samples, length, |sample| sample.gyro_rad_s);
    let accel = Spread::of(samples, length, |sample| sample.accel_m_s2);
    let noise = |density: T| density * rate_hz.root();
    let gyro_noise = noise(config.imu_noise.gyro_noise_density);
    let accel_noise = noise(config.imu_noise.accel_noise_density);
    let four = T::of(4.0);
    if gyro.of_blocks > config.gyro_spread_rad_s + gyro_noise * four / block_root || gyro.of_samples > config.gyro_vibration_rad_s {
        return Err(Motion::Turning(gyro.of_samples));
    }
    if accel.of_blocks > config.accel_spread_m_s2 + accel_noise * four / block_root || accel.of_samples > config.accel_vibration_m_s2 {
        return Err(Motion::Accelerating(accel.of_samples));
    }
    if gyro.mean.norm() > config.maximum_gyro_bias_rad_s {
        return Err(Motion::Turning(gyro.mean.norm()));
    }
    let magnitude = accel.mean.norm();
    if (magnitude - config.gravity_m_s2).abs() > config.sigma_accel_bias_m_s2 * T::of(5.0) {
        return Err(Motion::SpecificForce(magnitude));
    }
    let world_from_body: UnitQuaternion<T> = world_from_specific_force(&accel.mean).ok_or(Motion::SpecificForce(magnitude))?;
    let blocks_root = T::of(BLOCKS as f64).root();
    let measured = accel.of_blocks / blocks_root;
    let tilt = (config.sigma_accel_bias_m_s2 * config.sigma_accel_bias_m_s2 + measured * measured).root() / config.gravity_m_s2;
    Ok(Rest {
        state: NavState { world_from_body, bias: ImuBias { gyro_rad_s: gyro.mean, accel_m_s2: Vector3::zeros() }, ..NavState::origin() },
        sigma_tilt_rad: tilt,
        sigma_gyro_bias_rad_s: gyro.of_blocks.max(gyro_noise / block_root) / blocks_root,
        accel_spread_m_s2: accel.of_blocks,
        gyro_spread_rad_s: gyro.of_blocks,
    })
}

/// Mean, and root mean square distance from it per axis, of samples and of block means.
struct Spread<T: Real> {
    mean: Vector3<T>,
    of_samples: T,
    of_blocks: T,
}

impl<T: Real> Spread<T> {
    fn of(samples: &[ImuSample<T>], length: usize, part: fn(&ImuSample<T>) -> Vector3<T>) -> Self {
        let mean_of = |block: &[ImuSample<T>]| block.iter().fold(Vector3::zeros(), |sum, s| sum + part(s)) / T::of(block.len() as f64);
        let mean = mean_of(samples);
        let third = T::of(1.0 / 3.0);
        let squares = |sum: T, value: Vector3<T>| sum + (value - mean).norm_squared() * third;
        let of_samples = samples.iter().map(&part).fold(T::ZERO, squares) / T::of(samples.len() as f64);
        let of_blocks = samples.chunks_exact(length).map(mean_of).fold(T::ZERO, squares) / T::of((samples.len() / length) as f64);
        Self { mean, of_samples: of_samples.root(), of_blocks: of_blocks.root() }
    }
}
