use std::vec::Vec;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::{CameraPose, DepthKnowledge, DepthPrior, Frame, Landmark, NormalizedPoint, Window};
use crate::imu::{ImuBias, NavState, Preintegration};
use crate::real::Real;
use crate::time::Timestamp;
use crate::track::TrackId;

const FRAMES: usize = 6;
const INVERSE_SIGMA: f64 = 400.0;

/// Cameras side by side, looking about along z, turned a little.
fn cameras<T: Real>(count: usize) -> Vec<CameraPose<T>> {
    (0..count)
        .map(|k| {
            let k = k as f64;
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.03 * k, -0.05 * k, 0.1 * k));
            CameraPose {
                world_from_camera: turn.to_rotation_matrix().into_inner().map(T::of),
                center_in_world: Vector3::new(0.2 * k, 0.1 * k * k, 0.05 * k).map(T::of),
            }
        })
        .collect()
}

fn see<T: Real>(camera: &CameraPose<T>, point_in_world: &Vector3<T>) -> NormalizedPoint<T> {
    let point = camera.world_from_camera.transpose() * (point_in_world - camera.center_in_world);
    NormalizedPoint { x: point.x / point.z, y: point.y / point.z, inverse_sigma: T::of(INVERSE_SIGMA) }
}

/// A landmark at `point`, seen exactly by cameras `first..`.
fn landmark<T: Real>(cameras: &[CameraPose<T>], first: usize, point: &Vector3<T>) -> Landmark<T, FRAMES> {
    let mut landmark = Landmark::new(TrackId(1), first, see(&cameras[first], point));
    for (k, camera) in cameras.iter().enumerate().skip(first + 1) {
        landmark.observe(k, see(camera, point));
    }
    landmark
}

/// Sum of squared whitened residuals of all observations, for another bearing and inverse depth.
fn cost(landmark: &Landmark<f64, FRAMES>, cameras: &[CameraPose<f64>], bearing: [f64; 2], inverse_depth: f64) -> f64 {
    let anchor = &cameras[landmark.anchor()];
    let position = anchor.center_in_world + anchor.world_from_camera * Vector3::new(bearing[0], bearing[1], 1.0) / inverse_depth;
    let squared = |(k, point): (usize, &NormalizedPoint<f64>)| {
        let there = see(&cameras[k], &position);
        ((there.x - point.x).powi(2) + (there.y - point.y).powi(2)) * point.inverse_sigma.powi(2)
    };
    landmark.seen().map(squared).sum()
}

