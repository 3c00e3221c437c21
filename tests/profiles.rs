//! The small profiles on a simulated flight through a room, from the first image to the last.
//!
//! `cargo test --test system profiles:: -- --nocapture` prints the accuracy.

use libella_core::camera::{Camera, CameraModel, PinholeRadTan};
use libella_core::estimator::{Estimator, EstimatorConfig, FrameOutcome, StepBudget};
use libella_core::imu::ImuSample;
use libella_core::profile::{Micro, Mobile};
use libella_core::track::Observation;
use libella_host::eval::align;
use libella_host::sim::features::Tracker;
use libella_host::sim::{AnalyticConfig, FeatureConfig, Flight, ImuConfig, MotionKind, RoomConfig, Scene, euroc};
use nalgebra::{Isometry3, Vector3};

/// EuRoC's left camera with fewer pixels across.
fn camera(width: u32, height: u32) -> PinholeRadTan<f64> {
    let scale = f64::from(width) / 752.0;
    PinholeRadTan {
        size_px: (width, height),
        focal_px: [458.654 * scale, 457.296 * scale],
        center_px: [f64::from(width - 1) / 2.0, f64::from(height - 1) / 2.0],
        distortion: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
    }
}

struct Outcome {
    ate_m: f64,
    flown_m: f64,
    initialised_after_s: f64,
    coverage: f64,
    lost: usize,
}

/// Two starts: from rest into a calm flight, and in the middle of a lively one.
const FLIGHTS: [(MotionKind, f64); 2] = [(MotionKind::Easy, 2.0), (MotionKind::Difficult, 0.0)];

/// 30 s of flight after a rest. Corners are as sharp on a small image as on a large one, in pixels.
fn fly<const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>(
    camera: PinholeRadTan<f64>,
    (kind, rest_s): (MotionKind, f64),
    seed: u64,
    budget: StepBudget,
) -> Outcome {
    let motion = AnalyticConfig { kind, duration_s: 30.0, rest_s, ..AnalyticConfig::default() };
    let flight = Flight::analytic(&motion, &ImuConfig::default(), 20.0, seed).unwrap();
    let scene = Scene::room(&RoomConfig::vicon(&flight.path()), &flight.path(), seed).unwrap();
    let scale = camera.focal_px[0] / 458.654;
    let features = FeatureConfig {
        count: POINTS * 3 / 4,
        sigma_px: 0.2,
        outlier_share: 0.005,
        spacing_px: 20.0 * scale,
        border_px: 8.0 * scale,
        ..FeatureConfig::default()
    };
    let camera = CameraModel::PinholeRadTan(camera);
    let mut tracker = Tracker::new(&scene, camera, &features, seed).unwrap();
    let body_from_camera = euroc::body_from_camera(0);
    let default = EstimatorConfig::<f32>::default();
    let config = EstimatorConfig { keyframe_parallax_px: default.keyframe_parallax_px * camera.focal_px() as f32 / 458.654, ..default };
    let single: Isometry3<f32> = body_from_camera.cast();
    let mut estimator = Box::new(Estimator::<f32, FRAMES, PAIRS, POINTS, SAMPLES>::new(config, camera.cast(), single));
    let mut imu = flight.imu.iter().peekable();
    let (mut pairs, mut first, mut lost) = (Vec::new(), None, 0);
    for stamp in &flight.frame_stamps {
        while let Some(sample) = imu.next_if(|sample| sample.stamp <= *stamp) {
            let sample = ImuSample { stamp: sample.stamp, gyro_rad_s: sample.gyro_rad_s.cast(), accel_m_s2: sample.accel_m_s2.cast() };
            estimator.push_imu(sample).unwrap();
        }
        let seconds = (*stamp - flight.epoch).as_seconds::<f64>();
        let seen = tracker.observe(seconds, &flight.world_from_camera(*stamp, &body_from_camera));
        let seen: Vec<Observation<f32>> = seen.iter().map(|o| Observation { track: o.track, pixel: o.pixel.cast() }).collect();
        estimator.push_tracks(*stamp, &seen).unwrap();
        if estimator.step(budget) == FrameOutcome::Lost {
            lost += 1;
        }
        if let Some(estimate) = estimator.state() {
            first.get_or_insert(seconds);
            // The first state of a start that was spread belongs to an earlier image.
            let seconds = (estimate.stamp - flight.epoch).as_seconds::<f64>();
            let position: Vector3<f64> = estimate.state.position_in_world.cast();
            pairs.push((position, flight.trajectory.at(seconds).position_in_world));
        }
    }
    let alignment = align(&pairs).unwrap();
    let squared = |(e, t): &(Vector3<f64>, Vector3<f64>)| {
        (alignment.truth_from_estimate * nalgebra::Point3::from(*e) - nalgebra::Point3::from(*t)).norm_squared()
    };
    Outcome {
        ate_m: (pairs.iter().map(squared).sum::<f64>() / pairs.len() as f64).sqrt(),
        flown_m: flight.path().windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum(),
        initialised_after_s: first.unwrap(),
        coverage: pairs.len() as f64 / flight.frame_stamps.len() as f64,
        lost,
    }
}

/// The calm flights decide: slow motion tells a small window little about scale. Measured at worst: Micro 0.36 m, Mobile 0.07 m.
fn check(name: &str, most_share: f64, outcome: &Outcome) {
    let Outcome { ate_m, flown_m, initialised_after_s, coverage, lost } = *outcome;
    println!(
        "{name}: ATE {ate_m:.3} m of {flown_m:.1} m, initialised after {initialised_after_s:.2} s, {:.0} % of the images",
        100.0 * coverage
    );
    assert!(ate_m < most_share * flown_m && coverage > 0.9 && lost == 0);
}

#[test]
fn micro_flies_through_a_room() {
    let _: fn(&Micro) = |_: &Estimator<f32, 6, 21, 54, 128>| ();
    for (flight, seed) in FLIGHTS.into_iter().flat_map(|flight| [(flight, 1), (flight, 2)]) {
        for (name, budget) in [("Micro", StepBudget::default()), ("Micro, start spread", StepBudget::even())] {
            check(name, 0.05, &fly::<6, 21, 54, 128>(camera(160, 120), flight, seed, budget));
        }
    }
}

#[test]
fn mobile_flies_through_a_room() {
    let _: fn(&Mobile) = |_: &Estimator<f32, 8, 36, 150, 512>| ();
    for (flight, seed) in FLIGHTS.into_iter().flat_map(|flight| [(flight, 1), (flight, 2)]) {
        check("Mobile", 0.01, &fly::<8, 36, 150, 512>(camera(640, 480), flight, seed, StepBudget::default()));
    }
}
