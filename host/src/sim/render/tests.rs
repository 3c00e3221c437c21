//! The renderer against analysis: corners, depths, epipolar lines, blur, and the same bytes on any number of threads.
#![allow(clippy::unwrap_used)]

use nalgebra::{Matrix2, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

use libella_core::image::{ImageView, PyramidPair, pyramid_bytes};
use libella_core::track::detect::{Corner, DetectConfig, detect};

use super::*;
use crate::sim::scene::{Material, Quad, RoomConfig, Scene};
use crate::sim::texture::CHECKERBOARD_SQUARES;
use crate::sim::trajectory::{Analytic, AnalyticConfig, MotionKind};
use crate::sim::{Flight, ImuConfig, euroc};

/// Looks along the world's x from the origin, level, then turned by the given angles (rad) in the camera frame.
pub(super) fn looking(position: [f64; 3], turn: [f64; 3]) -> Isometry3<f64> {
    let forward = Rotation3::from_basis_unchecked(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&forward) * UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]);
    Isometry3::from_parts(Translation3::from(Vector3::from(position)), rotation)
}

/// A wall 3 m ahead with a checkerboard of 1.6 x 1.2 m in front of it.
fn board_world() -> World {
    let wall = Quad::new(Vector3::new(3.0, 4.0, -3.0), -Vector3::y() * 8.0, Vector3::z() * 6.0, Material::Plaster);
    let board = Quad::new(Vector3::new(2.5, 0.8, -0.6), -Vector3::y() * 1.6, Vector3::z() * 1.2, Material::Checkerboard);
    World::bake(Scene { quads: vec![wall, board] }, 1, 2)
}

fn board_corners(world: &World) -> Vec<Vector3<f64>> {
    let board = world.scene.quads[1];
    let [columns, rows] = CHECKERBOARD_SQUARES;
    let place = |k: usize, count: usize, side: f64| (k as f64 + 0.5) / (count as f64 + 1.0) * side;
    (1..rows)
        .flat_map(|j| (1..columns).map(move |i| (i, j)))
        .map(|(i, j)| board.point(place(i, columns, board.size_m[0]), place(j, rows, board.size_m[1])))
        .collect()
}

pub(super) fn ideal() -> RenderConfig {
    RenderConfig { exposure_s: 0.0, photometry: PhotometryConfig::ideal(), threads: 2 }
}

pub(super) fn still(world_from_camera: Isometry3<f64>) -> Moment {
    Moment { seconds: 0.0, world_from_camera }
}

/// The point at which all gradients of a window point along their own edges: Σ g gᵀ (p − q) = 0.
fn refine(image: &GrayImage, start: Vector2<f64>) -> Vector2<f64> {
    let value = |x: i64, y: i64| f64::from(image.pixels[y as usize * image.width + x as usize]);
    let mut corner = start;
    for _ in 0..20 {
        let (cx, cy) = (corner.x.round() as i64, corner.y.round() as i64);
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for y in cy - 5..=cy + 5 {
            for x in cx - 5..=cx + 5 {
                let gradient = Vector2::new(value(x + 1, y) - value(x - 1, y), value(x, y + 1) - value(x, y - 1));
                let place = Vector2::new(x as f64, y as f64);
                let weight = (-(place - corner).norm_squared() / 8.0).exp();
                let product = gradient * gradient.transpose() * weight;
                normal += product;
                right += product * place;
            }
        }
        corner = normal.try_inverse().unwrap() * right;
    }
    corner
}

/// What the project's own corner detector finds, to half a pixel.
fn detected(image: &GrayImage) -> Vec<Vector2<f64>> {
    const BYTES: usize = pyramid_bytes(752, 480, 4);
    let mut pyramids = Box::<PyramidPair<BYTES>>::default();
    pyramids.push(&ImageView::new(&image.pixels, image.width, image.height, image.width).unwrap(), 1).unwrap();
    let config = DetectConfig { cell_px: 16, min_distance_px: 8.0, border_px: 10, min_score: 100.0, min_relative_score: 0.0 };
    let mut found = vec![Corner::default(); 2000];
    let count = detect(&pyramids.current(0).unwrap(), &config, std::iter::empty(), 2000, &mut found);
    found[..count].iter().map(|corner| Vector2::from(corner.pixel).cast()).collect()
}

