use std::boxed::Box;
use std::string::ToString;
use std::vec::Vec;

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector2, Vector3};

use super::inertial::InertialHistory;
use super::{Estimator, EstimatorConfig, FrameOutcome, Health, InputError, StepBudget, Waiting};
use crate::camera::{CameraModel, PinholeRadTan};
use crate::depth::{DepthSample, Verdict};
use crate::image::{ImageView, PyramidPair};
use crate::imu::testing::Motion;
use crate::imu::{ImuBias, ImuNoise, ImuSample};
use crate::lie::so3;
use crate::time::{Span, Timestamp};
use crate::track::{Observation, TrackId};

const SAMPLES: usize = 256;
type Small = Estimator<f64, 6, 21, 64, SAMPLES>;

fn estimator() -> Box<Small> {
    let camera = PinholeRadTan { size_px: (752, 480), focal_px: [458.0, 457.0], center_px: [367.0, 248.0], distortion: [0.0; 4] };
    Box::new(Small::new(EstimatorConfig::default(), CameraModel::PinholeRadTan(camera), Isometry3::identity()))
}

fn at(millis: i64) -> Timestamp {
    Timestamp::from_nanos(1_000_000_000 + millis * 1_000_000)
}

/// A reading at rest, the body tilted.
fn resting(millis: i64, world_from_body: &UnitQuaternion<f64>, bias: &ImuBias<f64>) -> ImuSample<f64> {
    ImuSample {
        stamp: at(millis),
        gyro_rad_s: bias.gyro_rad_s,
        accel_m_s2: world_from_body.inverse() * Vector3::new(0.0, 0.0, 9.81) + bias.accel_m_s2,
    }
}

fn level(millis: i64) -> ImuSample<f64> {
    resting(millis, &UnitQuaternion::identity(), &ImuBias::default())
}

/// Forty corners that stay where they are.
fn corners() -> Vec<Observation<f64>> {
    let at = |k: u32| Vector2::new(60.0 + 80.0 * f64::from(k % 8), 50.0 + 90.0 * f64::from(k / 8));
    (0..40).map(|k| Observation { track: TrackId(k), pixel: at(k) }).collect()
}

#[test]
fn before_the_first_image_there_is_nothing_to_say() {
    let mut estimator = estimator();
    assert_eq!(estimator.health(), Health::Initialising(Waiting::Imu));
    assert!(estimator.state().is_none());
    assert_eq!(estimator.step(StepBudget::default()), FrameOutcome::NoFrame);
    assert!(estimator.window().frames.is_empty() && estimator.window().landmarks.is_empty());
}

#[test]
fn an_image_that_the_samples_do_not_reach_is_refused() {
    let mut estimator = estimator();
    assert_eq!(estimator.push_tracks(at(0), &corners()), Err(InputError::MissingImu(at(0))));
    for millis in [0, 5, 10] {
        assert_eq!(estimator.push_imu(level(millis)), Ok(()));
    }
    for beyond in [-1, 11, 1000] {
        assert_eq!(estimator.push_tracks(at(beyond), &corners()), Err(InputError::MissingImu(at(beyond))));
    }
    assert!(estimator.window().frames.is_empty());
    assert_eq!(estimator.step(StepBudget::default()), FrameOutcome::NoFrame);
    assert_eq!(estimator.push_tracks(at(7), &corners()), Ok(()));
    assert_eq!(estimator.push_tracks(at(7), &corners()), Err(InputError::Stale(Span::from_millis(0))));
    assert_eq!(estimator.push_tracks(at(3), &corners()), Err(InputError::Stale(Span::from_millis(4))));
    assert_eq!(estimator.window().frames.len(), 1);
}

#[test]
fn an_image_of_another_size_is_refused() {
    let mut estimator = estimator();
    assert_eq!(estimator.push_imu(level(0)), Ok(()));
    let pixels = [0_u8; 64 * 48];
    let mut pyramids: Box<PyramidPair<65536>> = Box::default();
    let found = estimator.push_image(at(0), &ImageView::new(&pixels, 64, 48, 64).unwrap(), &mut pyramids);
    assert_eq!(found, Err(InputError::WrongImageSize { given: (64, 48), expected: (752, 480) }));
    assert!(estimator.window().frames.is_empty());
}

