//! What is told about a recording beside the recording.

use std::path::{Path, PathBuf};

use crate::eval::Trajectory;
use crate::fault::{Fault, FaultKind};

/// What is told about a recording beside the recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Hints {
    /// Folder of the calibration, ASL (`cam0/sensor.yaml`, `imu0/sensor.yaml`) or Kalibr (`camchain.yaml`, `imu.yaml`); it takes the place
    /// of what lies in the recording or beside it.
    pub calibration: Option<PathBuf>,
    /// True trajectory of the inertial unit, in the TUM or EuRoC format; it takes the place of what lies in the recording.
    pub truth: Option<PathBuf>,
    /// Topic of the images in a bag.
    pub image_topic: Option<String>,
    /// Topic of the inertial samples in a bag.
    pub imu_topic: Option<String>,
}

impl Hints {
    /// Refuses topics for a recording that has none.
    pub(super) fn refuse_topics(&self, path: &Path) -> Result<(), Fault> {
        if self.image_topic.is_none() && self.imu_topic.is_none() {
            return Ok(());
        }
        Err(Fault::new(FaultKind::Configuration, "has no topics, it is no bag", "leave out --image-topic and --imu-topic").at(path))
    }

    /// The truth that is told.
    pub(super) fn truth(&self) -> Result<Option<Trajectory>, Fault> {
        self.truth.as_deref().map(Trajectory::read).transpose()
    }
}
