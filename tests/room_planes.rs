//! Planes found in whole flights with images, against rooms that are known exactly.
//!
//! By default one short flight with exact depth. All figures of the docs:
//! ```text
//! cargo test --release --test system room_planes:: -- --ignored --nocapture
//! ```
//! Recordings are looked for in `LIBELLA_DATA`; without them the tests say so and pass. `LIBELLA_ROOMS=101,102` flies only these.

use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use crate::support::pictures;
use crate::support::plane_truth::{Candidate, Rectangle, Score, areas_in_view};
use crate::support::recordings::{data, of_another_renderer, root};
use libella_core::camera::Camera;
use libella_core::image::ImageView;
use libella_core::plane::fit::{self, FitConfig};
use libella_core::plane::{Sample, Samples, Source};
use libella_core::robust::ransac::Generator;
use libella_core::time::Timestamp;
use libella_host::config::Config;
use libella_host::dataset::{self, Recording};
use libella_host::eval::evaluate;
use libella_host::network::{DepthKind, DepthMap, DepthNetwork, ModelChoice, NetworkError};
use libella_host::pipeline::{self, Run};
use libella_host::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RealMotionConfig, RenderConfig, RenderedFlight};
use nalgebra::{Isometry3, Point3, Vector3};

/// A wall is in view where so much of it is, m².
const IN_VIEW_M2: f64 = 2.0;
/// And has to be found where it is for so long, s.
const LEAST_S: f64 = 5.0;
/// Raw pixels from one value of an exact map to the next, and what it says of itself: as maps of a recording.
const STEP: usize = 8;
const SIGMA_LOG: f32 = 0.01;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Depth {
    None,
    Exact,
    Indoor,
}

/// What the camera has before it. A map costs more than an image, so those that were made are kept.
struct Exact(Arc<RenderedFlight>, Arc<Mutex<HashMap<Timestamp, DepthMap>>>);

impl DepthNetwork for Exact {
    fn predict(&mut self, stamp: Timestamp, _: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        if let Some(map) = self.1.lock().unwrap().get(&stamp) {
            return Ok(map.clone());
        }
        let flight = &self.0.flight;
        let renderer = self.0.renderer(0).map_err(|error| NetworkError::Failed(error.to_string()))?;
        let exact = renderer.depth(&flight.world_from_camera(stamp, renderer.body_from_camera()), (stamp - flight.epoch).as_seconds());
        let (width, height) = (exact.width / STEP, exact.height / STEP);
        let nothing = vec![0.0; width * height];
        let mut map = DepthMap {
            width,
            height,
            step_px: [STEP as f64; 2],
            origin_px: [0.0; 2],
            inverse_depth_1_m: nothing.clone(),
            sigma_log: nothing.clone(),
            uncertainty: nothing,
            kind: DepthKind::Metric,
        };
        for (index, inverse) in map.inverse_depth_1_m.iter_mut().enumerate() {
            let depth_m = exact.depth_m[(index / map.width * exact.width + index % map.width) * STEP];
            if depth_m > 0.0 {
                *inverse = depth_m.recip() as f32;
                map.sigma_log[index] = SIGMA_LOG;
                map.uncertainty[index] = SIGMA_LOG;
            }
        }
        self.1.lock().unwrap().insert(stamp, map.clone());
        Ok(map)
    }

    fn describe(&self) -> String {
        "exact".into()
    }

    fn kind(&self) -> DepthKind {
        DepthKind::Metric
    }
}

fn run(recording: &Recording, network: Option<Box<dyn DepthNetwork>>, config: &Config) -> Run {
    pipeline::run_with_depth(recording, config, network, &AtomicBool::new(false), |_| ()).unwrap()
}

/// What was found in a room; `poses` are those of the true camera, a fifth of a second apart.
fn score(recording: &Recording, run: &Run, room: &[Rectangle], poses: impl Iterator<Item = Isometry3<f64>>) -> Score {
    let camera = &recording.rig.camera;
    let (width, height) = recording.rig.size_px();
    let is_seen = |x: f64, y: f64| {
        let inside =
            |pixel: nalgebra::Vector2<f64>| (0.0..f64::from(width)).contains(&pixel.x) && (0.0..f64::from(height)).contains(&pixel.y);
        // Farther out the model of the lens folds back.
        x.hypot(y) < 1.2 && camera.project(&Vector3::new(x, y, 1.0)).is_some_and(inside)
    };
    let mut seconds = vec![0.0; room.len()];
    for pose in poses {
        for (seconds, area) in seconds.iter_mut().zip(areas_in_view(room, &pose, &is_seen)) {
            *seconds += if area >= IN_VIEW_M2 { 0.2 } else { 0.0 };
        }
    }
    let evaluation = evaluate(&run.trajectory(), recording.truth.as_ref().unwrap(), &Config::default().evaluation).unwrap();
    let candidates = run.planes.as_ref().unwrap().planes.iter().map(|plane| {
        let stands = plane.gone_into.is_none();
        Candidate::new(&plane.normal_in_world, &plane.polygon_in_world, stands, &evaluation.truth_from_estimate)
    });
    let candidates: Vec<Candidate> = candidates.collect();
    Score::new(room, &seconds, LEAST_S, &candidates)
}

