//! Whether gyro and accelerometer have the same axes, told by gravity.
//!
//! # Method
//! While the body turns, gravity turns in its frame by what the gyro says. Over eight seconds the specific force, turned back by the gyro,
//! is gravity plus accelerations, which two seconds' means mostly cancel; the shorter of a flying body are as large as gravity's tilt and
//! go along with it. Among the 48 ways to exchange axes and signs of the gyro, the right one leaves the least spread of those means. The
//! sign of all of specific force cannot be told here, nor a common rotation of both sensors; the images tell the latter.

use libella_core::lie::so3;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::Material;

/// Length of a window, of the means in it, and of the steps of its integration, s.
const WINDOW_S: f64 = 8.0;
const MEANS: usize = 4;
const STEP_S: f64 = 0.1;
/// The axes as they are must leave so much more spread than the best, as a ratio of squares, before they are doubted: right ones reach
/// 1.0 on six recordings, exchanged ones 11 and more.
const DOUBT: f64 = 3.0;

/// Matrices that exchange axes and turn signs, the identity first.
pub(super) fn exchanges() -> Vec<Matrix3<f64>> {
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let signed = |order: [usize; 3], signs: usize| {
        let mut exchange = Matrix3::zeros();
        for (row, column) in order.into_iter().enumerate() {
            exchange[(row, column)] = if signs >> row & 1 == 0 { 1.0 } else { -1.0 };
        }
        exchange
    };
    orders.into_iter().flat_map(|order| (0..8).map(move |signs| signed(order, signs))).collect()
}

/// An exchange in words: what the axes x, y, z should be read from.
pub(super) fn in_words(exchange: &Matrix3<f64>) -> String {
    let name = |row: usize| {
        let column = (0..3).max_by(|a, b| exchange[(row, *a)].abs().total_cmp(&exchange[(row, *b)].abs())).unwrap_or(0);
        let sign = if exchange[(row, column)] < 0.0 { "-" } else { "" };
        format!("{sign}{}", ["x", "y", "z"][column])
    };
    format!("({}, {}, {})", name(0), name(1), name(2))
}

/// Spread under each exchange.
#[derive(Debug, Clone)]
pub(super) struct Agreement {
    spreads: Vec<(Matrix3<f64>, f64)>,
    least: f64,
}

impl Agreement {
    /// Spread under an exchange of the gyro over the least, as a ratio of squares.
    pub fn excess(&self, gyro_exchange: &Matrix3<f64>) -> f64 {
        self.spreads.iter().find(|(exchange, _)| exchange == gyro_exchange).map_or(f64::INFINITY, |(_, spread)| spread / self.least)
    }

    /// Whether gyro and accelerometer contradict each other under an exchange of the gyro.
    pub fn contradicts(&self, gyro_exchange: &Matrix3<f64>) -> bool {
        self.excess(gyro_exchange) > DOUBT
    }

    /// The exchange of the gyro that leaves the least spread.
    pub fn best(&self) -> Matrix3<f64> {
        let best = self.spreads.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        best.map_or_else(Matrix3::identity, |(exchange, _)| *exchange)
    }
}

/// Compares the sensors; `bias` is that of the gyro as recorded. `None` of a recording that is too short.
pub(super) fn compare(material: &Material, rate_hz: f64, bias: &Vector3<f64>) -> Option<Agreement> {
    let step = (STEP_S * rate_hz).round().max(1.0) as usize;
    // Mean angle and specific force of every step.
    let means: Vec<(Vector3<f64>, Vector3<f64>)> = material
        .imu
        .chunks_exact(step)
        .map(|block| {
            let count = block.len() as f64;
            let rate = block.iter().map(|sample| sample.gyro_rad_s).sum::<Vector3<f64>>() / count - bias;
            (rate * (count / rate_hz), block.iter().map(|sample| sample.accel_m_s2).sum::<Vector3<f64>>() / count)
        })
        .collect();
    let length = ((WINDOW_S / STEP_S) as usize).min(means.len()) / MEANS;
    if length < 5 {
        return None;
    }
    let spread = |exchange: &Matrix3<f64>, window: &[(Vector3<f64>, Vector3<f64>)]| {
        let mut attitude = UnitQuaternion::identity();
        let mut forces = Vec::with_capacity(window.len());
        for (angle, force) in window {
            let half = so3::exp(&(exchange * angle * 0.5));
            forces.push(attitude * half * force);
            attitude = attitude * half * half;
        }
        let mean = |forces: &[Vector3<f64>]| forces.iter().sum::<Vector3<f64>>() / forces.len().max(1) as f64;
        let center = mean(&forces);
        forces.chunks_exact(length).map(|part| (mean(part) - center).norm_squared()).sum::<f64>()
    };
    let of = |exchange: Matrix3<f64>| (exchange, means.chunks_exact(length * MEANS).map(|window| spread(&exchange, window)).sum::<f64>());
    let spreads: Vec<_> = exchanges().into_iter().map(of).collect();
    let least = spreads.iter().map(|(_, spread)| *spread).fold(f64::INFINITY, f64::min);
    (least > 0.0 && least.is_finite()).then_some(Agreement { spreads, least })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_48_exchanges_half_of_them_rotations() {
        let all = exchanges();
        assert_eq!((all.len(), all.first()), (48, Some(&Matrix3::identity())));
        assert_eq!(all.iter().filter(|exchange| exchange.determinant() > 0.0).count(), 24);
        assert!(all.iter().all(|exchange| exchange * exchange.transpose() == Matrix3::identity()));
        assert_eq!(in_words(&all[0]), "(x, y, z)");
    }
}
