//! What is wrong with a recording, found before the run.
//!
//! ```text
//! Recording ─▶ stamps ─▶ specific_force ─▶ saturation ─▶ sightings ─▶ pictures ─▶ camera_imu ─▶ noise ─▶ motion ─▶ Report
//!              unit      unit              marks         corners      size        unit, axes                 (repaired on the way)
//! ```
//! Each fault that is found is repaired in memory where it can be, so that the next check sees what it would have seen without it, and
//! each cause is named once. Thresholds stand beside their reason in the file of each check.

mod axes;
mod camera_imu;
mod coarse;
mod finding;
mod fit;
mod gyro;
mod lens;
mod motion;
mod noise;
mod pairs;
mod pictures;
mod plane;
mod saturation;
mod sightings;
mod specific_force;
mod stamps;

pub use finding::{CameraImu, Clock, Figures, Finding, FindingKind, Measured, Noise, Pictures, Report, Severity};

use libella_core::camera::{Camera, CameraModel};
use libella_core::imu::{ImuNoise, ImuSample};
use libella_core::time::Timestamp;
use nalgebra::Isometry3;

use crate::dataset::Recording;
use crate::fault::Fault;
use finding::Findings;

/// How much is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckOptions {
    /// Images read at most; of a longer recording those of the most varied motion. Default 600.
    pub images: usize,
    /// Images decoded ahead. Default 8.
    pub images_ahead: usize,
    /// Magnitude of gravity, m/s². Default 9.81.
    pub gravity_m_s2: f64,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self { images: 600, images_ahead: 8, gravity_m_s2: 9.81 }
    }
}

/// The recording as far as it has been repaired.
struct Material {
    imu: Vec<ImuSample<f64>>,
    /// Samples of the gyro that are cut off.
    unreliable: Vec<bool>,
    /// Stamps of the frames, and which frame of the recording each is.
    frames: Vec<Timestamp>,
    source: Vec<usize>,
    camera: CameraModel<f64>,
    body_from_camera: Isometry3<f64>,
    noise: ImuNoise<f64>,
    accel_is_usable: bool,
    size_is_wrong: bool,
    figures: Figures,
}

impl Material {
    fn new(recording: &Recording) -> Self {
        let count = recording.frames.len();
        let (source, frames) = (0..count).filter_map(|index| Some((index, recording.frames.stamp(index)?))).unzip();
        Self {
            imu: recording.imu.clone(),
            unreliable: Vec::new(),
            frames,
            source,
            camera: recording.rig.camera,
            body_from_camera: recording.rig.body_from_camera,
            noise: recording.rig.imu_noise,
            accel_is_usable: true,
            size_is_wrong: false,
            figures: Figures::default(),
        }
    }

    fn keep_frames(&mut self, keep: impl Fn(usize, Timestamp) -> bool) {
        let kept = |index: &usize| self.frames.get(*index).is_some_and(|stamp| keep(*index, *stamp));
        let indices: Vec<usize> = (0..self.frames.len()).filter(kept).collect();
        self.source = indices.iter().filter_map(|index| self.source.get(*index).copied()).collect();
        self.frames = indices.iter().filter_map(|index| self.frames.get(*index).copied()).collect();
    }

    fn size_px(&self) -> (u32, u32) {
        self.camera.size_px()
    }

    fn set_size_px(&mut self, size_px: (u32, u32)) {
        match &mut self.camera {
            CameraModel::PinholeRadTan(camera) => camera.size_px = size_px,
            CameraModel::KannalaBrandt(camera) => camera.size_px = size_px,
        }
    }

    fn center_px(&self) -> [f64; 2] {
        match &self.camera {
            CameraModel::PinholeRadTan(camera) => camera.center_px,
            CameraModel::KannalaBrandt(camera) => camera.center_px,
        }
    }

    fn first_distortion(&self) -> f64 {
        match &self.camera {
            CameraModel::PinholeRadTan(camera) => camera.distortion[0],
            CameraModel::KannalaBrandt(camera) => camera.distortion[0],
        }
    }

    fn focal_px(&self) -> [f64; 2] {
        match &self.camera {
            CameraModel::PinholeRadTan(camera) => camera.focal_px,
            CameraModel::KannalaBrandt(camera) => camera.focal_px,
        }
    }
}

/// Checks a recording; [`open_to_check`](crate::dataset::open_to_check) opens those that a run would refuse.
///
/// # Errors
/// When no thread can be started.
pub fn check(recording: &Recording, options: &CheckOptions) -> Result<Report, Fault> {
    let mut material = Material::new(recording);
    let mut findings = Findings::default();
    stamps::check(recording, &mut material, &mut findings);
    specific_force::check(&mut material, options.gravity_m_s2, &mut findings);
    saturation::check(&mut material, &mut findings);
    let seen = sightings::look(recording, &material, options.images.max(1), options.images_ahead)?;
    pictures::check(&mut material, &seen, &mut findings);
    camera_imu::check(&mut material, &seen, &mut findings);
    noise::check(&mut material, &mut findings);
    let moves = motion::check(&material, &seen, &mut findings);
    if let Some(pictures) = &seen.pictures {
        pictures::check_repeats(pictures, moves, &mut findings);
    }
    let mut findings = findings.0;
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    let span_s = match (material.frames.first(), material.frames.last()) {
        (Some(first), Some(last)) => (*last - *first).as_seconds(),
        _ => 0.0,
    };
    Ok(Report {
        recording: recording.name.clone(),
        span_s,
        frames: recording.listed_frames,
        imu_samples: recording.imu.len(),
        worst: findings.first().map_or(Severity::Note, |finding| finding.severity),
        findings,
        figures: material.figures,
    })
}
