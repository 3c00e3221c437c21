//! `frames.csv`: one row per image, what became of it, how long it took, what was known and how wrong it was.
//!
//! The columns are an interface: they stay, in this order, and new ones come at the end. A field is empty where there is nothing to say.
//! `docs/report.md` lists them with their units.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use libella_core::estimator::{Health, Waiting};
use libella_core::time::{Span, Timestamp};
use nalgebra::Vector3;

use crate::config::Config;
use crate::dataset::Recording;
use crate::eval::Evaluation;
use crate::fault::{Fault, read_text};
use crate::pipeline::{FrameResult, Run, nees_over_time};

/// Columns in order; the unit stands in brackets.
const COLUMNS: [&str; 31] = [
    "#timestamp [ns]",
    "health",
    "left_out",
    "tracked",
    "imu [ms]",
    "track [ms]",
    "depth [ms]",
    "solve [ms]",
    "network [ms]",
    "wait [ms]",
    "depth_share",
    "sigma_rotation_x [rad]",
    "sigma_rotation_y [rad]",
    "sigma_rotation_z [rad]",
    "sigma_position_x [m]",
    "sigma_position_y [m]",
    "sigma_position_z [m]",
    "sigma_gyro_bias_x [rad s^-1]",
    "sigma_gyro_bias_y [rad s^-1]",
    "sigma_gyro_bias_z [rad s^-1]",
    "sigma_accel_bias_x [m s^-2]",
    "sigma_accel_bias_y [m s^-2]",
    "sigma_accel_bias_z [m s^-2]",
    "truth_x [m]",
    "truth_y [m]",
    "truth_z [m]",
    "error [m]",
    "nees",
    "has_pose",
    "imu_left_out",
    "depth_state",
];

/// One row.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Frame {
    pub stamp_ns: i64,
    pub health: String,
    pub left_out: bool,
    pub has_pose: bool,
    pub tracked: Option<f64>,
    /// `imu`, `track`, `depth`, `solve`.
    pub stages_ms: [f64; 4],
    pub network_ms: Option<f64>,
    pub sigma_gyro_bias: Option<[f64; 3]>,
    pub sigma_accel_bias: Option<[f64; 3]>,
    /// In the estimator's world.
    pub truth: Option<[f64; 3]>,
    pub error_m: Option<f64>,
    pub nees: Option<f64>,
}

/// The word for how the estimator was, with what it waits for.
pub(super) fn name_of(health: Health) -> &'static str {
    match health {
        Health::Initialising(Waiting::Imu) => "initialising_imu",
        Health::Initialising(Waiting::Tracks) => "initialising_tracks",
        Health::Initialising(Waiting::Parallax) => "initialising_parallax",
        Health::Initialising(Waiting::Excitation) => "initialising_excitation",
        Health::Initialising(Waiting::Gravity) => "initialising_gravity",
        Health::Initialising(Waiting::Agreement) => "initialising_agreement",
        Health::Tracking => "tracking",
        Health::Degraded => "degraded",
        Health::Lost => "lost",
        _ => "initialising",
    }
}

/// The file of a run.
pub(super) fn write(recording: &Recording, config: &Config, run: &Run, evaluation: Option<&Evaluation>) -> String {
    let nees: BTreeMap<Timestamp, f64> = nees_over_time(recording, config, run).unwrap_or_default().into_iter().collect();
    let errors: BTreeMap<i64, f64> = evaluation.map(|found| found.errors.iter().copied().collect()).unwrap_or_default();
    #[allow(clippy::cast_possible_truncation)]
    let max_gap = Span::from_nanos((config.evaluation.max_truth_gap_s * 1e9) as i64);
    let truth_at = |stamp: Timestamp| {
        let pose = recording.truth.as_ref()?.at(stamp, max_gap)?;
        // The truth is laid onto the estimate here, and not the other way round: that world has its z axis up and holds the planes.
        Some(evaluation?.truth_from_estimate.inverse_transform_point(&pose.translation.vector.into()).coords)
    };
    let mut text = COLUMNS.join(", ") + "\n";
    for frame in &run.frames {
        let found = Found {
            truth: truth_at(frame.stamp),
            error_m: errors.get(&frame.stamp.as_nanos()).copied(),
            nees: nees.get(&frame.stamp).copied(),
        };
        row(&mut text, frame, &found);
    }
    text
}

