//! One recording through one estimator.

use std::panic::AssertUnwindSafe;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::time::Instant;

use libella_core::depth::Verdict;
use libella_core::estimator::{FrameOutcome, Health, InputError};
use libella_core::image::PyramidPair;
use libella_core::imu::{ImuBias, ImuSample};
use libella_core::profile::Desktop;
use libella_core::real::Real;
use libella_core::time::Timestamp;
use libella_core::track::Observation;
use libella_core::window::DepthSource;
use nalgebra::{Isometry3, SMatrix, Vector3};

use super::depth::{self, DepthResult, DepthTimes, DepthUse, EventsWithDepth, Told};
use super::view::{self, View};
use crate::calibration::Rig;
use crate::config::{Config, Scalar};
use crate::dataset::{Event, Frames, Recording};
use crate::eval::{StampedPose, Trajectory};
use crate::fault::{Fault, FaultKind};
use crate::map::{FlightRecord, Glance, Recorder};
use crate::network::{Alike, DepthMap, DepthNetwork};
use crate::planes::{DepthLook, PlaneFinder, Planes};

/// Room for the pyramids of images up to about 1.5 megapixels; pages that are never touched cost nothing.
const PYRAMID_BYTES: usize = 2 << 20;
/// The estimator is built on the stack of its thread before it moves to the heap.
const STACK_BYTES: usize = 64 << 20;
/// Poses from one whose biases' uncertainty is asked for to the next: it changes slowly and costs an iteration.
const BIAS_SIGMA_EVERY: usize = 10;

/// A causal pose: what the estimator knew when the image had been worked on.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseResult {
    /// Time of the image.
    pub stamp: Timestamp,
    /// Maps body coordinates to world.
    pub world_from_body: Isometry3<f64>,
    /// Velocity in world, m/s.
    pub velocity_in_world: Vector3<f64>,
    /// Bias of the angular rate, rad/s.
    pub gyro_bias_rad_s: Vector3<f64>,
    /// Bias of the specific force, m/s².
    pub accel_bias_m_s2: Vector3<f64>,
    /// Covariance of `[δφ δp]`, rad and m.
    pub pose_covariance: SMatrix<f64, 6, 6>,
    /// Standard deviations of the biases, of every tenth pose.
    pub bias_sigma: Option<ImuBias<f64>>,
}

/// What became of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameResult {
    /// Time of the image.
    pub stamp: Timestamp,
    /// What the estimator made of it; `None` where the image did not reach it.
    pub outcome: Option<FrameOutcome>,
    /// How the estimator was afterwards.
    pub health: Health,
    /// Why the image was left out.
    pub refused: Option<String>,
    /// Landmarks with a depth that the image saw.
    pub tracked: usize,
    /// Time in `push_imu` since the image before, ms.
    pub imu_ms: f64,
    /// Time in `push_image` or `push_tracks`, ms.
    pub track_ms: f64,
    /// Time in `step`, ms.
    pub solve_ms: f64,
    /// The pose, where there is one.
    pub pose: Option<PoseResult>,
    /// Inertial samples refused since the image before, and the first reason.
    pub refused_imu: Refusals,
    /// What became of its depth, where it was to have one.
    pub depth: Option<DepthResult>,
    /// Share of the landmarks seen whose depth prior comes from a map, afterwards; in runs with depth only.
    pub depth_share: Option<f64>,
}

/// Inputs that the estimator did not take.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Refusals {
    /// How many.
    pub count: usize,
    /// Why the first of them.
    pub first: Option<String>,
}

impl Refusals {
    /// Counts one more.
    pub fn add(&mut self, reason: impl FnOnce() -> String) {
        self.count += 1;
        self.first.get_or_insert_with(reason);
    }
}

/// How a run came to its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// All of the recording was used.
    Complete,
    /// The user stopped it.
    Interrupted,
    /// The estimator's thread failed; what it said.
    Failed(String),
}

/// All results of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// One entry per image.
    pub frames: Vec<FrameResult>,
    /// How it ended.
    pub ended: Ended,
    /// The planes and points, where they were sought.
    pub planes: Option<Planes>,
    /// Wall time, s.
    pub wall_s: f64,
    /// What gave depth, where something did.
    pub depth_source: Option<String>,
}

impl Run {
    /// The causal poses in order.
    pub fn poses(&self) -> impl Iterator<Item = &PoseResult> {
        self.frames.iter().filter_map(|frame| frame.pose.as_ref())
    }

    /// The causal poses as a trajectory.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        Trajectory::new(self.poses().map(|pose| StampedPose { stamp: pose.stamp, world_from_body: pose.world_from_body }))
    }
}

