//! The files a run leaves behind: `trajectory.tum`, `trajectory.csv`, `report.json`; with depth also `depth_scale.csv`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use libella_core::depth::Verdict;
use libella_core::estimator::FrameOutcome;
use libella_core::time::{Span, Timestamp};
use serde::Serialize;

use super::{DepthResult, DepthUse, Ended, PoseResult, Refusals, Run, rss_peak_mb};
use crate::config::{Config, Scalar};
use crate::dataset::{Layout, Recording, Remark};
use crate::eval::{Evaluation, Matched, PoseWithCovariance, RelativeError, Statistics, Trajectory, evaluate, pose_nees_of_each};
use crate::fault::{Fault, FaultKind};
use crate::map::{EpochReport, Smooth};
use crate::planes::{Planes, name_of as name_of_class};

/// A time per image in a few numbers, ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Timing {
    /// Median, ms.
    pub median: f64,
    /// 95th percentile, ms.
    pub p95: f64,
    /// Largest, ms.
    pub max: f64,
}

impl Timing {
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let found = Statistics::of(&values.collect::<Vec<_>>())?;
        Some(Self { median: found.median, p95: found.p95, max: found.max })
    }
}

/// Time in the estimator per image and where it went.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoreTiming {
    /// Sum of the stages.
    #[serde(flatten)]
    pub total: Timing,
    /// Time of each stage: `imu`, `track`, `solve`; `depth` for images that have one.
    pub stages: BTreeMap<&'static str, Timing>,
}

/// Normalised estimation error squared of the pose; 6 for a consistent estimator.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Mean over the poses.
    pub mean: f64,
    /// Median over the poses.
    pub median: f64,
    /// Number of poses.
    pub poses: usize,
}

/// Inputs that did not reach the estimator, or that it refused.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Number of inputs.
    pub count: usize,
    /// The first reason.
    pub first: Option<String>,
}

/// What gave depth and what became of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DepthFigures {
    /// The network or the stored maps.
    pub source: String,
    /// Images that were to have a map.
    pub images: usize,
    /// Time that the network took, ms.
    pub network_ms: Option<Timing>,
    /// Time that the estimator waited for it, ms.
    pub wait_ms: Option<Timing>,
    /// Maps that were used.
    pub believed: usize,
    /// Maps that were rejected because their scale is not the one known so far.
    pub rejected_other_scale: usize,
    /// Maps that were rejected because they explain the depths that motion tells no better than one constant would.
    pub rejected_no_depth: usize,
    /// Maps that were rejected because they gave no landmark a depth: no usable number where the corners are.
    pub rejected_unusable: usize,
    /// Images without a map, or whose map could not be read.
    pub failed: LeftOut,
    /// Factor from the source's depths to metric ones.
    pub scale: Option<ScaleFigures>,
    /// Mean over the images of the share of landmarks seen whose depth prior comes from a map.
    pub observation_share: Option<f64>,
}

/// A factor over time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ScaleFigures {
    /// After the first map.
    pub first: f64,
    /// After the last.
    pub last: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl DepthFigures {
    /// The figures of a run; `None` where nothing gave depth.
    #[must_use]
    pub fn of(run: &Run) -> Option<Self> {
        let source = run.depth_source.clone()?;
        let results = || run.frames.iter().filter_map(|frame| frame.depth.as_ref());
        let used = || results().filter_map(|depth| depth.used.as_ref().ok());
        let with = |verdict| used().filter(|used| used.verdict == verdict).count();
        let mut failed = Refusals::default();
        for reason in results().filter_map(|depth| depth.used.as_ref().err()) {
            failed.add(|| reason.clone());
        }
        let scales = || used().map(|used| used.scale);
        let shares: Vec<f64> = run.frames.iter().filter_map(|frame| frame.depth_share).collect();
        Some(Self {
            source,
            images: results().count(),
            network_ms: Timing::of(results().map(|depth| depth.times.network_ms)),
            wait_ms: Timing::of(results().map(|depth| depth.times.wait_ms)),
            believed: used().filter(|used| used.verdict == Verdict::Believed && used.given > 0).count(),
            rejected_other_scale: with(Verdict::OtherScale),
            rejected_no_depth: with(Verdict::NoDepth),
            rejected_unusable: used().filter(|used| used.verdict == Verdict::Believed && used.given == 0).count(),
            failed: failed.into(),
            scale: scales().next().zip(scales().next_back()).map(|(first, last)| ScaleFigures {
                first,
                last,
                min: scales().fold(first, f64::min),
                max: scales().fold(first, f64::max),
            }),
            observation_share: Statistics::of(&shares).map(|found| found.mean),
        })
    }
}

