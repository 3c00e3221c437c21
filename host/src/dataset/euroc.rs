//! Folders of images beside inertial samples, unpacked or in an archive: EuRoC/ASL, TUM-VI, Kalibr.
//!
//! EuRoC/ASL: `mav0/{cam0,imu0,state_groundtruth_estimate0}`, each with `data.csv` and, at sensors, `sensor.yaml`. TUM-VI is the same with
//! `mocap0` for the truth and Kalibr's files in `dso` for the calibration. Kalibr's own (`kalibr_bagextractor`) has images named by their
//! time in `cam0` and the samples in `imu0.csv`.

use std::path::Path;

use libella_core::time::{Span, Timestamp};

use super::files::Files;
use super::hints::Hints;
use super::table::rows;
use super::{Layout, Purpose, Recording, Remark, RemarkKind, imu, remark, rig};
use crate::calibration::Rig;
use crate::config::DatasetSection;
use crate::eval::Trajectory;
use crate::fault::Fault;

/// Opens `mav0` or its parent.
pub(super) fn open(purpose: Purpose, path: &Path, files: Files, options: &DatasetSection, hints: &Hints) -> Result<Recording, Fault> {
    let root = find_root(path, &files)?;
    let calibration = rig::of_folder(&files, &root, hints.calibration.as_deref())?;
    let camera = calibration.camera(None).map_err(|fault| fault.at(path))?;
    let rig = calibration.rig(camera);
    let mut remarks = Vec::new();
    let table = [format!("{root}imu0/data.csv"), format!("{root}imu0.csv")];
    let table = table.iter().find(|table| files.has(table)).unwrap_or(&table[0]);
    let text = files.text(table, "a recording needs its inertial samples: copy the folder again, whole")?;
    let samples = imu::read(purpose, &files.path(table), &text, options, &mut remarks)?;
    let mut images = read_images(purpose, &files, &root, &mut remarks)?;
    if purpose == Purpose::Run {
        check_size(&files, &images, &rig, &camera.source)?;
    }
    if camera.shift != Span::default() {
        images.iter_mut().for_each(|image| image.0 = image.0 + camera.shift);
    }
    let truth = read_truth(&files, &root, &mut remarks)?.map(|truth| truth.attached(&calibration.imu.body_from_imu));
    Ok(Recording {
        name: name_of(path),
        layout: Layout::Euroc,
        rig,
        imu: samples,
        listed_frames: images.len(),
        frames: files.frames(images),
        truth,
        truth_is_level: true,
        remarks,
    })
}

/// Where `cam0` and `imu0` lie, with a `/` at the end where it is not the top.
fn find_root(path: &Path, files: &Files) -> Result<String, Fault> {
    let holds_one = |root: &str| files.has_folder(&format!("{root}cam0")) || files.has_folder(&format!("{root}imu0"));
    if let Some(root) = ["mav0/", ""].into_iter().find(|root| holds_one(root)) {
        return Ok(root.to_owned());
    }
    let Files::Archive(archive) = files else {
        let what = "is no recording: neither `mav0` with `cam0` and `imu0` nor `tracks_cam0.csv` is in it";
        return Err(Fault::missing(path, what, "give the folder of a EuRoC sequence, for example MH_01_easy"));
    };
    let mut roots: Vec<&str> =
        ["imu0/data.csv", "imu0.csv"].iter().flat_map(|table| archive.names().filter_map(|name| name.strip_suffix(*table))).collect();
    roots.retain(|root| root.ends_with('/'));
    match roots[..] {
        [root] => Ok(root.to_owned()),
        [] => {
            let packed = archive.names().find(|name| [".zip", ".bag", ".mcap"].iter().any(|ending| name.ends_with(ending)));
            let (what, remedy) = match packed {
                Some(name) => (format!("holds packed recordings, for example `{name}`"), "unpack it and give one of them"),
                None => ("is no recording: no `imu0/data.csv` beside `cam0` is in it".into(), "give the archive of a EuRoC sequence"),
            };
            Err(Fault::missing(path, what, remedy))
        }
        _ => {
            let what = format!("holds {} recordings, among them `{}` and `{}`", roots.len(), roots[0], roots[1]);
            Err(Fault::malformed(path, what, "unpack it and give one of them"))
        }
    }
}