/// What the truth says of an image.
struct Found {
    truth: Option<Vector3<f64>>,
    error_m: Option<f64>,
    nees: Option<f64>,
}

fn row(text: &mut String, frame: &FrameResult, found: &Found) {
    // Writing to a String cannot fail.
    let _ = write!(text, "{},{},{}", frame.stamp.as_nanos(), name_of(frame.health), u8::from(frame.refused.is_some()));
    let taken = frame.outcome.is_some();
    let depth_ms = frame.depth.as_ref().map(|depth| depth.times);
    let pose = frame.pose.as_ref();
    let sigma = |axis: usize| pose.map(|pose| pose.pose_covariance[(axis, axis)].max(0.0).sqrt());
    let bias = pose.and_then(|pose| pose.bias_sigma);
    let mut fields: Vec<(Option<f64>, usize)> = vec![
        (taken.then_some(frame.tracked as f64), 0),
        (Some(frame.imu_ms), 4),
        (Some(frame.track_ms), 4),
        (depth_ms.map(|times| times.push_ms), 4),
        (Some(frame.solve_ms), 4),
        (depth_ms.map(|times| times.network_ms), 4),
        (depth_ms.map(|times| times.wait_ms), 4),
        (frame.depth_share, 4),
    ];
    fields.extend((0..6).map(|axis| (sigma(axis), 7)));
    fields.extend((0..3).map(|axis| (bias.map(|bias| bias.gyro_rad_s[axis]), 8)));
    fields.extend((0..3).map(|axis| (bias.map(|bias| bias.accel_m_s2[axis]), 8)));
    fields.extend((0..3).map(|axis| (found.truth.map(|truth| truth[axis]), 6)));
    fields.extend([(found.error_m, 6), (found.nees, 4), (Some(f64::from(u8::from(pose.is_some()))), 0)]);
    fields.push((Some(frame.refused_imu.count as f64), 0));
    for (value, digits) in fields {
        text.push(',');
        if let Some(value) = value.filter(|value| value.is_finite()) {
            let _ = write!(text, "{value:.digits$}");
        }
    }
    let state = frame.depth.as_ref().map_or("", |depth| if depth.used.is_ok() { "given" } else { "failed" });
    let _ = writeln!(text, ",{state}");
}

/// Reads the file; columns are found by their names.
pub(super) fn read(path: &Path) -> Result<Vec<Frame>, Fault> {
    let text = read_text(path, "run `libella run` again")?;
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').map(|name| name.split('[').next().unwrap_or(name).trim()).collect();
    let place = |wanted: &str| names.iter().position(|name| name.trim_start_matches('#') == wanted);
    let mut frames: Vec<Frame> = Vec::new();
    for (line, number) in lines.zip(2_u64..) {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let text_of = |name: &str| place(name).and_then(|place| fields.get(place).copied()).unwrap_or_default();
        let value = |name: &str| text_of(name).parse::<f64>().ok().filter(|value| value.is_finite());
        let triple = |name: &str| {
            let [x, y, z] = ["x", "y", "z"].map(|axis| value(&format!("{name}_{axis}")));
            Some([x?, y?, z?])
        };
        let Ok(stamp_ns) = text_of("timestamp").parse::<i64>() else {
            return Err(Fault::malformed(path, "has no time stamp in its first column", "run `libella run` again").line(number));
        };
        if frames.last().is_some_and(|last| last.stamp_ns >= stamp_ns) {
            return Err(Fault::malformed(path, "time stamps do not increase", "run `libella run` again").line(number));
        }
        frames.push(Frame {
            stamp_ns,
            health: text_of("health").to_owned(),
            left_out: text_of("left_out") == "1",
            has_pose: text_of("has_pose") == "1",
            tracked: value("tracked"),
            stages_ms: ["imu", "track", "depth", "solve"].map(|stage| value(stage).unwrap_or(0.0)),
            network_ms: value("network"),
            sigma_gyro_bias: triple("sigma_gyro_bias"),
            sigma_accel_bias: triple("sigma_accel_bias"),
            truth: triple("truth"),
            error_m: value("error"),
            nees: value("nees"),
        });
    }
    Ok(frames)
}
