use super::*;
use crate::imu::testing::{Motion, Normal, bias_to_f32, gravity, integrated, to_f32};
use crate::imu::{ImuBias, ImuNoise};
use crate::testing::{assert_close, numerical_jacobian};

fn euroc_like() -> (Preintegration<f64>, NavState<f64>, NavState<f64>) {
    let motion = Motion::lively();
    // Linearised beside the bias of the states, so that the correction takes part.
    let beside = ImuBias {
        gyro_rad_s: motion.bias.gyro_rad_s + Vector3::new(0.01, -0.02, 0.015),
        accel_m_s2: motion.bias.accel_m_s2 + Vector3::new(0.05, 0.02, -0.04),
    };
    let pre = integrated(beside, &ImuNoise::adis16448(), &motion.samples(0, 5_000_000, 100));
    (pre, motion.state(0.0), motion.state(0.5))
}

fn far_from_truth(state: &NavState<f64>, seed: u64) -> NavState<f64> {
    let mut normal = Normal(seed);
    state.retract(&core::array::from_fn(|_| 0.1 * normal.draw()))
}

#[test]
fn residual_vanishes_at_the_predicted_state() {
    let (pre, from, _) = euroc_like();
    let to = pre.predict(&from, &gravity());
    assert!(residual(&pre, &gravity(), &from, &to).norm() < 1e-12);
}

#[test]
fn residual_vanishes_on_the_true_motion() {
    let motion = Motion::lively();
    let pre = integrated(motion.bias, &ImuNoise::adis16448(), &motion.samples(0, 500_000, 1000));
    // The midpoint rule at 2 kHz: 0.5 s · |d³x/dt³| · h²/24 stays below 1e-6.
    assert!(residual(&pre, &gravity(), &motion.state(0.0), &motion.state(0.5)).norm() < 1e-6);
}

#[test]
fn residual_of_a_body_at_rest_is_what_the_hand_computes() {
    // 1 s at rest, level; the later state is 1 m ahead, 2 m/s fast and turned by 0.1 rad.
    let rest = |nanos| crate::imu::ImuSample {
        stamp: crate::time::Timestamp::from_nanos(nanos),
        gyro_rad_s: Vector3::zeros(),
        accel_m_s2: Vector3::new(0.0, 0.0, 9.81),
    };
    let samples: std::vec::Vec<_> = (0..=10).map(|k| rest(k * 100_000_000)).collect();
    let pre = integrated(ImuBias::default(), &ImuNoise::adis16448(), &samples);
    let mut delta = [0.0; 15];
    (delta[1], delta[3], delta[8], delta[9], delta[14]) = (0.1, 1.0, 2.0, 0.01, 0.02);
    let r = residual(&pre, &gravity(), &NavState::origin(), &NavState::origin().retract(&delta));
    assert!((r - SVector::from(delta)).norm() < 1e-12);
}

#[test]
fn jacobians_match_central_differences() {
    let (pre, from, to) = euroc_like();
    let whitening = sqrt_information(&pre, 0.0).unwrap();
    for seed in 0..5 {
        let (from, to) = (far_from_truth(&from, seed), far_from_truth(&to, seed + 100));
        let linear = linearize(&pre, &gravity(), &whitening, &from, &to, &from, &to);
        let by_from = numerical_jacobian::<15, 15>(1e-6, |d| residual(&pre, &gravity(), &from.retract(&(*d).into()), &to));
        let by_to = numerical_jacobian::<15, 15>(1e-6, |d| residual(&pre, &gravity(), &from, &to.retract(&(*d).into())));
        // Unwhitened, block by block, so that no block hides behind a larger one.
        let unwhiten = |m: &SMatrix<f64, 15, 15>| whitening.solve_lower_triangular(m).unwrap();
        let (from_rows, to_rows) = (unwhiten(&linear.d_residual_d_from), unwhiten(&linear.d_residual_d_to));
        for row in (0..15).step_by(3) {
            for column in (0..15).step_by(3) {
                let pair = [(&from_rows, &by_from), (&to_rows, &by_to)];
                for (actual, expected) in pair {
                    let error = actual.fixed_view::<3, 3>(row, column) - expected.fixed_view::<3, 3>(row, column);
                    let scale = expected.fixed_view::<3, 3>(row, column).norm().max(1e-2);
                    assert!(error.norm() < 1e-7 * scale, "block {row},{column}: {error}");
                }
            }
        }
        assert_close(&linear.residual, &(whitening * residual(&pre, &gravity(), &from, &to)), 1e-14);
    }
}

