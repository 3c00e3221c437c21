//! The rig and the recorded motion of EuRoC.
//!
//! Calibration: `cam0/sensor.yaml` and `cam1/sensor.yaml` of the EuRoC MAV dataset (Burri et al., IJRR 2016), the same on all its
//! sequences.

use std::path::{Path, PathBuf};

use libella_core::camera::{CameraModel, PinholeRadTan};
use libella_core::imu::{ImuBias, ImuSample};
use libella_core::time::Timestamp;
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::SimError;

/// EuRoC's left (0) or right (any other number) camera.
#[must_use]
pub fn camera(index: usize) -> CameraModel<f64> {
    CameraModel::PinholeRadTan(pinhole(index))
}

pub(super) fn pinhole(index: usize) -> PinholeRadTan<f64> {
    if index == 0 {
        PinholeRadTan {
            size_px: (752, 480),
            focal_px: [458.654, 457.296],
            center_px: [367.215, 248.375],
            distortion: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
        }
    } else {
        PinholeRadTan {
            size_px: (752, 480),
            focal_px: [457.587, 456.134],
            center_px: [379.999, 255.238],
            distortion: [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05],
        }
    }
}

/// `T_BC` as the file gives it, rows of the 3×4 matrix.
pub(super) fn extrinsic_rows(index: usize) -> [[f64; 4]; 3] {
    if index == 0 {
        [
            [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
            [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
            [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949],
        ]
    } else {
        [
            [0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556],
            [0.999598781151, 0.0130119051815, 0.0251588363115, 0.0453689425024],
            [-0.0253898008918, 0.0179005838253, 0.999517347078, 0.00786212447038],
        ]
    }
}

/// `T_BC` of EuRoC's left (0) or right camera.
#[must_use]
pub fn body_from_camera(index: usize) -> Isometry3<f64> {
    let rows = extrinsic_rows(index);
    let rotation = Matrix3::from_fn(|r, c| rows[r][c]);
    // The file prints twelve digits: orthogonal only to those.
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_eps(&rotation, 1e-15, 100, Rotation3::identity()));
    Isometry3::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), rotation)
}

/// One row of a EuRoC ground truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthRow {
    /// When.
    pub stamp: Timestamp,
    /// `R_WB`.
    pub world_from_body: UnitQuaternion<f64>,
    /// `p_WB`, m.
    pub position_in_world: Vector3<f64>,
    /// Biases as the ground truth estimates them.
    pub bias: ImuBias<f64>,
}

/// What was recorded of a motion: no images.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedMotion {
    /// Stamps of `cam0`.
    pub frame_stamps: Vec<Timestamp>,
    /// Raw samples of `imu0`.
    pub imu: Vec<ImuSample<f64>>,
    /// `state_groundtruth_estimate0`.
    pub truth: Vec<TruthRow>,
}

impl RecordedMotion {
    /// Reads a EuRoC folder: the `mav0` folder itself or the one that holds it.
    ///
    /// # Errors
    /// A file that is missing, or a line that cannot be read, with its number.
    pub fn read(folder: &Path) -> Result<Self, SimError> {
        let inner = folder.join("mav0");
        let mav0 = if inner.is_dir() { inner } else { folder.to_owned() };
        let imu = read_rows(&mav0.join("imu0/data.csv"), 6)?
            .into_iter()
            .map(|(stamp, v)| ImuSample { stamp, gyro_rad_s: vector(&v, 0), accel_m_s2: vector(&v, 3) })
            .collect();
        let mut truth: Vec<TruthRow> = read_rows(&mav0.join("state_groundtruth_estimate0/data.csv"), 16)?
            .into_iter()
            .map(|(stamp, v)| TruthRow {
                stamp,
                world_from_body: UnitQuaternion::from_quaternion(Quaternion::new(v[3], v[4], v[5], v[6])),
                position_in_world: vector(&v, 0),
                bias: ImuBias { gyro_rad_s: vector(&v, 10), accel_m_s2: vector(&v, 13) },
            })
            .collect();
        remove_drifts(&mut truth);
        let frame_stamps = read_rows(&mav0.join("cam0/data.csv"), 0)?.into_iter().map(|(stamp, _)| stamp).collect();
        Ok(Self { frame_stamps, imu, truth })
    }
}

/// Longest drift that a leap is taken for the end of, s.
const LONGEST_DRIFT_S: f64 = 4.0;
const SHORTEST_DRIFT_S: f64 = 0.5;

