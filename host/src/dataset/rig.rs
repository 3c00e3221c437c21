//! Where a recording's calibration is found: told, in the recording, or beside it.
//!
//! A place holds a calibration as ASL writes it, `cam0/sensor.yaml` and `imu0/sensor.yaml` (`mav0` before them or not), or as Kalibr
//! does, a `.yaml` with `camchain` in its name and one for the inertial unit, `imu` in its name. TUM-VI keeps the latter in `dso`.

use std::path::Path;

use libella_core::camera::CameraModel;
use libella_core::time::Span;
use nalgebra::Isometry3;

use super::files::Files;
use crate::calibration::{ImuCalibration, Rig, SENSOR_REMEDY, camera_from, imu_from, kalibr};
use crate::fault::{Fault, FaultKind};

/// What a place says of the sensors.
#[derive(Debug)]
pub(super) struct Calibration {
    cameras: Vec<CalibratedCamera>,
    /// The inertial unit.
    pub(super) imu: ImuCalibration,
    /// The topic of its samples.
    pub(super) imu_topic: Option<String>,
}

/// A camera that can be used.
#[derive(Debug)]
pub(super) struct CalibratedCamera {
    camera: CameraModel<f64>,
    body_from_camera: Isometry3<f64>,
    /// What is added to its stamps to have those of the inertial unit.
    pub(super) shift: Span,
    /// The topic of its images.
    pub(super) topic: Option<String>,
    /// The file that says so, for messages.
    pub(super) source: String,
}

impl Calibration {
    /// The camera whose images are at a topic; without topics, or where the only camera has another one, the first.
    pub(super) fn camera(&self, topic: Option<&str>) -> Result<&CalibratedCamera, Fault> {
        let named = self.cameras.iter().find(|camera| topic.is_some() && camera.topic.as_deref() == topic);
        if let (Some(topic), None, true) =
            (topic, named, self.cameras.len() > 1 && self.cameras.iter().any(|camera| camera.topic.is_some()))
        {
            let topics: Vec<_> = self.cameras.iter().filter_map(|camera| camera.topic.as_deref()).collect();
            let what = format!("no camera of the calibration has the topic `{topic}`, they have `{}`", topics.join("`, `"));
            return Err(Fault::new(FaultKind::Configuration, what, "correct `rostopic` in the camchain, or choose another --image-topic"));
        }
        named.or_else(|| self.cameras.first()).ok_or_else(|| Fault::new(FaultKind::Missing, "the calibration has no camera", SENSOR_REMEDY))
    }

    /// The topic of the first camera.
    pub(super) fn image_topic(&self) -> Option<&str> {
        self.cameras.first().and_then(|camera| camera.topic.as_deref())
    }

    /// One of the cameras beside the inertial unit.
    pub(super) fn rig(&self, camera: &CalibratedCamera) -> Rig {
        Rig {
            camera: camera.camera,
            body_from_camera: self.imu.body_from_imu.inverse() * camera.body_from_camera,
            imu_noise: self.imu.noise,
        }
    }
}

/// The calibration for a folder of images, or for an archive of one.
pub(super) fn of_folder(files: &Files, root: &str, told: Option<&Path>) -> Result<Calibration, Fault> {
    if let Some(folder) = told {
        return of_told(folder);
    }
    let parent = root.trim_end_matches('/').rfind('/').map_or("", |slash| &root[..=slash]);
    let surroundings = files.surroundings();
    let dso = format!("{parent}dso/");
    let mut places = vec![(files, root), (files, parent), (files, &dso)];
    // A folder that is itself `mav0` has its calibration outside.
    places.push((&surroundings, ""));
    if root.is_empty() {
        places.push((&surroundings, "dso/"));
    }
    match first(&places)? {
        Some(found) => Ok(found),
        None => Err(Fault::missing(&files.path(&format!("{root}cam0/sensor.yaml")), "there is no such file", SENSOR_REMEDY)),
    }
}

/// The calibration for a bag.
pub(super) fn of_bag(path: &Path, told: Option<&Path>) -> Result<Calibration, Fault> {
    if let Some(folder) = told {
        return of_told(folder);
    }
    let bag = Files::Folder(path.to_path_buf());
    let (inside, beside) = (bag.clone(), bag.surroundings());
    match first(&[(&inside, ""), (&beside, ""), (&beside, "mav0/")])? {
        Some(found) => Ok(found),
        None => {
            let what = "has no calibration beside it, and bags hold none";
            let remedy = "put Kalibr's camchain.yaml and imu.yaml, or ASL's cam0/sensor.yaml and imu0/sensor.yaml, into a folder and give it \
                          with --calibration";
            Err(Fault::missing(path, what, remedy))
        }
    }
}

