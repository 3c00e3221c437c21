//! From the record of a flight to its smooth trajectory.
//!
//! Keyframes are the frames that the window kept, the first and the last of the epoch, and what it takes so that no two are more than half a
//! second apart. Corners of the other images are not used. Landmarks are placed by the causal poses; after each solution all corners are
//! judged anew, landmarks that had no place yet are tried again, and it is solved once more.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use libella_core::plane::Plane;
use libella_core::time::Span;
use libella_core::track::TrackId;
use nalgebra::Vector3;
use serde::Serialize;

use super::between::{self, SmoothPose};
use super::bundle::{Bundle, BundleError, BundleSettings, Keyframe, Landmark, LandmarkView};
use super::{Epoch, FlightRecord};
use crate::config::Config;
use crate::dataset::Recording;
use crate::eval::{StampedPose, Trajectory};
use crate::fault::{Fault, FaultKind};

/// Longest time between two keyframes.
const LONGEST_LINK: Span = Span::from_millis(500);
/// Steps of the solver in each round; corners are judged between rounds.
const ROUNDS: [usize; 3] = [10, 10, 20];

/// How far it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Epoch at hand, counted from 0, and their number.
    pub epoch: (usize, usize),
    /// Round at hand, counted from 0, and their number.
    pub round: (usize, usize),
    /// Keyframes and landmarks of the epoch.
    pub size: (usize, usize),
    /// Cost so far.
    pub cost: f64,
}

/// What became of an epoch.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct EpochReport {
    /// From its first to its last image, s.
    pub span_s: f64,
    /// Keyframes.
    pub keyframes: usize,
    /// Landmarks that took part in the last round.
    pub landmarks: usize,
    /// Their corners.
    pub observations: usize,
    /// Non-zeros of the factor of the reduced normal equations.
    pub factor_non_zeros: usize,
    /// Steps of the solver, all rounds together.
    pub iterations: usize,
    /// Robust cost at the beginning of the last round and at its end.
    pub cost: [f64; 2],
    /// Wall time, s.
    pub wall_s: f64,
    /// Why it was left out, where it was.
    pub left_out: Option<String>,
}

/// A smooth trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Smooth {
    /// One pose for every causal pose of the epochs that could be adjusted.
    pub poses: Vec<SmoothPose>,
    /// One per epoch.
    pub epochs: Vec<EpochReport>,
}

impl Smooth {
    /// The poses as a trajectory.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        Trajectory::new(self.poses.iter().map(|pose| StampedPose { stamp: pose.stamp, world_from_body: pose.state.pose() }))
    }
}

/// Adjusts every epoch of a flight, and draws landmarks to `planes`; `None` where `stop` was set before the end. A plane belongs to the world of
/// the newest epoch: with several, planes are left out.
///
/// # Errors
/// When no epoch can be adjusted, with the reason of the first.
pub fn smooth(
    record: &FlightRecord,
    recording: &Recording,
    config: &Config,
    planes: &[Plane<f64>],
    stop: &AtomicBool,
    mut observe: impl FnMut(&Progress),
) -> Result<Option<Smooth>, Fault> {
    let settings = BundleSettings::new(&config.estimator_config::<f64>(&recording.rig.imu_noise), recording.rig.body_from_camera);
    let mut found = Smooth { poses: Vec::new(), epochs: Vec::new() };
    let planes = if record.epochs.len() == 1 { planes } else { &[] };
    for (index, epoch) in record.epochs.iter().enumerate() {
        let mut go_on = |progress: Progress| {
            observe(&Progress { epoch: (index, record.epochs.len()), ..progress });
            !stop.load(Ordering::Relaxed)
        };
        let mut report = EpochReport { span_s: span_s(epoch), ..EpochReport::default() };
        match adjust(epoch, recording, &settings, planes, &mut report, &mut go_on) {
            Ok(poses) => found.poses.extend(poses),
            Err(error) => report.left_out = Some(error.to_string()),
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        found.epochs.push(report);
    }
    if found.poses.is_empty() {
        let reason = found.epochs.into_iter().find_map(|epoch| epoch.left_out).unwrap_or_else(|| "there is no causal trajectory".into());
        let remedy = "the causal trajectory stands; a longer flight with more corners can be smoothed";
        return Err(Fault::new(FaultKind::NoResult, format!("the flight cannot be smoothed: {reason}"), remedy));
    }
    Ok(Some(found))
}

fn span_s(epoch: &Epoch) -> f64 {
    match (epoch.frames.first(), epoch.frames.last()) {
        (Some(first), Some(last)) => (last.known.stamp - first.known.stamp).as_seconds(),
        _ => 0.0,
    }
}

fn adjust(
    epoch: &Epoch,
    recording: &Recording,
    settings: &BundleSettings,
    planes: &[Plane<f64>],
    report: &mut EpochReport,
    go_on: &mut impl FnMut(Progress) -> bool,
) -> Result<Vec<SmoothPose>, BundleError> {
    let begun = Instant::now();
    let (keyframes, landmarks) = problem(epoch);
    let mut bundle = Bundle::new(settings.clone(), keyframes, &recording.imu, landmarks, planes.to_vec())?;
    report.keyframes = bundle.keyframes().len();
    report.factor_non_zeros = bundle.factor_non_zeros();
    for (round, iterations) in ROUNDS.into_iter().enumerate() {
        bundle.judge();
        bundle.triangulate()?;
        bundle.attach_planes();
        (report.landmarks, report.observations) = bundle.counts();
        let size = (report.keyframes, report.landmarks);
        let solved = bundle.optimize(iterations, |cost| go_on(Progress { epoch: (0, 0), round: (round, ROUNDS.len()), size, cost }))?;
        report.iterations += solved.iterations;
        report.cost = [solved.initial_cost, solved.final_cost];
    }
    let stamps = epoch.frames.iter().filter(|frame| frame.causal).map(|frame| frame.known.stamp);
    let poses = between::fill(bundle.keyframes(), stamps, &recording.imu, settings);
    report.wall_s = begun.elapsed().as_secs_f64();
    Ok(poses)
}

/// The keyframes of an epoch, and the tracks through them.
fn problem(epoch: &Epoch) -> (Vec<Keyframe>, Vec<Landmark>) {
    let mut keyframes: Vec<Keyframe> = Vec::new();
    let mut tracks: BTreeMap<TrackId, Vec<LandmarkView>> = BTreeMap::new();
    let last = epoch.frames.len().saturating_sub(1);
    for (index, frame) in epoch.frames.iter().enumerate() {
        let known = &frame.known;
        let due = keyframes.last().is_none_or(|before| known.stamp - before.stamp > LONGEST_LINK);
        if !(known.keyframe || due || index == last) {
            continue;
        }
        for corner in &frame.corners {
            tracks.entry(corner.track).or_default().push(LandmarkView::new(keyframes.len(), corner.point));
        }
        keyframes.push(Keyframe { stamp: known.stamp, state: known.state, at_rest: known.at_rest });
    }
    let several = tracks.into_values().filter(|views| views.len() > 2);
    let landmarks = several.map(|views| Landmark { position_in_world: Vector3::zeros(), used: false, views, plane: None });
    (keyframes, landmarks.collect())
}
