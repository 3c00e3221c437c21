//! Inertial samples of a motion.
//!
//! # Model
//! ```text
//! ω̃ = ω_B + b_g + n_g            n ~ N(0, σ² rate)
//! ã = R_WBᵀ (a_W − g_W) + b_a + n_a
//! b ← b + w                      w ~ N(0, σ_w² Δt)
//! ```
//! Each sample is the exact value at its instant, so that the midpoint rule returns the motion with an error of second order in
//! the interval. Noise densities are continuous, see [`ImuNoise`].

use libella_core::imu::{ImuBias, ImuNoise, ImuSample, NavState};
use libella_core::time::Timestamp;
use nalgebra::Vector3;

use super::random::Random;
use super::trajectory::{Motion, Trajectory};
use super::{SimError, TruthState};

/// What the inertial measurement unit adds to the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuConfig {
    /// Samples per second; 20 to 2000.
    pub rate_hz: f64,
    /// Noise of the samples; `None` for exact samples with a constant bias.
    pub noise: Option<ImuNoise<f64>>,
    /// Bias at the start.
    pub initial_bias: ImuBias<f64>,
    /// Magnitude of gravity, m/s², along −z of the world.
    pub gravity_m_s2: f64,
}

impl Default for ImuConfig {
    fn default() -> Self {
        Self {
            rate_hz: 200.0,
            noise: Some(ImuNoise::adis16448()),
            // What EuRoC's sensor shows on all sequences, to two digits.
            initial_bias: ImuBias { gyro_rad_s: Vector3::new(-0.002, 0.021, 0.077), accel_m_s2: Vector3::new(-0.02, 0.1, 0.06) },
            gravity_m_s2: 9.81,
        }
    }
}

/// The reading without noise at one instant.
#[must_use]
pub fn exact_sample(stamp: Timestamp, motion: &Motion, bias: &ImuBias<f64>, gravity_m_s2: f64) -> ImuSample<f64> {
    let force_in_world = motion.acceleration_in_world + Vector3::new(0.0, 0.0, gravity_m_s2);
    ImuSample {
        stamp,
        gyro_rad_s: motion.rate_in_body + bias.gyro_rad_s,
        accel_m_s2: motion.world_from_body.inverse() * force_in_world + bias.accel_m_s2,
    }
}

/// Samples and true states of a motion at the given stamps; `epoch` is the trajectory's time 0.
///
/// # Errors
/// A rate outside of 20 to 2000 Hz, or noise that is negative or not finite.
pub fn samples(
    trajectory: &dyn Trajectory,
    epoch: Timestamp,
    stamps: &[Timestamp],
    config: &ImuConfig,
    seed: u64,
) -> Result<(Vec<ImuSample<f64>>, Vec<TruthState>), SimError> {
    SimError::check("imu.rate_hz", config.rate_hz, 20.0, 2000.0)?;
    SimError::check("gravity_m_s2", config.gravity_m_s2, 0.0, 30.0)?;
    if let Some(noise) = &config.noise {
        SimError::check("gyro_noise_density", noise.gyro_noise_density, 0.0, 1.0)?;
        SimError::check("accel_noise_density", noise.accel_noise_density, 0.0, 10.0)?;
        SimError::check("gyro_random_walk", noise.gyro_random_walk, 0.0, 1.0)?;
        SimError::check("accel_random_walk", noise.accel_random_walk, 0.0, 10.0)?;
    }
    let mut random = Random::new(seed, "imu");
    let mut bias = config.initial_bias;
    let white = config.rate_hz.sqrt();
    let mut previous: Option<Timestamp> = None;
    let mut readings = Vec::with_capacity(stamps.len());
    let mut truth = Vec::with_capacity(stamps.len());
    for stamp in stamps {
        if let (Some(noise), Some(previous)) = (&config.noise, previous) {
            let root = (*stamp - previous).as_seconds::<f64>().max(0.0).sqrt();
            bias.gyro_rad_s += random.normal3() * (noise.gyro_random_walk * root);
            bias.accel_m_s2 += random.normal3() * (noise.accel_random_walk * root);
        }
        previous = Some(*stamp);
        let motion = trajectory.at((*stamp - epoch).as_seconds());
        let mut sample = exact_sample(*stamp, &motion, &bias, config.gravity_m_s2);
        if let Some(noise) = &config.noise {
            sample.gyro_rad_s += random.normal3() * (noise.gyro_noise_density * white);
            sample.accel_m_s2 += random.normal3() * (noise.accel_noise_density * white);
        }
        readings.push(sample);
        truth.push(truth_state(*stamp, &motion, bias));
    }
    Ok((readings, truth))
}

