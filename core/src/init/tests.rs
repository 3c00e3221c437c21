//! The moving start on simulated motions with exact truth, and on recorded ones.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

mod recorded;
mod world;

use std::{println, vec, vec::Vec};

use nalgebra::{Isometry3, SVector, UnitQuaternion, Vector2, Vector3};

use self::world::{Kind, Setup, World};
use super::refinement::{Motion, PARAMETERS, Views, linearize, residual};
use super::tracks::across;
use super::*;
use crate::imu::{ImuBias, ImuNoise, ImuSample, NavState, Preintegration};
use crate::lie::so3;
use crate::testing::{assert_close, numerical_jacobian};
use crate::time::Timestamp;

type Started = (Result<Alignment<f64>, InitError<f64>>, Vec<NavState<f64>>, Vec<InitLandmark<f64>>);

fn start(world: &World, config: &InitConfig<f64>) -> Started {
    let mut landmarks = vec![InitLandmark::default(); world.landmark_count()];
    let mut states = vec![NavState::origin(); world.links.len() + 1];
    let problem = problem(world, config);
    let result = initialise_moving(&problem, &mut landmarks, &mut [], &mut states);
    (result, states, landmarks)
}

fn problem<'a>(world: &'a World, config: &'a InitConfig<f64>) -> Problem<'a, f64, World, MAX_INIT_FRAMES> {
    Problem { config, body_from_camera: &world.body_from_camera, links: &world.links, bearings: world }
}

/// Left after every iteration and taken up again, a start comes to the same numbers as in one go, bit for bit.
#[test]
fn a_start_in_pieces_is_the_start_in_one_go() {
    let world = World::new(&Setup::default());
    let config = config();
    let (whole, whole_states, whole_landmarks) = start(&world, &config);
    let problem = problem(&world, &config);
    let mut landmarks = vec![InitLandmark::default(); world.landmark_count()];
    let mut states = vec![NavState::origin(); world.links.len() + 1];
    let mut pieces = MovingStart::begin(&problem, &mut landmarks).unwrap();
    let mut count = 1;
    while !pieces.refine(&problem, &mut landmarks, &mut [], 1).unwrap() {
        count += 1;
    }
    let found = pieces.finish(&problem, &mut landmarks, &mut states).unwrap();
    assert!((4..=config.maximum_iterations).contains(&count), "{count} pieces");
    assert_eq!((found, states, landmarks), (whole.unwrap(), whole_states, whole_landmarks));
}

fn config() -> InitConfig<f64> {
    InitConfig { sigma_px: 0.5, ..InitConfig::default() }
}

fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * part).round() as usize]
}

/// Errors of one start: scale, tilt (rad), gyro bias (rad/s), velocity (m/s), and scale in standard deviations.
fn errors(world: &World, states: &[NavState<f64>], alignment: &Alignment<f64>) -> [f64; 5] {
    let centred = |p: &[Vector3<f64>]| {
        let mean = p.iter().sum::<Vector3<f64>>() / p.len() as f64;
        p.iter().map(|p| (p - mean).norm_squared()).sum::<f64>().sqrt()
    };
    let truth: Vec<_> = world.truth.iter().map(|state| state.position_in_world).collect();
    let ours: Vec<_> = states.iter().map(|state| state.position_in_world).collect();
    let scale = centred(&ours) / centred(&truth) - 1.0;
    let last = states.len() - 1;
    let up = |state: &NavState<f64>| state.world_from_body.inverse() * Vector3::z();
    let tilt = up(&states[last]).angle(&up(&world.truth[last]));
    let gyro = (states[0].bias.gyro_rad_s - world.bias.gyro_rad_s).norm();
    let velocity = |state: &NavState<f64>| state.world_from_body.inverse() * state.velocity_in_world;
    let velocity = (velocity(&states[last]) - velocity(&world.truth[last])).norm();
    [scale.abs(), tilt, gyro, velocity, scale / alignment.scale_sigma]
}