/// Pyramids without room for one level: the image is refused, and the next one finds the estimator as it was.
#[test]
fn an_image_that_the_pyramids_cannot_hold_leaves_nothing_behind() {
    let mut estimator = estimator();
    assert_eq!(estimator.push_imu(level(0)), Ok(()));
    let pixels = std::vec![0_u8; 752 * 480];
    let image = ImageView::new(&pixels, 752, 480, 752).unwrap();
    let mut pyramids: Box<PyramidPair<1024>> = Box::default();
    assert_eq!(estimator.push_image(at(0), &image, &mut pyramids), Err(InputError::PyramidTooSmall { bytes: 1024 }));
    assert!(estimator.window().frames.is_empty());
    assert_eq!(estimator.step(StepBudget::default()), FrameOutcome::NoFrame);
    assert_eq!(estimator.push_tracks(at(0), &corners()), Ok(()));
}

#[test]
fn samples_that_are_no_numbers_or_from_the_past_are_refused() {
    let mut estimator = estimator();
    assert_eq!(estimator.push_imu(level(10)), Ok(()));
    for spoil in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut gyro, mut accel) = (level(20), level(20));
            gyro.gyro_rad_s[axis] = spoil;
            accel.accel_m_s2[axis] = spoil;
            assert_eq!(estimator.push_imu(gyro), Err(InputError::NotFinite(at(20))));
            assert_eq!(estimator.push_imu(accel), Err(InputError::NotFinite(at(20))));
        }
    }
    assert_eq!(estimator.push_imu(level(10)), Err(InputError::Stale(Span::from_millis(0))));
    assert_eq!(estimator.push_imu(level(7)), Err(InputError::Stale(Span::from_millis(3))));
    assert_eq!(estimator.push_imu(level(11)), Ok(()));
}

#[test]
fn samples_wait_for_their_image_until_there_is_no_room() {
    let mut estimator = estimator();
    // Without an image the oldest make room.
    for k in 0..2 * SAMPLES as i64 {
        assert_eq!(estimator.push_imu(level(5 * k)), Ok(()));
    }
    let last = 5 * (2 * SAMPLES as i64 - 1);
    assert_eq!(estimator.push_tracks(at(last - 5), &corners()), Ok(()));
    // Now those since the image have to stay.
    let taken = (1..2 * SAMPLES as i64).take_while(|k| estimator.push_imu(level(last + 5 * k)).is_ok()).count();
    assert!((SAMPLES - 4..SAMPLES).contains(&taken), "{taken}");
    assert_eq!(estimator.push_imu(level(last + 100_000)), Err(InputError::Full));
    let newest = last + 5 * taken as i64;
    assert_eq!(estimator.push_tracks(at(newest), &corners()), Ok(()));
    assert_eq!(estimator.push_imu(level(newest + 5)), Ok(()), "the image made room");
}

#[test]
fn errors_say_what_is_wrong() {
    let text = InputError::WrongImageSize { given: (64, 48), expected: (752, 480) }.to_string();
    assert!(text.contains("64x48") && text.contains("752x480"), "{text}");
    assert!(InputError::Stale(Span::from_millis(5)).to_string().contains("goes back by"));
    let all = [InputError::NotFinite(at(0)), InputError::MissingImu(at(0)), InputError::PyramidTooSmall { bytes: 12 }, InputError::Full];
    assert!(all.iter().all(|error| error.to_string().len() > 20));
}

#[test]
fn inflation_multiplies_the_noise_it_names() {
    let config = EstimatorConfig::<f64> { imu_noise_inflation: 3.0, imu_walk_inflation: 5.0, ..EstimatorConfig::default() };
    let (plain, found) = (config.imu_noise, config.inflated_noise());
    assert_eq!((found.gyro_noise_density, found.accel_noise_density), (3.0 * plain.gyro_noise_density, 3.0 * plain.accel_noise_density));
    assert_eq!((found.gyro_random_walk, found.accel_random_walk), (5.0 * plain.gyro_random_walk, 5.0 * plain.accel_random_walk));
}

