//! Quintic splines through recorded motion.
//!
//! # Model
//! A uniform B-spline of degree 5 with knots `Δ` apart, four times continuously differentiable, for each component of the
//! position and of a quaternion in ℝ⁴; the rotation is the normalised quaternion:
//! ```text
//! s(t) = Σ_j B₅(t/Δ − j) c_j            min Σ_i ‖s(t_i) − y_i‖² + λ Σ_j ‖∇³c_j‖²
//! R = q/‖q‖                             ω_B = 2 Im(q̄ q̇) / ‖q‖²
//! ```
//! The rate is exact, because scaling `q` changes `q̄ q̇` only in its real part. `λ` is small: it closes gaps and settles the
//! ends, and takes a millionth off what the data say.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::SimError;
use super::trajectory::{Motion, Trajectory};

/// Controls that touch one instant: degree + 1.
const ORDER: usize = 6;
/// Weight of the third differences of the controls against one sample.
const SMOOTHNESS: f64 = 1e-6;

/// One pose of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPose {
    /// Seconds since the start of the trajectory.
    pub seconds: f64,
    /// `R_WB`.
    pub world_from_body: UnitQuaternion<f64>,
    /// `p_WB`, m.
    pub position_in_world: Vector3<f64>,
}

/// A smooth motion through recorded poses.
#[derive(Debug, Clone)]
pub struct Spline {
    knot_s: f64,
    duration_s: f64,
    /// Position and quaternion `w x y z`.
    controls: Vec<[f64; 7]>,
}

/// Values of the six basis functions that are not zero at `u ∈ [0, 1]` of a knot interval, and two derivatives by `u`.
fn basis(u: f64) -> [[f64; ORDER]; 3] {
    // Cox - de Boor on uniform knots: N_{j,k}(u) = ((u + k − j) N_{j−1,k−1} + (1 − u + j) N_{j,k−1}) / k.
    let raise = |lower: &[f64; ORDER], degree: usize| {
        let k = degree as f64;
        std::array::from_fn::<f64, ORDER, _>(|j| {
            let at = j as f64;
            let left = if j > 0 { lower[j - 1] * (u + k - at) } else { 0.0 };
            let right = if j < degree { lower[j] * (1.0 - u + at) } else { 0.0 };
            if j > degree { 0.0 } else { (left + right) / k }
        })
    };
    // N′_{j,k} = N_{j−1,k−1} − N_{j,k−1}
    let differentiate =
        |lower: &[f64; ORDER]| std::array::from_fn::<f64, ORDER, _>(|j| (if j > 0 { lower[j - 1] } else { 0.0 }) - lower[j]);
    let mut ladder = [[0.0; ORDER]; ORDER];
    ladder[0][0] = 1.0;
    for degree in 1..ORDER {
        ladder[degree] = raise(&ladder[degree - 1], degree);
    }
    [ladder[5], differentiate(&ladder[4]), differentiate(&differentiate(&ladder[3]))]
}