impl From<Refusals> for LeftOut {
    fn from(refusals: Refusals) -> Self {
        Self { count: refusals.count, first: refusals.first }
    }
}

/// Planes that stood at the end.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanesReport {
    /// How many of each class.
    pub by_class: BTreeMap<&'static str, usize>,
    /// Planes that became part of another or were given up.
    pub gone: usize,
    /// Points of the map.
    pub points: usize,
    /// Mean share of the landmarks that were drawn to a plane, where planes were used.
    pub share_on_planes: Option<f64>,
}

impl From<&Planes> for PlanesReport {
    fn from(planes: &Planes) -> Self {
        let mut by_class = BTreeMap::new();
        for plane in planes.planes.iter().filter(|plane| plane.gone_into.is_none()) {
            *by_class.entry(name_of_class(plane.class)).or_default() += 1;
        }
        let gone = planes.planes.iter().filter(|plane| plane.gone_into.is_some()).count();
        Self { by_class, gone, points: planes.points.len(), share_on_planes: planes.share_on_planes }
    }
}

/// `report.json`. The names of the fields are an interface: they stay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Version of the program.
    pub libella: &'static str,
    /// Name of the recording.
    pub dataset: String,
    /// How it was laid out.
    pub layout: Layout,
    /// `complete`, `interrupted`, or what the estimator said when it failed.
    pub ended: String,
    /// The configuration used.
    pub configuration: Config,
    /// Seed of everything random.
    pub seed: u64,
    /// Number type of the estimator.
    pub scalar: Scalar,
    /// Images in the recording.
    pub frames: usize,
    /// Causal poses.
    pub poses: usize,
    /// `poses / frames`.
    pub coverage: f64,
    /// From the first image to the first pose, s.
    pub initialised_after_s: Option<f64>,
    /// From the first image until the scale of every stretch of 2 s is right within 10 %, s: where there is a truth.
    pub metric_after_s: Option<f64>,
    /// Position error after alignment by a rigid transform, RMSE over the causal poses, m.
    pub ate_rmse_m: Option<f64>,
    /// How far the scale is from the truth's, percent.
    pub scale_error_percent: Option<f64>,
    /// Relative pose errors.
    pub rpe: Vec<RelativeError>,
    /// More on the position error, m.
    pub ate_m: Option<Statistics>,
    /// Length of the true path over the poses, m.
    pub path_length_m: Option<f64>,
    /// Consistency of the pose covariance.
    pub pose_nees: Option<Consistency>,
    /// Time in the estimator per image, ms.
    pub core_ms: Option<CoreTiming>,
    /// Images used per second of wall time.
    pub images_per_s: f64,
    /// Wall time of the run, s.
    pub wall_s: f64,
    /// Largest resident memory of the process, MB.
    pub rss_peak_mb: Option<f64>,
    /// Planes, where they were sought.
    pub planes: Option<PlanesReport>,
    /// How often each outcome of a frame occurred.
    pub outcomes: BTreeMap<String, usize>,
    /// Images that were left out.
    pub images_left_out: LeftOut,
    /// Inertial samples that were refused.
    pub imu_left_out: LeftOut,
    /// What gave depth and what became of it, where something did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthFigures>,
    /// What is odd about the recording.
    pub remarks: Vec<Remark>,
    /// The smooth trajectory, where one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smooth: Option<SmoothReport>,
}

/// Figures of the smooth trajectory.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SmoothReport {
    /// Position error after alignment by a rigid transform, RMSE, m.
    pub ate_rmse_m: Option<f64>,
    /// How far the scale is from the truth's, percent.
    pub scale_error_percent: Option<f64>,
    /// Poses.
    pub poses: usize,
    /// What each epoch was made of.
    pub epochs: Vec<EpochReport>,
}

impl SmoothReport {
    /// Gathers the figures.
    #[must_use]
    pub fn new(smooth: &Smooth, evaluation: Option<&Evaluation>) -> Self {
        Self {
            ate_rmse_m: evaluation.map(|found| found.ate_rmse_m),
            scale_error_percent: evaluation.map(|found| found.scale_error_percent),
            poses: smooth.poses.len(),
            epochs: smooth.epochs.clone(),
        }
    }
}

