//! The gyro's rotation between any two instants, with its derivatives by bias and time.
//!
//! # Model
//! The rate is linear between samples, `Q(t)` the attitude from its integral, midpoint rule. A bias `δb` turns it by
//! `−S(t) δb` on the left, `S(t) = ∫ Q dt`; so that the rotation of the body between two instants is
//! ```text
//! B = Q₂ᵀ Q₁                         second from first
//! ∂/∂b: Exp(Q₂ᵀ (S₂ − S₁) δb) B      ∂/∂t: Exp((B ω₁ − ω₂) δt) B
//! ```

use libella_core::lie::so3;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::Material;

/// A pause this long is not integrated across, s.
const LONGEST_STEP_S: f64 = 0.06;

/// Raw rates over seconds since the first sample.
#[derive(Debug, Clone)]
pub(super) struct Gyro {
    pub seconds: Vec<f64>,
    pub rates: Vec<Vector3<f64>>,
    /// Number of intervals up to each sample that must not be integrated across.
    gaps: Vec<u32>,
}

impl Gyro {
    /// The rates of the material, those next to a cut or a pause marked.
    pub fn new(material: &Material) -> Self {
        let Some(first) = material.imu.first().map(|sample| sample.stamp) else {
            return Self { seconds: Vec::new(), rates: Vec::new(), gaps: Vec::new() };
        };
        let seconds: Vec<f64> = material.imu.iter().map(|sample| (sample.stamp - first).as_seconds()).collect();
        let mut gaps = Vec::with_capacity(seconds.len());
        let mut count = 0;
        for index in 0..seconds.len() {
            let step = if index > 0 { seconds[index] - seconds[index - 1] } else { 0.0 };
            count += u32::from(step > LONGEST_STEP_S || material.unreliable.get(index).copied().unwrap_or(false));
            gaps.push(count);
        }
        Self { rates: material.imu.iter().map(|sample| sample.gyro_rad_s).collect(), seconds, gaps }
    }

    /// Replaces every rate.
    pub fn map(&mut self, change: &Matrix3<f64>) {
        self.rates.iter_mut().for_each(|rate| *rate = change * *rate);
    }

    /// Integrates with a bias taken off.
    pub fn path(&self, bias: &Vector3<f64>) -> Path<'_> {
        let mut attitude = Vec::with_capacity(self.seconds.len());
        let mut integral = Vec::with_capacity(self.seconds.len());
        let mut angle = Vec::with_capacity(self.seconds.len());
        let (mut q, mut s, mut sum) = (UnitQuaternion::identity(), Matrix3::zeros(), Vector3::zeros());
        for index in 0..self.seconds.len() {
            if index > 0 {
                let dt = self.seconds[index] - self.seconds[index - 1];
                let mean = (self.rates[index] + self.rates[index - 1]) * 0.5 - bias;
                let next = q * so3::exp(&(mean * dt));
                s += (q.to_rotation_matrix().into_inner() + next.to_rotation_matrix().into_inner()) * (0.5 * dt);
                q = UnitQuaternion::new_normalize(next.into_inner());
                sum += mean * dt;
            }
            angle.push(sum);
            attitude.push(q);
            integral.push(s);
        }
        Path { gyro: self, bias: *bias, angle, attitude, integral }
    }
}

/// Attitude over time for one bias.
#[derive(Debug)]
pub(super) struct Path<'a> {
    gyro: &'a Gyro,
    bias: Vector3<f64>,
    angle: Vec<Vector3<f64>>,
    attitude: Vec<UnitQuaternion<f64>>,
    integral: Vec<Matrix3<f64>>,
}

/// The state of the integral at an instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instant {
    /// `Q`.
    pub attitude: UnitQuaternion<f64>,
    /// `S = ∫ Q dt`.
    pub integral: Matrix3<f64>,
    /// Rate without bias, rad/s.
    pub rate: Vector3<f64>,
    /// Sum of the rates, `∫ ω dt`, rad: grows with the unit of the rates, however fast they are.
    pub angle: Vector3<f64>,
    gaps_before: u32,
    gaps_after: u32,
}

impl Path<'_> {
    /// The state at a time, or `None` outside of the samples.
    pub fn at(&self, seconds: f64) -> Option<Instant> {
        let gyro = self.gyro;
        let next = gyro.seconds.partition_point(|time| *time <= seconds);
        let index = next.checked_sub(1)?;
        let (start, end) = (*gyro.seconds.get(index)?, *gyro.seconds.get(next)?);
        let (from, to) = (gyro.rates.get(index)?, gyro.rates.get(next)?);
        let dt = seconds - start;
        let rate = from.lerp(to, dt / (end - start));
        let (attitude, integral) = (self.attitude.get(index)?, self.integral.get(index)?);
        let further = ((from + rate) * 0.5 - self.bias) * dt;
        let turned = attitude * so3::exp(&further);
        let integral = integral + attitude.to_rotation_matrix().into_inner() * dt;
        Some(Instant {
            attitude: turned,
            integral,
            rate: rate - self.bias,
            angle: self.angle.get(index)? + further,
            gaps_before: *gyro.gaps.get(index)?,
            gaps_after: *gyro.gaps.get(next)?,
        })
    }

    /// Both ends of an interval, if nothing is missing between them.
    pub fn between(&self, first: f64, second: f64) -> Option<(Instant, Instant)> {
        let (first, second) = (self.at(first)?, self.at(second)?);
        (first.gaps_before == second.gaps_after).then_some((first, second))
    }
}