impl Spline {
    /// Fits a spline to poses in rising order of time, the first at 0 s.
    ///
    /// # Errors
    /// `knot_s` outside of 5 ms to 1 s, fewer than ten poses, or times that do not rise.
    pub fn fit(poses: &[TimedPose], knot_s: f64) -> Result<Self, SimError> {
        SimError::check("knot_s", knot_s, 0.005, 1.0)?;
        let (Some(first), Some(last)) = (poses.first(), poses.last()) else {
            return Err(SimError::TooShort { what: "poses", count: poses.len(), least: 10 });
        };
        if poses.len() < 10 {
            return Err(SimError::TooShort { what: "poses", count: poses.len(), least: 10 });
        }
        if let Some(at) = poses.windows(2).position(|pair| pair[1].seconds <= pair[0].seconds) {
            return Err(SimError::NotRising { what: "poses", index: at + 1 });
        }
        let duration_s = last.seconds;
        let intervals = interval_of(duration_s, knot_s).0 + 1;
        let count = intervals + ORDER - 1;
        let mut normal = vec![[0.0; ORDER]; count];
        let mut right = vec![[0.0; 7]; count];
        let mut previous = first.world_from_body.into_inner();
        for pose in poses {
            let (start, u) = interval_of(pose.seconds, knot_s);
            let start = start.min(intervals - 1);
            let weights = basis(u)[0];
            // q and −q are the same rotation: stay on the side of the one before.
            let mut quaternion = pose.world_from_body.into_inner();
            if quaternion.dot(&previous) < 0.0 {
                quaternion = -quaternion;
            }
            previous = quaternion;
            let p = &pose.position_in_world;
            let values = [p.x, p.y, p.z, quaternion.w, quaternion.i, quaternion.j, quaternion.k];
            for (i, wi) in weights.iter().enumerate() {
                for (k, value) in values.iter().enumerate() {
                    right[start + i][k] += wi * value;
                }
                for (j, wj) in weights.iter().enumerate().take(i + 1) {
                    normal[start + i][i - j] += wi * wj;
                }
            }
        }
        let third = [-1.0, 3.0, -3.0, 1.0];
        for start in 0..count - 3 {
            for i in 0..4 {
                for j in 0..=i {
                    normal[start + i][i - j] += SMOOTHNESS * third[i] * third[j];
                }
            }
        }
        solve_banded(&mut normal, &mut right);
        Ok(Self { knot_s, duration_s, controls: right })
    }

    /// Value and two derivatives by time of the seven components.
    fn components(&self, seconds: f64) -> [[f64; 7]; 3] {
        let (start, u) = interval_of(seconds.clamp(0.0, self.duration_s), self.knot_s);
        let start = start.min(self.controls.len() - ORDER);
        let weights = basis(u);
        let mut out = [[0.0; 7]; 3];
        for (order, row) in out.iter_mut().enumerate() {
            let scale = self.knot_s.powi(-i32::try_from(order).unwrap_or(0));
            for (weight, control) in weights[order].iter().zip(&self.controls[start..start + ORDER]) {
                row.iter_mut().zip(control).for_each(|(sum, value)| *sum += weight * scale * value);
            }
        }
        out
    }
}

/// The knot interval of a time and the part of it, in `[0, 1)`.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn interval_of(seconds: f64, knot_s: f64) -> (usize, f64) {
    let place = (seconds / knot_s).max(0.0);
    (place.floor() as usize, place - place.floor())
}

/// Solves `A X = B` for a symmetric positive definite band matrix; `band[i][k] = A[i][i−k]`. Cholesky in place.
fn solve_banded(band: &mut [[f64; ORDER]], right: &mut [[f64; 7]]) {
    let count = band.len();
    for i in 0..count {
        for k in (0..ORDER.min(i + 1)).rev() {
            let j = i - k;
            let mut sum = band[i][k];
            for m in k + 1..ORDER.min(i + 1) {
                if m - k < ORDER {
                    sum -= band[i][m] * band[j][m - k];
                }
            }
            band[i][k] = if k == 0 { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum / band[j][0] };
        }
    }
    let scale = |row: &mut [f64; 7], factor: f64| row.iter_mut().for_each(|value| *value *= factor);
    let subtract = |right: &mut [[f64; 7]], row: usize, from: usize, factor: f64| {
        let other = right[row];
        right[from].iter_mut().zip(other).for_each(|(value, other)| *value -= factor * other);
    };
    for (i, line) in band.iter().enumerate() {
        for (k, factor) in line.iter().enumerate().take(i + 1).skip(1) {
            subtract(right, i - k, i, *factor);
        }
        scale(&mut right[i], 1.0 / line[0]);
    }
    for (i, line) in band.iter().enumerate().rev() {
        scale(&mut right[i], 1.0 / line[0]);
        for (k, factor) in line.iter().enumerate().take(i + 1).skip(1) {
            subtract(right, i, i - k, *factor);
        }
    }
}

