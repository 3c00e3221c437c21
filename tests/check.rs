//! `libella check` names each planted fault and is silent about clean recordings.

use std::sync::Arc;

use crate::support::recordings::data;
use libella_core::camera::CameraModel;
use libella_core::imu::ImuSample;
use libella_core::time::{Span, Timestamp};
use libella_host::check::{CheckOptions, FindingKind, Report, Severity, check};
use libella_host::config::Config;
use libella_host::dataset::{self, Frames, Recording};
use libella_host::pipeline::{rendered_recording, tracked_recording};
use libella_host::sim::{
    AnalyticConfig, FeatureConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight, SimulationConfig, simulate,
};
use nalgebra::{UnitQuaternion, Vector3};

const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Noise of the corners, px: as large as the front end's on real images (0.17 px on MH_01) and a half more.
const CORNER_SIGMA_PX: f64 = 0.25;

fn flight(kind: MotionKind, seconds: f64, seed: u64) -> Recording {
    noisy_flight(kind, seconds, seed, CORNER_SIGMA_PX)
}

fn noisy_flight(kind: MotionKind, seconds: f64, seed: u64, sigma_px: f64) -> Recording {
    let motion = AnalyticConfig { kind, duration_s: seconds, ..AnalyticConfig::default() };
    let features = FeatureConfig { sigma_px, ..FeatureConfig::default() };
    tracked_recording("flight", simulate(&SimulationConfig { motion, features, ..SimulationConfig::default() }, seed).unwrap())
}

fn checked(recording: &Recording) -> Report {
    let report = check(recording, &CheckOptions { images: 200, ..CheckOptions::default() }).unwrap();
    eprintln!("{report}");
    report
}

/// The one fault that is expected, and nothing else that is worse than a note.
fn assert_named(report: &Report, kind: FindingKind) {
    assert!(report.has(kind, Severity::Fault), "{kind:?} is not named:\n{report}");
    let others = report.findings.iter().filter(|finding| finding.kind != kind && finding.severity > Severity::Note);
    assert_eq!(others.count(), 0, "more than {kind:?} is named:\n{report}");
}

fn assert_silent(report: &Report) {
    assert_eq!(report.worst, Severity::Note, "{report}");
}

fn camera_of(recording: &mut Recording) -> (&mut [f64; 2], &mut (u32, u32)) {
    match &mut recording.rig.camera {
        CameraModel::PinholeRadTan(camera) => (&mut camera.focal_px, &mut camera.size_px),
        CameraModel::KannalaBrandt(camera) => (&mut camera.focal_px, &mut camera.size_px),
    }
}

fn shift_frames(recording: &mut Recording, change: impl Fn(Timestamp) -> Timestamp) {
    match &mut recording.frames {
        Frames::Images(images) => images.iter_mut().for_each(|image| image.stamp = change(image.stamp)),
        Frames::Tracks(frames) => frames.iter_mut().for_each(|frame| frame.stamp = change(frame.stamp)),
        Frames::Live(_) | Frames::Packed(_) => unreachable!(),
    }
}

fn each_sample(recording: &mut Recording, change: impl Fn(&mut ImuSample<f64>)) {
    recording.imu.iter_mut().for_each(change);
}

/// Makes the camera's stamps early by so much.
fn early_camera(recording: &mut Recording, ms: i64) {
    let frames = recording.frames.len();
    shift_frames(recording, |stamp| stamp - Span::from_millis(ms));
    assert_eq!(recording.frames.len(), frames);
}

type Plant = fn(&mut Recording);

/// Faults that need neither pixels nor another recording.
const PLANTS: [(&str, FindingKind, Plant); 11] = [
    ("inverted T_BS", FindingKind::ExtrinsicInverted, |r| r.rig.body_from_camera = r.rig.body_from_camera.inverse()),
    ("20 ms", FindingKind::TimeOffset, |r| early_camera(r, 20)),
    ("-7 ms", FindingKind::TimeOffset, |r| early_camera(r, -7)),
    ("gyro in deg/s", FindingKind::GyroUnit, |r| each_sample(r, |s| s.gyro_rad_s *= 180.0 / std::f64::consts::PI)),
    ("acc in g", FindingKind::AccelUnit, |r| each_sample(r, |s| s.accel_m_s2 /= STANDARD_GRAVITY_M_S2)),
    ("swapped axes", FindingKind::ImuAxes, |r| {
        each_sample(r, |s| {
            s.gyro_rad_s.swap_rows(0, 1);
            s.accel_m_s2.swap_rows(0, 1);
        });
    }),
    ("duplicate stamps", FindingKind::StampDuplicate, |r| {
        for index in (10..r.imu.len()).step_by(20) {
            r.imu[index].stamp = r.imu[index - 1].stamp;
        }
    }),
    ("us for ns", FindingKind::StampUnit, |r| each_sample(r, |s| s.stamp = Timestamp::from_nanos(s.stamp.as_nanos() / 1000))),
    ("focal length 20 % off", FindingKind::Intrinsics, |r| camera_of(r).0.iter_mut().for_each(|focal| *focal *= 1.2)),
    ("variance for sigma", FindingKind::NoiseDensity, |r| {
        let noise = &mut r.rig.imu_noise;
        for density in
            [&mut noise.gyro_noise_density, &mut noise.accel_noise_density, &mut noise.gyro_random_walk, &mut noise.accel_random_walk]
        {
            *density *= *density;
        }
    }),
    ("saturated gyro", FindingKind::GyroSaturated, |r| each_sample(r, |s| s.gyro_rad_s.apply(|rate| *rate = rate.clamp(-0.5, 0.5)))),
];