fn text(name: &str, score: &Score) -> String {
    let ((angle, most_deg), (offset, most_m)) = (Score::spread(&score.angles_deg), Score::spread(&score.offsets_m));
    format!(
        "{name:26} floor {:5}  walls {:2} of {:2}  planes there {:2} of {:2}  flips {}  angle {angle:.2}, at most {most_deg:.2} deg  offset {:.1}, at most {:.1} cm",
        score.floor_found,
        score.walls_found,
        score.walls,
        score.planes_true,
        score.planes,
        score.flips,
        100.0 * offset,
        100.0 * most_m
    )
}

/// A rendered room and the flight through it.
struct Flown {
    rendered: Arc<RenderedFlight>,
    recording: Recording,
    room: Vec<Rectangle>,
    maps: Arc<Mutex<HashMap<Timestamp, DepthMap>>>,
}

impl Flown {
    fn new(source: &MotionSource, seed: u64) -> Self {
        let rendered = Arc::new(RenderedFlight::new(source, &RenderConfig::default(), seed, seed).unwrap());
        let (mut recording, _) = pipeline::rendered_recording("room", &rendered);
        // Rendered once, flown five times.
        recording.frames = pictures::frames(&Arc::new(rendered.stream().unwrap().collect()));
        let room = rendered.world.scene.quads.iter().map(|quad| Rectangle::of(&quad.polygon())).collect();
        Self { rendered, recording, room, maps: Arc::default() }
    }

    fn score(&self, depth: Depth, normals: bool) -> Score {
        let network: Option<Box<dyn DepthNetwork>> = match depth {
            Depth::None => None,
            Depth::Exact => Some(Box::new(Exact(Arc::clone(&self.rendered), Arc::clone(&self.maps)))),
            Depth::Indoor => {
                let Ok(choice) = "indoor".parse::<ModelChoice>();
                choice.open(&self.recording.rig.camera, None).unwrap()
            }
        };
        let mut config = match depth {
            Depth::Exact => Config::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("suites/exact_depth_config.toml")).unwrap(),
            Depth::None | Depth::Indoor => Config::default(),
        };
        config.planes.normals = normals;
        let run = run(&self.recording, network, &config);
        let body_from_camera = self.recording.rig.body_from_camera;
        let flight = &self.rendered.flight;
        let poses = flight.frame_stamps.iter().step_by(4).map(|stamp| flight.world_from_camera(*stamp, &body_from_camera));
        score(&self.recording, &run, &self.room, poses)
    }
}

#[test]
fn a_short_flight_with_exact_depth_finds_the_floor_and_nothing_that_is_not_there() {
    let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s: 16.0, ..AnalyticConfig::default() };
    let score = Flown::new(&MotionSource::Analytic(motion, ImuConfig::default()), 7).score(Depth::Exact, true);
    println!("{}\n{:#?}", text("16 s", &score), score.remarks);
    assert!(score.floor_found && score.planes == score.planes_true && score.flips == 0);
}

/// The grid leans: no gravity-aligned plane is there to be found, and none is. Among the corners alone three points find what it is.
#[test]
fn a_real_grid_of_tags_is_a_plane_that_leans() {
    let Some(folder) = data("imu_april") else { return };
    let recording = dataset::open(&folder, &Config::default().dataset).unwrap();
    let run = run(&recording, None, &Config::default());
    let planes = run.planes.as_ref().unwrap();
    // The truth is that of the camera in the grid, whose plane is z = 0.
    let evaluation = evaluate(&run.trajectory(), recording.truth.as_ref().unwrap(), &Config::default().evaluation).unwrap();
    let grid_from_world = &evaluation.truth_from_estimate;
    let normal_in_world = grid_from_world.inverse() * Vector3::z();
    let leaning_deg = normal_in_world.z.asin().to_degrees().abs();
    let config = FitConfig::<f64>::default();
    assert!((config.tilt_tolerance_rad.to_degrees()..45.0).contains(&leaning_deg), "{leaning_deg} deg off a wall");
    assert_eq!(planes.standing().len(), 0, "steady planes that are not there");

    let mut samples = Box::new(Samples::<f64, 4096>::new(&Vector3::z_axis(), config.normal_tolerance_rad));
    for (point_in_world, _) in &planes.points {
        samples.push(&Sample { point_in_world: *point_in_world, normal_in_world: None, source: Source::MapPoint }).unwrap();
    }
    let fit = fit::free(&mut samples, &config, &mut Generator::new(1)).unwrap();
    let off_deg = fit.plane.normal_in_world.dot(&normal_in_world).abs().acos().to_degrees();
    let offset_m = fit.plane.distance_m(&(grid_from_world.inverse() * Point3::new(0.3, 0.3, 0.0)).coords);
    println!("{leaning_deg:.1} deg off a wall; {} of {} corners, {off_deg:.2} deg, {offset_m:.4} m", fit.inliers, planes.points.len());
    assert!(off_deg < 1.0 && offset_m.abs() < 0.02, "{off_deg} deg, {offset_m} m");
    assert!(fit.inliers * 10 > planes.points.len() * 9);
}

