//! Small recordings on disk, whole at first, for a test to damage.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use libella_host::config::Config;
use libella_host::dataset::{self, Recording};
use libella_host::fault::Fault;
use tempfile::TempDir;

/// Size of the images, px.
pub const SIZE: (u32, u32) = (64, 48);
/// Time of the first inertial sample.
pub const START_NS: i64 = 1_403_636_584_000_000_000;

/// A EuRoC folder in a temporary place: one second of rest, 201 inertial samples, 10 images.
pub struct Folder {
    temporary: TempDir,
}

impl Folder {
    /// Writes a recording without faults.
    pub fn new() -> Self {
        let folder = Self { temporary: tempfile::tempdir().unwrap() };
        for name in ["cam0/data", "imu0", "state_groundtruth_estimate0"] {
            std::fs::create_dir_all(folder.path(name)).unwrap();
        }
        std::fs::write(folder.path("cam0/sensor.yaml"), CAMERA).unwrap();
        std::fs::write(folder.path("imu0/sensor.yaml"), IMU).unwrap();
        let mut imu = String::from("#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n");
        let mut truth = String::from("#timestamp,x,y,z,qw,qx,qy,qz\n");
        for index in 0..=200_i64 {
            let stamp = START_NS + 5_000_000 * index;
            // A gyro that hums a little, so that no reading repeats itself.
            writeln!(imu, "{stamp},0.00{index:03},-0.01,0.02,0.1,-0.2,9.8{index:03}").unwrap();
            writeln!(truth, "{stamp},1.0,2.0,3.0,1.0,0.0,0.0,0.0").unwrap();
        }
        std::fs::write(folder.path("imu0/data.csv"), imu).unwrap();
        std::fs::write(folder.path("state_groundtruth_estimate0/data.csv"), truth).unwrap();
        let mut images = String::from("#timestamp [ns],filename\n");
        for index in 0..10_i64 {
            let stamp = START_NS + 25_000_000 + 100_000_000 * index;
            writeln!(images, "{stamp},{stamp}.png").unwrap();
            let pixels = image::GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| image::Luma([((x / 8 + y / 8) % 2 * 200) as u8]));
            pixels.save(folder.path(&format!("cam0/data/{stamp}.png"))).unwrap();
        }
        std::fs::write(folder.path("cam0/data.csv"), images).unwrap();
        folder
    }

    /// The folder that holds `mav0`.
    pub fn root(&self) -> &Path {
        self.temporary.path()
    }

    /// A path below `mav0`.
    pub fn path(&self, below: &str) -> PathBuf {
        self.temporary.path().join("mav0").join(below)
    }

    /// The image of the given number.
    pub fn image(&self, index: i64) -> PathBuf {
        self.path(&format!("cam0/data/{}.png", START_NS + 25_000_000 + 100_000_000 * index))
    }

    /// Rewrites a file.
    pub fn edit(&self, below: &str, change: impl FnOnce(String) -> String) {
        let path = self.path(below);
        let changed = change(std::fs::read_to_string(&path).unwrap());
        std::fs::write(path, changed).unwrap();
    }

    /// Rewrites the lines of a file.
    pub fn edit_lines(&self, below: &str, change: impl FnOnce(&mut Vec<String>)) {
        self.edit(below, |text| {
            let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
            change(&mut lines);
            lines.join("\n") + "\n"
        });
    }

    /// Opens the recording with the default configuration.
    pub fn open(&self) -> Result<Recording, Fault> {
        dataset::open(self.root(), &Config::default().dataset)
    }
}

const CAMERA: &str = "%YAML:1.0
# General sensor definitions.
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, -0.02,
         1.0, 0.0, 0.0, -0.06,
         0.0, 0.0, 1.0, 0.01,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 10
resolution: [64, 48]
camera_model: pinhole
intrinsics: [40.0, 40.0, 32.0, 24.0] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]
";

const IMU: &str = "sensor_type: imu
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0,
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]
gyroscope_random_walk: 1.9393e-05
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
";
