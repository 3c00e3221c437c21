//! `sensor.yaml` of the EuRoC/ASL layout: units and names of the file become types and SI units here, once.
//!
//! # Model
//! `T_BS` maps sensor coordinates to body coordinates. The estimator's body is the inertial unit, so
//! `body_from_camera = T_B_imu⁻¹ T_B_cam`; in EuRoC `T_B_imu` is the identity.

use std::path::Path;

use libella_core::camera::{CameraModel, KannalaBrandt, PinholeRadTan};
use libella_core::imu::ImuNoise;
use libella_core::real::Real;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use serde::Deserialize;

use crate::fault::{Fault, read_text};

pub(crate) mod kalibr;

/// One camera beside one inertial unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// The camera's model.
    pub camera: CameraModel<f64>,
    /// Maps camera coordinates to those of the inertial unit.
    pub body_from_camera: Isometry3<f64>,
    /// Noise of the inertial unit, as its maker or an Allan plot gives it.
    pub imu_noise: ImuNoise<f64>,
}

impl Rig {
    /// The sensor head of EuRoC (cam0 and ADIS16448), as the dataset's `sensor.yaml` files state it.
    #[must_use]
    pub fn euroc() -> Self {
        let camera = CameraModel::PinholeRadTan(PinholeRadTan {
            size_px: (752, 480),
            focal_px: [458.654, 457.296],
            center_px: [367.215, 248.375],
            distortion: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
        });
        #[rustfmt::skip]
        let rotation = Matrix3::new(
            0.0148655429818, -0.999880929698, 0.00414029679422,
            0.999557249008, 0.0149672133247, 0.025715529948,
            -0.0257744366974, 0.00375618835797, 0.999660727178,
        );
        let body_from_camera = rigid(&rotation, [-0.0216401454975, -0.064676986768, 0.00981073058949]);
        Self { camera, body_from_camera, imu_noise: ImuNoise::adis16448() }
    }

    /// Width and height of the images, px.
    #[must_use]
    pub fn size_px(&self) -> (u32, u32) {
        match &self.camera {
            CameraModel::PinholeRadTan(camera) => camera.size_px,
            CameraModel::KannalaBrandt(camera) => camera.size_px,
        }
    }

    /// The camera in another scalar.
    #[must_use]
    pub fn camera_as<T: Real>(&self) -> CameraModel<T> {
        match &self.camera {
            CameraModel::PinholeRadTan(camera) => CameraModel::PinholeRadTan(PinholeRadTan {
                size_px: camera.size_px,
                focal_px: camera.focal_px.map(T::of),
                center_px: camera.center_px.map(T::of),
                distortion: camera.distortion.map(T::of),
            }),
            CameraModel::KannalaBrandt(camera) => CameraModel::KannalaBrandt(KannalaBrandt {
                size_px: camera.size_px,
                focal_px: camera.focal_px.map(T::of),
                center_px: camera.center_px.map(T::of),
                distortion: camera.distortion.map(T::of),
            }),
        }
    }

    /// The extrinsics in another scalar.
    #[must_use]
    pub fn body_from_camera_as<T: Real>(&self) -> Isometry3<T> {
        let q = self.body_from_camera.rotation.quaternion();
        let rotation = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(T::of(q.w), T::of(q.i), T::of(q.j), T::of(q.k)));
        Isometry3::from_parts(Translation3::from(self.body_from_camera.translation.vector.map(T::of)), rotation)
    }
}

/// A camera and its pose on the body.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraCalibration {
    /// The camera's model.
    pub camera: CameraModel<f64>,
    /// Maps camera coordinates to those of the body.
    pub body_from_camera: Isometry3<f64>,
}

/// An inertial unit and its pose on the body.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuCalibration {
    /// Noise densities.
    pub noise: ImuNoise<f64>,
    /// Maps coordinates of the inertial unit to those of the body; mostly the identity.
    pub body_from_imu: Isometry3<f64>,
}

#[derive(Deserialize)]
struct MatrixYaml {
    data: Vec<f64>,
}

#[derive(Deserialize)]
struct ExtrinsicsYaml {
    #[serde(rename = "T_BS")]
    extrinsics: Option<MatrixYaml>,
}

#[derive(Deserialize)]
struct CameraYaml {
    #[serde(rename = "T_BS")]
    extrinsics: Option<MatrixYaml>,
    resolution: Option<Vec<u32>>,
    camera_model: Option<String>,
    intrinsics: Option<Vec<f64>>,
    distortion_model: Option<String>,
    #[serde(alias = "distortion_coeffs")]
    distortion_coefficients: Option<Vec<f64>>,
}

#[derive(Deserialize)]
struct ImuYaml {
    #[serde(rename = "T_BS")]
    extrinsics: Option<MatrixYaml>,
    gyroscope_noise_density: Option<f64>,
    gyroscope_random_walk: Option<f64>,
    accelerometer_noise_density: Option<f64>,
    accelerometer_random_walk: Option<f64>,
}