fn points() -> impl Strategy<Value = Vector3<f64>> {
    (-1.5..1.5, -1.0..1.5, 3.0..12.0).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

/// Nothing is known beforehand.
const NO_PRIOR: DepthKnowledge<f64> = DepthKnowledge::Usual(DepthPrior { mean: 0.0, inverse_sigma: 0.0 });

proptest! {
    #[test]
    fn triangulation_finds_the_point(point in points(), first in 0usize..3) {
        let cameras = cameras::<f64>(FRAMES);
        let mut found = landmark(&cameras, first, &point);
        found.inverse_depth = found.triangulate(&cameras).unwrap();
        found.active = true;
        let position = found.position_in_world(&cameras).unwrap();
        prop_assert!((position - point).norm() < 1e-9 * point.norm(), "{position} {point}");
    }

    /// The information that refinement reports is the curvature of the cost along the depth, the bearing following.
    #[test]
    fn refinement_knows_how_well_it_knows(point in points()) {
        let cameras = cameras::<f64>(FRAMES);
        let mut found = landmark(&cameras, 0, &point);
        found.inverse_depth = found.triangulate(&cameras).unwrap();
        let information = found.refine(&cameras, &NO_PRIOR).unwrap();
        let least = |inverse_depth: f64| {
            // Quadratic in the bearing, nearly: three Newton steps by differences.
            let mut bearing = found.bearing;
            for _ in 0..3 {
                let h = 1e-4;
                let at = |dx: f64, dy: f64| cost(&found, &cameras, [bearing[0] + dx, bearing[1] + dy], inverse_depth);
                let slope = nalgebra::Vector2::new(at(h, 0.0) - at(-h, 0.0), at(0.0, h) - at(0.0, -h)) / (2.0 * h);
                let cross = (at(h, h) + at(-h, -h) - at(h, -h) - at(-h, h)) / (4.0 * h * h);
                let curve = |forward: f64, back: f64| (forward + back - 2.0 * at(0.0, 0.0)) / (h * h);
                let hessian = nalgebra::Matrix2::new(curve(at(h, 0.0), at(-h, 0.0)), cross, cross, curve(at(0.0, h), at(0.0, -h)));
                let step = hessian.try_inverse().unwrap() * slope;
                bearing = [bearing[0] - step.x, bearing[1] - step.y];
            }
            cost(&found, &cameras, bearing, inverse_depth)
        };
        let step = 0.1 / information.sqrt();
        let at = found.inverse_depth;
        let curvature = 0.5 * (least(at + step) + least(at - step) - 2.0 * least(at)) / (step * step);
        prop_assert!((curvature / information - 1.0).abs() < 0.02, "{curvature} {information}");
    }

    /// Refinement goes down to the least-squares solution, whatever the noise, and never up.
    #[test]
    fn refinement_ends_where_the_cost_is_least(point in points(), seed in 0u64..1000) {
        let cameras = cameras::<f64>(FRAMES);
        let mut normal = crate::imu::testing::Normal(seed);
        let mut found = landmark(&cameras, 0, &point);
        for k in 0..FRAMES {
            let seen = *found.point(k).unwrap();
            let shift = normal.vector(1.0 / INVERSE_SIGMA);
            found.observe(k, NormalizedPoint { x: seen.x + shift.x, y: seen.y + shift.y, ..seen });
        }
        found.bearing = [found.point(0).unwrap().x, found.point(0).unwrap().y];
        let Some(inverse_depth) = found.triangulate(&cameras).filter(|inverse_depth| *inverse_depth > 0.02) else { return Ok(()) };
        found.inverse_depth = inverse_depth;
        found.active = true;
        let mut last = cost(&found, &cameras, found.bearing, found.inverse_depth);
        for _ in 0..10 {
            found.refine(&cameras, &NO_PRIOR);
            let now = cost(&found, &cameras, found.bearing, found.inverse_depth);
            // The cost here is summed in another order.
            prop_assert!(now <= last * (1.0 + 1e-9), "{last} rose to {now}");
            last = now;
        }
        for (axis, step) in [(0, 1e-4), (0, -1e-4), (1, 1e-4), (1, -1e-4), (2, 1e-4), (2, -1e-4)] {
            let (mut bearing, mut depth) = (found.bearing, found.inverse_depth);
            if axis < 2 { bearing[axis] += step } else { depth += step }
            prop_assert!(cost(&found, &cameras, bearing, depth) > last, "lower along {axis}");
        }
    }

    /// Whichever frame leaves, the point stays where it was, and every other observation stays with its frame.
    #[test]
    fn removing_a_frame_leaves_the_point_in_place(point in points(), first in 0usize..3, removed in 0usize..FRAMES) {
        let cameras = cameras::<f64>(FRAMES);
        let mut found = landmark(&cameras, first, &point);
        // Not quite where it is seen, so that the estimate and the observations can be told apart.
        found.inverse_depth = found.triangulate(&cameras).unwrap() * 1.1;
        found.bearing[0] += 0.01;
        found.active = true;
        let before = found.position_in_world(&cameras).unwrap();
        let seen: Vec<_> = (0..FRAMES).map(|k| found.point(k).copied()).collect();
        found.remove_frame(removed, &cameras);
        let mut left = cameras.clone();
        left.remove(removed);
        prop_assert!((found.position_in_world(&left).unwrap() - before).norm() < 1e-9 * before.norm());
        let mut expected = seen;
        expected.remove(removed);
        for (k, point) in expected.iter().enumerate() {
            prop_assert_eq!(found.point(k).copied(), *point);
        }
        prop_assert!(found.point(FRAMES - 1).is_none());
        prop_assert_eq!(found.anchor(), found.seen().next().unwrap().0, "the anchor is the oldest that sees it");
    }

    /// A landmark whose anchor's corner is taken out is where it was, seen from the next frame.
    #[test]
    fn forgetting_the_anchor_moves_it_on(point in points()) {
        let cameras = cameras::<f64>(FRAMES);
        let mut found = landmark(&cameras, 1, &point);
        found.inverse_depth = found.triangulate(&cameras).unwrap() * 1.1;
        found.bearing[0] += 0.01;
        found.active = true;
        let before = found.position_in_world(&cameras).unwrap();
        found.forget(1, &cameras);
        prop_assert_eq!((found.anchor(), found.observations()), (2, FRAMES - 2));
        prop_assert!((found.position_in_world(&cameras).unwrap() - before).norm() < 1e-9 * before.norm());
    }

    /// Observations are a set of frames: what is noted is there, what is forgotten is not.
    #[test]
    fn observations_come_and_go(actions in prop::collection::vec((any::<bool>(), 0usize..FRAMES), 0..40)) {
        let at = |k: usize, turn: usize| NormalizedPoint { x: k as f64, y: turn as f64, inverse_sigma: 1.0 };
        let cameras = cameras::<f64>(FRAMES);
        let mut found = Landmark::<f64, FRAMES>::new(TrackId(7), 0, at(0, 1000));
        let mut expected = [None; FRAMES];
        expected[0] = Some(at(0, 1000));
        for (turn, (note, frame)) in actions.into_iter().enumerate() {
            if note {
                found.observe(frame, at(frame, turn));
                expected[frame] = Some(at(frame, turn));
            } else {
                found.forget(frame, &cameras);
                expected[frame] = None;
            }
        }
        prop_assert_eq!(found.observations(), expected.iter().flatten().count());
        for (k, point) in expected.iter().enumerate() {
            prop_assert_eq!(found.point(k), point.as_ref());
            prop_assert_eq!(found.is_seen_in(k), point.is_some());
        }
        prop_assert!(found.seen().map(|(k, _)| k).eq((0..FRAMES).filter(|k| expected[*k].is_some())));
    }
}

#[test]
fn frames_beyond_the_window_are_ignored() {
    let cameras = cameras::<f64>(FRAMES);
    let mut found = landmark(&cameras, 0, &Vector3::new(0.3, 0.2, 5.0));
    found.observe(FRAMES, NormalizedPoint::default());
    found.observe(40, NormalizedPoint::default());
    found.forget(40, &cameras);
    found.remove_frame(FRAMES, &cameras);
    assert_eq!(found.observations(), FRAMES);
    assert!(!found.is_seen_in(FRAMES) && !found.is_seen_in(31) && !found.is_seen_in(32) && found.point(33).is_none());
}

#[test]
fn no_parallax_gives_no_depth() {
    let mut cameras = cameras::<f64>(FRAMES);
    for camera in &mut cameras {
        camera.center_in_world = Vector3::zeros();
    }
    assert!(landmark(&cameras, 0, &Vector3::new(0.3, 0.2, 5.0)).triangulate(&cameras).is_none());
    let alone = landmark(&cameras[..1], 0, &Vector3::new(0.3, 0.2, 5.0));
    assert!(alone.triangulate(&cameras).is_none());
}

/// A corner that moves the wrong way lies beyond infinity: the depth comes out negative instead of invented.
#[test]
fn points_beyond_infinity_have_a_negative_depth() {
    let cameras = cameras::<f64>(2);
    let mut found = Landmark::<f64, FRAMES>::new(TrackId(1), 0, see(&cameras[0], &Vector3::new(0.0, 0.0, 1e6)));
    let far = see(&cameras[1], &Vector3::new(0.0, 0.0, 1e6));
    let near = see(&cameras[1], &Vector3::new(0.0, 0.0, 10.0));
    found.observe(1, NormalizedPoint { x: 2.0 * far.x - near.x, y: 2.0 * far.y - near.y, ..far });
    assert!(found.triangulate(&cameras).unwrap() < -0.05);
}

#[test]
fn a_landmark_behind_its_new_anchor_loses_its_depth() {
    let mut cameras = cameras::<f64>(3);
    let mut found = landmark(&cameras, 0, &Vector3::new(0.3, 0.2, 5.0));
    (found.inverse_depth, found.active) = (0.2, true);
    cameras[1].world_from_camera = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 3.0, 0.0)).to_rotation_matrix().into_inner();
    let seen = *found.point(1).unwrap();
    found.remove_frame(0, &cameras);
    assert!(!found.active && found.bearing == [seen.x, seen.y] && found.anchor() == 0);
}

