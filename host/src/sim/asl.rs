//! A rendered flight as a EuRoC folder.
//!
//! ```text
//! mav0/cam0/{data.csv, sensor.yaml, data/<stamp>.png}          8-bit grey
//! mav0/cam0/depth/<stamp>.png                                  16-bit, millimetres along the optical axis, 0 = unknown
//! mav0/cam1/...                                                the right camera, if asked for
//! mav0/imu0/{data.csv, sensor.yaml}
//! mav0/state_groundtruth_estimate0/data.csv                    17 columns
//! mav0/planes.json                                             every rectangle of the room as a plane with its polygon,
//!                                                              without those of moving objects
//! ```

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::sync::mpsc::sync_channel;

use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use libella_core::imu::{ImuNoise, ImuSample};
use libella_core::time::Timestamp;

use super::render::DepthMap;
use super::scene::Scene;
use super::stream::RenderedFlight;
use super::{SimError, TruthState, euroc};
use crate::dataset::GrayImage;

/// What goes into the folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AslOptions {
    /// Also the right camera.
    pub right_camera: bool,
    /// Also the depth maps of the left camera.
    pub depth: bool,
}

impl Default for AslOptions {
    fn default() -> Self {
        Self { right_camera: false, depth: true }
    }
}

/// Writes a flight as a EuRoC folder; `progress` hears after each image how many of how many are done, and stops the writing by
/// returning `false`; the tables of images then end with the last one that is there.
///
/// # Errors
/// A file that cannot be written, or a parameter out of range.
pub fn write_asl(
    folder: &Path,
    rendered: &RenderedFlight,
    options: &AslOptions,
    progress: &mut dyn FnMut(usize, usize) -> bool,
) -> Result<(), SimError> {
    let mav0 = folder.join("mav0");
    let cameras: &[usize] = if options.right_camera { &[0, 1] } else { &[0] };
    let renderers = cameras.iter().map(|camera| rendered.renderer(*camera)).collect::<Result<Vec<_>, _>>()?;
    let stamps = &rendered.flight.frame_stamps;
    for camera in cameras {
        let base = mav0.join(format!("cam{camera}"));
        create(&base.join("data"))?;
        write(&base.join("sensor.yaml"), camera_yaml(*camera).as_bytes())?;
        write(&base.join("data.csv"), image_table(stamps).as_bytes())?;
    }
    if options.depth {
        create(&mav0.join("cam0/depth"))?;
    }
    create(&mav0.join("imu0"))?;
    write(&mav0.join("imu0/sensor.yaml"), imu_yaml(&rendered.flight.imu_noise).as_bytes())?;
    write(&mav0.join("imu0/data.csv"), imu_table(&rendered.flight.imu).as_bytes())?;
    create(&mav0.join("state_groundtruth_estimate0"))?;
    write(&mav0.join("state_groundtruth_estimate0/data.csv"), truth_table(&rendered.flight.truth).as_bytes())?;
    write(&mav0.join("planes.json"), planes_json(&rendered.world.scene).as_bytes())?;

    // One thread compresses while the others render.
    let (sender, receiver) = sync_channel::<(std::path::PathBuf, Picture)>(4);
    let mut written = 0;
    std::thread::scope(|scope| {
        let writer = scope.spawn(move || {
            for (path, picture) in receiver {
                picture.write(&path)?;
            }
            Ok(())
        });
        'flight: for (index, stamp) in stamps.iter().enumerate() {
            for (camera, renderer) in cameras.iter().zip(&renderers) {
                let Some(image) = rendered.image(renderer, index) else { break 'flight };
                let path = mav0.join(format!("cam{camera}/data/{}.png", stamp.as_nanos()));
                if sender.send((path, Picture::Gray(image))).is_err() {
                    break 'flight;
                }
            }
            if options.depth
                && let Some(renderer) = renderers.first()
            {
                let pose = rendered.flight.world_from_camera(*stamp, renderer.body_from_camera());
                let path = mav0.join(format!("cam0/depth/{}.png", stamp.as_nanos()));
                if sender.send((path, Picture::Depth(renderer.depth(&pose, (*stamp - rendered.flight.epoch).as_seconds())))).is_err() {
                    break 'flight;
                }
            }
            written = index + 1;
            if !progress(written, stamps.len()) {
                break;
            }
        }
        drop(sender);
        writer.join().unwrap_or_else(|_| Err(SimError::file(folder, "the writing thread ended")))
    })?;
    for camera in cameras.iter().filter(|_| written < stamps.len()) {
        write(&mav0.join(format!("cam{camera}/data.csv")), image_table(&stamps[..written]).as_bytes())?;
    }
    Ok(())
}

