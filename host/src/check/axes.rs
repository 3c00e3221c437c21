//! Whether gyro and accelerometer have the same axes, told by gravity.
//!
//! # Method
//! While the body turns, gravity turns in its frame by what the gyro says. Over two seconds the specific force, turned back by the gyro,
//! is gravity plus accelerations that mostly cancel. Among the 48 ways to exchange axes and signs of the gyro, the right one leaves the
//! least spread. A common exchange of both sensors that is a rotation cannot be told here; the images tell it.

use libella_core::lie::so3;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::Material;

/// Length of a window and of the blocks whose means are compared, s.
const WINDOW_S: f64 = 2.0;
const BLOCK_S: f64 = 0.1;
/// The stated axes must leave so much more spread than the best, as a ratio of squares, before they are doubted.
const DOUBT: f64 = 2.0;

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

/// What has to be done to the gyro (times a right-handed exchange of both) to agree with the accelerometer.
#[derive(Debug, Clone)]
pub(super) struct Agreement {
    /// The exchange of the least spread, the identity unless another is better by far.
    pub gyro_exchange: Matrix3<f64>,
    /// Spread with the axes as they are over the least spread, as a ratio of squares.
    pub ratio: f64,
}

/// Compares the sensors; `bias` is that of the gyro as recorded. `None` where the body hardly tilts.
pub(super) fn compare(material: &Material, rate_hz: f64, bias: &Vector3<f64>) -> Option<Agreement> {
    let block = (BLOCK_S * rate_hz).round().max(1.0) as usize;
    let blocks = (WINDOW_S / BLOCK_S) as usize;
    let candidates = exchanges();
    let mut costs = vec![0.0; candidates.len()];
    let mut unturned = 0.0;
    for window in material.imu.chunks_exact(block * blocks) {
        // Means of blocks: vibration and noise average out, tilting does not.
        let means: Vec<(Vector3<f64>, Vector3<f64>)> = window
            .chunks_exact(block)
            .map(|block| {
                let count = block.len() as f64;
                let gyro = block.iter().map(|sample| sample.gyro_rad_s).sum::<Vector3<f64>>() / count - bias;
                (gyro * (count / rate_hz), block.iter().map(|sample| sample.accel_m_s2).sum::<Vector3<f64>>() / count)
            })
            .collect();
        let spread = |exchange: &Matrix3<f64>| {
            let mut attitude = UnitQuaternion::identity();
            let mut forces = Vec::with_capacity(means.len());
            for (angle, force) in &means {
                let half = so3::exp(&(exchange * angle * 0.5));
                forces.push(attitude * half * force);
                attitude = attitude * half * half;
            }
            let center = forces.iter().sum::<Vector3<f64>>() / forces.len().max(1) as f64;
            forces.iter().map(|force| (force - center).norm_squared()).sum::<f64>()
        };
        for (cost, exchange) in costs.iter_mut().zip(&candidates) {
            *cost += spread(exchange);
        }
        unturned += spread(&Matrix3::zeros());
    }
    let stated = *costs.first()?;
    let (best, least) = costs.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
    // Without tilting all are alike, and what is left is acceleration.
    if !(*least > 0.0 && unturned > DOUBT * least) {
        return None;
    }
    let ratio = stated / least;
    let index = if ratio > DOUBT { best } else { 0 };
    Some(Agreement { gyro_exchange: *candidates.get(index)?, ratio })
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