impl Report {
    /// Gathers all figures of a run.
    #[must_use]
    pub fn new(recording: &Recording, config: &Config, run: &Run, evaluation: Option<&Evaluation>) -> Self {
        let poses = run.poses().count();
        let first = |stamp: Timestamp| run.poses().next().map(|pose| (pose.stamp - stamp).as_seconds::<f64>());
        let mut outcomes = BTreeMap::new();
        for outcome in run.frames.iter().filter_map(|frame| frame.outcome) {
            *outcomes.entry(name_of(outcome)).or_default() += 1;
        }
        let (mut images, mut samples) = (Refusals::default(), Refusals::default());
        for frame in &run.frames {
            if let Some(reason) = &frame.refused {
                images.add(|| reason.clone());
            }
            samples.count += frame.refused_imu.count;
            samples.first = samples.first.take().or_else(|| frame.refused_imu.first.clone());
        }
        Self {
            libella: env!("CARGO_PKG_VERSION"),
            dataset: recording.name.clone(),
            layout: recording.layout,
            ended: match &run.ended {
                Ended::Complete => "complete".into(),
                Ended::Interrupted => "interrupted".into(),
                Ended::Failed(said) => format!("failed: {said}"),
            },
            configuration: config.clone(),
            seed: config.seed,
            scalar: config.scalar,
            frames: recording.listed_frames,
            poses,
            coverage: poses as f64 / recording.listed_frames.max(1) as f64,
            initialised_after_s: recording.frames.stamp(0).and_then(first),
            metric_after_s: evaluation.and_then(|found| {
                let metric = Timestamp::from_nanos(found.metric_from_ns?);
                Some((metric - recording.frames.stamp(0)?).as_seconds())
            }),
            ate_rmse_m: evaluation.map(|found| found.ate_rmse_m),
            scale_error_percent: evaluation.map(|found| found.scale_error_percent),
            rpe: evaluation.map(|found| found.rpe.clone()).unwrap_or_default(),
            ate_m: evaluation.map(|found| found.ate_m),
            path_length_m: evaluation.map(|found| found.path_length_m),
            pose_nees: consistency(recording, config, run),
            core_ms: core_timing(run),
            images_per_s: run.frames.len() as f64 / run.wall_s.max(1e-9),
            wall_s: run.wall_s,
            rss_peak_mb: rss_peak_mb(),
            planes: run.planes.as_ref().map(PlanesReport::from),
            outcomes,
            images_left_out: images.into(),
            imu_left_out: samples.into(),
            depth: DepthFigures::of(run),
            remarks: recording.remarks.clone(),
            smooth: None,
        }
    }
}

/// The variant in snake case, without what it carries.
fn name_of(outcome: FrameOutcome) -> String {
    let whole = format!("{outcome:?}");
    let mut name = String::new();
    for letter in whole.chars() {
        if letter.is_uppercase() && !name.is_empty() && !name.ends_with('(') {
            name.push('_');
        }
        name.extend(letter.to_lowercase());
    }
    name.replace(['(', ')'], " ").trim().to_owned()
}

fn core_timing(run: &Run) -> Option<CoreTiming> {
    let frames = || run.frames.iter().filter(|frame| frame.outcome.is_some());
    let mut stages: BTreeMap<_, _> = [
        ("imu", Timing::of(frames().map(|frame| frame.imu_ms))?),
        ("track", Timing::of(frames().map(|frame| frame.track_ms))?),
        ("solve", Timing::of(frames().map(|frame| frame.solve_ms))?),
    ]
    .into();
    let depth = Timing::of(frames().filter_map(|frame| frame.depth.as_ref()).map(|depth| depth.times.push_ms));
    stages.extend(depth.map(|depth| ("depth", depth)));
    Some(CoreTiming { total: Timing::of(frames().map(|frame| frame.core_ms()))?, stages })
}

fn consistency(recording: &Recording, config: &Config, run: &Run) -> Option<Consistency> {
    let values: Vec<f64> = nees_over_time(recording, config, run)?.into_iter().map(|(_, value)| value).collect();
    let found = Statistics::of(&values)?;
    Some(Consistency { mean: found.mean, median: found.median, poses: values.len() })
}