/// What the writing thread gets.
enum Picture {
    Gray(GrayImage),
    Depth(DepthMap),
}

impl Picture {
    fn write(&self, path: &Path) -> Result<(), SimError> {
        let mut bytes = Vec::new();
        let (pixels, width, height, color) = match self {
            Self::Gray(image) => (image.pixels.clone(), image.width, image.height, image::ExtendedColorType::L8),
            Self::Depth(map) => (millimetres(map), map.width, map.height, image::ExtendedColorType::L16),
        };
        let size = [width, height].map(|side| u32::try_from(side).unwrap_or(0));
        PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub)
            .write_image(&pixels, size[0], size[1], color)
            .map_err(|error| SimError::file(path, error))?;
        write(path, &bytes)
    }
}

/// Native-endian bytes of the depths in whole millimetres; 0 where there is nothing or beyond 65.535 m.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn millimetres(map: &DepthMap) -> Vec<u8> {
    map.depth_m
        .iter()
        .map(|depth| (depth * 1000.0).round())
        .map(|depth| if depth > 0.0 && depth < 65535.5 { depth as u16 } else { 0 })
        .flat_map(u16::to_ne_bytes)
        .collect()
}

fn create(folder: &Path) -> Result<(), SimError> {
    std::fs::create_dir_all(folder).map_err(|error| SimError::file(folder, error))
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), SimError> {
    std::fs::File::create(path).and_then(|mut file| file.write_all(bytes)).map_err(|error| SimError::file(path, error))
}

fn image_table(stamps: &[Timestamp]) -> String {
    let mut text = String::from("#timestamp [ns],filename\n");
    for stamp in stamps {
        let _ = writeln!(text, "{0},{0}.png", stamp.as_nanos());
    }
    text
}

fn imu_table(samples: &[ImuSample<f64>]) -> String {
    let mut text = String::from(
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n",
    );
    for sample in samples {
        let (w, a) = (&sample.gyro_rad_s, &sample.accel_m_s2);
        // The shortest digits that read back as the same number.
        let _ = writeln!(text, "{},{},{},{},{},{},{}", sample.stamp.as_nanos(), w.x, w.y, w.z, a.x, a.y, a.z);
    }
    text
}

fn truth_table(truth: &[TruthState]) -> String {
    let mut text = String::from(
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], \
         v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], \
         b_a_RS_S_z [m s^-2]\n",
    );
    for row in truth {
        let state = &row.state;
        let q = state.world_from_body.quaternion();
        let _ = write!(text, "{}", row.stamp.as_nanos());
        let vectors = [&state.velocity_in_world, &state.bias.gyro_rad_s, &state.bias.accel_m_s2];
        let values = state.position_in_world.iter().copied().chain([q.w, q.i, q.j, q.k]).chain(vectors.into_iter().flatten().copied());
        for value in values {
            let _ = write!(text, ",{value:.9}");
        }
        text.push('\n');
    }
    text
}

fn camera_yaml(index: usize) -> String {
    let camera = euroc::pinhole(index);
    let rows = euroc::extrinsic_rows(index).map(|row| row.map(|value| value.to_string()).join(", "));
    format!(
        "# General sensor definitions.\nsensor_type: camera\ncomment: rendered, calibration of EuRoC cam{index}\n\n\
         # Sensor extrinsics wrt. the body-frame.\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{},\n         {},\n         {},\n         0.0, 0.0, 0.0, 1.0]\n\n\
         # Camera specific definitions.\nrate_hz: 20\nresolution: [{}, {}]\ncamera_model: pinhole\nintrinsics: [{}, {}, {}, {}] #fu, fv, cu, cv\n\
         distortion_model: radial-tangential\ndistortion_coefficients: [{}, {}, {}, {}]\n",
        rows[0],
        rows[1],
        rows[2],
        camera.size_px.0,
        camera.size_px.1,
        camera.focal_px[0],
        camera.focal_px[1],
        camera.center_px[0],
        camera.center_px[1],
        camera.distortion[0],
        camera.distortion[1],
        camera.distortion[2],
        camera.distortion[3],
    )
}

