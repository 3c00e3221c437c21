//! The files of Kalibr: `camchain.yaml` (cameras, extrinsics, time offset) and `imu.yaml` (noise).
//!
//! # Model
//! `T_cam_imu` maps coordinates of the inertial unit to those of the camera, so that `body_from_camera = T_cam_imu⁻¹`. The clock of the
//! inertial unit is `t_imu = t_cam + timeshift_cam_imu`, and it is the one that counts here. Noise densities have the units of ASL's files.

use std::collections::BTreeMap;
use std::path::Path;

use libella_core::camera::CameraModel;
use libella_core::time::Span;
use nalgebra::Isometry3;
use serde::Deserialize;

use super::{CameraYaml, ImuCalibration, ImuYaml, absent, miscounted, model, noise, parse, pose};
use crate::fault::Fault;

/// No driver stamps so late; a larger number is one of another unit.
const MOST_SHIFT_S: f64 = 10.0;

/// A camera of a chain.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChainCamera {
    /// Its name, `cam0` for the first.
    pub(crate) name: String,
    /// Its model.
    pub(crate) camera: CameraModel<f64>,
    /// Maps camera coordinates to those of the inertial unit.
    pub(crate) body_from_camera: Isometry3<f64>,
    /// What is added to its stamps to have those of the inertial unit.
    pub(crate) shift: Span,
    /// The topic of its images.
    pub(crate) topic: Option<String>,
}

#[derive(Deserialize)]
struct ChainYaml {
    #[serde(rename = "T_cam_imu")]
    camera_from_imu: Option<Vec<Vec<f64>>>,
    #[serde(rename = "T_imu_cam")]
    imu_from_camera: Option<Vec<Vec<f64>>>,
    timeshift_cam_imu: Option<f64>,
    rostopic: Option<String>,
    #[serde(flatten)]
    camera: CameraYaml,
}

/// Reads the cameras that have an extrinsic calibration.
///
/// # Errors
/// When the text is no chain, its first camera has no `T_cam_imu`, or a number describes no camera.
pub(crate) fn cameras_from(path: &Path, text: &str) -> Result<Vec<ChainCamera>, Fault> {
    let chain: BTreeMap<String, ChainYaml> = parse(path, text)?;
    let mut cameras = Vec::new();
    for (name, yaml) in chain {
        let flat = |key: &str, rows: &[Vec<f64>]| match rows.iter().find(|row| row.len() != 4) {
            Some(row) => Err(miscounted(path, &format!("a row of {key}"), row.len(), 4)),
            None => pose(path, key, &rows.concat()),
        };
        let body_from_camera = match (&yaml.camera_from_imu, &yaml.imu_from_camera) {
            (Some(rows), _) => flat("T_cam_imu", rows)?.inverse(),
            (None, Some(rows)) => flat("T_imu_cam", rows)?,
            // The second camera of a chain may be given by the first alone.
            (None, None) if !cameras.is_empty() => continue,
            (None, None) => {
                let what = format!("`{name}` has no `T_cam_imu`");
                return Err(Fault::malformed(
                    path,
                    what,
                    "calibrate camera and inertial unit together: give the file with `imucam` in its name",
                ));
            }
        };
        let shift_s = yaml.timeshift_cam_imu.unwrap_or(0.0);
        if !shift_s.is_finite() || shift_s.abs() > MOST_SHIFT_S {
            return Err(Fault::malformed(path, format!("timeshift_cam_imu of `{name}` is {shift_s} s"), "give seconds"));
        }
        #[allow(clippy::cast_possible_truncation)]
        let shift = Span::from_nanos((shift_s * 1e9).round() as i64);
        let camera = model(path, yaml.camera, "distortion_coeffs")?;
        cameras.push(ChainCamera { name, camera, body_from_camera, shift, topic: yaml.rostopic });
    }
    if cameras.is_empty() {
        return Err(absent(path, "cam0", "the calibration of the first camera"));
    }
    Ok(cameras)
}

#[derive(Deserialize)]
struct UnitYaml {
    rostopic: Option<String>,
    #[serde(flatten)]
    noise: ImuYaml,
}

#[derive(Deserialize)]
struct ResultYaml {
    imu0: Option<UnitYaml>,
}