fn window(frames: usize) -> Window<f64, FRAMES, 8> {
    let mut window = Window::default();
    for k in 0..frames {
        let frame = Frame::new(Timestamp::from_nanos(k as i64), NavState::origin(), Preintegration::new(ImuBias::default()));
        assert!(window.frames.push(frame).is_ok());
    }
    window
}

#[test]
fn the_newest_frame_sees_and_a_full_table_refuses() {
    let mut window = window(2);
    let at = |x: f64| NormalizedPoint { x, y: 0.0, inverse_sigma: 1.0 };
    for k in 0..20 {
        assert_eq!(window.observe(TrackId(k), at(f64::from(k))), None);
    }
    assert_eq!(window.landmarks.len(), 8);
    let frame = Frame::new(Timestamp::from_nanos(9), NavState::origin(), Preintegration::new(ImuBias::default()));
    assert!(window.frames.push(frame).is_ok());
    assert_eq!(window.observe(TrackId(3), at(30.0)), Some(at(3.0)), "where the frame before saw it");
    assert_eq!(window.landmarks[3].seen().map(|(k, point)| (k, point.x)).collect::<Vec<_>>(), [(1, 3.0), (2, 30.0)]);
    // Seen by no other frame, a landmark goes with its frame.
    window.remove_frame(1, &cameras(3));
    assert_eq!(window.landmarks.iter().map(|landmark| landmark.track.0).collect::<Vec<_>>(), [3]);
    assert_eq!(self::window(0).observe(TrackId(1), at(0.0)), None);
}

