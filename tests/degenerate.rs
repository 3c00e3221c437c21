//! Bad days: motions that teach nothing, sensors that fall silent or lie.

use crate::support::flight::{Flown, Pilot, fly, in_scalar, on_all_cores, real_config, simulated_config, truth_at, with_room};
use crate::support::motion::Script;
use crate::support::tolerance::{ATE_VICON_ROOM_M, ATE_WEAK_START_M, REST_DRIFT_M, SCALE_PERCENT};
use libella_core::estimator::{EstimatorConfig, FrameOutcome, Health, InputError, Waiting};
use libella_core::imu::ImuSample;
use libella_core::time::{Span, Timestamp};
use libella_core::track::{Observation, TrackId};
use libella_host::sim::{FeatureConfig, MotionKind, Recording};
use nalgebra::{Isometry3, UnitQuaternion, Vector2, Vector3};

/// Seconds since the first image of the recording.
fn clock(recording: &Recording, stamp: Timestamp) -> f64 {
    (stamp - recording.frames[0].stamp).as_seconds()
}

/// Never lost, a pose for nearly every image, and where the truth is.
fn assert_accurate(what: &str, flown: &Flown, recording: &Recording) {
    let accuracy = flown.accuracy(recording).unwrap_or_else(|| panic!("{what}: no poses"));
    println!(
        "{what}: ATE {:.4} m, scale {:+.2} %, coverage {:.3}, lost {}",
        accuracy.ate_m,
        accuracy.scale_error_percent,
        flown.coverage(),
        flown.losses()
    );
    assert_eq!(flown.losses(), 0, "{what}: lost");
    assert!(accuracy.ate_m < ATE_VICON_ROOM_M, "{what}: {:.3} m off", accuracy.ate_m);
    assert!(accuracy.scale_error_percent.abs() < SCALE_PERCENT, "{what}: scale {:.1} % off", accuracy.scale_error_percent);
}

/// How far a part of the flight is from the truth after that part's own alignment.
fn part(flown: &Flown, recording: &Recording, from_s: f64, to_s: f64) -> Flown {
    let mut part = flown.clone();
    part.states.retain(|known| (from_s..to_s).contains(&clock(recording, known.stamp)));
    part
}

#[test]
fn turning_on_the_spot_is_survived() {
    with_room(|| {
        let recording = Script { duration_s: 26.0, position_halts: vec![(9.0, 19.0)], ..Script::default() }.recording();
        let flown = fly::<f64>(&recording, simulated_config(&recording));
        assert_accurate("turning on the spot", &flown, &recording);
        assert_accurate("after turning on the spot", &part(&flown, &recording, 20.0, 26.0), &recording);
    });
}

#[test]
fn standing_still_for_a_minute_neither_drifts_nor_breaks_scale() {
    with_room(|| {
        let halts = vec![(8.0, 69.0)];
        let script =
            Script { duration_s: 78.0, position_halts: halts.clone(), rotation_halts: halts, frame_rate_hz: 10.0, ..Script::default() };
        let recording = script.with_calm_tracks().recording();
        let flown = fly::<f64>(&recording, simulated_config(&recording));
        let resting: Vec<_> = flown.states.iter().filter(|known| (9.5..68.5).contains(&clock(&recording, known.stamp))).collect();
        let first = resting.first().unwrap_or_else(|| panic!("no pose at rest"));
        let drift = |known: &crate::support::flight::Knowledge| (known.state.position_in_world - first.state.position_in_world).norm();
        let farthest = resting.iter().map(|known| drift(known)).fold(0.0, f64::max);
        println!("a minute at rest: {} poses, {farthest:.4} m away at most", resting.len());
        assert!(farthest < REST_DRIFT_M, "drifted {farthest:.3} m at rest");
        assert_accurate("a minute at rest", &flown, &recording);
        assert_accurate("after a minute at rest", &part(&flown, &recording, 70.5, 78.0), &recording);
    });
}

#[test]
fn taking_off_after_hovering_is_followed() {
    with_room(|| {
        let recording = Script { rest_s: 6.0, duration_s: 16.0, ..Script::default() }.recording();
        let flown = fly::<f64>(&recording, simulated_config(&recording));
        assert_accurate("hovering, then moving", &flown, &recording);
    });
}

