//! Worlds without noise whose solution is known exactly.

use libella_core::camera::Camera;
use libella_core::imu::{ImuNoise, NavState, stretch};
use libella_core::plane::Plane;
use libella_core::robust::kernel::Kernel;
use libella_core::time::{Span, Timestamp};
use libella_core::window::{CameraPose, NormalizedPoint};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::planes::FreePlane;
use super::views::from_world;
use super::{Bundle, BundleError, BundleSettings, Keyframe, Landmark, LandmarkView, RightView, pairs_between};
use crate::config::Config;
use crate::sim::random::Random;
use crate::sim::{AnalyticConfig, FeatureConfig, ImuConfig, MotionKind, Recording, SimulationConfig, simulate_with_landmarks};

/// Everything that a bundle is made of, at the truth.
struct World {
    settings: BundleSettings,
    keyframes: Vec<Keyframe>,
    landmarks: Vec<Landmark>,
    planes: Vec<Plane<f64>>,
    recording: Recording,
}

/// Six seconds of a simulated flight with a keyframe every fifth of a second. The states are those that the samples lead to from the
/// first one, and corners are where they project: every residual vanishes. Noise is that of the sensors, to weight by.
fn world(kernel: Kernel<f64>) -> World {
    let config = SimulationConfig {
        motion: AnalyticConfig { kind: MotionKind::Medium, duration_s: 6.0, rest_s: 0.0, ..AnalyticConfig::default() },
        imu: ImuConfig { noise: None, ..ImuConfig::default() },
        features: FeatureConfig { count: 40, sigma_px: 0.0, outlier_share: 0.0, ..FeatureConfig::default() },
        ..SimulationConfig::default()
    };
    let (recording, truth) = simulate_with_landmarks(&config, 3).unwrap();
    let estimator = Config::default().estimator_config::<f64>(&ImuNoise::adis16448());
    let settings = BundleSettings { kernel, first_bias_sigma: None, ..BundleSettings::new(&estimator, recording.body_from_camera) };
    let corner = truth.iter().copied().reduce(|a, b| a.sup(&b)).unwrap();
    let planes = vec![Plane::through(&Vector3::zeros(), Vector3::z_axis()), Plane::through(&corner, -Vector3::x_axis())];
    let mut keyframes: Vec<Keyframe> = Vec::new();
    let mut landmarks: Vec<Landmark> = truth
        .iter()
        .map(|at| Landmark {
            position_in_world: *at,
            used: true,
            views: Vec::new(),
            plane: planes.iter().position(|plane| plane.distance_m(at).abs() < 1e-6),
        })
        .collect();
    for frame in recording.frames.iter().step_by(4) {
        let state = match keyframes.last() {
            None => recording.truth.iter().find(|row| row.stamp == frame.stamp).unwrap().state,
            Some(before) => {
                let pairs = pairs_between(&recording.imu, before.stamp, frame.stamp);
                let integral = stretch::integrate(pairs, &settings.imu_noise, &settings.imu_range, before.state.bias);
                integral.predict(&before.state, &settings.gravity_in_world)
            }
        };
        let pair = from_world(&CameraPose::of(&state, &settings.body_from_camera));
        for seen in &frame.observations {
            let landmark = &mut landmarks[seen.track.0 as usize];
            let at = pair.target_from_anchor * landmark.position_in_world + pair.translation_in_target;
            let (corner, by_pixel) = recording.camera.unproject_with_jacobian(&seen.pixel).unwrap();
            let at = Vector3::new(at.x / at.z, at.y / at.z, at.z);
            // The motion that was integrated is that which was simulated, but for the midpoint rule.
            assert!((corner - at.xy()).norm() < 0.01);
            let point =
                NormalizedPoint { x: at.x, y: at.y, inverse_sigma: 1.0 / (estimator.sigma_px * by_pixel.determinant().abs().sqrt()) };
            let right = RightView::from_depth(&point, settings.virtual_baseline_m, at.z, 10.0);
            landmark.views.push(LandmarkView { right, ..LandmarkView::new(keyframes.len(), point) });
        }
        keyframes.push(Keyframe { stamp: frame.stamp, state, at_rest: false });
    }
    landmarks.retain(|landmark| landmark.views.len() > 3);
    World { settings, keyframes, landmarks, planes, recording }
}

impl World {
    fn bundle(&self) -> Result<Bundle, BundleError> {
        Bundle::new(self.settings.clone(), self.keyframes.clone(), &self.recording.imu, self.landmarks.clone(), self.planes.clone())
    }

