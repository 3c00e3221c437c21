//! What moves, against analysis: depth and normals, blur, and a room that does not know of it.
#![allow(clippy::unwrap_used)]

use nalgebra::{Point3, Vector2, Vector3};

use super::tests::{ideal, looking, still};
use super::*;
use crate::sim::scene::{Material, Mover, Quad, RoomConfig, Scene, Swing};
use crate::sim::trajectory::{Analytic, AnalyticConfig, Motion, MotionKind};
use crate::sim::{AnalyticConfig as Flown, Furnishing, ImuConfig, MotionSource, RenderedFlight, euroc};

/// A wall 4 m ahead and a box of 0.4 × 0.6 × 0.8 m that slides to and fro before it: 0.9 m to either side of (2.5, 0, 0) along the
/// direction (sin 0.5, cos 0.5), at up to 1.8 m/s.
const HALF_M: [f64; 3] = [0.2, 0.3, 0.4];
const REACH_M: f64 = 0.9;
const RATE_RAD_S: f64 = 2.0;
const HEADING_RAD: f64 = std::f64::consts::FRAC_PI_2 - 0.5;

fn street() -> World {
    let wall = Quad::new(Vector3::new(4.0, 6.0, -4.0), -Vector3::y() * 12.0, Vector3::z() * 8.0, Material::Blocks);
    let pivot = Isometry3::new(Vector3::new(2.5, 0.0, 0.0), Vector3::z() * HEADING_RAD);
    let cart = Mover::new(Vector3::from(HALF_M), Material::Cardboard, pivot, Swing::Cart { reach_m: REACH_M }, RATE_RAD_S, 0.3);
    World::bake_with(Scene { quads: vec![wall] }, vec![cart], 1, 2)
}

/// Distance along a ray to the box at a time, and the normal there, by clipping the ray against three slabs.
fn slabs(seconds: f64, eye: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let axes = [
        Vector3::new(HEADING_RAD.cos(), HEADING_RAD.sin(), 0.0),
        Vector3::new(-HEADING_RAD.sin(), HEADING_RAD.cos(), 0.0),
        Vector3::new(0.0, 0.0, 1.0),
    ];
    let center = Vector3::new(2.5, 0.0, 0.0) + axes[0] * (REACH_M * (RATE_RAD_S * seconds + 0.3).sin());
    let (mut enter, mut leave, mut normal) = (0.0, f64::INFINITY, Vector3::zeros());
    for (axis, half) in axes.iter().zip(HALF_M) {
        let (start, speed) = (axis.dot(&(eye - center)), axis.dot(direction));
        let near = (-half * speed.signum() - start) / speed;
        let far = (half * speed.signum() - start) / speed;
        if near > enter {
            (enter, normal) = (near, -axis * speed.signum());
        }
        leave = f64::min(leave, far);
    }
    (enter > 0.0 && enter < leave).then_some((enter, normal))
}

#[test]
fn depth_and_normals_of_a_mover_are_those_of_the_box_at_that_time() {
    let world = street();
    let camera = euroc::camera(0);
    let renderer = Renderer::new(&world, &camera, &Isometry3::identity(), &ideal(), 1).unwrap();
    for (seconds, turn) in [(0.0, [0.0; 3]), (0.7, [0.05, 0.1, 0.4]), (2.45, [-0.1, 0.05, -0.2])] {
        let pose = looking([0.3, 0.1, 0.2], turn);
        let map = renderer.depth(&pose, seconds);
        let normals = map.normals_in_world();
        let (mut moving, mut others) = (0, 0);
        for (pixel, depth) in map.depth_m.iter().enumerate() {
            let place = Vector2::new((pixel % map.width) as f64, (pixel / map.width) as f64);
            let bearing = camera.unproject(&place).unwrap();
            let (eye, direction) = (pose.translation.vector, pose.rotation * bearing);
            let Some((distance, normal)) = slabs(seconds, &eye, &direction) else {
                others += usize::from(world.moves(map.quad[pixel].into()));
                continue;
            };
            if !world.moves(map.quad[pixel].into()) || (normals[pixel].cast() - normal).norm() > 1e-6 {
                others += 1;
                continue;
            }
            assert!((depth / (distance * bearing.z) - 1.0).abs() < 1e-5, "{depth} at {place}");
            moving += 1;
        }
        // Only on the edges f32 may decide differently.
        assert!(moving > 5_000 && others < 20, "{moving} {others}");
    }
}

/// A camera that stays where it is.
struct Tripod(Motion);

impl Trajectory for Tripod {
    fn at(&self, _: f64) -> Motion {
        self.0
    }
    fn duration_s(&self) -> f64 {
        10.0
    }
}