#[test]
fn residual_jacobians_match_central_differences() {
    let world = World::new(&Setup::default());
    let body_from_world = world.truth[0].world_from_body.inverse();
    let motion = Motion {
        velocity: body_from_world * world.truth[0].velocity_in_world,
        gravity: body_from_world * Vector3::z() * -9.81,
        bias: ImuBias { gyro_rad_s: Vector3::new(0.05, -0.02, 0.03), accel_m_s2: Vector3::new(0.1, 0.05, -0.1) },
        // The product of drift and turn, of second order, is left out of the Jacobian.
        drift: Vector3::zeros(),
    };
    let views = |step: &SVector<f64, PARAMETERS>| {
        let mut views = Views::<f64, MAX_INIT_FRAMES>::empty();
        views.fill(&motion.retract(step), &world.links, &world.body_from_camera);
        views
    };
    let base = views(&SVector::zeros());
    let (anchor, frame) = (2, 7);
    let u = Vector3::new(0.2, -0.1, 1.0).normalize();
    let f = Vector3::new(0.1, 0.15, 1.0).normalize();
    let rho = 0.4;
    let linear = linearize(&base.as_slice()[anchor], &base.as_slice()[frame], false, &u, rho, &f).unwrap();
    let at = |views: &Views<f64, MAX_INIT_FRAMES>, u: &Vector3<f64>, rho: f64| -> Vector2<f64> {
        residual(&views.as_slice()[anchor].pose, &views.as_slice()[frame].pose, u, rho, &f).unwrap().0
    };
    let by_motion = numerical_jacobian::<2, PARAMETERS>(1e-5, |d| at(&views(d), &u, rho));
    // The bias enters the deltas to first order; its exponential moves the rotation Jacobian by 1e-3 of itself.
    assert_close(&linear.d_motion, &by_motion, 1e-6);
    let by_landmark = numerical_jacobian::<2, 3>(1e-6, |d| at(&base, &(u + across(&u) * d.fixed_rows::<2>(0)).normalize(), rho + d.z));
    assert_close(&linear.d_landmark, &by_landmark, 1e-7);
}

#[test]
fn a_preintegration_becomes_the_link_that_independent_integration_gives() {
    let bias = ImuBias { gyro_rad_s: Vector3::new(0.02, -0.01, 0.03), accel_m_s2: Vector3::new(0.05, 0.1, -0.05) };
    let sample = |i: i32| {
        let t = f64::from(i) * 0.005;
        let gyro_rad_s = Vector3::new((3.0 * t).sin(), 0.5 * (2.0 * t).cos(), 0.4);
        let accel_m_s2 = Vector3::new(1.0 + t, (5.0 * t).sin(), 9.81);
        ImuSample { stamp: Timestamp::from_nanos(i64::from(i) * 5_000_000), gyro_rad_s, accel_m_s2 }
    };
    let samples: Vec<_> = (0..=40).map(sample).collect();
    let mut integral = Preintegration::new(bias);
    samples.windows(2).for_each(|pair| integral.integrate(&ImuNoise::adis16448(), &pair[0], &pair[1]).unwrap());
    let link = InertialLink::from(&integral);
    let readings: Vec<_> = samples.iter().map(|sample| (sample.gyro_rad_s, sample.accel_m_s2)).collect();
    let expected = world::link(&readings, 0.005, &bias);
    // Two midpoint rules at 200 Hz: they differ by (ω Δt)² ≈ 3e-5 and less.
    assert_close(&link.velocity, &expected.velocity, 1e-4);
    assert_close(&link.position, &expected.position, 1e-4);
    assert_close(&link.d_rotation_d_gyro, &expected.d_rotation_d_gyro, 1e-4);
    assert_close(&link.d_velocity_d_bias, &expected.d_velocity_d_bias, 1e-3);
    assert_close(&link.d_position_d_bias, &expected.d_position_d_bias, 1e-3);
    assert!((link.span_s - 0.2).abs() < 1e-12 && link.rotation.angle_to(&expected.rotation) < 1e-5);
}

#[test]
fn exact_bearings_give_the_exact_motion() {
    for seed in 0..10 {
        // Midpoint integration at 200 Hz is itself good to some 1e-4 of the motion.
        let world = World::new(&Setup { seed, noise_px: 0.0, outliers: 0.0, imu_noise: 0.0, ..Setup::default() });
        let trusting = InitConfig { sigma_px: 0.02, sigma_accel_bias_m_s2: 1.0, ..config() };
        let (result, states, landmarks) = start(&world, &trusting);
        let [scale, tilt, gyro, velocity, _] = errors(&world, &states, &result.unwrap());
        assert!(scale < 1e-3 && tilt < 1e-3 && gyro < 1e-4 && velocity < 2e-3, "{seed}: {scale} {tilt} {gyro} {velocity}");
        for (landmark, row) in landmarks.iter().zip(&world.distances).filter(|(landmark, _)| landmark.is_used) {
            let error = landmark.inverse_distance_per_m * row[usize::from(landmark.anchor)] - 1.0;
            assert!(error.abs() < 0.02, "{seed}: relative inverse distance {error}");
        }
    }
}