    /// All states but the first position and heading, and all landmarks, a little off.
    fn disturb(&mut self, scale: f64) {
        let mut random = Random::new(5, "disturbance");
        for (k, keyframe) in self.keyframes.iter_mut().enumerate() {
            let sigmas = [0.01, 0.03, 0.05, 0.002, 0.02];
            let mut delta: [f64; 15] = std::array::from_fn(|i| scale * random.normal() * sigmas[i / 3]);
            if k == 0 {
                delta[..6].fill(0.0);
            }
            keyframe.state = keyframe.state.retract(&delta);
        }
        for landmark in &mut self.landmarks {
            landmark.position_in_world += random.normal3() * (0.05 * scale);
        }
        for plane in &mut self.planes {
            let mut free = FreePlane::new(*plane);
            free.retract([scale * random.normal() * 0.05, scale * random.normal() * 0.02]);
            *plane = free.plane;
        }
    }
}

fn farthest(bundle: &Bundle, truth: &World) -> (f64, f64) {
    let states = bundle
        .keyframes()
        .iter()
        .zip(&truth.keyframes)
        .map(|(found, truth)| found.state.local(&truth.state).into_iter().fold(0.0, |most: f64, value| most.max(value.abs())));
    let landmarks = bundle.landmarks().iter().zip(&truth.landmarks).map(|(a, b)| (a.position_in_world - b.position_in_world).norm());
    (states.fold(0.0, f64::max), landmarks.fold(0.0, f64::max))
}

#[test]
fn at_the_truth_there_is_no_cost() {
    let bundle = world(Kernel::huber(4.0)).bundle().unwrap();
    let (landmarks, corners) = bundle.counts();
    assert!(landmarks > 60 && corners > 600, "{landmarks} {corners}");
    for plane in [0, 1] {
        let on = bundle.landmarks().iter().filter(|landmark| landmark.plane == Some(plane)).count();
        assert!(on > 5, "{on} landmarks on plane {plane}");
    }
    assert!(bundle.cost() < 1e-12, "{}", bundle.cost());
}

#[test]
fn what_was_disturbed_is_found_again() {
    let truth = world(Kernel::huber(4.0));
    let mut disturbed = world(Kernel::huber(4.0));
    disturbed.disturb(1.0);
    let mut bundle = disturbed.bundle().unwrap();
    let report = bundle.optimize(40, |_| true).unwrap();
    let (state, landmark) = farthest(&bundle, &truth);
    assert!(report.initial_cost > 1e4 && report.final_cost < 1e-12, "{report:?}");
    assert!(state < 1e-6 && landmark < 1e-6, "{state} {landmark}");
    for (found, truth) in bundle.planes().zip(&truth.planes) {
        assert!((found.offset_m - truth.offset_m).abs() < 1e-6 && found.angle_rad(truth) < 1e-6, "{found:?} {truth:?}");
    }
}

#[test]
fn the_estimators_way_to_the_first_landmarks_leads_there_too() {
    let truth = world(Kernel::huber(4.0));
    let mut near = world(Kernel::huber(4.0));
    near.disturb(0.02);
    for landmark in &mut near.landmarks {
        (landmark.position_in_world, landmark.used) = (Vector3::zeros(), false);
    }
    let mut bundle = near.bundle().unwrap();
    assert_eq!(bundle.counts(), (0, 0));
    for _ in 0..3 {
        bundle.judge();
        bundle.triangulate().unwrap();
        bundle.optimize(20, |_| true).unwrap();
    }
    let used: Vec<_> = bundle.landmarks().iter().map(|landmark| landmark.used).collect();
    assert!(used.iter().filter(|used| **used).count() * 10 > used.len() * 8, "{used:?}");
    assert!(farthest(&bundle, &truth).0 < 1e-6);
    for (found, truth) in bundle.landmarks().iter().zip(&truth.landmarks).filter(|(found, _)| found.used) {
        assert!((found.position_in_world - truth.position_in_world).norm() < 1e-6);
    }
}