fn assert_all_plants_are_named(recording: impl Fn() -> Recording) {
    for (name, kind, plant) in PLANTS {
        let mut planted = recording();
        plant(&mut planted);
        eprintln!("=== {name}");
        let report = checked(&planted);
        assert_named(&report, kind);
        if let Some(offset_ms) = name.strip_suffix(" ms").map(|ms| ms.parse::<f64>().unwrap()) {
            let found = report.figures.camera_imu.unwrap().time_offset_ms;
            assert!(found.observable && (found.value - offset_ms).abs() < 1.0, "{found:?}");
        }
    }
}

#[test]
fn planted_faults_of_a_simulated_flight_are_named() {
    assert_all_plants_are_named(|| flight(MotionKind::Medium, 20.0, 3));
}

#[test]
fn planted_faults_of_a_real_recording_are_named() {
    let Some(path) = data("euroc/MH_01_easy") else { return };
    let open = || dataset::open_to_check(&path, &Config::default().dataset).unwrap();
    assert_all_plants_are_named(open);
    eprintln!("=== wrong size");
    let mut planted = open();
    *camera_of(&mut planted).1 = (640, 480);
    assert_named(&checked(&planted), FindingKind::ImageSize);
    eprintln!("=== static");
    let mut planted = open();
    rest_as_at_the_end(&mut planted);
    assert_named(&checked(&planted), FindingKind::Static);
}

/// The last second of inertial samples, in which the rig rests, and the last image, over the whole of the recording.
fn rest_as_at_the_end(recording: &mut Recording) {
    let last: Vec<ImuSample<f64>> = recording.imu.iter().rev().take(200).rev().copied().collect();
    for (index, sample) in recording.imu.iter_mut().enumerate() {
        *sample = ImuSample { stamp: sample.stamp, ..last[index % last.len()] };
    }
    if let Frames::Images(images) = &mut recording.frames {
        let last = images.last().unwrap().clone();
        images.iter_mut().for_each(|image| *image = dataset::ImageFile { stamp: image.stamp, ..last.clone() });
    }
}

#[test]
fn simulated_flights_are_clean_and_their_offset_and_rotation_are_found() {
    for (kind, seed) in [(MotionKind::Easy, 1), (MotionKind::FastYaw, 2), (MotionKind::Medium, 1), (MotionKind::Difficult, 3)] {
        let report = checked(&flight(kind, 20.0, seed));
        assert_silent(&report);
        let found = report.figures.camera_imu.unwrap();
        let (offset, rotation) = (found.time_offset_ms, found.rotation_off_deg);
        assert!(offset.value.abs() < 1.0 && rotation.value < 0.5, "{kind:?} {seed}: {found:?}");
    }
}

#[test]
fn corners_too_noisy_for_an_offset_raise_no_alarm() {
    let report = checked(&noisy_flight(MotionKind::Easy, 20.0, 3, 1.0));
    assert_silent(&report);
    assert!(!report.figures.camera_imu.unwrap().time_offset_ms.observable);
}

#[test]
fn a_camera_that_only_turns_is_told_to_move() {
    let report = checked(&flight(MotionKind::PureRotation, 15.0, 1));
    assert!(report.has(FindingKind::Motion, Severity::Warning), "{report}");
    assert_eq!(report.count(Severity::Fault), 0, "{report}");
}

#[test]
fn a_turned_camera_is_measured() {
    let mut recording = flight(MotionKind::Medium, 20.0, 5);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.05, 0.03));
    recording.rig.body_from_camera.rotation *= turn.inverse();
    let report = checked(&recording);
    assert_named(&report, FindingKind::ExtrinsicRotation);
    let found = Vector3::from(report.figures.camera_imu.unwrap().rotation_off_vector_deg).map(f64::to_radians);
    assert!((found - turn.scaled_axis()).norm().to_degrees() < 0.5, "{found}");
}

#[test]
fn a_rig_at_rest_is_called_static_and_its_calibration_unobservable() {
    let report = checked(&flight(MotionKind::Still, 10.0, 1));
    assert_named(&report, FindingKind::Static);
    assert!(report.figures.camera_imu.is_none());
}

#[test]
fn images_of_another_size_are_told_from_wrong_intrinsics() {
    let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s: 2.0, rest_s: 0.0, ..AnalyticConfig::default() };
    let source = MotionSource::Analytic(motion, ImuConfig::default());
    let flight = Arc::new(RenderedFlight::new(&source, &RenderConfig::default(), 3, 3).unwrap());
    let (mut recording, _) = rendered_recording("rendered", &flight);
    assert_silent(&checked(&recording));
    *camera_of(&mut recording).1 = (640, 480);
    assert_named(&checked(&recording), FindingKind::ImageSize);
}

#[test]
fn recordings_at_hand_are_clean() {
    for name in ["euroc/MH_01_easy", "imu_april"] {
        let Some(path) = data(name) else { continue };
        let report = checked(&dataset::open_to_check(&path, &Config::default().dataset).unwrap());
        assert_silent(&report);
    }
}
