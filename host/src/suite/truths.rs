//! More than one truth of a recording.
//!
//! EuRoC states poses that were computed from the tracker and the inertial samples (`state_groundtruth_estimate0`), and what the
//! tracker itself said: poses of a marker (`vicon0`) or positions of a prism (`leica0`). An estimate is compared with those where
//! they were taken: at `world_from_body · T_BS`.

use std::path::Path;

use libella_core::time::Timestamp;
use nalgebra::Isometry3;

use crate::calibration::read_extrinsics;
use crate::config::EvaluationSection;
use crate::dataset::table::rows;
use crate::eval::{StampedPose, Trajectory, evaluate};
use crate::fault::{Fault, read_text};

/// A truth beside the first one.
#[derive(Debug, Clone)]
pub(super) struct OtherTruth {
    /// The folder that it comes from.
    pub name: &'static str,
    body_from_sensor: Isometry3<f64>,
    /// Rotations mean nothing where only positions were measured.
    world_from_sensor: Trajectory,
}

impl OtherTruth {
    /// RMSE of the position after alignment, m.
    pub fn ate_rmse_m(&self, estimate: &Trajectory, options: &EvaluationSection) -> Option<f64> {
        let found = evaluate(&estimate.attached(&self.body_from_sensor), &self.world_from_sensor, options).ok()?;
        Some(found.ate_rmse_m).filter(|ate| ate.is_finite())
    }
}

/// What there is beside `state_groundtruth_estimate0`; nothing where the recording has another layout.
pub(super) fn others(recording: &Path) -> Result<Vec<OtherTruth>, Fault> {
    let mav0 = recording.join("mav0");
    let root = if mav0.is_dir() { mav0.as_path() } else { recording };
    if !root.join("state_groundtruth_estimate0/data.csv").is_file() {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for (name, has_rotation) in [("vicon0", true), ("leica0", false)] {
        let (table, yaml) = (root.join(name).join("data.csv"), root.join(name).join("sensor.yaml"));
        if !table.is_file() {
            continue;
        }
        let body_from_sensor = if yaml.is_file() { read_extrinsics(&yaml)? } else { Isometry3::identity() };
        let world_from_sensor = if has_rotation { Trajectory::read(&table)? } else { positions(&table)? };
        found.push(OtherTruth { name, body_from_sensor, world_from_sensor });
    }
    Ok(found)
}

/// `t,x,y,z`, positions alone.
fn positions(table: &Path) -> Result<Trajectory, Fault> {
    let text = read_text(table, "copy the recording again")?;
    let pose = |stamp: Timestamp, [x, y, z]: [f64; 3]| StampedPose { stamp, world_from_body: Isometry3::translation(x, y, z) };
    let poses = rows(table, &text, true).map(|row| Ok(pose(row.stamp()?, row.numbers::<3>(1)?)));
    Ok(Trajectory::new(poses.collect::<Result<Vec<_>, Fault>>()?))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::fmt::Write as _;

    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn a_prism_off_the_body_is_compared_where_it_is() {
        let (lever, stamps) = (Vector3::new(0.1, -0.2, 0.3), 0..200_i64);
        let pose = |k: i64| {
            let t = k as f64 * 0.05;
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3 * t.sin(), 0.2 * t.cos(), 0.5 * t));
            Isometry3::from_parts(Translation3::new(t.sin(), (1.3 * t).cos(), 0.2 * t), turn)
        };
        let folder = tempfile::tempdir().unwrap();
        let sensor = |name: &str| {
            std::fs::create_dir_all(folder.path().join("mav0").join(name)).unwrap();
            folder.path().join("mav0").join(name)
        };
        let mut prism = String::from("#timestamp, x, y, z\n");
        for k in stamps.clone() {
            let at = pose(k) * nalgebra::Point3::from(lever);
            writeln!(prism, "{},{},{},{}", k * 50_000_000, at.x, at.y, at.z).unwrap();
        }
        std::fs::write(sensor("leica0").join("data.csv"), prism).unwrap();
        std::fs::write(
            sensor("leica0").join("sensor.yaml"),
            "sensor_type: position\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0.1, 0, 1, 0, -0.2, 0, 0, 1, 0.3, 0, 0, 0, 1]\n",
        )
        .unwrap();
        assert!(others(folder.path()).unwrap().is_empty(), "without the first truth the tracker's is the first");
        std::fs::write(sensor("state_groundtruth_estimate0").join("data.csv"), "").unwrap();
        let found = others(folder.path()).unwrap();
        assert_eq!(found.iter().map(|truth| truth.name).collect::<Vec<_>>(), ["leica0"]);
        // An exact estimate in a world of its own.
        let elsewhere = Isometry3::new(Vector3::new(4.0, -1.0, 2.0), Vector3::new(0.0, 0.0, 1.1));
        let estimate = Trajectory::new(
            stamps.map(|k| StampedPose { stamp: Timestamp::from_nanos(k * 50_000_000), world_from_body: elsewhere * pose(k) }),
        );
        assert!(found[0].ate_rmse_m(&estimate, &EvaluationSection::default()).unwrap() < 1e-6);
        let ignored = OtherTruth { body_from_sensor: Isometry3::identity(), ..found[0].clone() };
        assert!(ignored.ate_rmse_m(&estimate, &EvaluationSection::default()).unwrap() > 0.05);
    }
}