/// The room and boxes of another renderer.
fn other_room(folder: &Path) -> Vec<Rectangle> {
    let scene: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(folder.join("scene.json")).unwrap()).unwrap();
    let vector = |value: &serde_json::Value| Vector3::from_iterator(value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()));
    let mut all = Vec::new();
    let boxes = scene["boxes"].as_array().unwrap().iter().map(|block| (block, false));
    for (block, is_inside) in std::iter::once((&scene["room"], true)).chain(boxes) {
        let (low, high) = (vector(&block["min"]), vector(&block["max"]));
        for (axis, is_high) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
            let mut corner = low;
            if is_high {
                corner[axis] = high[axis];
            }
            let side = |k: usize| Vector3::ith(k, high[k] - low[k]);
            let (mut u, mut v) = (side((axis + 1) % 3), side((axis + 2) % 3));
            if is_high == is_inside {
                std::mem::swap(&mut u, &mut v);
            }
            all.push(Rectangle::of(&[corner, corner + u, corner + u + v, corner + v]));
        }
    }
    all
}

#[test]
#[ignore = "minutes"]
fn rooms_of_another_renderer() {
    let mut total = Score::default();
    for sequence in ["V1_01", "V1_02"] {
        let Some((_folder, recording)) = of_another_renderer(sequence) else { return };
        let room = other_room(&root().join("semi_real").join(sequence));
        let truth = recording.truth.as_ref().unwrap();
        let body_from_camera = recording.rig.body_from_camera;
        for depth in ["none", "indoor"] {
            let Ok(choice) = depth.parse::<ModelChoice>();
            let run = run(&recording, choice.open(&recording.rig.camera, None).unwrap(), &Config::default());
            let poses = (0..recording.listed_frames)
                .step_by(4)
                .filter_map(|index| truth.at(recording.frames.stamp(index)?, libella_core::time::Span::from_millis(100)));
            let score = score(&recording, &run, &room, poses.map(|body| body * body_from_camera));
            println!("{}\n    {}", text(&format!("{sequence} {depth}"), &score), score.remarks.join("\n    "));
            total.add(&score);
        }
    }
    println!("{}", text("all", &total));
}

/// Ten rooms that nothing was made for, on recorded motions of a minute.
#[test]
#[ignore = "an hour on two cores"]
fn ten_unseen_rooms() {
    let only = std::env::var("LIBELLA_ROOMS").ok().map(|list| list.split(',').map(|room| room.parse().unwrap()).collect::<Vec<u64>>());
    let sequences = ["V1_01_easy", "V1_02_medium", "V2_01_easy"];
    let ways = [(Depth::None, true), (Depth::Exact, true), (Depth::Exact, false), (Depth::Indoor, true), (Depth::Indoor, false)];
    let mut totals = ways.map(|_| (Score::default(), 0));
    for room in only.unwrap_or_else(|| (101..=110).collect()) {
        let sequence = sequences[room as usize % 3];
        let Some(folder) = data(&format!("euroc_motion/{sequence}")) else { return };
        let source = MotionSource::Recorded(folder, RealMotionConfig { duration_s: 60.0, ..RealMotionConfig::default() });
        let flown = Flown::new(&source, room);
        for ((depth, normals), total) in ways.into_iter().zip(&mut totals) {
            let score = flown.score(depth, normals);
            println!("{}\n    {}", text(&format!("{room} {depth:?} normals {normals}"), &score), score.remarks.join("\n    "));
            total.0.add(&score);
            total.1 += usize::from(score.floor_found);
        }
    }
    for ((depth, normals), (total, floors)) in ways.into_iter().zip(&totals) {
        let (recall, precision) = (total.recall(), total.precision());
        println!(
            "{}  floors {floors} recall {recall:.3} precision {precision:.3}",
            text(&format!("all {depth:?} normals {normals}"), total)
        );
    }
}
