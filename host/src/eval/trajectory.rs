//! Poses over time, read from TUM or EuRoC files.

use std::path::Path;

use libella_core::time::{Span, Timestamp};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use crate::dataset::table::{Row, has_commas, rows};
use crate::fault::{Fault, read_text};

/// A pose at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// When.
    pub stamp: Timestamp,
    /// Maps body coordinates to world.
    pub world_from_body: Isometry3<f64>,
}

/// Poses, strictly increasing in time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    poses: Vec<StampedPose>,
}

impl Trajectory {
    /// A trajectory of the given poses; those not newer than their predecessor are left out.
    #[must_use]
    pub fn new(poses: impl IntoIterator<Item = StampedPose>) -> Self {
        let mut kept: Vec<StampedPose> = Vec::new();
        for pose in poses {
            if kept.last().is_none_or(|last| last.stamp < pose.stamp) {
                kept.push(pose);
            }
        }
        Self { poses: kept }
    }

    /// Reads a file in the TUM format (`t x y z qx qy qz qw`, separated by blanks, seconds) or in EuRoC's
    /// (`t,x,y,z,qw,qx,qy,qz,...`, separated by commas, nanoseconds), whichever it looks like.
    ///
    /// # Errors
    /// When it is absent, cut off, out of order, or holds something that is no pose.
    pub fn read(path: &Path) -> Result<Self, Fault> {
        let text = read_text(path, "give a trajectory in the TUM or EuRoC format")?;
        Self::parse_counting(path, &text).map(|(trajectory, _)| trajectory)
    }

    /// The same of a text, with the lines whose stamp repeats that of the line before; those poses are left out.
    pub(crate) fn parse_counting(path: &Path, text: &str) -> Result<(Self, Vec<u64>), Fault> {
        let is_euroc = has_commas(text);
        let (mut poses, mut duplicates): (Vec<StampedPose>, Vec<u64>) = (Vec::new(), Vec::new());
        for row in rows(path, text, is_euroc) {
            let pose = read_pose(&row, is_euroc)?;
            match poses.last().map(|last| pose.stamp - last.stamp) {
                Some(step) if step < Span::default() => {
                    let what = format!("time stamp goes back by {:.3} ms", -step.as_seconds::<f64>() * 1e3);
                    return Err(row.fault(what, "sort the file by its first column"));
                }
                Some(step) if step == Span::default() => duplicates.push(row.line),
                _ => poses.push(pose),
            }
        }
        if poses.is_empty() {
            return Err(Fault::malformed(path, "holds no pose", "give a trajectory in the TUM or EuRoC format"));
        }
        Ok((Self { poses }, duplicates))
    }

    /// The poses in order.
    #[must_use]
    pub fn poses(&self) -> &[StampedPose] {
        &self.poses
    }

    /// The poses of something fixed to the body: `world_from_body · body_from_other`.
    #[must_use]
    pub fn attached(&self, body_from_other: &Isometry3<f64>) -> Self {
        let poses = self.poses.iter();
        let moved = poses.map(|pose| StampedPose { stamp: pose.stamp, world_from_body: pose.world_from_body * body_from_other });
        Self { poses: moved.collect() }
    }

    /// The pose at `stamp`, position interpolated linearly and rotation along the great circle; `None` outside of the
    /// trajectory and where its neighbours are more than `max_gap` apart.
    #[must_use]
    pub fn at(&self, stamp: Timestamp, max_gap: Span) -> Option<Isometry3<f64>> {
        let next = self.poses.partition_point(|pose| pose.stamp < stamp);
        let later = self.poses.get(next)?;
        if later.stamp == stamp {
            return Some(later.world_from_body);
        }
        let earlier = self.poses.get(next.checked_sub(1)?)?;
        let gap = later.stamp - earlier.stamp;
        if gap > max_gap {
            return None;
        }
        let ratio = (stamp - earlier.stamp).as_nanos() as f64 / gap.as_nanos() as f64;
        let (from, to) = (&earlier.world_from_body, &later.world_from_body);
        let position = from.translation.vector.lerp(&to.translation.vector, ratio);
        let turn = from.rotation.inverse() * to.rotation;
        Some(Isometry3::from_parts(Translation3::from(position), from.rotation * turn.powf(ratio)))
    }

    /// Length of the path through all positions, m.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        let pairs = self.poses.iter().zip(self.poses.iter().skip(1));
        pairs.map(|(a, b)| (b.world_from_body.translation.vector - a.world_from_body.translation.vector).norm()).sum()
    }
}

fn read_pose(row: &Row<'_>, is_euroc: bool) -> Result<StampedPose, Fault> {
    row.at_least(8)?;
    let mut stamp = row.stamp()?;
    let [x, y, z, a, b, c, d] = row.numbers::<7>(1)?;
    let quaternion = if is_euroc {
        Quaternion::new(a, b, c, d)
    } else {
        // Whole numbers below 1e12 are seconds: TUM files never count in nanoseconds.
        if !row.text(0)?.contains(['.', 'e', 'E']) && stamp.as_nanos().abs() < 1_000_000_000_000 {
            stamp = Timestamp::from_nanos(stamp.as_nanos().saturating_mul(1_000_000_000));
        }
        Quaternion::new(d, a, b, c)
    };
    if (quaternion.norm() - 1.0).abs() > 0.05 {
        let what = format!("quaternion has length {:.3}", quaternion.norm());
        return Err(row.fault(what, "TUM wants x y z w separated by blanks, EuRoC w,x,y,z separated by commas"));
    }
    Ok(StampedPose { stamp, world_from_body: Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_normalize(quaternion)) })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn pose(nanos: i64, position: [f64; 3], turn: [f64; 3]) -> StampedPose {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
        StampedPose { stamp: Timestamp::from_nanos(nanos), world_from_body: Isometry3::from_parts(Translation3::from(position), rotation) }
    }

    #[test]
    fn interpolation_halves_the_way_and_the_turn_and_stops_at_the_ends() {
        let truth = Trajectory::new([pose(0, [0.0; 3], [0.0; 3]), pose(100, [1.0, 2.0, 0.0], [0.0, 0.0, 0.6])]);
        let middle = truth.at(Timestamp::from_nanos(50), Span::from_nanos(100)).unwrap();
        assert!((middle.translation.vector - Vector3::new(0.5, 1.0, 0.0)).norm() < 1e-15);
        assert!((middle.rotation.scaled_axis() - Vector3::new(0.0, 0.0, 0.3)).norm() < 1e-15);
        assert!(truth.at(Timestamp::from_nanos(50), Span::from_nanos(99)).is_none());
        assert!(truth.at(Timestamp::from_nanos(-1), Span::from_nanos(1000)).is_none());
        assert!(truth.at(Timestamp::from_nanos(101), Span::from_nanos(1000)).is_none());
    }

    #[test]
    fn both_formats_give_the_same_poses() {
        let folder = tempfile::tempdir().unwrap();
        let (tum, euroc) = (folder.path().join("a.txt"), folder.path().join("b.csv"));
        std::fs::write(&tum, "# t x y z qx qy qz qw\n1403636584.763555584 1 2 3 0.1 0.2 0.3 0.9273618495495703\n").unwrap();
        std::fs::write(&euroc, "#t,...\n1403636584763555584,1,2,3,0.9273618495495703,0.1,0.2,0.3,9,9,9\n").unwrap();
        assert_eq!(Trajectory::read(&tum).unwrap(), Trajectory::read(&euroc).unwrap());
    }
}