/// Runs a recording through the estimator in the scalar of the configuration. `stop` is looked at after every image;
/// `observe` sees every result as it comes.
///
/// # Errors
/// When no thread can be started. Faults of single inputs are in the results instead.
pub fn run(recording: &Recording, config: &Config, stop: &AtomicBool, observe: impl FnMut(&FrameResult)) -> Result<Run, Fault> {
    run_with_depth(recording, config, None, stop, observe)
}

/// [`run`] with a source of depth, which works in a thread of its own ahead of the estimator. The results do not depend on how fast it is.
///
/// # Errors
/// As [`run`], and for a source or a recording that cannot be used for it.
pub fn run_with_depth(
    recording: &Recording,
    config: &Config,
    network: Option<Box<dyn DepthNetwork>>,
    stop: &AtomicBool,
    mut observe: impl FnMut(&FrameResult),
) -> Result<Run, Fault> {
    run_with(recording, config, network, Watch::default(), stop, |frame, _| observe(frame)).map(|(run, _)| run)
}

/// [`run_with_depth`] for somebody who also wants to see what the estimator saw, or to keep what the map needs of the flight: `watch` says
/// what. The record is empty where it is not wanted.
///
/// # Errors
/// As [`run_with_depth`].
pub fn run_with(
    recording: &Recording,
    config: &Config,
    network: Option<Box<dyn DepthNetwork>>,
    watch: Watch,
    stop: &AtomicBool,
    mut observe: impl FnMut(&FrameResult, Option<View>),
) -> Result<(Run, FlightRecord), Fault> {
    let mut recorder = Recorder::default();
    let run = run_to(recording, config, stop, network, watch, |seen| {
        let view = seen.view.take();
        observe(&seen.result, view);
        if let Some(glance) = seen.glance.take() {
            recorder.add(glance);
        }
    })?;
    Ok((run, recorder.finish()))
}

/// [`run`] for somebody who also wants to see what the estimator saw in each image that it took.
///
/// # Errors
/// As [`run`].
pub fn run_watched(
    recording: &Recording,
    config: &Config,
    stop: &AtomicBool,
    observe: impl FnMut(&FrameResult, Option<View>),
) -> Result<Run, Fault> {
    run_with(recording, config, None, Watch { view: true, ..Watch::default() }, stop, observe).map(|(run, _)| run)
}

/// What is wanted of every image beside its result.
#[derive(Debug, Clone, Copy, Default)]
pub struct Watch {
    /// What the estimator saw in it.
    pub view: bool,
    /// What the map needs of it; some 6 KB an image with 200 corners.
    pub record: bool,
}

/// The result of an image with what was wanted beside it.
struct Seen {
    result: FrameResult,
    view: Option<View>,
    glance: Option<Glance>,
}

fn run_to(
    recording: &Recording,
    config: &Config,
    stop: &AtomicBool,
    network: Option<Box<dyn DepthNetwork>>,
    watch: Watch,
    mut observe: impl FnMut(&mut Seen),
) -> Result<Run, Fault> {
    if let Some(network) = &network {
        depth::check(network.as_ref(), !matches!(recording.frames, Frames::Tracks(_)))?;
    }
    let network = network.map(|network| -> Box<dyn DepthNetwork> {
        if config.depth.uncertainty { network } else { Box::new(Alike::new(network, config.depth.sigma_log)) }
    });
    let begun = Instant::now();
    let depth_source = network.as_ref().map(DepthNetwork::describe);
    let (sender, receiver) = channel();
    let mut frames = Vec::with_capacity(recording.frames.len());
    let (ended, planes) = std::thread::scope(|scope| {
        let work = move || match config.scalar {
            Scalar::F64 => work::<f64>(recording, config, stop, network, watch, &sender),
            Scalar::F32 => work::<f32>(recording, config, stop, network, watch, &sender),
        };
        let thread = std::thread::Builder::new()
            .name("estimator".into())
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, move || std::panic::catch_unwind(AssertUnwindSafe(work)))
            .map_err(|error| {
                Fault::new(FaultKind::Output, format!("no thread for the estimator ({error})"), "free memory or raise the limit")
            })?;
        for mut seen in receiver {
            observe(&mut seen);
            frames.push(seen.result);
        }
        match thread.join() {
            Ok(Ok(Ok(finished))) => Ok(finished),
            Ok(Ok(Err(fault))) => Err(fault),
            Ok(Err(payload)) | Err(payload) => Ok((Ended::Failed(said(payload.as_ref())), None)),
        }
    })?;
    Ok(Run { frames, ended, planes, wall_s: begun.elapsed().as_secs_f64(), depth_source })
}

