//! The noise model of an inertial measurement unit, in continuous time.

use crate::real::Real;
use crate::storage::blank::blank;

/// Noise densities as a datasheet or an Allan plot gives them. Discrete values follow from the rate:
/// white `σ_d = σ √rate`, random walk `σ_d = σ / √rate`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuNoise<T: Real> {
    /// White noise of the angular rate, rad/s/√Hz.
    pub gyro_noise_density: T,
    /// White noise of the specific force, m/s²/√Hz.
    pub accel_noise_density: T,
    /// Random walk of the gyro bias, rad/s²/√Hz.
    pub gyro_random_walk: T,
    /// Random walk of the accelerometer bias, m/s³/√Hz.
    pub accel_random_walk: T,
}

blank!([T: Real] ImuNoise<T> { gyro_noise_density, accel_noise_density, gyro_random_walk, accel_random_walk });

impl<T: Real> ImuNoise<T> {
    /// All four densities times a factor.
    #[must_use]
    pub fn scaled(&self, factor: T) -> Self {
        Self {
            gyro_noise_density: self.gyro_noise_density * factor,
            accel_noise_density: self.accel_noise_density * factor,
            gyro_random_walk: self.gyro_random_walk * factor,
            accel_random_walk: self.accel_random_walk * factor,
        }
    }

    /// The white noise densities times a factor, the random walks as they are.
    #[must_use]
    pub fn with_white_scaled(&self, factor: T) -> Self {
        Self { gyro_noise_density: self.gyro_noise_density * factor, accel_noise_density: self.accel_noise_density * factor, ..*self }
    }

    /// The ADIS16448 as EuRoC's `imu0/sensor.yaml` states it.
    #[must_use]
    pub fn adis16448() -> Self {
        Self {
            gyro_noise_density: T::of(1.6968e-4),
            accel_noise_density: T::of(2.0e-3),
            gyro_random_walk: T::of(1.9393e-5),
            accel_random_walk: T::of(3.0e-3),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datasheet_values_are_positive_and_the_same_in_both_scalars() {
        let (wide, narrow) = (ImuNoise::<f64>::adis16448(), ImuNoise::<f32>::adis16448());
        let wide = [wide.gyro_noise_density, wide.accel_noise_density, wide.gyro_random_walk, wide.accel_random_walk];
        let narrow = [narrow.gyro_noise_density, narrow.accel_noise_density, narrow.gyro_random_walk, narrow.accel_random_walk];
        for (w, n) in wide.into_iter().zip(narrow) {
            assert!(w > 0.0 && (f64::from(n) / w - 1.0).abs() < 1e-7);
        }
    }
}