/// Takes the drift out of positions that end in a leap. Where the tracker of `MH_04` loses sight, its ground truth runs on inertial
/// samples, drifts, and leaps back with the next fix: 13 cm and 0.1 m/s within one row of 5 ms.
///
/// # Model
/// A constant error of the acceleration (a tilt) gives the drift `d = ½ a τ²`, so the leap `l` and the leap of the velocity `v` tell how
/// long it lasted, `T = 2 |l| / |v|`. Taken out is the cubic with `d(0) = d'(0) = 0`, `d(T) = l`, `d'(T) = v`: the motion becomes smooth,
/// and where the tracker sees, nothing changes.
fn remove_drifts(truth: &mut [TruthRow]) {
    // What an acceleration of 30 m/s² explains, and noise.
    let explained = |seconds: f64| 0.005 + 30.0 * seconds * seconds;
    let raw: Vec<_> = truth.iter().map(|row| (row.stamp, row.position_in_world)).collect();
    let velocity = |i: usize| (raw[i + 1].1 - raw[i].1) / (raw[i + 1].0 - raw[i].0).as_seconds::<f64>();
    // The row after a leap is told by what follows; the leap itself would pass for a second one.
    let mut after = 0;
    for i in 2..raw.len().saturating_sub(1) {
        let (span, last) = ((raw[i].0 - raw[i - 1].0).as_seconds::<f64>(), (raw[i - 1].0 - raw[i - 2].0).as_seconds::<f64>());
        let (before, behind) = (velocity(i - 2), velocity(i));
        let leap = raw[i].1 - raw[i - 1].1 - before * span;
        if i <= after || leap.norm() <= explained(span.max(last)) {
            continue;
        }
        after = i + 1;
        let change = behind - before;
        let lasted_s = (2.0 * leap.norm() / change.norm().max(1e-9)).clamp(SHORTEST_DRIFT_S, LONGEST_DRIFT_S);
        for (row, (stamp, _)) in truth[..i].iter_mut().zip(&raw).rev() {
            let share = 1.0 - (raw[i].0 - *stamp).as_seconds::<f64>() / lasted_s;
            if share <= 0.0 {
                break;
            }
            row.position_in_world += leap * (share * share * (3.0 - 2.0 * share)) + change * (lasted_s * share * share * (share - 1.0));
        }
    }
}

fn vector(values: &[f64], at: usize) -> Vector3<f64> {
    Vector3::new(values[at], values[at + 1], values[at + 2])
}

/// Rows of `stamp, number, ...` with at least `columns` finite numbers and rising stamps.
fn read_rows(path: &PathBuf, columns: usize) -> Result<Vec<(Timestamp, Vec<f64>)>, SimError> {
    let text = std::fs::read_to_string(path).map_err(|error| SimError::file(path, error))?;
    let mut rows: Vec<(Timestamp, Vec<f64>)> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.starts_with('#') || line.trim().is_empty() {
            continue;
        }
        let wrong = |reason: String| SimError::Line { path: path.clone(), line: index + 1, reason };
        let mut fields = line.split(',').map(str::trim);
        let stamp = fields.next().unwrap_or_default();
        let stamp = stamp.parse().map(Timestamp::from_nanos).map_err(|_| wrong(format!("`{stamp}` is no time stamp in nanoseconds")))?;
        let mut values = Vec::with_capacity(columns);
        for field in fields.by_ref().take(columns) {
            match field.parse::<f64>() {
                Ok(value) if value.is_finite() => values.push(value),
                _ => return Err(wrong(format!("`{field}` is no finite number"))),
            }
        }
        if values.len() < columns {
            return Err(wrong(format!("{} numbers after the time stamp, {columns} are needed", values.len())));
        }
        if let Some((last, _)) = rows.last()
            && *last >= stamp
        {
            return Err(wrong("the time stamp is not newer than the one before".to_owned()));
        }
        rows.push((stamp, values));
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion with a drift of constant acceleration that ends in a leap comes back as it was before the drift; without a leap
    /// nothing is touched.
    #[test]
    fn a_drift_that_ends_in_a_leap_is_taken_out() {
        let row = |k: i64, position: Vector3<f64>| TruthRow {
            stamp: Timestamp::from_nanos(k * 5_000_000),
            world_from_body: UnitQuaternion::identity(),
            position_in_world: position,
            bias: ImuBias::default(),
        };
        let moving = |k: i64| Vector3::new((0.005 * k as f64).sin(), 0.3 * (0.01 * k as f64).cos(), 1.0);
        let exact: Vec<_> = (0..1200).map(|k| row(k, moving(k))).collect();
        let mut untouched = exact.clone();
        remove_drifts(&mut untouched);
        assert_eq!(untouched, exact);
        let (begins, ends) = (500, 840);
        let mut drifting = exact.clone();
        for (k, row) in (begins..ends).zip(&mut drifting[begins as usize..]) {
            let seconds = 0.005 * (k - begins) as f64;
            row.position_in_world -= Vector3::new(0.06, -0.05, 0.02) * (0.5 * seconds * seconds);
        }
        let worst = |rows: &[TruthRow]| {
            rows.iter().zip(&exact).map(|(row, exact)| (row.position_in_world - exact.position_in_world).norm()).fold(0.0, f64::max)
        };
        let before = worst(&drifting);
        remove_drifts(&mut drifting);
        // The velocity before the leap is told by one difference: a row of the drift stays, 2 % of it.
        assert!(before > 0.1 && worst(&drifting) < 0.02 * before, "{before} m became {} m", worst(&drifting));
        assert_eq!(drifting[ends as usize..], exact[ends as usize..]);
    }
}
