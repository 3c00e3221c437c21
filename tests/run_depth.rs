//! Depth in a whole run: the right map for the right image, the same result however long the network takes, and no harm from one that
//! fails.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use crate::support::pictures;
use libella_core::depth::Verdict;
use libella_core::image::ImageView;
use libella_core::time::Timestamp;
use libella_host::config::Config;
use libella_host::dataset::Recording;
use libella_host::network::{DepthKind, DepthMap, DepthNetwork, NetworkError};
use libella_host::pipeline::{self, Ended, FrameResult, Report, Run};
use libella_host::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight, SimulationConfig, simulate};

/// Every so many images get a depth: 5 of 20 a second.
const EVERY: usize = 4;
/// Raw pixels from one value of a map to the next.
const STEP: usize = 8;

/// A short flight without rest, rendered once for all tests.
struct Short {
    flight: RenderedFlight,
    images: pictures::Stamped,
    /// Of every fourth image.
    maps: Vec<DepthMap>,
}

fn short() -> &'static Short {
    static SHORT: OnceLock<Short> = OnceLock::new();
    SHORT.get_or_init(|| {
        let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s: 4.0, rest_s: 0.0, ..AnalyticConfig::default() };
        let source = MotionSource::Analytic(motion, ImuConfig::default());
        let flight = RenderedFlight::new(&source, &RenderConfig::default(), 2, 2).unwrap();
        let images = Arc::new(Arc::new(flight.clone()).stream().unwrap().collect());
        let maps = flight.flight.frame_stamps.iter().step_by(EVERY).map(|stamp| exact(&flight, *stamp)).collect();
        Short { flight, images, maps }
    })
}

/// What the camera has before it.
fn exact(rendered: &RenderedFlight, stamp: Timestamp) -> DepthMap {
    let (renderer, flight) = (rendered.renderer(0).unwrap(), &rendered.flight);
    let exact = renderer.depth(&flight.world_from_camera(stamp, renderer.body_from_camera()), (stamp - flight.epoch).as_seconds());
    let (width, height) = (exact.width / STEP, exact.height / STEP);
    let values = (0..width * height).map(|index| exact.depth_m[(index / width * exact.width + index % width) * STEP]);
    let inverse: Vec<f32> = values.map(|depth| if depth > 0.0 { depth.recip() as f32 } else { 0.0 }).collect();
    let sigma_log = vec![0.05; inverse.len()];
    DepthMap {
        width,
        height,
        step_px: [STEP as f64; 2],
        origin_px: [0.0; 2],
        inverse_depth_1_m: inverse,
        uncertainty: sigma_log.clone(),
        sigma_log,
        kind: DepthKind::Metric,
    }
}

fn recording() -> Recording {
    let short = short();
    let (recording, _) = pipeline::rendered_recording("short", &Arc::new(short.flight.clone()));
    Recording { frames: pictures::frames(&short.images), ..recording }
}

/// What a source of the tests says, and how long it takes over it.
#[derive(Clone)]
struct Source {
    takes: Duration,
    says: Says,
}

#[derive(Clone, Copy, PartialEq)]
enum Says {
    Truth,
    Nothing,
    NoNumbers,
    UpToScale,
    /// The truth for the image 0.4 s before.
    Late,
}

impl DepthNetwork for Source {
    fn predict(&mut self, stamp: Timestamp, _: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        std::thread::sleep(self.takes);
        if self.says == Says::Nothing {
            return Err(NetworkError::Failed("on purpose".into()));
        }
        let image = short().images.iter().position(|(taken, _)| *taken == stamp).unwrap();
        let map = if self.says == Says::Late { (image / EVERY).saturating_sub(2) } else { image / EVERY };
        let mut map = short().maps[map].clone();
        if self.says == Says::NoNumbers {
            map.inverse_depth_1_m.fill(f32::NAN);
            map.sigma_log.fill(f32::NAN);
            map.uncertainty.fill(f32::NAN);
        }
        Ok(map)
    }

    fn describe(&self) -> String {
        "a source of the tests".into()
    }

    fn kind(&self) -> DepthKind {
        if self.says == Says::UpToScale { DepthKind::UpToScale } else { DepthKind::Metric }
    }
}

fn run(recording: &Recording, source: Option<Source>, config: &Config) -> Run {
    let network = source.map(|source| Box::new(source) as Box<dyn DepthNetwork>);
    let run = pipeline::run_with_depth(recording, config, network, &AtomicBool::new(false), |_| ()).unwrap();
    assert_eq!(run.ended, Ended::Complete);
    run
}

/// What must be the same in two runs: everything but times.
fn timeless(run: &Run) -> Vec<FrameResult> {
    let still = |frame: &FrameResult| {
        let mut frame = FrameResult { imu_ms: 0.0, track_ms: 0.0, solve_ms: 0.0, ..frame.clone() };
        if let Some(depth) = &mut frame.depth {
            depth.times = pipeline::DepthTimes::default();
        }
        frame
    };
    run.frames.iter().map(still).collect()
}