fn of_told(folder: &Path) -> Result<Calibration, Fault> {
    const REMEDY: &str = "give a folder with Kalibr's camchain.yaml and imu.yaml, or with ASL's cam0/sensor.yaml and imu0/sensor.yaml";
    if !folder.is_dir() {
        return Err(Fault::missing(folder, "there is no such folder of a calibration", REMEDY));
    }
    let files = Files::Folder(folder.to_path_buf());
    first(&[(&files, ""), (&files, "mav0/"), (&files, "dso/")])?.ok_or_else(|| Fault::missing(folder, "holds no calibration", REMEDY))
}

/// The calibration of the first place that has one.
fn first(places: &[(&Files, &str)]) -> Result<Option<Calibration>, Fault> {
    for (files, folder) in places {
        let camera = format!("{folder}cam0/sensor.yaml");
        if files.has(&camera) {
            return asl(files, folder).map(Some);
        }
        if let Some(chain) = choose(files, folder, |name| name.contains("camchain"), "imucam")? {
            return kalibr(files, folder, &chain).map(Some);
        }
    }
    Ok(None)
}

fn asl(files: &Files, folder: &str) -> Result<Calibration, Fault> {
    let text = |name: &str| Ok((files.path(name), files.text(name, SENSOR_REMEDY)?));
    let (path, yaml) = text(&format!("{folder}cam0/sensor.yaml"))?;
    let camera = camera_from(&path, &yaml)?;
    let (path, yaml) = text(&format!("{folder}imu0/sensor.yaml"))?;
    let imu = imu_from(&path, &yaml)?;
    let camera = CalibratedCamera {
        camera: camera.camera,
        body_from_camera: camera.body_from_camera,
        shift: Span::default(),
        topic: None,
        source: "cam0/sensor.yaml".into(),
    };
    Ok(Calibration { cameras: vec![camera], imu, imu_topic: None })
}

fn kalibr(files: &Files, folder: &str, chain: &str) -> Result<Calibration, Fault> {
    let is_imu = |name: &str| name.contains("imu") && !name.contains("camchain") && !name.contains("result") && !name.contains("report");
    let remedy = "put the file with the noise of the inertial unit beside it, named imu.yaml";
    let Some(unit) = choose(files, folder, is_imu, "imu.yaml")? else {
        return Err(Fault::missing(&files.path(&format!("{folder}imu.yaml")), "there is no such file beside the camchain", remedy));
    };
    let name = format!("{folder}{chain}");
    let chain_path = files.path(&name);
    let cameras = kalibr::cameras_from(&chain_path, &files.text(&name, remedy)?)?;
    let name = format!("{folder}{unit}");
    let (imu, imu_topic) = kalibr::imu_from(&files.path(&name), &files.text(&name, remedy)?)?;
    let cameras = cameras
        .into_iter()
        .map(|camera| CalibratedCamera {
            camera: camera.camera,
            body_from_camera: camera.body_from_camera,
            shift: camera.shift,
            topic: camera.topic,
            source: format!("{chain} ({})", camera.name),
        })
        .collect();
    Ok(Calibration { cameras, imu, imu_topic })
}

/// The yaml file of a folder that is meant; of several the one whose name holds a certain word.
fn choose(files: &Files, folder: &str, is_meant: impl Fn(&str) -> bool, preferred: &str) -> Result<Option<String>, Fault> {
    let mut names = files.names_in(folder);
    names.retain(|name| (name.ends_with(".yaml") || name.ends_with(".yml")) && is_meant(name));
    if names.len() > 1 && names.iter().filter(|name| name.contains(preferred)).count() == 1 {
        names.retain(|name| name.contains(preferred));
    }
    match &names[..] {
        [] => Ok(None),
        [name] => Ok(Some(name.clone())),
        [first, second, ..] => {
            let what = format!("`{first}` and `{second}` may both be meant");
            Err(Fault::malformed(&files.path(folder), what, "move one away, or give a folder with one of them with --calibration"))
        }
    }
}

/// Refuses an image of another size than the calibration's.
pub(super) fn check_size(image: &Path, size_px: (u32, u32), rig: &Rig, calibration: &str) -> Result<(), Fault> {
    let expected = rig.size_px();
    if size_px == expected {
        return Ok(());
    }
    let what = format!("image is {}x{} where {calibration} says {}x{}", size_px.0, size_px.1, expected.0, expected.1);
    Err(Fault::malformed(image, what, "use the calibration of this camera at this resolution"))
}
