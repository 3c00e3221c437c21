use std::vec::Vec;

use super::*;
use crate::factor::imu::residual;
use crate::imu::testing::{Motion, Normal, bias_to_f32, gravity, integrated, to_f32};
use crate::testing::{assert_close, numerical_jacobian};
use crate::time::Timestamp;

const STEP_NS: i64 = 5_000_000;
const SILENT: ImuNoise<f64> = ImuNoise { gyro_noise_density: 0.0, accel_noise_density: 0.0, gyro_random_walk: 0.0, accel_random_walk: 0.0 };
const NAMES: [&str; 5] = ["φ", "p", "v", "b_g", "b_a"];

const _: () = assert!(size_of::<Preintegration<f32>>() <= 700);

fn noise() -> ImuNoise<f64> {
    ImuNoise::adis16448()
}

/// Adds `gyro` and `accel` to a bias.
fn shifted(bias: &ImuBias<f64>, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> ImuBias<f64> {
    ImuBias { gyro_rad_s: bias.gyro_rad_s + gyro, accel_m_s2: bias.accel_m_s2 + accel }
}

/// `[Log(R₀ᵀ R), p − p₀, v − v₀]`, both deltas at their own bias.
fn difference(base: &Preintegration<f64>, other: &Preintegration<f64>) -> SMatrix<f64, 9, 1> {
    let ((r0, v0, p0), (r, v, p)) = (base.corrected(base.bias()), other.corrected(other.bias()));
    let phi = so3::log(&(r0.inverse() * r));
    let (dp, dv) = (p - p0, v - v0);
    SMatrix::from_column_slice(&[phi.x, phi.y, phi.z, dp.x, dp.y, dp.z, dv.x, dv.y, dv.z])
}

fn jacobian(integral: &Preintegration<f64>) -> SMatrix<f64, 9, 6> {
    let mut whole = SMatrix::<f64, 9, 6>::zeros();
    let parts = [
        (0, 0, *integral.d_rotation_d_gyro()),
        (3, 0, *integral.d_position_d_gyro()),
        (3, 3, *integral.d_position_d_accel()),
        (6, 0, *integral.d_velocity_d_gyro()),
        (6, 3, *integral.d_velocity_d_accel()),
    ];
    for (row, column, part) in parts {
        whole.fixed_view_mut::<3, 3>(row, column).copy_from(&part);
    }
    whole
}

#[test]
fn constant_rate_and_still_body_are_integrated_exactly() {
    // Any rate, however coarse the sampling: constant ω is the model. The force is zero, so that nothing else moves.
    let rate = Vector3::new(1.0, -2.0, 0.5);
    let sample = |k: i64| ImuSample { stamp: Timestamp::from_nanos(k * 50_000_000), gyro_rad_s: rate, accel_m_s2: Vector3::zeros() };
    let samples: Vec<_> = (0..=20).map(sample).collect();
    let integral = integrated(ImuBias::default(), &noise(), &samples);
    let (rotation, velocity, position) = integral.corrected(integral.bias());
    assert!(rotation.angle_to(&so3::exp(&(rate * 1.0))) < 1e-14);
    assert_eq!((velocity, position), (Vector3::zeros(), Vector3::zeros()));
    assert_eq!(integral.span(), Span::from_millis(1000));
}

#[test]
fn constant_force_gives_the_parabola() {
    let force = Vector3::new(0.3, -0.1, 9.0);
    let sample = |k: i64| ImuSample { stamp: Timestamp::from_nanos(k * 100_000_000), gyro_rad_s: Vector3::zeros(), accel_m_s2: force };
    let samples: Vec<_> = (0..=20).map(sample).collect();
    let integral = integrated(ImuBias::default(), &noise(), &samples);
    let (_, velocity, position) = integral.corrected(integral.bias());
    assert!((velocity - force * 2.0).norm() < 1e-13 && (position - force * 2.0).norm() < 1e-13);
}

#[test]
fn error_falls_with_the_square_of_the_interval() {
    let motion = Motion::lively();
    let error = |step_ns: i64, count: i64| {
        let integral = integrated(motion.bias, &noise(), &motion.samples(300_000_000, step_ns, count));
        let off = integral.predict(&motion.state(0.3), &gravity()).local(&motion.state(1.3));
        [0, 3, 6].map(|at| Vector3::from_column_slice(&off[at..at + 3]).norm())
    };
    let (coarse, fine, finest) = (error(10_000_000, 100), error(5_000_000, 200), error(2_500_000, 400));
    for block in 0..3 {
        for ratio in [coarse[block] / fine[block], fine[block] / finest[block]] {
            assert!((3.8..4.2).contains(&ratio), "{}: {coarse:?} {fine:?} {finest:?}", NAMES[block]);
        }
    }
    // And small in absolute terms: h²/24 · |second derivative| · 1 s at 200 Hz.
    assert!(fine[0] < 2e-5 && fine[1] < 1e-4 && fine[2] < 1e-4, "{fine:?}");
}

#[test]
fn bias_jacobians_match_integrating_anew() {
    for (agility, step_ns, count) in [(1.0, STEP_NS, 100), (4.0, 40_000_000, 12), (1.0, 200_000_000, 1)] {
        let motion = Motion { agility, ..Motion::lively() };
        let samples = motion.samples(0, step_ns, count);
        let base = integrated(motion.bias, &noise(), &samples);
        let numerical = numerical_jacobian::<9, 6>(1e-5, |d| {
            let bias = shifted(&motion.bias, &d.fixed_rows::<3>(0).into_owned(), &d.fixed_rows::<3>(3).into_owned());
            difference(&base, &integrated(bias, &noise(), &samples))
        });
        assert_close(&jacobian(&base), &numerical, 1e-8);
        let start = base.end_from_start().transpose() * base.d_rotation_d_gyro();
        assert_close(base.d_theta_d_gyro(), &start, 1e-14);
    }
}

#[test]
fn correction_is_right_to_first_order() {
    let motion = Motion::lively();
    let samples = motion.samples(0, STEP_NS, 100);
    let base = integrated(motion.bias, &noise(), &samples);
    let error = |scale: f64| {
        let bias = shifted(&motion.bias, &(Vector3::new(0.02, -0.03, 0.01) * scale), &(Vector3::new(0.1, 0.2, -0.1) * scale));
        let anew = integrated(bias, &noise(), &samples);
        let (rotation, velocity, position) = base.corrected(&bias);
        let moved = Preintegration { rotation, velocity, position, ..base };
        difference(&moved, &anew).norm()
    };
    let ratio = error(1.0) / error(0.5);
    assert!((3.8..4.2).contains(&ratio), "{ratio}");
    // What a second-order term can be: half the angle θ = |δb_g| t, squared on Δv, once on the change |δb_a| t.
    let (theta, change, gained) = (0.0374 * 0.5, 0.245 * 0.5, base.corrected(base.bias()).1.norm());
    let limit = 0.5 * theta * (theta * gained + change);
    assert!(error(1.0) < limit && error(1.0) > 0.1 * limit, "{} {limit}", error(1.0));
}

#[test]
fn bias_is_beyond_either_threshold() {
    let integral = Preintegration::<f64>::new(Motion::lively().bias);
    let at = |gyro: f64, accel: f64| {
        let bias = shifted(integral.bias(), &Vector3::new(0.0, gyro, 0.0), &Vector3::new(accel, 0.0, 0.0));
        integral.bias_is_beyond(&bias, 0.01, 0.1)
    };
    assert!(!at(0.009, 0.09) && at(0.011, 0.0) && at(0.0, 0.11) && at(f64::NAN, 0.0));
}

#[test]
fn appending_is_one_long_integration() {
    let motion = Motion::lively();
    let samples = motion.samples(0, STEP_NS, 200);
    let long = integrated(motion.bias, &noise(), &samples);
    let mut first = integrated(motion.bias, &noise(), &samples[..=70]);
    first.append(&integrated(motion.bias, &noise(), &samples[70..]));
    assert_eq!(first.span(), long.span());
    assert!(difference(&long, &first).norm() < 1e-13);
    assert_close(&jacobian(&first), &jacobian(&long), 1e-13);
    let (actual, expected) = (first.covariance(), long.covariance());
    for row in 0..15 {
        for column in 0..15 {
            let scale = (expected[(row, row)] * expected[(column, column)]).sqrt();
            // The simplification within one interval: angle per sample (0.01) / samples (100).
            let off = (actual[(row, column)] - expected[(row, column)]) / scale;
            assert!(off.abs() < 1e-6, "{row},{column}: {off:e}");
        }
    }
}

#[test]
fn appending_is_exact_for_a_body_that_does_not_turn() {
    let motion = Motion { agility: 0.0, ..Motion::lively() };
    let samples = motion.samples(0, STEP_NS, 200);
    let heavy = ImuNoise { gyro_random_walk: 1e-3, ..noise() };
    let long = integrated(motion.bias, &heavy, &samples);
    let mut first = integrated(motion.bias, &heavy, &samples[..=70]);
    first.append(&integrated(motion.bias, &heavy, &samples[70..]));
    assert_close(&first.covariance(), &long.covariance(), 1e-12);
    let (actual, expected) = (first.covariance(), long.covariance());
    assert!((actual - expected).iter().zip(expected.iter()).all(|(d, e)| d.abs() <= 1e-10 * e.abs() + 1e-22));
}

#[test]
fn appending_moves_the_later_bias_to_first_order() {
    let motion = Motion::lively();
    let samples = motion.samples(0, STEP_NS, 200);
    let long = integrated(motion.bias, &noise(), &samples);
    let error = |scale: f64| {
        let beside = shifted(&motion.bias, &(Vector3::new(0.02, -0.03, 0.01) * scale), &(Vector3::new(0.1, 0.2, -0.1) * scale));
        let mut first = integrated(motion.bias, &noise(), &samples[..=70]);
        first.append(&integrated(beside, &noise(), &samples[70..]));
        difference(&long, &first).norm()
    };
    let ratio = error(1.0) / error(0.5);
    assert!((3.8..4.2).contains(&ratio), "{ratio}");
}

#[test]
fn appending_nothing_changes_nothing() {
    let motion = Motion::lively();
    let whole = integrated(motion.bias, &noise(), &motion.samples(0, STEP_NS, 50));
    let mut appended = whole;
    appended.append(&Preintegration::new(motion.bias));
    assert!(difference(&whole, &appended).norm() < 1e-15);
    assert_close(&appended.covariance(), &whole.covariance(), 1e-14);
    let mut begun = Preintegration::new(motion.bias);
    begun.append(&whole);
    assert!(difference(&whole, &begun).norm() < 1e-15);
    assert_close(&begun.covariance(), &whole.covariance(), 1e-14);
}

#[test]
fn each_noise_parameter_moves_its_blocks_and_no_other() {
    let motion = Motion::lively();
    let samples = motion.samples(0, STEP_NS, 100);
    let full = noise();
    let cases = [
        (ImuNoise { gyro_noise_density: full.gyro_noise_density, ..SILENT }, [true, true, true, false, false]),
        (ImuNoise { accel_noise_density: full.accel_noise_density, ..SILENT }, [false, true, true, false, false]),
        (ImuNoise { gyro_random_walk: full.gyro_random_walk, ..SILENT }, [true, true, true, true, false]),
        (ImuNoise { accel_random_walk: full.accel_random_walk, ..SILENT }, [false, true, true, false, true]),
    ];
    let mut sum = SMatrix::<f64, 15, 15>::zeros();
    for (only, touched) in cases {
        let covariance = integrated(motion.bias, &only, &samples).covariance();
        let twice = ImuNoise {
            gyro_noise_density: 2.0 * only.gyro_noise_density,
            accel_noise_density: 2.0 * only.accel_noise_density,
            gyro_random_walk: 2.0 * only.gyro_random_walk,
            accel_random_walk: 2.0 * only.accel_random_walk,
        };
        assert_close(&integrated(motion.bias, &twice, &samples).covariance(), &(covariance * 4.0), 1e-14);
        for row in 0..5 {
            for column in 0..5 {
                let block = covariance.fixed_view::<3, 3>(3 * row, 3 * column);
                let moved = block.norm() > 0.0;
                assert_eq!(moved, touched[row] && touched[column], "{}-{} under {only:?}", NAMES[row], NAMES[column]);
            }
        }
        sum += covariance;
    }
    // Independent sources add up.
    assert_close(&integrated(motion.bias, &full, &samples).covariance(), &sum, 1e-13);
}

#[test]
fn covariance_of_a_body_at_rest_is_the_one_of_integrated_noise() {
    // No force and no rotation: integrated white noise and integrated random walk have their moments in closed form.
    let white = ImuNoise { gyro_noise_density: 2e-3, accel_noise_density: 2e-2, ..SILENT };
    let walking = ImuNoise { gyro_random_walk: 3e-3, accel_random_walk: 3e-2, ..white };
    // White noise is exact from the first sample on; the trapezoidal rule for the walks is off by the order of 1 / samples².
    for (noise, count, tolerance) in [(white, 1, 1e-14), (white, 400, 1e-12), (walking, 400, 2.0 / (400.0 * 400.0))] {
        let sample = |k: i32| ImuSample {
            stamp: Timestamp::from_nanos(i64::from(k) * STEP_NS),
            gyro_rad_s: Vector3::zeros(),
            accel_m_s2: Vector3::zeros(),
        };
        let samples: Vec<_> = (0..=count).map(sample).collect();
        let covariance = integrated(ImuBias::default(), &noise, &samples).covariance();
        let t = 0.005 * f64::from(count);
        let [g, a, wg, wa] =
            [noise.gyro_noise_density, noise.accel_noise_density, noise.gyro_random_walk, noise.accel_random_walk].map(|s| s * s);
        let expected = [
            (0, 0, g * t + wg * t.powi(3) / 3.0),
            (0, 9, -wg * t.powi(2) / 2.0),
            (9, 9, wg * t),
            (3, 3, a * t.powi(3) / 3.0 + wa * t.powi(5) / 20.0),
            (3, 6, a * t.powi(2) / 2.0 + wa * t.powi(4) / 8.0),
            (3, 12, -wa * t.powi(3) / 6.0),
            (6, 6, a * t + wa * t.powi(3) / 3.0),
            (6, 12, -wa * t.powi(2) / 2.0),
            (12, 12, wa * t),
        ];
        for (row, column, value) in expected {
            let actual = covariance[(row, column)];
            assert!((actual - value).abs() <= tolerance * value.abs(), "{count}: {row},{column}: {actual:e} {value:e}");
        }
    }
}

#[test]
fn covariance_agrees_with_monte_carlo_through_the_residual() {
    const TRIALS: u32 = 20_000;
    const SAMPLES: i64 = 60;
    // The second set is ruled by the random walks, the first by white noise.
    let walking = ImuNoise { gyro_random_walk: 1e-3, accel_random_walk: 2e-2, ..noise() };
    for (seed, noise) in [(1, noise()), (2, walking)] {
        let motion = Motion::lively();
        let samples = motion.samples(0, 2 * STEP_NS, SAMPLES);
        let clean = integrated(motion.bias, &noise, &samples);
        let from = motion.state(0.0);
        let end = clean.predict(&from, &gravity());
        let mut normal = Normal(seed);
        let mut sum = SMatrix::<f64, 15, 15>::zeros();
        for _ in 0..TRIALS {
            let mut noisy = Preintegration::new(motion.bias);
            let mut drift = ImuBias::default();
            for pair in samples.windows(2) {
                let dt = (pair[1].stamp - pair[0].stamp).as_seconds::<f64>();
                let mut walk = |drift: &mut ImuBias<f64>| {
                    drift.gyro_rad_s += normal.vector(noise.gyro_random_walk * (dt / 2.0).sqrt());
                    drift.accel_m_s2 += normal.vector(noise.accel_random_walk * (dt / 2.0).sqrt());
                };
                walk(&mut drift);
                let middle = drift;
                walk(&mut drift);
                let gyro = middle.gyro_rad_s + normal.vector(noise.gyro_noise_density / dt.sqrt());
                let accel = middle.accel_m_s2 + normal.vector(noise.accel_noise_density / dt.sqrt());
                let read = |s: &ImuSample<f64>| ImuSample { gyro_rad_s: s.gyro_rad_s + gyro, accel_m_s2: s.accel_m_s2 + accel, ..*s };
                noisy.integrate(&noise, &read(&pair[0]), &read(&pair[1])).unwrap();
            }
            let to = NavState { bias: shifted(&motion.bias, &drift.gyro_rad_s, &drift.accel_m_s2), ..end };
            let error = residual(&noisy, &gravity(), &from, &to);
            sum += error * error.transpose();
        }
        let (sampled, propagated) = (sum / f64::from(TRIALS), clean.covariance());
        // An entry of the sampled correlation has standard deviation √((1 + ρ²)/n) ≤ √(2/n) = 1 %; 225 of them lie within 4.5 of it.
        let limit = 4.5 * (2.0 / f64::from(TRIALS)).sqrt();
        for row in 0..15 {
            for column in 0..15 {
                let scale = (propagated[(row, row)] * propagated[(column, column)]).sqrt();
                let off = (sampled[(row, column)] - propagated[(row, column)]) / scale;
                assert!(off.abs() < limit, "{}-{} ({row},{column}): {off:.4} > {limit:.4}", NAMES[row / 3], NAMES[column / 3]);
            }
        }
    }
}

#[test]
fn single_precision_follows_double() {
    let motion = Motion::lively();
    let samples = motion.samples(0, STEP_NS, 200);
    let double = integrated(motion.bias, &noise(), &samples);
    let small: Vec<_> = samples.iter().map(to_f32).collect();
    let single = integrated(bias_to_f32(&motion.bias), &ImuNoise::adis16448(), &small);
    let ((r, v, p), (r32, v32, p32)) = (double.corrected(double.bias()), single.corrected(single.bias()));
    // 400 products of quaternions, each off by 2⁻²³ rad, add up at random to 2.4e-6 rad; the bound is three times that.
    assert!(r.angle_to(&r32.cast::<f64>()) < 7e-6);
    assert!((v - v32.cast::<f64>()).norm() < 2e-5 && (p - p32.cast::<f64>()).norm() < 1e-5);
    let (wide, narrow) = (double.covariance(), single.covariance());
    for row in 0..15 {
        for column in 0..15 {
            let scale = (wide[(row, row)] * wide[(column, column)]).sqrt();
            assert!((wide[(row, column)] - f64::from(narrow[(row, column)])).abs() < 1e-5 * scale, "{row},{column}");
        }
    }
}

#[test]
fn stale_samples_are_refused_and_change_nothing() {
    let motion = Motion::lively();
    let samples = motion.samples(0, STEP_NS, 10);
    let mut integral = integrated(motion.bias, &noise(), &samples);
    let before = integral;
    assert_eq!(integral.integrate(&noise(), &samples[3], &samples[3]), Err(PreintegrationError::Stale(Span::default())));
    let back = integral.integrate(&noise(), &samples[3], &samples[2]);
    assert_eq!(back, Err(PreintegrationError::Stale(Span::from_nanos(-STEP_NS))));
    assert_eq!(integral, before);
}

#[test]
fn numbers_that_are_none_pass_through_without_panic() {
    let motion = Motion::lively();
    let good = motion.samples(0, STEP_NS, 3);
    for bad in [f64::NAN, f64::INFINITY, f64::MAX, f64::MIN_POSITIVE] {
        let mut samples = good.clone();
        samples[1].gyro_rad_s = Vector3::repeat(bad);
        samples[2].accel_m_s2.z = bad;
        let mut integral = integrated(motion.bias, &noise(), &samples);
        integral.append(&integral.clone());
        let _ = (integral.covariance(), integral.predict(&motion.state(0.0), &gravity()));
    }
    let fast = ImuSample { gyro_rad_s: Vector3::repeat(400.0), ..good[0] };
    let integral = integrated(motion.bias, &noise(), &[fast, ImuSample { gyro_rad_s: fast.gyro_rad_s, ..good[1] }]);
    assert!(integral.covariance().iter().all(|x| x.is_finite()));
}