/// Reads a camera's `sensor.yaml`.
///
/// # Errors
/// When the file is absent or damaged, a key is missing, or its numbers describe no camera.
pub fn read_camera(path: &Path) -> Result<CameraCalibration, Fault> {
    camera_from(path, &read_text(path, SENSOR_REMEDY)?)
}

/// A camera from the text of its `sensor.yaml`.
pub(crate) fn camera_from(path: &Path, text: &str) -> Result<CameraCalibration, Fault> {
    let yaml: CameraYaml = parse(path, text)?;
    let extrinsics = yaml.extrinsics.as_ref().map(|matrix| pose(path, "T_BS", &matrix.data)).transpose()?;
    let camera = model(path, yaml, "distortion_coefficients")?;
    let body_from_camera = extrinsics.ok_or_else(|| absent(path, "T_BS", "the 4x4 matrix that maps camera to body coordinates"))?;
    Ok(CameraCalibration { camera, body_from_camera })
}

/// The camera's model out of the keys that ASL and Kalibr share.
fn model(path: &Path, yaml: CameraYaml, coefficients_key: &str) -> Result<CameraModel<f64>, Fault> {
    let size = yaml.resolution.ok_or_else(|| absent(path, "resolution", "[width, height] in pixels"))?;
    let [width, height] = size[..] else { return Err(miscounted(path, "resolution", size.len(), 2)) };
    if width == 0 || height == 0 {
        return Err(Fault::malformed(path, format!("resolution is {width}x{height}"), "give the size of the images in pixels"));
    }
    let intrinsics = yaml.intrinsics.ok_or_else(|| absent(path, "intrinsics", "[fu, fv, cu, cv] in pixels"))?;
    let [fu, fv, cu, cv] = intrinsics[..] else { return Err(miscounted(path, "intrinsics", intrinsics.len(), 4)) };
    all_finite(path, "intrinsics", &intrinsics)?;
    if fu <= 0.0 || fv <= 0.0 {
        return Err(Fault::malformed(
            path,
            format!("focal lengths {fu} and {fv} px are not positive"),
            "give intrinsics as [fu, fv, cu, cv]",
        ));
    }
    let coefficients = yaml
        .distortion_coefficients
        .ok_or_else(|| absent(path, coefficients_key, "[k1, k2, p1, p2], four zeros for images without distortion"))?;
    let distortion: [f64; 4] = match coefficients[..] {
        [] if yaml.distortion_model.as_deref() == Some("none") => [0.0; 4],
        [a, b, c, d] => [a, b, c, d],
        // OpenCV writes k3 as a fifth coefficient; the model here ends before it.
        [a, b, c, d, 0.0] => [a, b, c, d],
        _ => return Err(miscounted(path, coefficients_key, coefficients.len(), 4)),
    };
    all_finite(path, coefficients_key, &distortion)?;
    if let Some(model) = yaml.camera_model.as_deref().filter(|model| *model != "pinhole") {
        return Err(Fault::malformed(path, format!("camera_model `{model}` is not supported"), "use `pinhole` with a distortion_model"));
    }
    let model = yaml.distortion_model.ok_or_else(|| absent(path, "distortion_model", "`radial-tangential` or `equidistant`"))?;
    let (size_px, focal_px, center_px) = ((width, height), [fu, fv], [cu, cv]);
    match model.as_str() {
        "radial-tangential" | "radtan" | "plumb_bob" | "none" => {
            Ok(CameraModel::PinholeRadTan(PinholeRadTan { size_px, focal_px, center_px, distortion }))
        }
        "equidistant" | "fisheye" => Ok(CameraModel::KannalaBrandt(KannalaBrandt { size_px, focal_px, center_px, distortion })),
        other => {
            let what = format!("distortion_model `{other}` is not supported");
            Err(Fault::malformed(path, what, "calibrate for `radial-tangential` or `equidistant`"))
        }
    }
}

/// Reads an inertial unit's `sensor.yaml`.
///
/// # Errors
/// When the file is absent or damaged, or a noise density is missing or not positive.
pub fn read_imu(path: &Path) -> Result<ImuCalibration, Fault> {
    imu_from(path, &read_text(path, SENSOR_REMEDY)?)
}

/// An inertial unit from the text of its `sensor.yaml`.
pub(crate) fn imu_from(path: &Path, text: &str) -> Result<ImuCalibration, Fault> {
    let yaml: ImuYaml = parse(path, text)?;
    let noise = noise(path, &yaml)?;
    let body_from_imu = yaml.extrinsics.map_or_else(|| Ok(Isometry3::identity()), |matrix| pose(path, "T_BS", &matrix.data))?;
    Ok(ImuCalibration { noise, body_from_imu })
}

