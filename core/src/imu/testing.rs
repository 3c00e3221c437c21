//! A motion with exact readings, and random numbers, for unit tests.

use std::vec::Vec;

use nalgebra::{UnitQuaternion, Vector3};

use super::{ImuBias, ImuNoise, ImuSample, NavState, Preintegration};
use crate::lie::so3;
use crate::real::Real;
use crate::time::Timestamp;

/// Gravity in a world with z up.
pub fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

/// A body on a Lissajous curve, `R = R₀ Exp(a sin(w t)) Exp(c t)`, everything about it in closed form.
pub struct Motion {
    /// Biases that the readings contain.
    pub bias: ImuBias<f64>,
    /// Factor on all turning.
    pub agility: f64,
}

impl Motion {
    /// Turning at up to 2.5 rad/s and 6 m/s².
    pub fn lively() -> Self {
        let bias = ImuBias { gyro_rad_s: Vector3::new(-0.02, 0.08, 0.03), accel_m_s2: Vector3::new(0.1, -0.12, 0.05) };
        Self { bias, agility: 1.0 }
    }

    /// The state at `time_s`.
    pub fn state(&self, time_s: f64) -> NavState<f64> {
        let t = time_s;
        NavState {
            world_from_body: self.rotation(t),
            position_in_world: Vector3::new(2.0 * (1.3 * t).sin(), 1.5 * (0.9 * t).cos(), 0.5 * (2.1 * t).sin()),
            velocity_in_world: Vector3::new(2.6 * (1.3 * t).cos(), -1.35 * (0.9 * t).sin(), 1.05 * (2.1 * t).cos()),
            bias: self.bias,
        }
    }

    fn swing(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let axis = Vector3::new(0.5, -0.8, 0.3) * self.agility;
        (axis * (2.0 * t).sin(), axis * (2.0 * (2.0 * t).cos()))
    }

    fn spin(&self) -> Vector3<f64> {
        Vector3::new(0.2, 0.3, -0.7) * self.agility
    }

    fn rotation(&self, t: f64) -> UnitQuaternion<f64> {
        so3::exp(&Vector3::new(0.3, -0.2, 1.0)) * so3::exp(&self.swing(t).0) * so3::exp(&(self.spin() * t))
    }

    /// The reading at `nanos`, with the motion's biases.
    pub fn sample(&self, nanos: i64) -> ImuSample<f64> {
        #[allow(clippy::cast_precision_loss)]
        let t = nanos as f64 * 1e-9;
        // The axis of the swing is fixed, so that its rate is plain.
        let rate = so3::exp(&(self.spin() * t)).inverse() * self.swing(t).1 + self.spin();
        let acceleration = Vector3::new(-3.38 * (1.3 * t).sin(), -1.215 * (0.9 * t).cos(), -2.205 * (2.1 * t).sin());
        ImuSample {
            stamp: Timestamp::from_nanos(nanos),
            gyro_rad_s: rate + self.bias.gyro_rad_s,
            accel_m_s2: self.rotation(t).inverse() * (acceleration - gravity()) + self.bias.accel_m_s2,
        }
    }

    /// `count + 1` samples, `step_ns` apart.
    pub fn samples(&self, start_ns: i64, step_ns: i64, count: i64) -> Vec<ImuSample<f64>> {
        (0..=count).map(|k| self.sample(start_ns + k * step_ns)).collect()
    }
}

/// The integral of neighbouring samples.
#[allow(clippy::unwrap_used)]
pub fn integrated<T: Real>(bias: ImuBias<T>, noise: &ImuNoise<T>, samples: &[ImuSample<T>]) -> Preintegration<T> {
    let mut integral = Preintegration::new(bias);
    for pair in samples.windows(2) {
        integral.integrate(noise, &pair[0], &pair[1]).unwrap();
    }
    integral
}

/// The sample rounded to f32.
pub fn to_f32(sample: &ImuSample<f64>) -> ImuSample<f32> {
    ImuSample { stamp: sample.stamp, gyro_rad_s: sample.gyro_rad_s.map(f64::as_f32), accel_m_s2: sample.accel_m_s2.map(f64::as_f32) }
}

/// The bias rounded to f32.
pub fn bias_to_f32(bias: &ImuBias<f64>) -> ImuBias<f32> {
    ImuBias { gyro_rad_s: bias.gyro_rad_s.map(f64::as_f32), accel_m_s2: bias.accel_m_s2.map(f64::as_f32) }
}

/// Normally distributed numbers (splitmix64 and Box-Muller).
pub struct Normal(pub u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        #[allow(clippy::cast_precision_loss)]
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        unit
    }

    /// One number of zero mean and unit variance.
    pub fn draw(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (core::f64::consts::TAU * self.uniform()).cos()
    }

    /// Three of them, times `sigma`.
    pub fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.draw(), self.draw(), self.draw()) * sigma
    }
}