/// At rest the estimator knows which way is down and what its gyro says of nothing, and stays where it is.
#[test]
fn a_body_at_rest_knows_the_vertical_and_stays() {
    let bias = ImuBias { gyro_rad_s: Vector3::new(-0.002, 0.021, 0.077), accel_m_s2: Vector3::zeros() };
    for tilt in [Vector3::zeros(), Vector3::new(0.4, -0.3, 0.0), Vector3::new(0.0, -1.5, 0.0), Vector3::new(2.0, 0.5, 0.0)] {
        let truth = UnitQuaternion::from_rotation_matrix(&Rotation3::from_scaled_axis(tilt));
        let mut estimator = estimator();
        let mut outcomes = Vec::new();
        for millis in (0..6000).step_by(5) {
            assert_eq!(estimator.push_imu(resting(millis, &truth, &bias)), Ok(()));
            if millis % 50 == 0 {
                assert_eq!(estimator.push_tracks(at(millis), &corners()), Ok(()));
                outcomes.push(estimator.step(StepBudget::default()));
            }
        }
        let initialised = outcomes.iter().position(|outcome| *outcome == FrameOutcome::Initialised);
        assert!(initialised.is_some_and(|frame| frame <= 20), "{tilt}: {initialised:?}");
        assert_eq!(estimator.health(), Health::Tracking);
        let state = estimator.state().unwrap();
        let up = state.state.world_from_body.inverse() * Vector3::z();
        assert!(up.angle(&(truth.inverse() * Vector3::z())) < 1e-3, "{tilt}: the vertical is off");
        assert!((state.state.bias.gyro_rad_s - bias.gyro_rad_s).norm() < 1e-4, "{tilt}: {}", state.state.bias.gyro_rad_s);
        assert!(state.state.position_in_world.norm() < 1e-3, "{tilt}: moved to {}", state.state.position_in_world);
        assert!(state.state.velocity_in_world.norm() < 1e-3, "{tilt}: moving at {}", state.state.velocity_in_world);
        assert!(state.pose_covariance.cholesky().is_some(), "{tilt}: the covariance is none");

        estimator.reset();
        assert!(estimator.state().is_none() && estimator.window().frames.is_empty() && estimator.window().landmarks.is_empty());
        assert_eq!(estimator.health(), Health::Initialising(Waiting::Tracks));
    }
}

fn history() -> InertialHistory<f64, SAMPLES> {
    let mut history = InertialHistory::default();
    for sample in Motion::lively().samples(0, 5_000_000, 200) {
        assert!(history.push(sample, None).is_ok());
    }
    history
}

/// Two parts of an interval, cut between samples, make up the whole.
#[test]
fn integrals_meet_where_an_image_cuts_a_sample_interval() {
    let history = history();
    let nanos = Timestamp::from_nanos;
    let (from, cut, to) = (nanos(101_300_000), nanos(252_600_000), nanos(403_900_000));
    let noise = ImuNoise::adis16448();
    let bias = Motion::lively().bias;
    let mut joined = history.integrate(&noise, bias, from, cut);
    joined.append(&history.integrate(&noise, bias, cut, to));
    let whole = history.integrate(&noise, bias, from, to);
    assert_eq!(whole.span(), to - from);
    let ((r, v, p), (r_joined, v_joined, p_joined)) = (whole.corrected(&bias), joined.corrected(&bias));
    // The cut interpolates a reading: second order in 5 ms.
    assert!(r.angle_to(&r_joined) < 1e-6 && (v - v_joined).norm() < 1e-5 && (p - p_joined).norm() < 1e-5);
    // Both are the motion's own.
    let motion = Motion::lively();
    let (start, end) = (motion.state(0.1013), motion.state(0.4039));
    let found = whole.predict(&start, &crate::imu::testing::gravity());
    assert!((found.position_in_world - end.position_in_world).norm() < 1e-5);
    assert!(found.world_from_body.angle_to(&end.world_from_body) < 1e-5);
    let turned = history.rotation(&bias.gyro_rad_s, from, to);
    assert!(turned.angle_to(&(start.world_from_body.inverse() * end.world_from_body)) < 1e-5);
}