fn noise(path: &Path, yaml: &ImuYaml) -> Result<ImuNoise<f64>, Fault> {
    let density = |key: &str, value: Option<f64>, unit: &str| -> Result<f64, Fault> {
        let value = value.ok_or_else(|| absent(path, key, unit))?;
        if value.is_finite() && value > 0.0 {
            return Ok(value);
        }
        Err(Fault::malformed(path, format!("{key} is {value}"), format!("give a positive number, {unit}")))
    };
    Ok(ImuNoise {
        gyro_noise_density: density("gyroscope_noise_density", yaml.gyroscope_noise_density, "in rad/s/sqrt(Hz)")?,
        accel_noise_density: density("accelerometer_noise_density", yaml.accelerometer_noise_density, "in m/s^2/sqrt(Hz)")?,
        gyro_random_walk: density("gyroscope_random_walk", yaml.gyroscope_random_walk, "in rad/s^2/sqrt(Hz)")?,
        accel_random_walk: density("accelerometer_random_walk", yaml.accelerometer_random_walk, "in m/s^3/sqrt(Hz)")?,
    })
}

/// Reads `T_BS` of any `sensor.yaml`: the pose of the sensor on the body, the identity where it does not say.
///
/// # Errors
/// When the file is absent or damaged, or what it says is no rigid transform.
pub fn read_extrinsics(path: &Path) -> Result<Isometry3<f64>, Fault> {
    let yaml: ExtrinsicsYaml = parse(path, &read_text(path, SENSOR_REMEDY)?)?;
    yaml.extrinsics.map_or_else(|| Ok(Isometry3::identity()), |matrix| pose(path, "T_BS", &matrix.data))
}

/// What to do where there is no calibration.
pub(crate) const SENSOR_REMEDY: &str = "every sensor folder needs its sensor.yaml: copy it from the original dataset, or give Kalibr's camchain and imu yaml with --calibration";

fn parse<D: for<'de> Deserialize<'de>>(path: &Path, text: &str) -> Result<D, Fault> {
    // OpenCV writes a `%YAML:1.0` line that no YAML standard knows, and tags of its own.
    let plain: String = text
        .lines()
        .map(|line| if line.starts_with('%') || line.trim_end() == "---" { String::new() } else { line.replace("!!opencv-matrix", "") })
        .collect::<Vec<_>>()
        .join("\n");
    serde_saphyr::from_str(&plain).map_err(|error| {
        let line = error.location().map(|location| location.line());
        let reason = error.without_snippet().to_string().replace('\n', " ");
        let mut fault = Fault::malformed(
            path,
            format!("is not a calibration ({reason})"),
            "compare it with a sensor.yaml of EuRoC or with Kalibr's wiki",
        );
        fault.line = line;
        fault
    })
}

fn absent(path: &Path, key: &str, meaning: &str) -> Fault {
    Fault::malformed(path, format!("has no `{key}`"), format!("add `{key}:` {meaning}"))
}

fn miscounted(path: &Path, key: &str, given: usize, expected: usize) -> Fault {
    Fault::malformed(path, format!("`{key}` has {given} numbers"), format!("it needs {expected}"))
}

fn all_finite(path: &Path, key: &str, values: &[f64]) -> Result<(), Fault> {
    if values.iter().all(|value| value.is_finite()) {
        return Ok(());
    }
    Err(Fault::malformed(path, format!("`{key}` holds a number that is not finite"), "calibrate again"))
}

/// A rigid transform from sixteen numbers, row by row.
fn pose(path: &Path, key: &str, data: &[f64]) -> Result<Isometry3<f64>, Fault> {
    all_finite(path, key, data)?;
    let &[a, b, c, x, d, e, f, y, g, h, i, z, ref last @ ..] = data else { return Err(miscounted(path, key, data.len(), 16)) };
    if last.len() != 4 {
        return Err(miscounted(path, key, data.len(), 16));
    }
    let rotation = Matrix3::new(a, b, c, d, e, f, g, h, i);
    let bent = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    if bent > 1e-3 || rotation.determinant() < 0.0 || last != [0.0, 0.0, 0.0, 1.0] {
        let what = format!("{key} is not a rigid transform (rotation not orthonormal, mirrored, or last row not 0 0 0 1)");
        let remedy = match key {
            "T_BS" => "write it row by row, rotation and translation in metres, mapping sensor to body",
            _ => "write it row by row, rotation and translation in metres",
        };
        return Err(Fault::malformed(path, what, remedy));
    }
    let far_m = x.hypot(y).hypot(z);
    if far_m > 20.0 {
        return Err(Fault::malformed(path, format!("{key} puts the sensor {far_m:.0} m from the body"), "give metres"));
    }
    Ok(rigid(&rotation, [x, y, z]))
}

fn rigid(rotation: &Matrix3<f64>, [x, y, z]: [f64; 3]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation));
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_normalize(rotation.into_inner()))
}