#[test]
fn a_second_without_images_is_bridged() {
    with_room(|| {
        for renamed in [false, true] {
            let recording = Script { duration_s: 18.0, ..Script::default() }.recording();
            let mut pilot = Pilot::<f64>::new(&recording, simulated_config(&recording));
            for frame in &recording.frames {
                let seconds = clock(&recording, frame.stamp);
                if (9.0..10.0).contains(&seconds) {
                    continue;
                }
                // A tracker that lost everything in between gives new names to what it finds afterwards.
                let offset = if renamed && seconds >= 10.0 { 1_000_000 } else { 0 };
                let seen: Vec<_> = frame
                    .observations
                    .iter()
                    .map(|seen| Observation { track: TrackId(seen.track.0 + offset), pixel: seen.pixel })
                    .collect();
                pilot.push_imu_past(frame.stamp, Some);
                pilot.push_frame(frame.stamp, &seen).unwrap_or_else(|error| panic!("{error}"));
            }
            assert_accurate(
                if renamed { "a second without images, tracks renamed" } else { "a second without images" },
                &pilot.flown,
                &recording,
            );
        }
    });
}

#[test]
fn three_seconds_in_the_dark_are_bridged_and_reported() {
    with_room(|| {
        let recording = Script { duration_s: 20.0, ..Script::default() }.recording();
        let mut pilot = Pilot::<f64>::new(&recording, simulated_config(&recording));
        for frame in &recording.frames {
            let seconds = clock(&recording, frame.stamp);
            let dark = (9.0..12.0).contains(&seconds);
            let offset = if seconds >= 12.0 { 1_000_000 } else { 0 };
            let seen: Vec<_> = frame
                .observations
                .iter()
                .filter(|_| !dark)
                .map(|seen| Observation { track: TrackId(seen.track.0 + offset), pixel: seen.pixel })
                .collect();
            pilot.push_imu_past(frame.stamp, Some);
            let outcome = pilot.push_frame(frame.stamp, &seen).unwrap_or_else(|error| panic!("{error}"));
            if dark {
                assert_eq!((outcome, pilot.estimator.health()), (FrameOutcome::Coasted, Health::Degraded), "at {seconds} s");
            }
            // One image to see corners, one to follow them.
            if seconds >= 12.2 {
                assert_eq!(pilot.estimator.health(), Health::Tracking, "at {seconds} s");
            }
        }
        let flown = &pilot.flown;
        assert_eq!(flown.losses(), 0);
        let (before, after) = (part(flown, &recording, 0.0, 9.0), part(flown, &recording, 12.5, 20.0));
        assert_accurate("before the dark", &before, &recording);
        assert_accurate("after the dark", &after, &recording);
        // Nothing computed before was touched: poses are causal. What coasting costs is a matter of the sensor; see the bound.
        let whole = flown.accuracy(&recording).unwrap();
        println!("with the dark: ATE {:.3} m, scale {:+.2} %", whole.ate_m, whole.scale_error_percent);
        assert!(whole.ate_m < 0.5, "{:.2} m off over the whole flight", whole.ate_m);
    });
}

/// Half of the new starts are as accurate as a flight has to be; those that begin while the motion says little of the scale have
/// a bound of their own.
#[test]
fn more_than_five_seconds_in_the_dark_are_a_loss_and_a_new_start() {
    let seeds = [1, 2, 3, 4, 5];
    let mut ates = on_all_cores(&seeds, |seed| {
        let recording = Script { duration_s: 24.0, seed: *seed, ..Script::default() }.recording();
        let mut pilot = Pilot::<f64>::new(&recording, simulated_config(&recording));
        for frame in &recording.frames {
            let seconds = clock(&recording, frame.stamp);
            pilot.push_imu_past(frame.stamp, Some);
            let seen: &[_] = if (8.0..14.0).contains(&seconds) { &[] } else { &frame.observations };
            let _ = pilot.push_frame(frame.stamp, seen);
        }
        let flown = &pilot.flown;
        assert_eq!(flown.losses(), 1);
        assert_eq!(flown.count(|outcome| outcome == FrameOutcome::Initialised), 2, "it started once and once more");
        assert_eq!(flown.health.last(), Some(&Health::Tracking));
        let (before, after) = (part(flown, &recording, 0.0, 8.0), part(flown, &recording, 14.0, 24.0));
        [("before the loss", before), ("after the new start", after)].map(|(what, flown)| {
            let accuracy = flown.accuracy(&recording).unwrap_or_else(|| panic!("{what}: no poses"));
            println!("seed {seed}, {what}: ATE {:.4} m, scale {:+.2} %", accuracy.ate_m, accuracy.scale_error_percent);
            accuracy.ate_m
        })
    });
    for [before_m, after_m] in &ates {
        assert!(*before_m < ATE_VICON_ROOM_M, "{before_m:.3} m off before the loss");
        assert!(*after_m < ATE_WEAK_START_M, "{after_m:.3} m off after the new start");
    }
    ates.sort_by(|a, b| a[1].total_cmp(&b[1]));
    let median_m = ates[ates.len() / 2][1];
    assert!(median_m < ATE_VICON_ROOM_M, "half of the new starts are more than {median_m:.3} m off");
}