#[test]
fn slopes_of_the_whole_are_those_of_the_cost() {
    for kernel in [Kernel::Quadratic, Kernel::huber(4.0)] {
        let mut world = world(kernel);
        world.settings.first_bias_sigma = Some((0.05, 0.15));
        world.keyframes[7].at_rest = true;
        world.disturb(0.3);
        let mut bundle = world.bundle().unwrap();
        let (keyframes, landmarks, planes) = bundle.linearize().gradients();
        let step = 1e-6;
        for k in [0, 1, 7, 20, bundle.keyframes.len() - 1] {
            let saved = bundle.keyframes[k].state;
            for i in 0..15 {
                let mut cost = |step: f64| {
                    let mut delta = [0.0; 15];
                    delta[i] = step;
                    bundle.keyframes[k].state = saved.retract(&delta);
                    bundle.cost()
                };
                let numerical = (cost(step) - cost(-step)) / (2.0 * step);
                assert!((numerical - keyframes[k][i]).abs() < 1e-3 + 1e-4 * numerical.abs(), "{k} {i}: {numerical} {}", keyframes[k][i]);
            }
            bundle.keyframes[k].state = saved;
        }
        for (index, slope) in planes.into_iter().enumerate() {
            let saved = bundle.planes[index];
            for i in 0..2 {
                let mut cost = |step: f64| {
                    let mut delta = [0.0; 2];
                    delta[i] = step;
                    bundle.planes[index] = saved;
                    bundle.planes[index].retract(delta);
                    bundle.cost()
                };
                let numerical = (cost(step) - cost(-step)) / (2.0 * step);
                assert!((numerical - slope[i]).abs() < 1e-3 + 1e-4 * numerical.abs(), "plane {index} {i}: {numerical} {slope}");
            }
            bundle.planes[index] = saved;
        }
        for (index, slope) in landmarks.into_iter().step_by(9) {
            let saved = bundle.landmarks[index].position_in_world;
            for axis in 0..3 {
                let mut cost = |step: f64| {
                    bundle.landmarks[index].position_in_world[axis] = saved[axis] + step;
                    bundle.cost()
                };
                let numerical = (cost(step) - cost(-step)) / (2.0 * step);
                assert!((numerical - slope[axis]).abs() < 1e-3 + 1e-4 * numerical.abs(), "{index} {axis}: {numerical} {slope}");
                bundle.landmarks[index].position_in_world = saved;
            }
        }
    }
}

#[test]
fn the_model_knows_how_far_the_cost_falls() {
    let mut world = world(Kernel::Quadratic);
    world.disturb(0.002);
    for damping in [0.0, 0.1] {
        let mut bundle = world.bundle().unwrap();
        let normal = bundle.linearize();
        let step = bundle.step(&normal, damping).unwrap().unwrap();
        let before = bundle.cost();
        bundle.take(&step);
        let gain = (before - bundle.cost()) / step.predicted;
        assert!((gain - 1.0).abs() < 0.02, "{damping}: {gain}");
        assert!(damping > 0.0 || bundle.cost() < 0.01 * before);
    }
}

#[test]
fn the_first_position_and_heading_stay_and_the_rest_may_turn_with_the_world() {
    let mut disturbed = world(Kernel::huber(4.0));
    disturbed.disturb(0.3);
    let mut first = disturbed.bundle().unwrap();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
    let moved = Isometry3::from_parts(Vector3::new(3.0, -2.0, 0.5).into(), turn);
    for keyframe in &mut disturbed.keyframes {
        let pose = moved * keyframe.state.pose();
        keyframe.state = NavState {
            world_from_body: pose.rotation,
            position_in_world: pose.translation.vector,
            velocity_in_world: turn * keyframe.state.velocity_in_world,
            ..keyframe.state
        };
    }
    for landmark in &mut disturbed.landmarks {
        landmark.position_in_world = moved * nalgebra::Point3::from(landmark.position_in_world) - nalgebra::Point3::origin();
    }
    for plane in &mut disturbed.planes {
        let on_it = moved * nalgebra::Point3::from(plane.normal_in_world.into_inner() * -plane.offset_m);
        *plane = Plane::through(&on_it.coords, turn * plane.normal_in_world);
    }
    let mut second = disturbed.bundle().unwrap();
    assert!((first.cost() / second.cost() - 1.0).abs() < 1e-9);
    let before = first.keyframes[0].state;
    first.optimize(30, |_| true).unwrap();
    second.optimize(30, |_| true).unwrap();
    let heading = |state: &NavState<f64>| (state.world_from_body * before.world_from_body.inverse()).euler_angles().2;
    assert!((first.keyframes[0].state.position_in_world - before.position_in_world).norm() < 1e-6);
    assert!(heading(&first.keyframes[0].state).abs() < 1e-5, "{}", heading(&first.keyframes[0].state));
    for (a, b) in first.keyframes.iter().zip(&second.keyframes) {
        assert!(((moved * a.state.pose()).translation.vector - b.state.position_in_world).norm() < 1e-5);
    }
}