fn imu_yaml(noise: &ImuNoise<f64>) -> String {
    format!(
        "#Default imu sensor yaml file\nsensor_type: imu\ncomment: as EuRoC's ADIS16448\n\n# Sensor extrinsics wrt. the body-frame.\nT_BS:\n  cols: 4\n  \
         rows: 4\n  data: [1.0, 0.0, 0.0, 0.0,\n         0.0, 1.0, 0.0, 0.0,\n         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\nrate_hz: 200\n\n\
         # inertial sensor noise model parameters (static)\ngyroscope_noise_density: {:e}     # [ rad / s / sqrt(Hz) ]\n\
         gyroscope_random_walk: {:e}       # [ rad / s^2 / sqrt(Hz) ]\naccelerometer_noise_density: {:e}  # [ m / s^2 / sqrt(Hz) ]\n\
         accelerometer_random_walk: {:e}    # [ m / s^3 / sqrt(Hz) ]\n",
        noise.gyro_noise_density, noise.gyro_random_walk, noise.accel_noise_density, noise.accel_random_walk
    )
}

/// The rectangles as planes `nᵀx = d` in world, with polygons (m). Only what stands still is a plane of the room: moving objects are
/// in the pictures and the depth maps, not here.
#[must_use]
pub fn planes_json(scene: &Scene) -> String {
    let planes: Vec<String> = scene
        .quads
        .iter()
        .enumerate()
        .map(|(id, quad)| {
            let vector = |v: &nalgebra::Vector3<f64>| format!("[{:.9}, {:.9}, {:.9}]", v.x, v.y, v.z);
            let polygon: Vec<String> = quad.polygon().iter().map(vector).collect();
            format!(
                "    {{\"id\": {id}, \"material\": \"{}\", \"normal\": {}, \"offset_m\": {:.9}, \"polygon\": [{}]}}",
                quad.material.name(),
                vector(&quad.normal),
                quad.offset_m(),
                polygon.join(", ")
            )
        })
        .collect();
    format!("{{\n  \"planes\": [\n{}\n  ]\n}}\n", planes.join(",\n"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::sim::stream::MotionSource;
    use crate::sim::{AnalyticConfig, Furnishing, ImuConfig, MotionKind, RenderConfig};
    use std::sync::{Arc, OnceLock};

    /// One second; baked once for all tests.
    fn short() -> Arc<RenderedFlight> {
        static FLIGHT: OnceLock<Arc<RenderedFlight>> = OnceLock::new();
        Arc::clone(FLIGHT.get_or_init(|| Arc::new(fly())))
    }

    fn fly() -> RenderedFlight {
        let motion = AnalyticConfig { kind: MotionKind::Easy, duration_s: 1.0, rest_s: 0.0, ..AnalyticConfig::default() };
        RenderedFlight::new(&MotionSource::Analytic(motion, ImuConfig::default()), &RenderConfig::default(), 3, 3).unwrap()
    }

    #[test]
    fn what_is_written_reads_back() {
        let rendered = short();
        let folder = tempfile::tempdir().unwrap();
        let mut heard = Vec::new();
        write_asl(folder.path(), &rendered, &AslOptions { right_camera: true, depth: true }, &mut |done, all| {
            heard.push((done, all));
            true
        })
        .unwrap();
        assert_eq!(heard, (1..=21).map(|done| (done, 21)).collect::<Vec<_>>());

        let read = euroc::RecordedMotion::read(folder.path()).unwrap();
        assert_eq!(read.imu, rendered.flight.imu);
        assert_eq!(read.frame_stamps, rendered.flight.frame_stamps);
        for (row, truth) in read.truth.iter().zip(&rendered.flight.truth) {
            assert!((row.position_in_world - truth.state.position_in_world).norm() < 1e-8);
            assert!(row.world_from_body.angle_to(&truth.state.world_from_body) < 1e-7);
            assert!((row.bias.gyro_rad_s - truth.state.bias.gyro_rad_s).norm() < 1e-8);
        }
        // The reader of recordings finds nothing odd about it, and the same rig.
        let recording = crate::dataset::open(folder.path(), &crate::config::DatasetSection::default()).unwrap();
        assert!(recording.remarks.is_empty(), "{:?}", recording.remarks);
        assert_eq!((recording.imu.len(), recording.frames.len()), (201, 21));
        assert_eq!(recording.rig.camera, euroc::camera(0));
        assert_eq!(recording.rig.imu_noise, rendered.flight.imu_noise);
        let difference = recording.rig.body_from_camera.to_homogeneous() - euroc::body_from_camera(0).to_homogeneous();
        assert!(difference.norm() < 1e-9, "{difference}");
        assert!(recording.truth_is_level && recording.truth.is_some());
        // The file holds the very pixels of the stream, and the depth in millimetres.
        let second = rendered.flight.frame_stamps[1];
        let (stamp, streamed) = rendered.stream().unwrap().nth(1).unwrap();
        assert_eq!(stamp, second);
        let open = |name: &str| image::open(folder.path().join(format!("mav0/{name}/{}.png", second.as_nanos()))).unwrap();
        assert_eq!(open("cam0/data").into_luma8().into_raw(), streamed.pixels);
        assert_ne!(open("cam1/data").into_luma8().into_raw(), streamed.pixels);
        let renderer = rendered.renderer(0).unwrap();
        let depth = renderer.depth(&rendered.flight.world_from_camera(second, renderer.body_from_camera()), 0.05);
        let stored = open("cam0/depth").into_luma16().into_raw();
        assert!(stored.iter().zip(&depth.depth_m).all(|(stored, exact)| (f64::from(*stored) - exact * 1e3).abs() <= 0.5 + 1e-9));
    }

    #[test]
    fn same_seed_same_folder_on_any_number_of_threads() {
        let folders = [RenderConfig::default().threads.max(2), 1].map(|threads| {
            let render = RenderConfig { threads, ..RenderConfig::default() };
            let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s: 1.0, rest_s: 0.0, ..AnalyticConfig::default() };
            let source = MotionSource::Analytic(motion, ImuConfig::default());
            let rendered = RenderedFlight::furnished(&source, &render, 5, 6, Furnishing { movers: 3, is_bare: false }).unwrap();
            let folder = tempfile::tempdir().unwrap();
            let options = AslOptions { right_camera: true, depth: true };
            write_asl(folder.path(), &rendered, &options, &mut |done, _| done < 4).unwrap();
            folder
        });
        let mut compared = 0;
        let mut rest = vec![std::path::PathBuf::from("mav0")];
        while let Some(below) = rest.pop() {
            let [one, two] = [&folders[0], &folders[1]].map(|folder| folder.path().join(&below));
            if one.is_dir() {
                rest.extend(std::fs::read_dir(one).unwrap().map(|entry| below.join(entry.unwrap().file_name())));
                continue;
            }
            assert!(std::fs::read(one).unwrap() == std::fs::read(two).unwrap(), "{}", below.display());
            compared += 1;
        }
        // Four images of two cameras, four depth maps, and eight tables.
        assert_eq!(compared, 4 * 3 + 8);
    }

    #[test]
    fn writing_stops_when_nobody_wants_more() {
        let folder = tempfile::tempdir().unwrap();
        write_asl(folder.path(), &short(), &AslOptions { right_camera: false, depth: false }, &mut |done, _| done < 2).unwrap();
        assert_eq!(std::fs::read_dir(folder.path().join("mav0/cam0/data")).unwrap().count(), 2);
        let recording = crate::dataset::open(folder.path(), &crate::config::DatasetSection::default()).unwrap();
        assert_eq!(recording.frames.len(), 2);
    }

    #[test]
    fn planes_are_json_with_every_rectangle() {
        let rendered = short();
        let json: serde_json::Value = serde_json::from_str(&planes_json(&rendered.world.scene)).unwrap();
        let planes = json["planes"].as_array().unwrap();
        assert_eq!(planes.len(), rendered.world.scene.quads.len());
        for plane in planes {
            let number = |value: &serde_json::Value| value.as_f64().unwrap();
            for corner in plane["polygon"].as_array().unwrap() {
                let distance: f64 =
                    (0..3).map(|k| number(&plane["normal"][k]) * number(&corner[k])).sum::<f64>() - number(&plane["offset_m"]);
                assert!(distance.abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = write_asl(file.path(), &short(), &AslOptions::default(), &mut |_, _| true).err().unwrap();
        assert!(error.to_string().contains(file.path().to_str().unwrap()), "{error}");
    }
}