#[test]
fn gaps_between_inertial_samples_are_bridged() {
    with_room(|| {
        for gap_s in [0.06, 0.2] {
            let recording = Script { duration_s: 16.0, ..Script::default() }.recording();
            let mut pilot = Pilot::<f64>::new(&recording, simulated_config(&recording));
            for frame in &recording.frames {
                let silent = |stamp| {
                    let seconds = clock(&recording, stamp);
                    (7.0..15.0).contains(&seconds) && seconds % 2.0 < gap_s
                };
                pilot.push_imu_past(frame.stamp, |sample| (!silent(sample.stamp)).then_some(sample));
                let _ = pilot.push_frame(frame.stamp, &frame.observations);
            }
            assert_accurate(&format!("gaps of {gap_s} s"), &pilot.flown, &recording);
        }
    });
}

/// A sensor whose range is too small for the flight: readings are cut off all along. Told of its range, the estimator trusts what
/// was not cut off; without, it believes all.
#[test]
fn a_saturated_sensor_is_survived() {
    with_room(|| {
        let recording = Script { kind: MotionKind::Difficult, duration_s: 20.0, ..Script::default() }.recording();
        let (rate, force) = (0.9, 11.5);
        let clip = |sample: ImuSample<f64>| ImuSample {
            gyro_rad_s: sample.gyro_rad_s.map(|value| value.clamp(-rate, rate)),
            accel_m_s2: sample.accel_m_s2.map(|value| value.clamp(-force, force)),
            ..sample
        };
        let clipped = recording.imu.iter().filter(|sample| clip(**sample) != **sample).count();
        assert!(clipped * 50 > recording.imu.len(), "only {clipped} samples were cut off");
        let flown = |config: EstimatorConfig<f64>| {
            let mut pilot = Pilot::<f64>::new(&recording, config);
            let mut reported = 0;
            for frame in &recording.frames {
                pilot.push_imu_past(frame.stamp, |sample| Some(clip(sample)));
                let _ = pilot.push_frame(frame.stamp, &frame.observations);
                reported += pilot.estimator.report().saturated;
            }
            let accuracy = pilot.flown.accuracy(&recording);
            println!("{clipped} samples cut off, {reported} reported, lost {}, {accuracy:?}", pilot.flown.losses());
            (pilot.flown, reported, accuracy.map_or(f64::INFINITY, |found| found.ate_m))
        };
        let config = real_config(&recording);
        let (_, unreported, believed) = flown(config);
        let (told, reported, known) = flown(EstimatorConfig { gyro_range_rad_s: rate, accel_range_m_s2: force, ..config });
        assert_eq!(unreported, 0);
        assert!(reported * 2 > clipped, "{clipped} samples were cut off, {reported} reported");
        assert!(told.losses() == 0 && told.health.last() == Some(&Health::Tracking), "it did not survive");
        assert!(known < 0.1 && known < believed, "{known:.3} m off where the range is known, {believed:.3} m where it is not");
    });
}

/// Refusals leave no trace: the flight with bad input in between is the same to the last bit.
#[test]
fn what_is_refused_changes_nothing() {
    with_room(|| {
        let recording = Script { duration_s: 8.0, ..Script::default() }.recording();
        let clean = fly::<f64>(&recording, simulated_config(&recording));
        let mut pilot = Pilot::<f64>::new(&recording, simulated_config(&recording));
        let mut refused = 0;
        for (index, frame) in recording.frames.iter().enumerate() {
            pilot.push_imu_past(frame.stamp, Some);
            let last = recording.imu.iter().rfind(|sample| sample.stamp <= frame.stamp).copied().unwrap();
            for bad in bad_samples(&last) {
                let result = pilot.estimator.push_imu(in_scalar(&bad));
                assert!(
                    matches!(result, Err(InputError::NotFinite(_) | InputError::Stale(_))),
                    "took {bad:?} after {:?}: {result:?}",
                    last.stamp
                );
                refused += 1;
            }
            // An image beyond the samples, then one from the past.
            let beyond = pilot.push_frame(frame.stamp + Span::from_millis(500), &frame.observations);
            assert!(matches!(beyond, Err(InputError::MissingImu(_))), "{beyond:?}");
            if index > 0 {
                for back in [0, 1, 1000] {
                    let stamp = recording.frames[index - 1].stamp - Span::from_millis(back);
                    let stale = pilot.push_frame(stamp, &frame.observations);
                    assert!(matches!(stale, Err(InputError::Stale(_))), "{stale:?}");
                    refused += 1;
                }
            }
            pilot.push_frame(frame.stamp, &frame.observations).unwrap();
        }
        assert!(refused > 500);
        assert_eq!(clean.outcomes, pilot.flown.outcomes);
        assert_eq!(clean.states.len(), pilot.flown.states.len());
        for (a, b) in clean.states.iter().zip(&pilot.flown.states) {
            assert!(a.state == b.state && a.pose_covariance == b.pose_covariance, "at {:?}", a.stamp);
        }
    });
}