#[test]
fn a_wrong_corner_is_taken_out_and_comes_back_when_it_fits() {
    let truth = world(Kernel::huber(4.0));
    let mut spoiled = world(Kernel::huber(4.0));
    for landmark in spoiled.landmarks.iter_mut().step_by(5) {
        landmark.views[1].point.x += 0.05;
    }
    let mut bundle = spoiled.bundle().unwrap();
    bundle.optimize(20, |_| true).unwrap();
    bundle.judge();
    bundle.triangulate().unwrap();
    bundle.optimize(20, |_| true).unwrap();
    for landmark in bundle.landmarks().iter().step_by(5).filter(|landmark| landmark.used) {
        assert!(!landmark.views[1].used);
    }
    assert!(farthest(&bundle, &truth).0 < 1e-4, "{:?}", farthest(&bundle, &truth));
}

#[test]
fn what_cannot_be_adjusted_is_said_in_a_sentence() {
    let sound = || world(Kernel::huber(4.0));
    let refused = |spoil: &dyn Fn(&mut World)| {
        let mut world = sound();
        spoil(&mut world);
        world.bundle().unwrap_err()
    };
    assert_eq!(refused(&|world| world.keyframes.clear()), BundleError::TooFewKeyframes(0));
    assert_eq!(refused(&|world| world.keyframes.truncate(1)), BundleError::TooFewKeyframes(1));
    assert!(matches!(refused(&|world| world.keyframes[3].state.velocity_in_world.x = f64::NAN), BundleError::NotFinite(_)));
    assert!(matches!(refused(&|world| world.landmarks[3].views[0].point.y = f64::INFINITY), BundleError::NotFinite(_)));
    assert!(matches!(refused(&|world| world.recording.imu[300].gyro_rad_s.x = f64::NAN), BundleError::NotFinite(_)));
    assert!(matches!(refused(&|world| world.keyframes.swap(3, 4)), BundleError::Order(_)));
    assert!(matches!(refused(&|world| world.recording.imu.truncate(400)), BundleError::MissingImu(..)));
    assert!(matches!(refused(&|world| world.recording.imu.clear()), BundleError::MissingImu(..)));
    assert!(matches!(refused(&|world| world.landmarks[0].views[0].keyframe = 1000), BundleError::Reference(0)));
    assert!(matches!(refused(&|world| world.landmarks[2].plane = Some(2)), BundleError::Reference(2)));
    assert!(matches!(refused(&|world| world.settings.imu_noise = world.settings.imu_noise.scaled(0.0)), BundleError::Noise(_)));
    let mut blind = sound();
    blind.landmarks.clear();
    assert_eq!(blind.bundle().unwrap().triangulate(), Err(BundleError::NoLandmarks));
    let mut wild = sound();
    wild.landmarks[0].position_in_world.x = f64::NAN;
    assert!(matches!(wild.bundle().unwrap().optimize(5, |_| true), Err(BundleError::NotFinite(_))));
    let said = refused(&|world| world.keyframes.truncate(1)).to_string();
    assert_eq!(said, "there are only 1 keyframes");
}

#[test]
fn neighbouring_samples_cover_the_interval_and_no_more() {
    let recording = world(Kernel::Quadratic).recording;
    let start = recording.imu[10].stamp;
    let at = |microseconds: i64| start + Span::from_nanos(microseconds * 1000);
    let spans = |from: Timestamp, to: Timestamp| {
        pairs_between(&recording.imu, from, to).map(|(a, b)| (a.stamp - from, b.stamp - from)).collect::<Vec<_>>()
    };
    let micro = |a: i64, b: i64| (Span::from_nanos(a * 1000), Span::from_nanos(b * 1000));
    assert_eq!(spans(at(0), at(10_000)), [micro(0, 5000), micro(5000, 10_000)]);
    assert_eq!(spans(at(2000), at(11_000)), [micro(0, 3000), micro(3000, 8000), micro(8000, 9000)]);
    assert_eq!(spans(at(1000), at(2000)), [micro(0, 1000)]);
    assert_eq!(spans(at(0), at(0)), []);
}

#[test]
fn a_plane_that_no_landmark_tells_of_stays_and_harms_nothing() {
    let truth = world(Kernel::huber(4.0));
    let mut disturbed = world(Kernel::huber(4.0));
    disturbed.disturb(0.3);
    let far = Plane::through(&Vector3::new(0.0, 90.0, 0.0), Vector3::y_axis());
    disturbed.planes.push(far);
    let mut bundle = disturbed.bundle().unwrap();
    bundle.optimize(40, |_| true).unwrap();
    assert!(farthest(&bundle, &truth).0 < 1e-6);
    assert_eq!(bundle.planes().nth(2), Some(&far));
}