/// The last folder name that says something; of an archive its own name without the ending.
fn name_of(path: &Path) -> String {
    let whole = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let whole = if whole.is_file() { whole.with_extension("") } else { whole };
    let named = whole.ancestors().filter_map(Path::file_name).map(|name| name.to_string_lossy().into_owned());
    named.into_iter().find(|name| name != "mav0").unwrap_or_else(|| "recording".into())
}

fn read_images(purpose: Purpose, files: &Files, root: &str, remarks: &mut Vec<Remark>) -> Result<Vec<(Timestamp, String)>, Fault> {
    let folder = format!("{root}cam0/");
    let name = format!("{folder}data.csv");
    // Kalibr's layout has no list; EuRoC's always has one.
    if !files.has(&name) && !files.has(&format!("{root}imu0/data.csv")) {
        let named = images_by_name(files, &folder);
        if !named.is_empty() {
            return Ok(named);
        }
    }
    let table = files.path(&name);
    let text = files.text(&name, "a recording needs the list of its images: copy the folder again, whole")?;
    let mut images: Vec<(Timestamp, String)> = Vec::new();
    for row in rows(&table, &text, true) {
        row.at_least(2)?;
        let stamp = row.stamp()?;
        if let Some((last, _)) = images.last() {
            if stamp < *last && purpose == Purpose::Check {
                remark(remarks, RemarkKind::ImageOrder, || format!("{} line {}: time stamp goes back", table.display(), row.line));
                continue;
            }
            if stamp < *last {
                let back_ms = (*last - stamp).as_seconds::<f64>() * 1e3;
                return Err(row.fault(format!("time stamp goes back by {back_ms:.3} ms"), "sort the file by its first column"));
            }
            if stamp == *last {
                remark(remarks, RemarkKind::ImageDuplicate, || {
                    format!("{} line {}: time stamp occurs twice; the second image is left out", table.display(), row.line)
                });
                continue;
            }
        }
        let file = format!("{folder}data/{}", row.text(1)?);
        if !files.has(&file) {
            let what = format!("image {} is not there", files.path(&file).display());
            return Err(row.fault(what, "copy the images again, or remove the line"));
        }
        images.push((stamp, file));
    }
    if images.is_empty() {
        return Err(Fault::malformed(&table, "lists no image", "the file is cut off: copy it again"));
    }
    Ok(images)
}

/// Images without a list, whose names are their time in nanoseconds.
fn images_by_name(files: &Files, folder: &str) -> Vec<(Timestamp, String)> {
    let stamped = |folder: &str| -> Vec<(Timestamp, String)> {
        let names = files.names_in(folder).into_iter();
        let mut images: Vec<_> = names
            .filter_map(|name| {
                let (stem, ending) = name.rsplit_once('.')?;
                let is_image = ["png", "jpg", "jpeg"].contains(&ending.to_ascii_lowercase().as_str());
                Some((Timestamp::from_nanos(stem.parse().ok().filter(|_| is_image)?), format!("{folder}{name}")))
            })
            .collect();
        // Names of different length do not sort as numbers do.
        images.sort();
        images.dedup_by_key(|image| image.0);
        images
    };
    [format!("{folder}data/"), folder.to_owned()].iter().map(|folder| stamped(folder)).find(|images| !images.is_empty()).unwrap_or_default()
}

/// A first image of another size than the calibration's means the wrong calibration; later ones are refused one by one.
fn check_size(files: &Files, images: &[(Timestamp, String)], rig: &Rig, calibration: &str) -> Result<(), Fault> {
    match images.iter().find_map(|(_, name)| Some((name, files.image_size(name)?))) {
        Some((name, size)) => rig::check_size(&files.path(name), size, rig, calibration),
        None => Ok(()),
    }
}

fn read_truth(files: &Files, root: &str, remarks: &mut Vec<Remark>) -> Result<Option<Trajectory>, Fault> {
    let candidates = ["state_groundtruth_estimate0", "mocap0", "vicon0"].map(|folder| format!("{root}{folder}/data.csv"));
    let Some(name) = candidates.into_iter().find(|name| files.has(name)) else { return Ok(None) };
    let table = files.path(&name);
    let (truth, duplicates) = Trajectory::parse_counting(&table, &files.text(&name, "copy it again")?)?;
    if let Some(line) = duplicates.first() {
        let first = format!("{} line {line}: time stamp occurs twice; the second pose is left out", table.display());
        remarks.push(Remark { kind: RemarkKind::TruthDuplicate, count: duplicates.len(), first });
    }
    Ok(Some(truth))
}