#[test]
fn detected_corners_are_where_the_camera_model_says() {
    let world = board_world();
    let poses = [
        looking([0.6, 0.0, 0.0], [0.0; 3]),
        looking([0.8, 0.5, 0.2], [0.1, 0.25, -0.3]),
        looking([0.0, -0.9, -0.4], [-0.2, -0.3, 0.7]),
        looking([0.4, 0.1, 0.4], [0.3, 0.1, 1.3]),
    ];
    for side in [0, 1] {
        let camera = euroc::camera(side);
        let renderer = Renderer::new(&world, &camera, &Isometry3::identity(), &ideal(), 1).unwrap();
        let (mut squares, mut count, mut visible, mut sum) = (0.0, 0, 0, Vector2::zeros());
        for pose in poses {
            // Without lamps the board is dim; four times as bright its white has a grey value of 190.
            let image = renderer.expose(&[still(pose); 4], 4.0, 0);
            let corners = detected(&image);
            for corner in board_corners(&world) {
                let expected = camera.project(&pose.inverse_transform_point(&Point3::from(corner)).coords).unwrap();
                if expected.x < 14.0 || expected.y < 14.0 || expected.x > 737.0 || expected.y > 465.0 {
                    continue;
                }
                visible += 1;
                // The detector takes the best pixel of a window of seven: the true corner is nearby, and no other is.
                let Some(start) = corners.iter().find(|found| (*found - expected).norm() < 4.0) else { continue };
                let error = refine(&image, *start) - expected;
                squares += error.norm_squared();
                sum += error;
                count += 1;
            }
        }
        let rms = (squares / f64::from(count)).sqrt();
        let mean = sum / f64::from(count);
        eprintln!("camera {side}: {count} of {visible} corners, {rms:.4} px RMS, mean {:.4} {:.4}", mean.x, mean.y);
        assert!(count > 60 && count * 10 >= visible * 9 && rms < 0.05, "camera {side}: {count} of {visible} corners, {rms} px");
    }
}

#[test]
fn stereo_corners_lie_on_epipolar_lines() {
    let world = board_world();
    let world_from_body = looking([0.6, 0.1, 0.0], [0.1, 0.1, 0.0]) * euroc::body_from_camera(0).inverse();
    let sides = [0, 1].map(|side| {
        let (camera, body_from_camera) = (euroc::camera(side), euroc::body_from_camera(side));
        let renderer = Renderer::new(&world, &camera, &body_from_camera, &ideal(), 1).unwrap();
        let pose = world_from_body * body_from_camera;
        let image = renderer.expose(&[still(pose); 4], 1.0, 0);
        let bearings: Vec<Vector3<f64>> = board_corners(&world)
            .iter()
            .map(|corner| {
                let expected = camera.project(&pose.inverse_transform_point(&Point3::from(*corner)).coords).unwrap();
                camera.unproject(&refine(&image, expected.map(f64::round))).unwrap()
            })
            .collect();
        (pose, bearings)
    });
    let right_from_left = sides[1].0.inverse() * sides[0].0;
    for (left, right) in sides[0].1.iter().zip(&sides[1].1) {
        let normal = right_from_left.translation.vector.cross(&(right_from_left.rotation * left)).normalize();
        // The distance from the epipolar plane, in pixels near the axis.
        assert!(normal.dot(right).abs() * 457.0 < 0.1, "{}", normal.dot(right).abs() * 457.0);
    }
}

/// Baked once for all tests.
fn room_world() -> &'static World {
    static WORLD: std::sync::OnceLock<World> = std::sync::OnceLock::new();
    let path = [Vector3::new(0.0, 0.0, 1.5)];
    WORLD.get_or_init(|| World::bake(Scene::room(&RoomConfig::vicon(&path), &path, 4).unwrap(), 4, 2))
}