#[test]
fn maps_belong_to_their_images_and_how_long_they_take_changes_nothing() {
    let recording = recording();
    let config = Config::default();
    let source = |milliseconds, says| Source { takes: Duration::from_millis(milliseconds), says };
    let alone = run(&recording, None, &config);
    assert!(alone.frames.iter().all(|frame| frame.depth.is_none() && frame.depth_share.is_none()));
    let quick = run(&recording, Some(source(0, Says::Truth)), &config);
    let slow = run(&recording, Some(source(40, Says::Truth)), &config);
    assert_eq!(timeless(&quick), timeless(&slow));

    // One image in four, from the first on.
    for (index, frame) in quick.frames.iter().enumerate() {
        assert_eq!(frame.depth.is_some(), index % EVERY == 0, "image {index}");
    }
    let depths = || quick.frames.iter().filter_map(|frame| frame.depth.as_ref().map(|depth| depth.used.as_ref().unwrap()));
    assert!(depths().all(|used| used.verdict == Verdict::Believed && used.given > 20));
    // Four seconds of motion tell the scale to some percent.
    assert!(depths().all(|used| (used.scale - 1.0).abs() < 0.05), "{:?}", depths().map(|used| used.scale).collect::<Vec<_>>());
    // What it is for: metric at once.
    let started = |run: &Run| run.frames.iter().position(|frame| frame.pose.is_some()).unwrap_or(run.frames.len());
    println!("first pose at image {} with depth, {} alone", started(&quick), started(&alone));
    assert!(started(&quick) <= 6 && started(&quick) * 3 <= started(&alone), "{} {}", started(&quick), started(&alone));
    let share: Vec<f64> = quick.frames.iter().filter_map(|frame| frame.depth_share).collect();
    assert!(share.iter().sum::<f64>() / share.len() as f64 > 0.3, "{share:?}");

    // Depth of the scene as it was 0.4 s before is found out.
    let late = run(&recording, Some(source(0, Says::Late)), &config);
    let error = |run: &Run| libella_host::eval::evaluate(&run.trajectory(), recording.truth.as_ref().unwrap(), &config.evaluation).unwrap();
    println!(
        "ATE {:.4} m with depth, {:.4} m 0.4 s late, {:.4} m alone",
        error(&quick).ate_rmse_m,
        error(&late).ate_rmse_m,
        error(&alone).ate_rmse_m
    );
    assert!(error(&quick).ate_rmse_m < error(&alone).ate_rmse_m);

    // And the files say so.
    let folder = tempfile::tempdir().unwrap();
    let report = Report::new(&recording, &config, &quick, None);
    pipeline::write_outputs(folder.path(), &quick, &report).unwrap();
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let table = read("depth_scale.csv");
    assert_eq!(table.lines().count(), 1 + quick.frames.len().div_ceil(EVERY));
    assert!(table.lines().nth(1).unwrap().starts_with(&format!("{},", quick.frames[0].stamp.as_nanos())) && table.contains(",believed"));
    let json: serde_json::Value = serde_json::from_str(&read("report.json")).unwrap();
    let depth = &json["depth"];
    assert_eq!(
        (depth["source"].as_str(), depth["believed"].as_u64()),
        (Some("a source of the tests"), Some(quick.frames.len().div_ceil(EVERY) as u64))
    );
    assert!((depth["scale"]["last"].as_f64().unwrap() - 1.0).abs() < 0.05 && depth["network_ms"]["median"].is_f64());
    let report = Report::new(&recording, &config, &alone, None);
    assert!(serde_json::to_value(&report).unwrap().get("depth").is_none());
}

#[test]
fn a_source_that_says_nothing_changes_nothing() {
    let recording = recording();
    let config = Config::default();
    let alone = run(&recording, None, &config);
    let mut every = config.clone();
    every.depth.rate_hz = 1000.0;
    for says in [Says::Nothing, Says::NoNumbers] {
        let source = Source { takes: Duration::ZERO, says };
        // Both rules which images get a depth.
        let config = if says == Says::Nothing { &every } else { &config };
        let with = run(&recording, Some(source), config);
        let poses = |run: &Run| run.frames.iter().map(|frame| frame.pose.clone()).collect::<Vec<_>>();
        assert_eq!(poses(&with), poses(&alone));
        let figures = Report::new(&recording, config, &with, None).depth.unwrap();
        let images = with.frames.len().div_ceil(if says == Says::Nothing { 1 } else { EVERY });
        if says == Says::Nothing {
            assert_eq!((figures.images, figures.failed.count, figures.believed), (images, images, 0));
            assert_eq!(figures.failed.first.unwrap(), "the network failed (on purpose)");
        } else {
            assert_eq!((figures.believed, figures.rejected_unusable), (0, images));
        }
    }
}

#[test]
fn sources_that_a_run_cannot_use_are_refused() {
    let refused = |recording: &Recording, says| {
        let source = Source { takes: Duration::ZERO, says };
        pipeline::run_with_depth(recording, &Config::default(), Some(Box::new(source)), &AtomicBool::new(false), |_| ())
            .unwrap_err()
            .to_string()
    };
    let said = refused(&recording(), Says::UpToScale);
    assert_eq!(
        said,
        "a source of the tests gives depth up to a factor that differs by image, and a run needs metres; give a network whose depth is metric"
    );
    let motion = AnalyticConfig { duration_s: 2.0, rest_s: 0.5, ..AnalyticConfig::default() };
    let corners = SimulationConfig { motion, ..SimulationConfig::default() };
    let said = refused(&pipeline::tracked_recording("corners", simulate(&corners, 1).unwrap()), Says::Truth);
    assert!(said.contains("has no images"), "{said}");
}