/// Normalised estimation error squared of the poses that have a truth; nothing where the truth has no vertical in common.
pub(crate) fn nees_over_time(recording: &Recording, config: &Config, run: &Run) -> Option<Vec<(Timestamp, f64)>> {
    // Without a vertical in common the first pose cannot be laid onto the truth.
    let truth = recording.truth.as_ref().filter(|_| recording.truth_is_level)?;
    #[allow(clippy::cast_possible_truncation)]
    let max_gap = Span::from_nanos((config.evaluation.max_truth_gap_s * 1e9) as i64);
    let poses: Vec<_> = run
        .poses()
        .filter_map(|pose| {
            let truth = truth.at(pose.stamp, max_gap)?;
            let matched = Matched { stamp: pose.stamp, estimate: pose.world_from_body, truth };
            Some(PoseWithCovariance { matched, covariance: pose.pose_covariance })
        })
        .collect();
    let stamped = pose_nees_of_each(&poses).into_iter().zip(&poses);
    Some(stamped.filter_map(|(value, pose)| Some((pose.matched.stamp, value?))).collect())
}

/// A trajectory against the truth of its recording; `None` where there is none, or they share no time.
#[must_use]
pub fn evaluated(estimate: &Trajectory, recording: &Recording, config: &Config) -> Option<Evaluation> {
    evaluate(estimate, recording.truth.as_ref()?, &config.evaluation).ok()
}

/// Makes the folder of the results, and finds out before a run whether it can be written to.
///
/// # Errors
/// When it cannot be made or written to.
pub fn prepare_outputs(folder: &Path) -> Result<(), Fault> {
    std::fs::create_dir_all(folder).map_err(|error| Fault::unwritable(folder, &error))?;
    write(&folder.join("report.json"), "{}\n")
}

/// Writes `trajectory.tum`, `trajectory.csv`, `trajectory.kitti`, `report.json` and, in a run with depth, `depth_scale.csv` into a folder, which is made if
/// it is not there.
///
/// # Errors
/// When the folder or a file cannot be written.
pub fn write_outputs(folder: &Path, run: &Run, report: &Report) -> Result<(), Fault> {
    std::fs::create_dir_all(folder).map_err(|error| Fault::unwritable(folder, &error))?;
    write(&folder.join("trajectory.tum"), &tum(run.poses()))?;
    write(&folder.join("trajectory.csv"), &euroc(run.poses()))?;
    write(&folder.join("trajectory.kitti"), &kitti(run.poses()))?;
    if run.depth_source.is_some() {
        write(&folder.join("depth_scale.csv"), &depth_scale(run))?;
    }
    write_report(folder, report)
}

/// Writes `report.json` into a folder that is there.
///
/// # Errors
/// When it cannot be written.
pub fn write_report(folder: &Path, report: &Report) -> Result<(), Fault> {
    let json = serde_json::to_string_pretty(report)
        .map_err(|error| Fault::new(FaultKind::Output, format!("the report cannot be written ({error})"), "report this as an error"))?;
    write(&folder.join("report.json"), &(json + "\n"))
}

/// Writes `trajectory_smooth.tum` and `trajectory_smooth.csv` into a folder that is there.
///
/// # Errors
/// When a file cannot be written.
pub fn write_smooth(folder: &Path, smooth: &Smooth) -> Result<(), Fault> {
    let poses: Vec<_> = smooth
        .poses
        .iter()
        .map(|pose| PoseResult {
            stamp: pose.stamp,
            world_from_body: pose.state.pose(),
            velocity_in_world: pose.state.velocity_in_world,
            gyro_bias_rad_s: pose.state.bias.gyro_rad_s,
            accel_bias_m_s2: pose.state.bias.accel_m_s2,
            // Neither format has a place for it.
            pose_covariance: nalgebra::SMatrix::zeros(),
            bias_sigma: None,
        })
        .collect();
    write(&folder.join("trajectory_smooth.tum"), &tum(poses.iter()))?;
    write(&folder.join("trajectory_smooth.csv"), &euroc(poses.iter()))
}

pub(super) fn write(path: &Path, text: &str) -> Result<(), Fault> {
    std::fs::write(path, text).map_err(|error| Fault::unwritable(path, &error))
}