fn said(payload: &(dyn std::any::Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(ToString::to_string).or_else(|| payload.downcast_ref::<String>().cloned());
    text.unwrap_or_else(|| "the estimator stopped without a word".into())
}

/// The estimator with what it borrows and what is being measured about the image at hand.
struct Worker<'a, T: Real> {
    estimator: Box<Desktop<T>>,
    pyramids: Box<PyramidPair<PYRAMID_BYTES>>,
    config: &'a Config,
    rig: &'a Rig,
    finder: Option<PlaneFinder>,
    has_depth: bool,
    /// The map of the image at hand, for the planes and to be shown.
    newest_map: Option<DepthMap>,
    poses: usize,
    imu_ms: f64,
    refused_imu: Refusals,
}

fn work<T: Real>(
    recording: &Recording,
    config: &Config,
    stop: &AtomicBool,
    network: Option<Box<dyn DepthNetwork>>,
    watch: Watch,
    sender: &Sender<Seen>,
) -> Result<(Ended, Option<Planes>), Fault> {
    let rig = &recording.rig;
    let settings = config.estimator_config::<T>(&rig.imu_noise);
    let mut worker = Worker {
        estimator: Box::new(Desktop::<T>::new(settings, rig.camera_as(), rig.body_from_camera_as())),
        pyramids: Box::default(),
        config,
        rig,
        finder: config.planes.finder().map(PlaneFinder::new).transpose()?,
        has_depth: network.is_some(),
        newest_map: None,
        poses: 0,
        imu_ms: 0.0,
        refused_imu: Refusals::default(),
    };
    let ahead = config.dataset.images_ahead;
    for (event, told) in EventsWithDepth::new(recording.events(ahead)?, network, &config.depth, ahead)? {
        let mut pixels = None;
        let result = match event {
            Event::Imu(sample) => {
                worker.take_imu(&sample);
                continue;
            }
            Event::Image { stamp, image: Err(fault) } => worker.leave_out(stamp, fault.to_string()),
            Event::Image { stamp, image: Ok(image) } => match image.view() {
                Ok(view) => {
                    let result = worker.take_frame(stamp, told, |estimator, pyramids| estimator.push_image(stamp, &view, pyramids));
                    pixels = Some(image);
                    result
                }
                Err(error) => worker.leave_out(stamp, error.to_string()),
            },
            Event::Tracks(frame) => {
                let observations: Vec<_> =
                    frame.observations.iter().map(|seen| Observation { track: seen.track, pixel: seen.pixel.map(T::of) }).collect();
                worker.take_frame(frame.stamp, None, |estimator, _| estimator.push_tracks(frame.stamp, &observations))
            }
        };
        let depth = worker.newest_map.take();
        let view = (watch.view && result.outcome.is_some())
            .then(|| View { depth, ..view::of(&worker.estimator, rig, result.stamp, pixels, worker.finder.as_ref()) });
        let glance = result.outcome.filter(|_| watch.record).map(|outcome| view::glance(&worker.estimator, result.stamp, outcome));
        if sender.send(Seen { result, view, glance }).is_err() || stop.load(Ordering::Relaxed) {
            return Ok((Ended::Interrupted, worker.finder.map(PlaneFinder::finish)));
        }
    }
    Ok((Ended::Complete, worker.finder.map(PlaneFinder::finish)))
}