/// The state that a motion and a bias amount to.
#[must_use]
pub fn truth_state(stamp: Timestamp, motion: &Motion, bias: ImuBias<f64>) -> TruthState {
    TruthState {
        stamp,
        state: NavState {
            world_from_body: motion.world_from_body,
            position_in_world: motion.position_in_world,
            velocity_in_world: motion.velocity_in_world,
            bias,
        },
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::sim::trajectory::{Analytic, AnalyticConfig, MotionKind};
    use crate::sim::{EPOCH, regular_stamps};
    use libella_core::lie::so3;

    /// Dead reckoning by the midpoint rule, written here apart from the core's integrator.
    fn midpoint_error(rate_hz: f64) -> (f64, f64) {
        let config = AnalyticConfig { kind: MotionKind::Medium, duration_s: 10.0, rest_s: 1.0, ..AnalyticConfig::default() };
        let motion = Analytic::new(&config, 4).unwrap();
        let stamps = regular_stamps(10.0, rate_hz);
        let imu = ImuConfig { rate_hz, noise: None, initial_bias: ImuBias::default(), gravity_m_s2: 9.81 };
        let (readings, truth) = samples(&motion, EPOCH, &stamps, &imu, 1).unwrap();
        let mut state = truth[0].state;
        for pair in readings.windows(2) {
            let dt = (pair[1].stamp - pair[0].stamp).as_seconds::<f64>();
            let next = state.world_from_body * so3::exp(&((pair[0].gyro_rad_s + pair[1].gyro_rad_s) * (0.5 * dt)));
            let force = (state.world_from_body * pair[0].accel_m_s2 + next * pair[1].accel_m_s2) * 0.5;
            let acceleration = force - Vector3::new(0.0, 0.0, 9.81);
            state.position_in_world += state.velocity_in_world * dt + acceleration * (0.5 * dt * dt);
            state.velocity_in_world += acceleration * dt;
            state.world_from_body = next;
        }
        let last = truth.last().unwrap().state;
        (
            (state.position_in_world - last.position_in_world).norm(),
            so3::log(&(state.world_from_body.inverse() * last.world_from_body)).norm(),
        )
    }

    #[test]
    fn exact_samples_integrate_to_the_motion_with_second_order() {
        let errors = [100.0, 200.0, 400.0].map(midpoint_error);
        for pair in errors.windows(2) {
            // Halving the interval divides a second-order error by 4.
            assert!((3.6..4.4).contains(&(pair[0].0 / pair[1].0)), "position {errors:?}");
            assert!((3.6..4.4).contains(&(pair[0].1 / pair[1].1)), "rotation {errors:?}");
        }
        assert!(errors[1].0 < 0.02, "{errors:?}");
    }

    /// Allan variance of a signal for clusters of `size` samples, non-overlapping.
    fn allan_variance(signal: &[f64], size: usize) -> f64 {
        let means: Vec<f64> = signal.chunks_exact(size).map(|chunk| chunk.iter().sum::<f64>() / size as f64).collect();
        means.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>() / (2.0 * (means.len() - 1) as f64)
    }

    #[test]
    fn allan_variance_shows_the_densities() {
        let motion = Analytic::new(&AnalyticConfig { kind: MotionKind::Still, ..AnalyticConfig::default() }, 1).unwrap();
        let rate_hz = 100.0;
        let stamps = regular_stamps(3000.0, rate_hz);
        // Walks strong enough to dominate at long times, white noise at short ones: the two asymptotes stand apart.
        let noise = ImuNoise { gyro_noise_density: 1e-3, accel_noise_density: 2e-2, gyro_random_walk: 3e-4, accel_random_walk: 3e-3 };
        let config = ImuConfig { rate_hz, noise: Some(noise), initial_bias: ImuBias::default(), gravity_m_s2: 9.81 };
        let (readings, truth) = samples(&motion, EPOCH, &stamps, &config, 9).unwrap();
        let (mut white, mut walk) = ([0.0; 2], [0.0; 2]);
        let long = 2000;
        for axis in 0..3 {
            let gyro: Vec<f64> = readings.iter().map(|sample| sample.gyro_rad_s[axis]).collect();
            let accel: Vec<f64> = readings.iter().map(|sample| sample.accel_m_s2[axis]).collect();
            let gyro_bias: Vec<f64> = truth.iter().map(|truth| truth.state.bias.gyro_rad_s[axis]).collect();
            let accel_bias: Vec<f64> = truth.iter().map(|truth| truth.state.bias.accel_m_s2[axis]).collect();
            for (k, (signal, bias)) in [(gyro, gyro_bias), (accel, accel_bias)].iter().enumerate() {
                white[k] += allan_variance(signal, 10) / 3.0; // σ²/τ at τ = 0.1 s
                walk[k] += allan_variance(bias, long) / 3.0; // σ_w² τ/3 at τ = 20 s
            }
        }
        // 3 × 30 000 clusters: relative standard error sqrt(3/90 000) = 0.6 %; the walk adds (σ_w τ/σ)²/3 < 0.2 %.
        for (measured, density) in white.iter().zip([1e-3, 2e-2_f64]) {
            assert!((measured / (density * density / 0.1) - 1.0).abs() < 0.03, "white {measured}");
        }
        // 3 × 150 clusters: relative standard error about sqrt(3/450) = 8 %; three of them.
        for (measured, density) in walk.iter().zip([3e-4, 3e-3_f64]) {
            assert!((measured / (density * density * 20.0 / 3.0) - 1.0).abs() < 0.25, "walk {measured}");
        }
    }

    #[test]
    fn at_rest_the_accelerometer_reads_gravity_upwards() {
        let motion = Analytic::new(&AnalyticConfig { kind: MotionKind::Still, ..AnalyticConfig::default() }, 1).unwrap();
        let state = motion.at(0.0);
        let sample = exact_sample(EPOCH, &state, &ImuBias::default(), 9.81);
        assert!((state.world_from_body * sample.accel_m_s2 - Vector3::new(0.0, 0.0, 9.81)).norm() < 1e-12);
    }
}