#[test]
fn depth_agrees_with_the_intersection_of_ray_and_plane() {
    let world = room_world();
    let camera = euroc::camera(0);
    let renderer = Renderer::new(world, &camera, &Isometry3::identity(), &ideal(), 1).unwrap();
    for turn in [[0.2, 0.0, 0.1], [-0.5, 1.4, 0.0], [-0.3, 2.9, -0.2]] {
        let pose = looking([0.1, -0.3, 1.4], turn);
        let map = renderer.depth(&pose, 0.0);
        let normals = map.normals_in_world();
        let mut others = 0;
        for (pixel, depth) in map.depth_m.iter().enumerate().step_by(7) {
            let place = Vector2::new((pixel % map.width) as f64, (pixel / map.width) as f64);
            let bearing = camera.unproject(&place).unwrap();
            let hit = world.scene.cast(&pose.translation.vector, &(pose.rotation * bearing)).unwrap();
            if hit.quad == usize::from(map.quad[pixel]) {
                let expected = hit.distance * bearing.z;
                assert!((depth / expected - 1.0).abs() < 1e-5, "{depth} {expected} at {place}");
                assert_eq!(normals[pixel], world.scene.quads[hit.quad].normal.cast());
            } else {
                others += 1;
            }
        }
        // f32 may decide differently on the very edge of two faces, nowhere else.
        assert!(others < 10, "{others}");
    }
}

#[test]
fn same_seed_same_bytes_on_any_number_of_threads() {
    // A closet: three bakings take their time.
    let path = [Vector3::new(0.0, 0.0, 1.2)];
    let room = RoomConfig { size_m: Vector3::new(4.0, 4.0, 2.5), boxes: 4, ..RoomConfig::vicon(&path) };
    let reach_m = Vector3::new(0.5, 0.5, 0.2);
    let center_m = Vector3::new(0.0, 0.0, 1.2);
    let motion = AnalyticConfig { reach_m, center_m, ..AnalyticConfig::default() };
    let motion = Analytic::new(&AnalyticConfig { kind: MotionKind::Medium, rest_s: 0.0, ..motion }, 2).unwrap();
    let pictures: Vec<Vec<GrayImage>> = [1, 2, 3]
        .iter()
        .map(|threads| {
            let world = World::bake(Scene::room(&room, &path, 9).unwrap(), 9, *threads);
            let config = RenderConfig { threads: *threads, ..RenderConfig::default() };
            let renderer = Renderer::new(&world, &euroc::camera(0), &euroc::body_from_camera(0), &config, 9).unwrap();
            (0..3_u32).map(|k| renderer.image(&motion, 1.0 + 0.05 * f64::from(k), k.into())).collect()
        })
        .collect();
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2]);
    assert!(pictures[0][0] != pictures[0][1]);
}

#[test]
fn a_long_exposure_is_the_mean_of_short_ones() {
    let world = room_world();
    let motion = Analytic::new(&AnalyticConfig { kind: MotionKind::Difficult, rest_s: 0.0, ..AnalyticConfig::default() }, 6).unwrap();
    let render = |exposure_s: f64, seconds: f64| {
        let config = RenderConfig { exposure_s, ..ideal() };
        let renderer = Renderer::new(world, &euroc::camera(0), &euroc::body_from_camera(0), &config, 1).unwrap();
        renderer.image(&motion, seconds, 0)
    };
    let long = render(0.02, 2.0);
    let mut mean = vec![0.0; long.pixels.len()];
    let count = 32;
    for k in 0..count {
        let instant = render(0.0, 2.0 + 0.02 * ((f64::from(k) + 0.5) / f64::from(count) - 0.5));
        mean.iter_mut().zip(&instant.pixels).for_each(|(sum, value)| *sum += f64::from(*value) / f64::from(count));
    }
    let difference = |image: &GrayImage| {
        let squares: f64 = image.pixels.iter().zip(&mean).map(|(value, mean)| (f64::from(*value) - mean).powi(2)).sum();
        (squares / mean.len() as f64).sqrt()
    };
    let (blurred, sharp) = (difference(&long), difference(&render(0.0, 2.0)));
    assert!(blurred < 0.35 * sharp && sharp > 2.0, "{blurred} {sharp}");
}

