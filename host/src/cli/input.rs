//! How a recording is named on the command line.

use std::path::PathBuf;

use libella_host::dataset::Hints;

/// A recording, and what it does not say itself.
#[derive(clap::Args)]
pub(crate) struct Input {
    /// The recording: a folder of EuRoC/ASL, TUM-VI (`mav0` or its parent), Kalibr (`cam0` beside `imu0.csv`), ROS 2, or corners
    /// (`tracks_cam0.csv` and `imu0.csv`); or a file, told by its content: `.zip` of such a folder, ROS 1 `.bag`, `.mcap`.
    pub(crate) dataset: PathBuf,
    /// Folder of the calibration, Kalibr (camchain.yaml, imu.yaml) or ASL (cam0/sensor.yaml, imu0/sensor.yaml) [default: in the
    /// recording or beside it].
    #[arg(long, value_name = "FOLDER")]
    calibration: Option<PathBuf>,
    /// True trajectory of the inertial unit, TUM or EuRoC format [default: that of the recording].
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Topic of the images in a bag [default: the only one, or that of the calibration].
    #[arg(long, value_name = "TOPIC")]
    image_topic: Option<String>,
    /// Topic of the inertial samples in a bag [default: the only one, or that of the calibration].
    #[arg(long, value_name = "TOPIC")]
    imu_topic: Option<String>,
}

impl Input {
    /// What is told beside the recording.
    pub(crate) fn hints(&self) -> Hints {
        Hints {
            calibration: self.calibration.clone(),
            truth: self.truth.clone(),
            image_topic: self.image_topic.clone(),
            imu_topic: self.imu_topic.clone(),
        }
    }
}