#[test]
fn hand_held_motion_is_recovered_over_a_hundred_seeds() {
    // Bounds: median and 90 % of relative scale, rad of tilt, rad/s of gyro bias, m/s of velocity; largest scale error.
    let bounds = [
        (1.0, [0.010, 0.012, 0.0015, 0.012], [0.025, 0.018, 0.0025, 0.020], 0.06),
        (1.5, [0.006, 0.010, 0.0010, 0.010], [0.015, 0.015, 0.0015, 0.015], 0.04),
        (2.0, [0.004, 0.008, 0.0006, 0.008], [0.012, 0.013, 0.0012, 0.012], 0.03),
        (2.5, [0.004, 0.008, 0.0006, 0.008], [0.010, 0.012, 0.0010, 0.010], 0.03),
    ];
    for (span_s, median, most, largest) in bounds {
        let mut all: [Vec<f64>; 5] = Default::default();
        let (mut refused, mut times) = (Vec::new(), Vec::new());
        for seed in 0..100 {
            let world = World::new(&Setup { span_s, seed, ..Setup::default() });
            let clock = std::time::Instant::now();
            let (result, states, _) = start(&world, &config());
            times.push(clock.elapsed().as_secs_f64() * 1e3);
            match result {
                Ok(alignment) => all.iter_mut().zip(errors(&world, &states, &alignment)).for_each(|(list, e)| list.push(e)),
                Err(error) => refused.push(error),
            }
        }
        println!("window {span_s} s: refused {refused:?}, median {:.1} ms", quantile(&mut times, 0.5));
        let nees = all[4].iter().map(|z| z * z).sum::<f64>() / all[4].len() as f64;
        for (i, (name, list)) in ["scale", "tilt", "gyro", "velocity"].iter().zip(&mut all).enumerate() {
            let (half, ninety) = (quantile(list, 0.5), quantile(list, 0.9));
            println!("  {name:9} median {half:.4} p90 {ninety:.4} max {:.4}", quantile(list, 1.0));
            assert!(half < median[i] && ninety < most[i], "{span_s} s: {name}");
        }
        println!("  scale NEES {nees:.2}");
        assert!(quantile(&mut all[0], 1.0) < largest);
        assert!(refused.len() <= 3, "{refused:?}");
        // 100 samples of χ²₁: mean 1 ± 0.14. The accelerometer bias is smaller than its prior and IMU noise is left out.
        assert!(nees > 0.25 && nees < 2.0, "{nees}");
    }
}

#[test]
fn pure_rotation_and_standing_still_lack_parallax() {
    for kind in [Kind::PureRotation, Kind::Still] {
        for seed in 0..10 {
            let (result, ..) = start(&World::new(&Setup { kind, seed, ..Setup::default() }), &config());
            assert!(matches!(result, Err(InitError::Parallax(px)) if px < 5.0), "{seed}: {result:?}");
        }
    }
}

#[test]
fn constant_velocity_lacks_excitation() {
    for seed in 0..20 {
        let (result, ..) = start(&World::new(&Setup { kind: Kind::ConstantVelocity, seed, ..Setup::default() }), &config());
        assert!(matches!(result, Err(InitError::Excitation(_))), "{seed}: {result:?}");
    }
}

#[test]
fn wrong_extrinsics_and_too_few_tracks_are_told_apart() {
    for seed in 0..10 {
        let mut world = World::new(&Setup { seed, ..Setup::default() });
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), core::f64::consts::FRAC_PI_2);
        world.body_from_camera *= Isometry3::from_parts(Vector3::zeros().into(), turned);
        let (result, ..) = start(&world, &config());
        assert!(matches!(result, Err(InitError::Agreement(..) | InitError::Gravity(_))), "{seed}: {result:?}");
    }
    let (result, ..) = start(&World::new(&Setup { points: 10, ..Setup::default() }), &config());
    assert_eq!(result, Err(InitError::Tracks(10)));
    let mut world = World::new(&Setup::default());
    world.links.truncate(1);
    assert_eq!(start(&world, &config()).0, Err(InitError::Frames(2)));
    world.links[0].velocity.x = f64::NAN;
    assert!(start(&world, &config()).0.is_err());
}