fn bad_samples(last: &ImuSample<f64>) -> Vec<ImuSample<f64>> {
    let next = last.stamp + Span::from_millis(500);
    let spoil = |gyro: f64, accel: f64| ImuSample {
        stamp: next,
        gyro_rad_s: Vector3::new(gyro, 0.0, 0.0),
        accel_m_s2: Vector3::new(0.0, 0.0, accel),
    };
    vec![
        spoil(f64::NAN, 9.81),
        spoil(0.0, f64::NAN),
        spoil(f64::INFINITY, 9.81),
        spoil(0.0, f64::NEG_INFINITY),
        ImuSample { stamp: last.stamp, ..*last },
        ImuSample { stamp: last.stamp - Span::from_millis(5), ..*last },
        ImuSample { stamp: last.stamp - Span::from_millis(100_000), ..*last },
    ]
}

#[test]
fn nonsense_corners_do_no_harm() {
    with_room(|| {
        let recording = Script { duration_s: 10.0, ..Script::default() }.recording();
        let mut pilot = Pilot::<f64>::new(&recording, simulated_config(&recording));
        for (index, frame) in recording.frames.iter().enumerate() {
            let mut seen = frame.observations.clone();
            let strange = [f64::NAN, f64::INFINITY, -1e9, 1e300];
            for (k, value) in strange.into_iter().enumerate() {
                seen.push(Observation { track: TrackId(2_000_000 + k as u32), pixel: Vector2::new(value, 100.0) });
                // And one name for two corners.
                seen.push(Observation { track: TrackId(3_000_000), pixel: Vector2::new(100.0 * k as f64, 50.0 + index as f64 % 90.0) });
            }
            pilot.push_imu_past(frame.stamp, Some);
            pilot.push_frame(frame.stamp, &seen).unwrap();
        }
        assert_accurate("nonsense corners", &pilot.flown, &recording);
    });
}

/// A camera that is mounted otherwise than the calibration says.
#[test]
fn wrong_extrinsics_are_reported_instead_of_flown() {
    with_room(|| {
        for (what, rest_s) in [("in motion", 0.0), ("at rest", 1.5)] {
            let recording = Script { rest_s, duration_s: 12.0, ..Script::default() }.recording();
            let pose = recording.body_from_camera;
            let quarter = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
            let wrong = [
                ("inverted", pose.inverse()),
                ("identity", Isometry3::identity()),
                ("a quarter turn off", Isometry3::from_parts(pose.translation, pose.rotation * quarter)),
            ];
            for (name, extrinsics) in wrong {
                let mut pilot = Pilot::<f64>::with_extrinsics(&recording, simulated_config(&recording), &extrinsics);
                let mut waiting = Vec::new();
                for frame in &recording.frames {
                    pilot.fly(frame);
                    if let Health::Initialising(reason) = pilot.estimator.health() {
                        waiting.push(reason);
                    }
                }
                let flown = &pilot.flown;
                let worst = flown.states.iter().filter_map(|known| {
                    let truth = truth_at(&recording, known.stamp)?;
                    Some((known.state.velocity_in_world.norm() - truth.velocity_in_world.norm()).abs())
                });
                let worst = worst.fold(0.0, f64::max);
                let healthy = flown.health.iter().filter(|health| **health == Health::Tracking).count();
                let disagreed = waiting.iter().filter(|reason| matches!(reason, Waiting::Agreement | Waiting::Gravity)).count();
                println!(
                    "{name}, started {what}: {healthy} healthy of {} images, {} losses, speed wrong by up to {worst:.2} m/s, {disagreed} times reported",
                    flown.outcomes.len(),
                    flown.losses()
                );
                assert!(disagreed > 0, "{name}, started {what}: nobody was told");
                assert!(worst < 2.0, "{name}, started {what}: healthy with a speed that is {worst:.1} m/s wrong");
                if rest_s == 0.0 {
                    assert_eq!(healthy, 0, "{name}: healthy with the camera looking elsewhere");
                }
            }
        }
    });
}

#[test]
fn a_crowd_of_outliers_is_flown_through() {
    with_room(|| {
        let features = FeatureConfig { count: 100, outlier_share: 0.1, ..FeatureConfig::default() };
        let recording = Script { duration_s: 14.0, features, ..Script::default() }.recording();
        let flown = fly::<f64>(&recording, simulated_config(&recording));
        assert_accurate("every tenth corner an outlier", &flown, &recording);
    });
}