#[test]
fn refuses_an_exposure_longer_than_the_interval_of_images() {
    let world = board_world();
    let config = RenderConfig { exposure_s: 0.2, ..RenderConfig::default() };
    let error = Renderer::new(&world, &euroc::camera(0), &Isometry3::identity(), &config, 1).err().unwrap();
    assert_eq!(error.to_string(), "render.exposure_s = 0.2 is outside of the allowed range 0 to 0.03");
}

/// Writes a rendered recording: `ASL=folder MOTION=easy SEED=1 cargo test -p libella-host write_recording -- --ignored`.
#[test]
#[ignore = "writes a recording for the odometry to run on"]
fn write_recording() {
    use crate::sim::{AslOptions, MotionSource, RenderedFlight, write_asl};
    let folder = std::env::var("ASL").unwrap_or("target/rendered".into());
    let seed = std::env::var("SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let source = MotionSource::parse(&std::env::var("MOTION").unwrap_or("easy".into()), 60.0).unwrap();
    let rendered = RenderedFlight::new(&source, &RenderConfig::default(), seed, seed).unwrap();
    write_asl(folder.as_ref(), &rendered, &AslOptions { right_camera: false, depth: false }, &mut |_, _| true).unwrap();
}

/// Writes pictures to look at, and prints the speed: `LOOK=folder cargo test -p libella-host look -- --ignored --nocapture`.
#[test]
#[ignore = "writes pictures for the eye"]
fn look() {
    let folder = std::path::PathBuf::from(std::env::var_os("LOOK").unwrap_or("target/look".into()));
    std::fs::create_dir_all(&folder).unwrap();
    let seed = std::env::var("SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let flight = match std::env::var("MOTION") {
        Ok(path) => Flight::recorded(path.as_ref(), &crate::sim::RealMotionConfig::default(), seed).unwrap(),
        Err(_) => {
            Flight::analytic(&AnalyticConfig { kind: MotionKind::Medium, ..AnalyticConfig::default() }, &ImuConfig::default(), 20.0, seed)
                .unwrap()
        }
    };
    let clock = std::time::Instant::now();
    let world = World::bake(Scene::room(&flight.fitting_room(), &flight.path(), seed).unwrap(), seed, 2);
    eprintln!("baked {} rectangles in {:.2} s", world.scene.quads.len(), clock.elapsed().as_secs_f64());
    let renderer = Renderer::new(&world, &euroc::camera(0), &euroc::body_from_camera(0), &RenderConfig::default(), seed).unwrap();
    let seconds = |k: usize| (flight.frame_stamps[k] - flight.epoch).as_seconds::<f64>();
    for k in 0..9 {
        let at = (k * 2 + 1) * flight.frame_stamps.len() / 18;
        let image = renderer.image(flight.trajectory.as_ref(), seconds(at), at as u64);
        let mut bytes = format!("P5\n{} {}\n255\n", image.width, image.height).into_bytes();
        bytes.extend(&image.pixels);
        std::fs::write(folder.join(format!("s{k}.pgm")), bytes).unwrap();
    }
    // CPU time of this process where the system tells it: the wall clock of a busy machine says little.
    let cpu_s = || {
        let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
        let ticks: f64 = text.split(' ').skip(13).take(2).filter_map(|field| field.parse::<f64>().ok()).sum();
        ticks / 100.0
    };
    let (clock, cpu) = (std::time::Instant::now(), cpu_s());
    let count = 60;
    for k in 0..count {
        std::hint::black_box(renderer.image(flight.trajectory.as_ref(), seconds(200 + k), k as u64));
    }
    let (wall_s, cpu_s) = (clock.elapsed().as_secs_f64(), cpu_s() - cpu);
    eprintln!("{:.1} images/s on the wall clock, {:.1} ms of CPU per image", count as f64 / wall_s, 1e3 * cpu_s / count as f64);
}