#[test]
fn first_estimates_move_the_jacobians_and_not_the_residual() {
    let (pre, from, to) = euroc_like();
    let whitening = sqrt_information(&pre, 0.0).unwrap();
    let (first_from, first_to) = (far_from_truth(&from, 1), far_from_truth(&to, 2));
    let mixed = linearize(&pre, &gravity(), &whitening, &from, &to, &first_from, &first_to);
    let now = linearize(&pre, &gravity(), &whitening, &from, &to, &from, &to);
    let first = linearize(&pre, &gravity(), &whitening, &first_from, &first_to, &first_from, &first_to);
    assert_eq!(mixed.residual, now.residual);
    assert_eq!(mixed.d_residual_d_from, first.d_residual_d_from);
    assert_eq!(mixed.d_residual_d_to, first.d_residual_d_to);
    assert_ne!(mixed.d_residual_d_from, now.d_residual_d_from);
}

#[test]
fn yaw_and_translation_of_the_world_leave_the_residual() {
    let (pre, from, to) = euroc_like();
    let turn = so3::exp(&Vector3::new(0.0, 0.0, 0.7));
    let moved = |s: &NavState<f64>| NavState {
        world_from_body: turn * s.world_from_body,
        position_in_world: turn * s.position_in_world + Vector3::new(3.0, -2.0, 1.0),
        velocity_in_world: turn * s.velocity_in_world,
        bias: s.bias,
    };
    let (from, to) = (far_from_truth(&from, 3), far_from_truth(&to, 4));
    let here = residual(&pre, &gravity(), &from, &to);
    let there = residual(&pre, &gravity(), &moved(&from), &moved(&to));
    assert_close(&there, &here, 1e-12);
}

#[test]
fn whitening_is_lower_triangular_and_inverts_the_covariance() {
    let (pre, _, _) = euroc_like();
    let w = sqrt_information(&pre, 0.0).unwrap();
    assert_close(&(w * pre.covariance() * w.transpose()), &SMatrix::identity(), 1e-10);
    for row in 0..15 {
        for column in row + 1..15 {
            assert_eq!(w[(row, column)], 0.0);
        }
    }
}

#[test]
fn jitter_adds_to_the_position_alone() {
    let (pre, _, _) = euroc_like();
    let w = sqrt_information(&pre, 3e-3).unwrap();
    let mut expected = pre.covariance();
    for axis in 3..6 {
        expected[(axis, axis)] += 9e-6;
    }
    assert_close(&(w * expected * w.transpose()), &SMatrix::identity(), 1e-10);
}

#[test]
fn single_precision_whitens_as_double_does_from_one_sample_to_ten_seconds() {
    let motion = Motion::lively();
    for count in [1, 2, 10, 100, 1000, 2000] {
        let samples = motion.samples(0, 5_000_000, i64::from(count));
        let small: std::vec::Vec<_> = samples.iter().map(to_f32).collect();
        let double = integrated(motion.bias, &ImuNoise::adis16448(), &samples);
        let single = integrated(bias_to_f32(&motion.bias), &ImuNoise::adis16448(), &small);
        let w: SMatrix<f64, 15, 15> = sqrt_information(&single, 0.0).unwrap().map(f64::from);
        // Whitened by f32, the covariance of f64 is the identity. A sum of n terms in f32 is off by up to n 2⁻²⁴ = 6e-8 n.
        let white = w * double.covariance() * w.transpose();
        let off = (white - SMatrix::identity()).abs().max();
        assert!(off < 2e-6 + 1e-7 * f64::from(count), "{count} samples: {off:.1e}");
    }
}

#[test]
fn no_information_without_samples_noise_or_numbers() {
    let motion = Motion::lively();
    let noise = ImuNoise::adis16448();
    assert!(sqrt_information(&Preintegration::<f64>::new(motion.bias), 0.0).is_none());
    let silent = ImuNoise { gyro_random_walk: 0.0, ..noise };
    assert!(sqrt_information(&integrated(motion.bias, &silent, &motion.samples(0, 5_000_000, 10)), 0.0).is_none());
    let mut samples = motion.samples(0, 5_000_000, 10);
    samples[5].gyro_rad_s.x = f64::NAN;
    samples[7].accel_m_s2.y = f64::INFINITY;
    let broken = integrated(motion.bias, &noise, &samples);
    assert!(sqrt_information(&broken, 0.0).is_none());
    let state = motion.state(0.0);
    let linear = linearize(&broken, &gravity(), &SMatrix::identity(), &state, &state, &state, &state);
    assert!(linear.residual.iter().any(|x| x.is_nan()));
}