impl<T: Real> Worker<'_, T> {
    fn take_imu(&mut self, sample: &ImuSample<f64>) {
        let sample = ImuSample { stamp: sample.stamp, gyro_rad_s: sample.gyro_rad_s.map(T::of), accel_m_s2: sample.accel_m_s2.map(T::of) };
        let begun = Instant::now();
        let taken = self.estimator.push_imu(sample);
        self.imu_ms += milliseconds_since(begun);
        if let Err(error) = taken {
            self.refused_imu.add(|| error.to_string());
        }
    }

    fn take_frame(
        &mut self,
        stamp: Timestamp,
        told: Option<Told>,
        push: impl FnOnce(&mut Desktop<T>, &mut PyramidPair<PYRAMID_BYTES>) -> Result<(), InputError>,
    ) -> FrameResult {
        let begun = Instant::now();
        let pushed = push(&mut self.estimator, &mut self.pyramids);
        let track_ms = milliseconds_since(begun);
        if let Err(error) = pushed {
            return FrameResult { track_ms, ..self.leave_out(stamp, error.to_string()) };
        }
        let depth = told.map(|told| self.take_depth(stamp, told));
        let begun = Instant::now();
        let outcome = self.estimator.step(self.config.budget());
        let solve_ms = milliseconds_since(begun);
        self.seek_planes(stamp, outcome);
        let did = self.estimator.report().depth.map(|did| DepthUse {
            given: did.given,
            scale: did.scale.as_f64(),
            sigma_log_scale: did.sigma_log_scale.as_f64(),
            verdict: did.verdict,
        });
        let depth = depth.map(|(times, pushed)| DepthResult {
            times,
            used: pushed.and_then(|()| did.ok_or_else(|| "the image was not worked on".into())),
        });
        let depth_share = self.has_depth.then(|| self.depth_share()).flatten();
        let tracked = self.estimator.report().tracked;
        FrameResult {
            outcome: Some(outcome),
            tracked,
            track_ms,
            solve_ms,
            pose: self.pose_at(stamp),
            depth,
            depth_share,
            ..self.blank(stamp)
        }
    }

    /// Hands a map to the estimator; what it did with it, its next step says.
    fn take_depth(&mut self, stamp: Timestamp, told: Told) -> (DepthTimes, Result<(), String>) {
        let begun = Instant::now();
        let pushed = told.map.and_then(|map| {
            let view = map.view().map_err(|error| error.to_string())?;
            let pushed = self.estimator.push_depth(stamp, &view).map_err(|error| error.to_string());
            self.newest_map = Some(map);
            pushed
        });
        (DepthTimes { push_ms: milliseconds_since(begun), ..told.times }, pushed)
    }

    /// Shows the finder of planes what the image taught, with its depth where that was believed.
    fn seek_planes(&mut self, stamp: Timestamp, outcome: FrameOutcome) {
        let Some(finder) = &mut self.finder else { return };
        match outcome {
            FrameOutcome::Tracked | FrameOutcome::NewKeyframe => {
                let believed = self.estimator.report().depth.filter(|did| did.verdict == Verdict::Believed);
                let place = self.estimator.state().filter(|newest| newest.stamp == stamp).map(|newest| view::in_f64(&newest.state).pose());
                let map = self.newest_map.as_ref().and_then(|map| map.view().ok());
                let look = map.zip(place).zip(believed).map(|((map, world_from_body), did)| DepthLook {
                    map,
                    camera: &self.rig.camera,
                    world_from_camera: world_from_body * self.rig.body_from_camera,
                    scale: did.scale.as_f64(),
                });
                finder.look(&mut self.estimator, stamp, look.as_ref());
            }
            FrameOutcome::Initialised | FrameOutcome::Lost => finder.forget(),
            _ => {}
        }
    }

    /// Share of the landmarks that the newest frame sees whose depth prior comes from a map.
    fn depth_share(&self) -> Option<f64> {
        let window = self.estimator.window();
        let newest = window.frames.len().checked_sub(1)?;
        let seen = || window.landmarks.iter().filter(|landmark| landmark.active && landmark.is_seen_in(newest));
        let given = seen().filter(|landmark| landmark.depth_source == DepthSource::Given).count();
        let all = seen().count();
        (all > 0).then(|| given as f64 / all as f64)
    }

    /// The result of an image that the estimator did not take.
    fn leave_out(&mut self, stamp: Timestamp, reason: String) -> FrameResult {
        FrameResult { refused: Some(reason), ..self.blank(stamp) }
    }

    /// A result with what has gathered since the image before.
    fn blank(&mut self, stamp: Timestamp) -> FrameResult {
        FrameResult {
            stamp,
            outcome: None,
            health: self.estimator.health(),
            refused: None,
            tracked: 0,
            imu_ms: std::mem::take(&mut self.imu_ms),
            track_ms: 0.0,
            solve_ms: 0.0,
            pose: None,
            refused_imu: std::mem::take(&mut self.refused_imu),
            depth: None,
            depth_share: None,
        }
    }

    /// The newest state, if it is the one of this image and usable.
    fn pose_at(&mut self, stamp: Timestamp) -> Option<PoseResult> {
        let newest = self.estimator.state().filter(|newest| newest.stamp == stamp)?;
        let state = view::in_f64(&newest.state);
        let bias_sigma = self.poses.is_multiple_of(BIAS_SIGMA_EVERY).then(|| self.estimator.bias_sigmas()).flatten();
        self.poses += 1;
        let vector = |v: &Vector3<T>| v.map(Real::as_f64);
        let pose = PoseResult {
            stamp,
            world_from_body: state.pose(),
            velocity_in_world: state.velocity_in_world,
            gyro_bias_rad_s: state.bias.gyro_rad_s,
            accel_bias_m_s2: state.bias.accel_m_s2,
            pose_covariance: newest.pose_covariance.map(Real::as_f64),
            bias_sigma: bias_sigma.map(|sigma| ImuBias { gyro_rad_s: vector(&sigma.gyro_rad_s), accel_m_s2: vector(&sigma.accel_m_s2) }),
        };
        let finite =
            state.world_from_body.coords.iter().chain(pose.world_from_body.translation.vector.iter()).all(|value| value.is_finite());
        finite.then_some(pose)
    }
}

impl FrameResult {
    /// Time in the estimator for this image, ms.
    #[must_use]
    pub fn core_ms(&self) -> f64 {
        self.imu_ms + self.track_ms + self.solve_ms + self.depth.as_ref().map_or(0.0, |depth| depth.times.push_ms)
    }
}

pub(super) fn milliseconds_since(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}