impl Trajectory for Spline {
    fn at(&self, seconds: f64) -> Motion {
        let [value, first, second] = self.components(seconds);
        let vector = |row: &[f64; 7]| Vector3::new(row[0], row[1], row[2]);
        let quaternion = |row: &[f64; 7]| Quaternion::new(row[3], row[4], row[5], row[6]);
        let q = quaternion(&value);
        let rate = (q.conjugate() * quaternion(&first)).imag() * (2.0 / q.norm_squared());
        Motion {
            world_from_body: UnitQuaternion::from_quaternion(q),
            position_in_world: vector(&value),
            velocity_in_world: vector(&first),
            acceleration_in_world: vector(&second),
            rate_in_body: rate,
        }
    }

    fn duration_s(&self) -> f64 {
        self.duration_s
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::sim::trajectory::{Analytic, AnalyticConfig, MotionKind, worst_derivative_error};

    fn sampled(rate_hz: f64, quantum_m: f64) -> (Analytic, Vec<TimedPose>) {
        let config = AnalyticConfig { kind: MotionKind::Medium, duration_s: 20.0, ..AnalyticConfig::default() };
        let truth = Analytic::new(&config, 11).unwrap();
        let round = |x: f64| if quantum_m > 0.0 { (x / quantum_m).round() * quantum_m } else { x };
        let poses = (0..=(20.0 * rate_hz) as usize)
            .map(|k| {
                let seconds = k as f64 / rate_hz;
                let motion = truth.at(seconds);
                TimedPose { seconds, world_from_body: motion.world_from_body, position_in_world: motion.position_in_world.map(round) }
            })
            .collect();
        (truth, poses)
    }

    #[test]
    fn basis_is_a_partition_of_unity_with_matching_derivatives() {
        for k in 0..=20 {
            let u = f64::from(k) / 20.0;
            let [value, first, second] = basis(u);
            assert!((value.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            assert!(first.iter().sum::<f64>().abs() < 1e-14 && second.iter().sum::<f64>().abs() < 1e-13);
            let (step, clamped) = (1e-5, u.clamp(1e-5, 1.0 - 1e-5));
            let (below, here, above) = (basis(clamped - step), basis(clamped), basis(clamped + step));
            for j in 0..ORDER {
                assert!(((above[0][j] - below[0][j]) / (2.0 * step) - here[1][j]).abs() < 1e-9);
                assert!(((above[1][j] - below[1][j]) / (2.0 * step) - here[2][j]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn derivatives_match_central_differences() {
        let (_, poses) = sampled(20.0, 0.0);
        let spline = Spline::fit(&poses, 0.05).unwrap();
        let worst = worst_derivative_error(&spline, (1..400).map(|k| 0.01 + f64::from(k) * 0.0491));
        assert!(worst.iter().all(|error| *error < 1e-6), "{worst:?}");
    }

    #[test]
    fn recovers_a_smooth_motion_from_quantised_poses() {
        // Tolerances in m, m/s², rad/s: 20 Hz resolves 0.3 Hz waves to a millionth; 200 Hz averages the quantisation.
        for (rate_hz, knot_s) in [(20.0, 0.05), (200.0, 0.025)] {
            let (truth, poses) = sampled(rate_hz, 1e-6);
            let spline = Spline::fit(&poses, knot_s).unwrap();
            let mut worst = [0.0_f64; 3];
            for k in 0..1900 {
                let time = 0.5 + f64::from(k) * 0.01;
                let (expected, actual) = (truth.at(time), spline.at(time));
                worst[0] = worst[0].max((expected.position_in_world - actual.position_in_world).norm());
                worst[1] = worst[1].max((expected.acceleration_in_world - actual.acceleration_in_world).norm());
                worst[2] = worst[2].max((expected.rate_in_body - actual.rate_in_body).norm());
            }
            assert!(worst[0] < 5e-6 && worst[1] < 2e-2 && worst[2] < 1e-3, "{rate_hz} Hz: {worst:?}");
        }
    }

    #[test]
    fn refuses_times_that_do_not_rise() {
        let (_, mut poses) = sampled(20.0, 0.0);
        poses[7].seconds = poses[6].seconds;
        assert_eq!(Spline::fit(&poses, 0.05).unwrap_err(), SimError::NotRising { what: "poses", index: 7 });
    }
}