#[test]
fn single_precision_agrees_with_double() {
    for seed in 0..20 {
        let world = World::new(&Setup { seed, ..Setup::default() });
        let (double, states, _) = start(&world, &config());
        let narrow = world.narrow();
        let mut landmarks = vec![InitLandmark::default(); world.landmark_count()];
        let mut narrow_states = vec![NavState::<f32>::origin(); world.links.len() + 1];
        let config = InitConfig { sigma_px: 0.5_f32, ..InitConfig::default() };
        let bearings = (world.landmark_count(), |l: usize, f: usize| world.bearing(l, f).map(|b| b.cast::<f32>()));
        let extrinsics = world.body_from_camera.cast();
        let problem =
            Problem::<_, _, MAX_INIT_FRAMES> { config: &config, body_from_camera: &extrinsics, links: &narrow, bearings: &bearings };
        let single = initialise_moving(&problem, &mut landmarks, &mut [], &mut narrow_states);
        let (single, double) = (single.unwrap(), double.unwrap());
        let last = states.len() - 1;
        let apart = (narrow_states[last].position_in_world.cast::<f64>() - states[last].position_in_world).norm() / double.distance_m;
        println!("seed {seed}: {apart:.5} of the distance apart, scale sigma {:.4} and {:.4}", single.scale_sigma, double.scale_sigma);
        assert!(apart < 0.5 * double.scale_sigma.max(0.004), "{seed}: {apart}");
    }
}

/// 200 Hz readings of a body at rest in `attitude`, with noise and a disturbance.
fn rest_samples(
    attitude: &UnitQuaternion<f64>,
    bias: &ImuBias<f64>,
    disturb: impl Fn(f64) -> (Vector3<f64>, Vector3<f64>),
) -> Vec<ImuSample<f64>> {
    let mut random = world::Random::new(7);
    (0..160)
        .map(|i| {
            let (rate, force) = disturb(f64::from(i) * 0.005);
            ImuSample {
                stamp: Timestamp::from_nanos(i64::from(i) * 5_000_000),
                gyro_rad_s: bias.gyro_rad_s + random.vector() * 2.4e-3 + rate,
                accel_m_s2: attitude.inverse() * (Vector3::z() * 9.81) + bias.accel_m_s2 + random.vector() * 0.028 + force,
            }
        })
        .collect()
}

#[test]
fn rest_is_seen_through_vibration_and_measured() {
    let attitude = so3::exp(&Vector3::new(0.3, -0.8, 0.0));
    let bias = ImuBias { gyro_rad_s: Vector3::new(0.01, -0.02, 0.08), accel_m_s2: Vector3::new(0.05, -0.05, 0.03) };
    for vibration in [0.0, 0.5] {
        let shake = |t: f64| (Vector3::x() * 0.05 * vibration * (500.0 * t).sin(), Vector3::y() * vibration * (430.0 * t).cos());
        let rest = detect_rest(&RestConfig::default(), &rest_samples(&attitude, &bias, shake), Some(0.2)).unwrap();
        let tilt = (rest.state.world_from_body.inverse() * Vector3::z()).angle(&(attitude.inverse() * Vector3::z()));
        assert!(tilt < 2.0 * rest.sigma_tilt_rad, "{tilt} for {}", rest.sigma_tilt_rad);
        assert!((rest.state.bias.gyro_rad_s - bias.gyro_rad_s).norm() < 3e-3);
    }
}

#[test]
fn motion_is_not_taken_for_rest() {
    let attitude = UnitQuaternion::identity();
    let judge = |samples: &[ImuSample<f64>], px| detect_rest(&RestConfig::default(), samples, px);
    let bias = ImuBias::default();
    let still = |_: f64| (Vector3::zeros(), Vector3::zeros());
    let walking = rest_samples(&attitude, &bias, |t| (Vector3::zeros(), Vector3::x() * (6.0 * t).sin()));
    assert!(matches!(judge(&walking, None), Err(super::Motion::Accelerating(_))));
    let turning = rest_samples(&attitude, &bias, |t| (Vector3::y() * 0.2 * (5.0 * t).sin(), Vector3::zeros()));
    assert!(matches!(judge(&turning, None), Err(super::Motion::Turning(_))));
    let spinning = rest_samples(&attitude, &bias, |_| (Vector3::y() * 0.5, Vector3::zeros()));
    assert!(matches!(judge(&spinning, None), Err(super::Motion::Turning(_))));
    let light = rest_samples(&attitude, &bias, |_| (Vector3::zeros(), Vector3::z() * -3.0));
    assert!(matches!(judge(&light, None), Err(super::Motion::SpecificForce(_))));
    assert!(matches!(judge(&rest_samples(&attitude, &bias, still), Some(4.0)), Err(super::Motion::Image(_))));
    assert!(matches!(judge(&rest_samples(&attitude, &bias, still)[..50], None), Err(super::Motion::Window(_))));
    let mut broken = rest_samples(&attitude, &bias, still);
    broken[20].gyro_rad_s.x = f64::NAN;
    assert!(matches!(judge(&broken, None), Err(super::Motion::Window(_))));
    assert!(judge(&rest_samples(&attitude, &bias, still), None).is_ok());
}