/// Parallax is what rotation does not explain: nothing for a camera that only turns, the disparity for one that only moves.
#[test]
fn parallax_is_what_rotation_does_not_explain() {
    let turned = UnitQuaternion::from_scaled_axis(Vector3::new(0.05, -0.1, 0.3)).to_rotation_matrix().into_inner();
    let still = CameraPose::<f64>::default();
    let places: Vec<_> = (0..6).map(|k| Vector3::new(0.2 * f64::from(k) - 0.5, 0.1, 4.0)).collect();
    for (camera, expected) in [
        (CameraPose { world_from_camera: turned, ..still }, 0.0),
        (CameraPose { center_in_world: Vector3::new(0.3, 0.4, 0.0), ..still }, 0.5 / 4.0),
        (
            CameraPose {
                world_from_camera: UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, 0.7)).to_rotation_matrix().into_inner(),
                center_in_world: Vector3::new(0.3, 0.4, 0.0),
            },
            0.5 / 4.0,
        ),
    ] {
        let mut window = window(1);
        for (k, place) in places.iter().enumerate().take(4) {
            window.observe(TrackId(k as u32), see(&still, place));
        }
        let frame = Frame::new(Timestamp::from_nanos(9), NavState::origin(), Preintegration::new(ImuBias::default()));
        assert!(window.frames.push(frame).is_ok());
        for (k, place) in places.iter().enumerate().skip(1) {
            window.observe(TrackId(k as u32), see(&camera, place));
        }
        let found = window.covisibility(0, 1, &[still, camera]);
        assert_eq!((found.shared, found.later), (3, 5));
        assert!((found.parallax - expected).abs() < 1e-12, "{} where {expected} is due", found.parallax);
        assert_eq!(window.covisibility(0, 7, &[still, camera]).shared, 0);
    }
}

#[test]
fn camera_poses_are_those_of_the_body_and_the_mount() {
    let state = crate::imu::testing::Motion::lively().state(0.4);
    let mount = Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.5, 1.0, -0.2));
    let found = CameraPose::of(&state, &mount);
    let expected = state.pose() * mount;
    assert!((found.center_in_world - expected.translation.vector).norm() < 1e-12);
    assert!((found.world_from_camera - expected.rotation.to_rotation_matrix().matrix()).norm() < 1e-12);
    let point = nalgebra::Point3::new(1.0, 2.0, 5.0);
    let other = CameraPose::of(&crate::imu::testing::Motion::lively().state(0.9), &mount);
    let (rotation, translation) = CameraPose::target_from_anchor(&other, &found);
    let there = other.world_from_camera.transpose() * ((expected * point).coords - other.center_in_world);
    assert!((rotation * point.coords + translation - there).norm() < 1e-12);
}

#[test]
fn the_last_keyframe_before_a_frame() {
    let mut window = window(5);
    assert_eq!(window.last_keyframe(4), None);
    for k in [0, 2, 4] {
        window.frames[k].keyframe = true;
    }
    assert_eq!([0, 1, 2, 3, 4, 5].map(|before| window.last_keyframe(before)), [None, Some(0), Some(0), Some(2), Some(2), Some(4)]);
}

#[test]
fn the_origin_follows_the_body_and_nothing_moves() {
    let mut window = Window::<f32, FRAMES, 8>::default();
    for k in 0..4 {
        let mut state = NavState::origin();
        state.position_in_world = Vector3::new(7.3 + 0.1 * k as f32, -0.4, 3.6);
        let mut frame = Frame::new(Timestamp::from_nanos(k), state, Preintegration::new(ImuBias::default()));
        frame.linearization = (k < 2).then_some(state);
        assert!(window.frames.push(frame).is_ok());
    }
    let states = |window: &Window<f32, FRAMES, 8>| window.frames.iter().map(|frame| window.in_world(&frame.state)).collect::<Vec<_>>();
    let before = states(&window);
    window.follow();
    assert_eq!(window.origin_in_world, Vector3::new(8.0, 0.0, 4.0));
    assert!(window.frames.iter().all(|frame| frame.state.position_in_world.amax() < 1.0));
    assert!(window.frames.iter().all(|frame| frame.linearization.is_none_or(|first| first == frame.state)));
    assert_eq!(states(&window), before);
    // Near enough: it stays.
    window.frames[3].state.position_in_world.x = 1.4;
    window.follow();
    assert_eq!(window.origin_in_world, Vector3::new(8.0, 0.0, 4.0));
    window.clear();
    assert_eq!(window.origin_in_world, Vector3::zeros());
}