fn tum<'a>(poses: impl Iterator<Item = &'a PoseResult>) -> String {
    let mut text = String::from("# timestamp[s] tx ty tz qx qy qz qw\n");
    for pose in poses {
        let nanos = pose.stamp.as_nanos();
        let (p, q) = (&pose.world_from_body.translation.vector, pose.world_from_body.rotation.quaternion());
        let (seconds, rest) = (nanos.div_euclid(1_000_000_000), nanos.rem_euclid(1_000_000_000));
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{seconds}.{rest:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}", p.x, p.y, p.z, q.i, q.j, q.k, q.w);
    }
    text
}

/// The upper three rows of `world_from_body`, row by row. KITTI's poses have no time and no comments.
fn kitti<'a>(poses: impl Iterator<Item = &'a PoseResult>) -> String {
    let mut text = String::new();
    for pose in poses {
        let matrix = pose.world_from_body.to_homogeneous();
        let upper = matrix.fixed_rows::<3>(0).transpose();
        let values: Vec<String> = upper.iter().map(|value| format!("{value:.9}")).collect();
        let _ = writeln!(text, "{}", values.join(" "));
    }
    text
}

/// One row an image that was to have a map. Nothing in it hangs on how long anything took.
fn depth_scale(run: &Run) -> String {
    let mut text = String::from("#timestamp [ns], scale [], sigma_log_scale [], landmarks_given [], verdict\n");
    for (stamp, depth) in run.frames.iter().filter_map(|frame| Some((frame.stamp, frame.depth.as_ref()?))) {
        let stamp = stamp.as_nanos();
        let _ = match depth {
            DepthResult { used: Ok(DepthUse { given, scale, sigma_log_scale, verdict }), .. } => {
                let verdict = match verdict {
                    Verdict::Believed => "believed",
                    Verdict::OtherScale => "other_scale",
                    Verdict::NoDepth => "no_depth",
                };
                writeln!(text, "{stamp},{scale:.6},{sigma_log_scale:.6},{given},{verdict}")
            }
            DepthResult { used: Err(_), .. } => writeln!(text, "{stamp},,,0,failed"),
        };
    }
    text
}

fn euroc<'a>(poses: impl Iterator<Item = &'a PoseResult>) -> String {
    let mut text = String::from(
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], \
         v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], \
         b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n",
    );
    for pose in poses {
        let q = pose.world_from_body.rotation.quaternion();
        let _ = write!(text, "{}", pose.stamp.as_nanos());
        let position = pose.world_from_body.translation.vector;
        let rotation = [q.w, q.i, q.j, q.k];
        let vectors = [pose.velocity_in_world, pose.gyro_bias_rad_s, pose.accel_bias_m_s2];
        for value in position.iter().chain(&rotation).chain(vectors.iter().flat_map(|vector| vector.iter())) {
            let _ = write!(text, ",{value:.9}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use libella_core::estimator::Waiting;

    use super::*;

    /// A turn by 90 degrees about z: x becomes y.
    #[test]
    fn kitti_has_the_rows_of_the_pose_that_tum_has_as_a_quaternion() {
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
        let pose = PoseResult {
            stamp: Timestamp::from_nanos(1_500_000_000),
            world_from_body: nalgebra::Isometry3::from_parts(nalgebra::Translation3::new(1.0, 2.0, 3.0), turn),
            velocity_in_world: nalgebra::Vector3::zeros(),
            gyro_bias_rad_s: nalgebra::Vector3::zeros(),
            accel_bias_m_s2: nalgebra::Vector3::zeros(),
            pose_covariance: nalgebra::SMatrix::identity(),
            bias_sigma: None,
        };
        let text = kitti([&pose, &pose].into_iter());
        let numbers: Vec<f64> = text.lines().next().unwrap().split(' ').map(|value| value.parse().unwrap()).collect();
        assert_eq!(numbers, [0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0]);
        assert_eq!(text.lines().count(), 2);
        assert_eq!(
            tum([&pose].into_iter()).lines().nth(1).unwrap(),
            "1.500000000 1.000000000 2.000000000 3.000000000 0.000000000 0.000000000 0.707106781 0.707106781"
        );
    }

    #[test]
    fn outcomes_have_plain_names() {
        assert_eq!(name_of(FrameOutcome::NewKeyframe), "new_keyframe");
        assert_eq!(name_of(FrameOutcome::Initialising(Waiting::Parallax)), "initialising parallax");
    }
}
