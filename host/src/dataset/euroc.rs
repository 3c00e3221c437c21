//! The EuRoC/ASL layout: `mav0/{cam0,imu0,state_groundtruth_estimate0}`.

use std::path::{Path, PathBuf};

use super::table::rows;
use super::{Frames, ImageFile, Layout, Purpose, Recording, Remark, RemarkKind, decode, imu, remark};
use crate::calibration::{Rig, read_camera, read_imu};
use crate::config::DatasetSection;
use crate::eval::Trajectory;
use crate::fault::{Fault, read_text};

/// Opens `mav0` or its parent.
pub(super) fn open(purpose: Purpose, path: &Path, options: &DatasetSection) -> Result<Recording, Fault> {
    let root = find_root(path)?;
    let camera = read_camera(&root.join("cam0").join("sensor.yaml"))?;
    let inertial = read_imu(&root.join("imu0").join("sensor.yaml"))?;
    let rig = Rig {
        camera: camera.camera,
        body_from_camera: inertial.body_from_imu.inverse() * camera.body_from_camera,
        imu_noise: inertial.noise,
    };
    let mut remarks = Vec::new();
    let samples = imu::read(purpose, &root.join("imu0").join("data.csv"), options, &mut remarks)?;
    let images = read_images(purpose, &root.join("cam0"), &mut remarks)?;
    if purpose == Purpose::Run {
        check_size(&images, &rig)?;
    }
    let truth = read_truth(&root, &mut remarks)?.map(|truth| truth.attached(&inertial.body_from_imu));
    let listed_frames = images.len();
    let name = name_of(path, &root);
    Ok(Recording {
        name,
        layout: Layout::Euroc,
        rig,
        imu: samples,
        frames: Frames::Images(images),
        listed_frames,
        truth,
        truth_is_level: true,
        remarks,
    })
}

fn find_root(path: &Path) -> Result<PathBuf, Fault> {
    [path.join("mav0"), path.to_path_buf()].into_iter().find(|root| root.join("cam0").is_dir() || root.join("imu0").is_dir()).ok_or_else(
        || {
            let what = "is no recording: neither `mav0` with `cam0` and `imu0` nor `tracks_cam0.csv` is in it";
            Fault::missing(path, what, "give the folder of a EuRoC sequence, for example MH_01_easy")
        },
    )
}

/// The last folder name that says something.
fn name_of(path: &Path, root: &Path) -> String {
    let whole = root.canonicalize().or_else(|_| path.canonicalize()).unwrap_or_else(|_| path.to_path_buf());
    let named = whole.ancestors().filter_map(Path::file_name).map(|name| name.to_string_lossy().into_owned());
    named.into_iter().find(|name| name != "mav0").unwrap_or_else(|| "recording".into())
}

fn read_images(purpose: Purpose, folder: &Path, remarks: &mut Vec<Remark>) -> Result<Vec<ImageFile>, Fault> {
    let table = folder.join("data.csv");
    let text = read_text(&table, "a recording needs the list of its images: copy the folder again, whole")?;
    let mut images: Vec<ImageFile> = Vec::new();
    for row in rows(&table, &text, true) {
        row.at_least(2)?;
        let stamp = row.stamp()?;
        if let Some(last) = images.last() {
            if stamp < last.stamp && purpose == Purpose::Check {
                remark(remarks, RemarkKind::ImageOrder, || format!("{} line {}: time stamp goes back", table.display(), row.line));
                continue;
            }
            if stamp < last.stamp {
                let back_ms = (last.stamp - stamp).as_seconds::<f64>() * 1e3;
                return Err(row.fault(format!("time stamp goes back by {back_ms:.3} ms"), "sort the file by its first column"));
            }
            if stamp == last.stamp {
                remark(remarks, RemarkKind::ImageDuplicate, || {
                    format!("{} line {}: time stamp occurs twice; the second image is left out", table.display(), row.line)
                });
                continue;
            }
        }
        let file = folder.join("data").join(row.text(1)?);
        if !file.is_file() {
            let what = format!("image {} is not there", file.display());
            return Err(row.fault(what, "copy the images again, or remove the line"));
        }
        images.push(ImageFile { stamp, path: file });
    }
    if images.is_empty() {
        return Err(Fault::malformed(&table, "lists no image", "the file is cut off: copy it again"));
    }
    Ok(images)
}

/// A first image of another size than the calibration's means the wrong calibration; later ones are refused one by one.
fn check_size(images: &[ImageFile], rig: &Rig) -> Result<(), Fault> {
    let Some((image, (width, height))) = images.iter().find_map(|image| Some((image, decode::size(&image.path)?))) else { return Ok(()) };
    let (expected_width, expected_height) = rig.size_px();
    if (width, height) == (expected_width, expected_height) {
        return Ok(());
    }
    let what = format!("image is {width}x{height} where cam0/sensor.yaml says {expected_width}x{expected_height}");
    Err(Fault::malformed(&image.path, what, "use the calibration of this camera at this resolution"))
}

fn read_truth(root: &Path, remarks: &mut Vec<Remark>) -> Result<Option<Trajectory>, Fault> {
    let candidates = ["state_groundtruth_estimate0", "mocap0", "vicon0"].map(|folder| root.join(folder).join("data.csv"));
    let Some(table) = candidates.into_iter().find(|table| table.is_file()) else { return Ok(None) };
    let (truth, duplicates) = Trajectory::read_counting(&table)?;
    if let Some(line) = duplicates.first() {
        let first = format!("{} line {line}: time stamp occurs twice; the second pose is left out", table.display());
        remarks.push(Remark { kind: RemarkKind::TruthDuplicate, count: duplicates.len(), first });
    }
    Ok(Some(truth))
}
