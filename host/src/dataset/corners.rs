//! Recordings of a calibration target: corners found beforehand, raw inertial samples, and the target's pose.
//!
//! `tracks_cam0.csv` holds `stamp, tag, corner, u, v` (px, raw image); `imu0.csv` the samples; `pnp_cam0_in_target.csv`,
//! if present, `T_target_cam0`, which serves as truth after `T_target_body = T_target_cam0 T_BC⁻¹`. Calibration is that of the
//! folder's `cam0/sensor.yaml` and `imu0/sensor.yaml`, else that of EuRoC's sensor head.

use std::collections::HashMap;
use std::path::Path;

use libella_core::track::{Observation, TrackId};
use nalgebra::Vector2;

use super::table::rows;
use super::{Frames, Layout, Purpose, Recording, RemarkKind, TrackFrame, imu, remark};
use crate::calibration::{Rig, read_camera, read_imu};
use crate::config::DatasetSection;
use crate::eval::Trajectory;
use crate::fault::{Fault, read_text};

const CORNERS_PER_TAG: u32 = 4;

/// Opens a folder that holds `tracks_cam0.csv`.
pub(super) fn open(purpose: Purpose, path: &Path, options: &DatasetSection) -> Result<Recording, Fault> {
    let mut remarks = Vec::new();
    let camera_file = path.join("cam0").join("sensor.yaml");
    let imu_file = path.join("imu0").join("sensor.yaml");
    let mut rig = Rig::euroc();
    if camera_file.is_file() {
        let camera = read_camera(&camera_file)?;
        (rig.camera, rig.body_from_camera) = (camera.camera, camera.body_from_camera);
    } else {
        remark(&mut remarks, RemarkKind::Assumed, || format!("{}: no cam0/sensor.yaml; EuRoC's sensor head is assumed", path.display()));
    }
    if imu_file.is_file() {
        let inertial = read_imu(&imu_file)?;
        rig.imu_noise = inertial.noise;
        rig.body_from_camera = inertial.body_from_imu.inverse() * rig.body_from_camera;
    }
    let table = path.join("imu0.csv");
    let text = read_text(&table, "a recording needs its inertial samples: copy the folder again, whole")?;
    let samples = imu::read(purpose, &table, &text, options, &mut remarks)?;
    let frames = read_tracks(&path.join("tracks_cam0.csv"), options.reacquired_corner_is_new)?;
    let pnp = path.join("pnp_cam0_in_target.csv");
    let truth = if pnp.is_file() { Some(Trajectory::read(&pnp)?.attached(&rig.body_from_camera.inverse())) } else { None };
    let name = path.canonicalize().ok().and_then(|whole| whole.file_name().map(|name| name.to_string_lossy().into_owned()));
    Ok(Recording {
        name: name.unwrap_or_else(|| "corners".into()),
        layout: Layout::Corners,
        rig,
        imu: samples,
        listed_frames: frames.len(),
        frames: Frames::Tracks(frames),
        truth,
        // The target may stand or hang in any way.
        truth_is_level: false,
        remarks,
    })
}

fn read_tracks(path: &Path, reacquired_is_new: bool) -> Result<Vec<TrackFrame>, Fault> {
    let text = read_text(path, "copy the recording again, whole")?;
    let mut frames: Vec<TrackFrame> = Vec::new();
    let mut names = Names { reacquired_is_new, ..Names::default() };
    for row in rows(path, &text, true) {
        row.at_least(5)?;
        let stamp = row.stamp()?;
        match frames.last().map(|frame| frame.stamp) {
            Some(last) if stamp < last => {
                let back_ms = (last - stamp).as_seconds::<f64>() * 1e3;
                return Err(row.fault(format!("time stamp goes back by {back_ms:.3} ms"), "sort the file by its first column"));
            }
            Some(last) if stamp == last => {}
            _ => {
                frames.push(TrackFrame { stamp, observations: Vec::new() });
                names.frame += 1;
            }
        }
        let (tag, corner) = (row.index(1)?, row.index(2)?);
        if corner >= CORNERS_PER_TAG || tag > u32::MAX / CORNERS_PER_TAG - 1 {
            return Err(row.fault(format!("tag {tag} has no corner {corner}"), "corners are counted 0 to 3"));
        }
        let track = names
            .of(tag * CORNERS_PER_TAG + corner)
            .ok_or_else(|| row.fault(format!("corner {corner} of tag {tag} occurs twice in the image"), "remove one of the lines"))?;
        let [u, v] = row.numbers::<2>(3)?;
        if let Some(frame) = frames.last_mut() {
            frame.observations.push(Observation { track, pixel: Vector2::new(u, v) });
        }
    }
    if frames.is_empty() {
        return Err(Fault::malformed(path, "has no corners", "the file is cut off: copy it again"));
    }
    Ok(frames)
}

/// Gives corners their track ids.
#[derive(Default)]
struct Names {
    reacquired_is_new: bool,
    frame: u64,
    next: u32,
    /// Corner to the frame where it was last seen and its track.
    seen: HashMap<u32, (u64, TrackId)>,
}

impl Names {
    /// The track of a corner in the current frame; `None` when it was asked for already.
    fn of(&mut self, corner: u32) -> Option<TrackId> {
        let track = match self.seen.get(&corner) {
            Some((frame, _)) if *frame == self.frame => return None,
            _ if !self.reacquired_is_new => TrackId(corner),
            Some((frame, track)) if frame + 1 == self.frame => *track,
            _ => {
                self.next += 1;
                TrackId(self.next - 1)
            }
        };
        self.seen.insert(corner, (self.frame, track));
        Some(track)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use libella_core::time::Timestamp;

    use super::*;

    fn tracks(reacquired_is_new: bool) -> Vec<Vec<u32>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tracks_cam0.csv");
        std::fs::write(&path, "#t,tag,corner,u,v\n1,0,0,1,1\n1,0,1,1,1\n2,0,0,1,1\n3,0,0,1,1\n3,0,1,1,1\n").unwrap();
        let frames = read_tracks(&path, reacquired_is_new).unwrap();
        assert_eq!(frames.iter().map(|frame| frame.stamp).collect::<Vec<_>>(), [1, 2, 3].map(Timestamp::from_nanos));
        frames.iter().map(|frame| frame.observations.iter().map(|o| o.track.0).collect()).collect()
    }

    #[test]
    fn a_corner_that_was_away_returns_as_a_new_track() {
        assert_eq!(tracks(true), [vec![0, 1], vec![0], vec![0, 2]]);
        assert_eq!(tracks(false), [vec![0, 1], vec![0], vec![0, 1]]);
    }
}