#[test]
fn a_mover_is_blurred_by_its_own_motion() {
    let world = street();
    let pose = looking([0.3, 0.1, 0.2], [0.0; 3]);
    let zero = Vector3::zeros();
    let tripod = Tripod(Motion {
        world_from_body: pose.rotation,
        position_in_world: pose.translation.vector,
        velocity_in_world: zero,
        acceleration_in_world: zero,
        rate_in_body: zero,
    });
    let render = |exposure_s: f64, seconds: f64| {
        let config = RenderConfig { exposure_s, ..ideal() };
        Renderer::new(&world, &euroc::camera(0), &Isometry3::identity(), &config, 1).unwrap().image(&tripod, seconds, 0)
    };
    // 1.8 m/s at 2.2 m for 10 ms: 4 px.
    let (open_s, middle_s) = (0.01, 1.42);
    let long = render(open_s, middle_s);
    let count = 16;
    let mut mean = vec![0.0; long.pixels.len()];
    for k in 0..count {
        let instant = render(0.0, middle_s + open_s * ((f64::from(k) + 0.5) / f64::from(count) - 0.5));
        mean.iter_mut().zip(&instant.pixels).for_each(|(sum, value)| *sum += f64::from(*value) / f64::from(count));
    }
    let sharp = render(0.0, middle_s);
    let difference =
        |image: &GrayImage| -> f64 { image.pixels.iter().zip(&mean).map(|(value, mean)| (f64::from(*value) - mean).powi(2)).sum() };
    let (blurred, unblurred) = (difference(&long), difference(&sharp));
    assert!(blurred < 0.25 * unblurred && unblurred > 1e4, "{blurred} {unblurred}");
    // And sharp where it is in the middle of the exposure, not at its beginning or end.
    let late = render(0.0, middle_s + 0.5 * open_s);
    assert!(difference(&late) > 1.5 * unblurred);
}

#[test]
fn what_stands_still_is_the_same_with_movers_before_it() {
    let path = [Vector3::new(0.0, 0.0, 1.2)];
    let room = RoomConfig { size_m: Vector3::new(6.0, 6.0, 2.8), boxes: 4, ..RoomConfig::vicon(&path) };
    let scene = Scene::room(&room, &path, 9).unwrap();
    let movers = scene.movers(&room, &path, 4, 9).unwrap();
    let (reach_m, center_m) = (Vector3::new(0.3, 0.3, 0.2), path[0]);
    let motion = AnalyticConfig { kind: MotionKind::Medium, rest_s: 0.0, reach_m, center_m, ..AnalyticConfig::default() };
    let motion = Analytic::new(&motion, 2).unwrap();
    let (camera, body_from_camera) = (euroc::camera(0), euroc::body_from_camera(0));
    let config = RenderConfig { threads: 2, ..RenderConfig::default() };
    let (empty, busy) = (World::bake(scene.clone(), 9, 2), World::bake_with(scene, movers, 9, 1));
    let renderers = [&empty, &busy].map(|world| Renderer::new(world, &camera, &body_from_camera, &config, 9).unwrap());
    let (mut seen, mut changed) = (0, 0);
    for (index, seconds) in (0_u32..8).map(|k| (u64::from(k), 0.7 * f64::from(k) + 1.0)) {
        let [alone, crowded] = [&renderers[0], &renderers[1]].map(|renderer| renderer.image(&motion, seconds, index));
        // Whatever a mover covers at the beginning, the middle or the end of the exposure, and two pixels around it.
        let (width, height) = (alone.width, alone.height);
        let mut may_change = vec![false; width * height];
        for time in [-0.5, 0.0, 0.5].map(|part| seconds + part * config.exposure_s) {
            let at = motion.at(time);
            let pose = Isometry3::from_parts(at.position_in_world.into(), at.world_from_body) * body_from_camera;
            let map = renderers[1].depth(&pose, time);
            for pixel in (0..width * height).filter(|pixel| busy.moves(map.quad[*pixel].into())) {
                seen += 1;
                let (x, y) = (pixel % width, pixel / width);
                for y in y.saturating_sub(2)..(y + 3).min(height) {
                    may_change[y * width + x.saturating_sub(2)..y * width + (x + 3).min(width)].fill(true);
                }
            }
        }
        for (pixel, may_change) in may_change.into_iter().enumerate() {
            let differs = alone.pixels[pixel] != crowded.pixels[pixel];
            assert!(may_change || !differs, "pixel {} {} of image {index}", pixel % width, pixel / width);
            changed += usize::from(differs);
        }
    }
    assert!(seen > 3_000 && changed > 1_000, "{seen} {changed}");
}

#[test]
fn movers_are_the_same_on_any_number_of_threads() {
    let flown = Flown { kind: MotionKind::Easy, duration_s: 1.0, rest_s: 0.0, ..Flown::default() };
    let source = MotionSource::Analytic(flown, ImuConfig::default());
    let pictures = [1, 3].map(|threads| {
        let flight = RenderedFlight::furnished(
            &source,
            &RenderConfig { threads, ..RenderConfig::default() },
            2,
            2,
            Furnishing { movers: 6, is_bare: false },
        )
        .unwrap();
        assert_eq!(flight.world.movers.len(), 6);
        let renderer = flight.renderer(0).unwrap();
        [0, 9].map(|index| flight.image(&renderer, index).unwrap())
    });
    assert!(pictures[0] == pictures[1] && pictures[0][0] != pictures[0][1]);
}

#[test]
fn a_mover_out_of_sight_costs_no_pixel_and_one_ahead_is_seen() {
    let world = street();
    let renderer = Renderer::new(&world, &euroc::camera(0), &Isometry3::identity(), &ideal(), 1).unwrap();
    let center = world.movers[0].world_from_mover(1.0).transform_point(&Point3::origin());
    let pose = looking([0.0, center.y, 0.0], [0.0; 3]);
    let moment = |seconds| Moment { seconds, ..still(pose) };
    let images = [0.0, 1.0].map(|seconds| renderer.expose(&[moment(seconds); 4], 1.0, 0));
    assert!(images[0] != images[1]);
    assert!(renderer.depth(&looking([2.5, 0.0, 3.0], [0.0; 3]), 0.0).quad.iter().all(|quad| !world.moves((*quad).into())));
}