/// Reads the noise of the inertial unit and its topic, from what Kalibr is given or from what it writes (below `imu0`).
///
/// # Errors
/// When a density is missing or not positive.
pub(crate) fn imu_from(path: &Path, text: &str) -> Result<(ImuCalibration, Option<String>), Fault> {
    let unit = match parse::<ResultYaml>(path, text)?.imu0 {
        Some(unit) => unit,
        None => parse::<UnitYaml>(path, text)?,
    };
    Ok((ImuCalibration { noise: noise(path, &unit.noise)?, body_from_imu: Isometry3::identity() }, unit.rostopic))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// The example of Kalibr's wiki for its first camera, and a second one given by the first.
    const CHAIN: &str = "cam0:
  camera_model: pinhole
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  distortion_model: radtan
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
  T_cam_imu:
  - [0.01779318, 0.99967549,-0.01822936, 0.07008565]
  - [-0.9998017, 0.01795239, 0.00860714,-0.01771023]
  - [0.00893160, 0.01807260, 0.99979678, 0.00399246]
  - [0.0, 0.0, 0.0, 1.0]
  timeshift_cam_imu: -8.121e-05
  rostopic: /cam0/image_raw
  resolution: [752, 480]
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
";

    #[test]
    fn a_chain_maps_the_unit_into_the_camera_and_shifts_its_clock() {
        let cameras = cameras_from(Path::new("camchain.yaml"), CHAIN).unwrap();
        let [camera] = <[ChainCamera; 1]>::try_from(cameras).unwrap();
        // The origin of the unit lies at the translation of T_cam_imu in the camera.
        let origin = camera.body_from_camera.inverse() * Point3::origin();
        assert!((origin - Point3::new(0.07008565, -0.01771023, 0.00399246)).norm() < 1e-12, "{origin}");
        // A point on the unit's x axis moves in the camera by the first column of the rotation, which is rounded to eight digits.
        let along_x = camera.body_from_camera.inverse() * Point3::new(1.0, 0.0, 0.0) - origin;
        assert!((along_x.y + 0.9998017).abs() < 1e-4, "{along_x}");
        assert_eq!(camera.shift, Span::from_nanos(-81_210));
        assert_eq!(camera.topic.as_deref(), Some("/cam0/image_raw"));
        let is_given =
            |model: &CameraModel<f64>| matches!(model, CameraModel::PinholeRadTan(model) if model.focal_px == [461.629, 460.152]);
        assert!(is_given(&camera.camera), "{:?}", camera.camera);
    }

    #[test]
    fn the_noise_is_read_as_given_and_as_written() {
        let given = "rostopic: /imu0\nupdate_rate: 200.0\naccelerometer_noise_density: 0.002\naccelerometer_random_walk: 0.003\n\
                     gyroscope_noise_density: 1.7e-04\ngyroscope_random_walk: 1.9e-05\n";
        let written =
            format!("imu0:\n  T_i_b:\n  - [1.0, 0.0, 0.0, 0.0]\n  model: calibrated\n  {}", given.trim_end().replace('\n', "\n  "));
        let path = Path::new("imu.yaml");
        let (imu, topic) = imu_from(path, given).unwrap();
        assert_eq!((imu.noise.accel_noise_density, imu.noise.gyro_random_walk, topic.as_deref()), (0.002, 1.9e-5, Some("/imu0")));
        assert_eq!(imu_from(path, &written).unwrap().0, imu);
        let fault = imu_from(path, "rostopic: /imu0\n").unwrap_err();
        assert!(fault.to_string().contains("gyroscope_noise_density"), "{fault}");
    }

    #[test]
    fn chains_that_describe_no_camera_are_refused() {
        for (from, to, word) in [
            ("T_cam_imu", "T_cam", "imucam"),
            ("-8.121e-05", "81210", "timeshift"),
            ("0.99979678, 0.00399246]", "0.99979678]", "row of T_cam_imu"),
            ("pinhole\n  intrinsics", "omni\n  intrinsics", "omni"),
            ("0.01779318,", "0.9,", "rigid"),
            ("[752, 480]", "[752]", "resolution"),
            ("cam0:", "", "not a calibration"),
        ] {
            assert!(CHAIN.contains(from));
            let fault = cameras_from(Path::new("camchain.yaml"), &CHAIN.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(fault.contains(word) && fault.starts_with("camchain.yaml") && !fault.contains('\n'), "{fault}");
        }
    }
}