#[test]
fn what_is_covered_lies_between_the_first_sample_and_the_last() {
    let mut history = history();
    let nanos = Timestamp::from_nanos;
    assert!(history.covers(nanos(0), nanos(1_000_000_000)));
    assert!(!history.covers(nanos(-1), nanos(5)) && !history.covers(nanos(0), nanos(1_000_000_001)));
    assert_eq!(history.between(nanos(10_000_000), nanos(24_999_999)).len(), 3);
    assert_eq!(history.between(nanos(2_000_000_000), nanos(3_000_000_000)).len(), 0);
    assert!(history.integrate(&ImuNoise::adis16448(), ImuBias::default(), nanos(5), nanos(5)).span_s() == 0.0);
}

/// A frame that leaves hands its inertial samples to the next one: the integral then reaches over both.
#[test]
fn a_dropped_frame_hands_its_samples_on() {
    let motion = Motion { agility: 0.1, ..Motion::lively() };
    let mut estimator = estimator();
    let mut samples = motion.samples(0, 5_000_000, 200).into_iter();
    for k in 0..5_i64 {
        let stamp = Timestamp::from_nanos(k * 150_000_000 + 2_000_000);
        for sample in samples.by_ref() {
            assert_eq!(estimator.push_imu(sample), Ok(()));
            if sample.stamp >= stamp {
                break;
            }
        }
        assert_eq!(estimator.push_tracks(stamp, &corners()), Ok(()));
    }
    let stamps: Vec<_> = estimator.window().frames.iter().map(|frame| frame.stamp).collect();
    let bias = estimator.window().frames[0].state.bias;
    let whole = estimator.inertial.integrate(&estimator.noise, bias, stamps[1], stamps[3]);
    estimator.drop_frame(2);
    let left = estimator.window();
    assert_eq!(left.frames.iter().map(|frame| frame.stamp).collect::<Vec<_>>(), [stamps[0], stamps[1], stamps[3], stamps[4]]);
    assert_eq!(left.frames[2].from_previous, whole);
    assert!(left.landmarks.iter().all(|landmark| landmark.observations() == 4 && landmark.anchor() == 0));
    // The newest never leaves; the oldest takes no integral with it.
    estimator.drop_frame(3);
    assert_eq!(estimator.window().frames.len(), 4);
    estimator.drop_frame(0);
    assert_eq!(estimator.window().frames.len(), 3);
    assert_eq!(estimator.window().frames[1].from_previous, whole);
    let turned = so3::log(&estimator.window().frames[1].from_previous.corrected(&bias).0);
    assert!(turned.norm() > 1e-3, "the motion turns nowhere");
}

#[test]
fn a_depth_map_of_an_image_that_is_not_there_is_refused() {
    let mut estimator = estimator();
    assert_eq!(estimator.push_depths(at(0), &[]), Err(InputError::NoSuchImage(at(0))));
    assert!(estimator.push_imu(level(-5)).is_ok() && estimator.push_imu(level(5)).is_ok());
    assert!(estimator.push_tracks(at(0), &corners()).is_ok());
    let sample = DepthSample { inverse_depth: 0.5, sigma_log: 0.1, uncertainty: 0.1 };
    assert_eq!(estimator.push_depths(at(0), &[(TrackId(3), sample), (TrackId(999), sample)]), Ok(()));
    estimator.step(StepBudget::default());
    let report = estimator.report().depth;
    assert!(report.is_some_and(|report| report.given == 1 && report.verdict == Verdict::Believed), "{report:?}");
    assert_eq!(estimator.push_depths(at(50), &[]), Err(InputError::NoSuchImage(at(50))));
}
