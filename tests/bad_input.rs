//! Damaged recordings: each is refused before the run with its place named, or goes on with a remark that counts it.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use crate::support::{Folder, SIZE, START_NS};
use libella_host::config::Config;
use libella_host::dataset::{self, Event, RemarkKind};
use libella_host::fault::{Fault, FaultKind};
use libella_host::pipeline::{self, Ended};

const IMU: &str = "imu0/data.csv";
const IMAGES: &str = "cam0/data.csv";
const CAMERA: &str = "cam0/sensor.yaml";

/// Opens a folder that must be refused, and checks the place that the complaint names.
fn refused(folder: &Folder, kind: FaultKind, file: &str, line: Option<u64>) -> String {
    let fault = folder.open().map(|recording| recording.name).unwrap_err();
    check(&fault, kind, &folder.path(file), line);
    fault.to_string()
}

fn check(fault: &Fault, kind: FaultKind, path: &Path, line: Option<u64>) {
    assert_eq!((fault.kind, fault.path.as_deref(), fault.line), (kind, Some(path), line), "{fault}");
    assert!(!fault.remedy.is_empty() && !fault.to_string().contains('\n'), "one sentence that says what to do: {fault}");
}

/// Opens a folder that must be accepted, and returns how often the remark was made.
fn remarked(folder: &Folder, kind: RemarkKind) -> usize {
    folder.open().unwrap().remarks.iter().find(|remark| remark.kind == kind).map_or(0, |remark| remark.count)
}

#[test]
fn a_whole_recording_passes_without_remark() {
    let folder = Folder::new();
    let recording = folder.open().unwrap();
    assert_eq!((recording.imu.len(), recording.frames.len(), recording.listed_frames), (201, 10, 10));
    assert_eq!(recording.remarks, []);
    assert!(recording.truth.is_some());
    let direct = dataset::open(&folder.path(""), &Config::default().dataset).unwrap();
    assert_eq!(direct.imu.len(), 201);
}

#[test]
fn images_are_skipped_at_the_beginning_and_never_all_of_them() {
    let folder = Folder::new();
    let (root, mut options) = (folder.path(""), Config::default().dataset);
    let stamp = |skipped: usize| folder.open().unwrap().frames.stamp(skipped);
    options.skip_images = 3;
    let recording = dataset::open(&root, &options).unwrap();
    assert_eq!((recording.frames.len(), recording.listed_frames, recording.frames.stamp(0), recording.imu.len()), (7, 7, stamp(3), 201));
    options.skip_images = 10;
    let fault = dataset::open(&root, &options).map(|recording| recording.name).unwrap_err();
    assert!(fault.to_string().contains("has 10 images, and `dataset.skip_images` is 10"), "{fault}");
}

#[test]
fn an_image_follows_the_first_inertial_sample_that_reaches_it() {
    let folder = Folder::new();
    let recording = folder.open().unwrap();
    let (mut reached, mut images) = (None, 0);
    for event in recording.events(2).unwrap() {
        match event {
            Event::Imu(sample) => reached = Some(sample.stamp),
            Event::Image { stamp, image } => {
                let image = image.unwrap();
                assert_eq!((image.width as u32, image.height as u32), SIZE);
                // Image stamps fall on inertial stamps here: the sample before the image is the one at its time.
                assert_eq!(reached, Some(stamp));
                images += 1;
            }
            Event::Tracks(_) => unreachable!(),
        }
    }
    assert_eq!(images, 10);
}

#[test]
fn missing_folders_and_files_are_named() {
    let folder = Folder::new();
    let nowhere = folder.root().join("nowhere");
    check(&dataset::open(&nowhere, &Config::default().dataset).map(|_| ()).unwrap_err(), FaultKind::Missing, &nowhere, None);
    let empty = folder.root().join("empty");
    std::fs::create_dir(&empty).unwrap();
    check(&dataset::open(&empty, &Config::default().dataset).map(|_| ()).unwrap_err(), FaultKind::Missing, &empty, None);
    for file in [IMU, IMAGES, CAMERA, "imu0/sensor.yaml"] {
        let folder = Folder::new();
        std::fs::remove_file(folder.path(file)).unwrap();
        refused(&folder, FaultKind::Missing, file, None);
    }
    let folder = Folder::new();
    std::fs::remove_file(folder.image(3)).unwrap();
    assert!(refused(&folder, FaultKind::Malformed, IMAGES, Some(5)).contains(".png"));
}

#[test]
fn cut_off_tables_are_named_with_their_line() {
    for (file, lines) in [(IMU, 202), (IMAGES, 11), ("state_groundtruth_estimate0/data.csv", 202)] {
        let folder = Folder::new();
        // The last line ends within its first number.
        folder.edit(file, |text| text[..text.trim_end().rfind('\n').unwrap() + 9].to_owned());
        assert!(refused(&folder, FaultKind::Malformed, file, Some(lines)).contains("cut off"));
        let folder = Folder::new();
        folder.edit_lines(file, |lines| lines.truncate(1));
        refused(&folder, FaultKind::Malformed, file, None);
    }
}

#[test]
fn stamps_that_go_back_are_named_with_their_line() {
    for file in [IMU, IMAGES, "state_groundtruth_estimate0/data.csv"] {
        let folder = Folder::new();
        folder.edit_lines(file, |lines| lines.swap(5, 6));
        assert!(refused(&folder, FaultKind::Malformed, file, Some(7)).contains("goes back by"));
    }
}

#[test]
fn numbers_that_are_none_are_named_with_their_line() {
    for (bad, word) in [("NaN", "finite"), ("inf", "finite"), ("-inf", "finite"), ("zero", "not a number"), ("", "empty")] {
        for (file, column) in [(IMU, 4), ("state_groundtruth_estimate0/data.csv", 2)] {
            let folder = Folder::new();
            folder.edit_lines(file, |lines| {
                let mut fields: Vec<&str> = lines[9].split(',').collect();
                fields[column] = bad;
                lines[9] = fields.join(",");
            });
            assert!(refused(&folder, FaultKind::Malformed, file, Some(10)).contains(word));
        }
    }
    let folder = Folder::new();
    std::fs::write(folder.path(IMU), b"#t\n1,2,3\n\xff\xfe\n").unwrap();
    refused(&folder, FaultKind::Malformed, IMU, Some(3));
}

#[test]
fn calibrations_that_describe_no_camera_are_refused() {
    let without = |key: &str| {
        let folder = Folder::new();
        folder.edit_lines(CAMERA, |lines| lines.retain(|line| !line.starts_with(key)));
        assert!(refused(&folder, FaultKind::Malformed, CAMERA, None).contains(key));
    };
    for key in ["distortion_coefficients", "distortion_model", "intrinsics", "resolution"] {
        without(key);
    }
    let replaced = |from: &str, to: &str, word: &str| {
        let folder = Folder::new();
        folder.edit(CAMERA, |text| {
            assert!(text.contains(from));
            text.replace(from, to)
        });
        let fault = folder.open().map(|_| ()).unwrap_err();
        assert!(fault.kind == FaultKind::Malformed && fault.path == Some(folder.path(CAMERA)), "{fault}");
        assert!(fault.to_string().contains(word) && !fault.to_string().contains('\n'), "{fault}");
    };
    replaced("radial-tangential", "omni-magic", "omni-magic");
    replaced("[40.0, 40.0, 32.0, 24.0]", "[40.0, 40.0, 32.0]", "3 numbers");
    replaced("[40.0, 40.0, 32.0, 24.0]", "[-40.0, 40.0, 32.0, 24.0]", "not positive");
    replaced("0.07, ", ".nan, ", "not finite");
    replaced("[64, 48]", "[64, forty]", "calibration");
    // Mirrored, bent, in millimetres.
    replaced("0.0, -1.0, 0.0, -0.02", "0.0, 1.0, 0.0, -0.02", "rigid");
    replaced("1.0, 0.0, 0.0, -0.06", "1.1, 0.0, 0.0, -0.06", "rigid");
    replaced("-0.06", "-60.0", "60 m");
    let folder = Folder::new();
    folder.edit("imu0/sensor.yaml", |text| text.replace("1.6968e-04", "0.0"));
    assert!(refused(&folder, FaultKind::Malformed, "imu0/sensor.yaml", None).contains("gyroscope_noise_density"));
}

#[test]
fn equidistant_cameras_are_read_and_a_turned_inertial_unit_is_undone() {
    let folder = Folder::new();
    folder.edit(CAMERA, |text| text.replace("radial-tangential", "equidistant"));
    // Body coordinates are those of the inertial unit turned by half a turn about z.
    folder.edit("imu0/sensor.yaml", |text| {
        text.replace("[1.0, 0.0, 0.0, 0.0,", "[-1.0, 0.0, 0.0, 0.5,")
            .replace(" 0.0, 1.0, 0.0, 0.0,\n         0.0, 0.0, 1.0", " 0.0, -1.0, 0.0, 0.0,\n         0.0, 0.0, 1.0")
    });
    let recording = folder.open().unwrap();
    assert!(matches!(recording.rig.camera, libella_core::camera::CameraModel::KannalaBrandt(_)));
    let offset = recording.rig.body_from_camera.translation.vector;
    assert!((offset - nalgebra::Vector3::new(0.52, 0.06, 0.01)).norm() < 1e-12, "{offset}");
    let truth = recording.truth.unwrap().poses()[0].world_from_body.translation.vector;
    assert!((truth - nalgebra::Vector3::new(1.5, 2.0, 3.0)).norm() < 1e-12, "{truth}");
}

#[test]
fn images_of_the_wrong_size_are_refused_before_the_run() {
    let folder = Folder::new();
    image::GrayImage::new(SIZE.0 * 2, SIZE.1).save(folder.image(0)).unwrap();
    let fault = folder.open().map(|_| ()).unwrap_err();
    check(&fault, FaultKind::Malformed, &folder.image(0), None);
    assert!(fault.to_string().contains("128x48") && fault.to_string().contains("64x48"), "{fault}");
}

#[test]
fn duplicates_gaps_and_saturation_are_counted_and_the_run_goes_on() {
    let folder = Folder::new();
    folder.edit_lines(IMU, |lines| {
        lines.insert(8, lines[7].clone());
        lines.insert(20, lines[19].clone());
    });
    assert_eq!(remarked(&folder, RemarkKind::ImuDuplicate), 2);
    assert_eq!(folder.open().unwrap().imu.len(), 201);

    let folder = Folder::new();
    folder.edit_lines(IMAGES, |lines| lines.insert(3, lines[2].clone()));
    assert_eq!(remarked(&folder, RemarkKind::ImageDuplicate), 1);
    assert_eq!(folder.open().unwrap().frames.len(), 10);

    let folder = Folder::new();
    folder.edit_lines("state_groundtruth_estimate0/data.csv", |lines| lines.insert(3, lines[2].clone()));
    assert_eq!(remarked(&folder, RemarkKind::TruthDuplicate), 1);

    // 10 samples of 5 ms are left out: 55 ms without one; one fewer is 50 ms and allowed.
    let folder = Folder::new();
    folder.edit_lines(IMU, |lines| drop(lines.drain(50..60)));
    assert_eq!(remarked(&folder, RemarkKind::ImuGap), 1);
    let folder = Folder::new();
    folder.edit_lines(IMU, |lines| drop(lines.drain(50..59)));
    assert_eq!(remarked(&folder, RemarkKind::ImuGap), 0);

    // 6 images of 100 ms are left out: 700 ms without one.
    let folder = Folder::new();
    folder.edit_lines(IMAGES, |lines| drop(lines.drain(2..8)));
    assert_eq!(remarked(&folder, RemarkKind::ImageGap), 1);

    let saturated = |samples: usize| {
        let folder = Folder::new();
        folder.edit_lines(IMU, |lines| {
            for line in &mut lines[40..40 + samples] {
                let stamp = line.split(',').next().unwrap().to_owned();
                *line = format!("{stamp},17.4533,0.0,0.0,0.1,-0.2,9.81");
            }
        });
        remarked(&folder, RemarkKind::ImuSaturated)
    };
    assert_eq!((saturated(2), saturated(4)), (0, 1));
}

#[test]
fn specific_force_in_the_wrong_unit_is_refused_and_an_odd_one_remarked() {
    let scaled = |factor: f64| {
        let folder = Folder::new();
        folder.edit_lines(IMU, |lines| {
            for line in lines.iter_mut().skip(1) {
                let fields: Vec<f64> = line.split(',').skip(1).map(|field| field.parse().unwrap()).collect();
                let [a, b, c] = [fields[3], fields[4], fields[5]].map(|value| value * factor);
                *line = format!("{},{},{},{},{a},{b},{c}", line.split(',').next().unwrap(), fields[0], fields[1], fields[2]);
            }
        });
        folder
    };
    // In units of g, and in cm/s².
    assert!(refused(&scaled(1.0 / 9.81), FaultKind::Malformed, IMU, None).contains("m/s^2"));
    assert!(refused(&scaled(100.0), FaultKind::Malformed, IMU, None).contains("m/s^2"));
    assert_eq!(remarked(&scaled(0.6), RemarkKind::Gravity), 1);
    assert_eq!(remarked(&scaled(1.2), RemarkKind::Gravity), 0);
}

#[test]
fn clocks_that_never_meet_are_refused_and_images_without_imu_are_left_out() {
    let folder = Folder::new();
    folder.edit(IMAGES, |text| text.replace(&format!("\n{}", START_NS / 1_000_000_000), "\n1303636584"));
    let fault = folder.open().map(|_| ()).unwrap_err();
    check(&fault, FaultKind::Malformed, folder.root(), None);
    assert!(fault.to_string().contains("clock"), "{fault}");
    let folder = Folder::new();
    folder.edit_lines(IMU, |lines| drop(lines.drain(1..10)));
    let recording = folder.open().unwrap();
    assert_eq!((recording.frames.len(), recording.listed_frames), (9, 10));
    assert_eq!(remarked(&folder, RemarkKind::ImagesWithoutImu), 1);
}

#[test]
fn unreadable_images_are_left_out_with_their_reason_and_the_run_goes_on() {
    let folder = Folder::new();
    let whole = std::fs::read(folder.image(2)).unwrap();
    std::fs::write(folder.image(2), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(folder.image(5), b"this is no image").unwrap();
    std::fs::write(folder.image(0), b"").unwrap();
    let recording = folder.open().unwrap();
    let run = pipeline::run(&recording, &Config::default(), &AtomicBool::new(false), |_| ()).unwrap();
    assert_eq!((run.frames.len(), &run.ended), (10, &Ended::Complete));
    for (index, frame) in run.frames.iter().enumerate() {
        match (index, &frame.refused) {
            (0 | 2 | 5, Some(reason)) => assert!(reason.contains("cannot be decoded") && reason.contains(".png"), "{reason}"),
            (_, reason) => assert_eq!(*reason, None, "image {index}"),
        }
    }
}

#[test]
fn an_interrupted_run_ends_after_the_image_at_hand_and_writes_its_results() {
    let folder = Folder::new();
    let recording = folder.open().unwrap();
    let config = Config::default();
    let run = pipeline::run(&recording, &config, &AtomicBool::new(true), |_| ()).unwrap();
    assert_eq!((run.frames.len(), &run.ended), (1, &Ended::Interrupted));
    let out = folder.root().join("out");
    pipeline::write_outputs(&out, &run, &pipeline::Report::new(&recording, &config, &run, None)).unwrap();
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(report["ended"], "interrupted");
    assert!(out.join("trajectory.tum").is_file() && out.join("trajectory.csv").is_file());
}

#[test]
fn damaged_corner_recordings_are_named_with_their_line() {
    let write = |tracks: &str| {
        let folder = Folder::new();
        std::fs::copy(folder.path(IMU), folder.root().join("imu0.csv")).unwrap();
        let rows: String = tracks.lines().map(|row| format!("{}{row}\n", START_NS / 1_000_000_000)).collect();
        std::fs::write(folder.root().join("tracks_cam0.csv"), format!("#t,tag,corner,u,v\n{rows}")).unwrap();
        folder
    };
    let whole = write("100000000,0,0,10.5,20.5\n100000000,0,1,30.5,20.5\n200000000,0,0,11.5,20.5");
    let recording = whole.open().unwrap();
    assert_eq!((recording.frames.len(), recording.imu.len()), (2, 201));
    let damaged = [
        ("100000000,0,0,10.5,20.5\n100000000,0,4,30.5,20.5", 3, "no corner"),
        ("100000000,0,0,10.5,20.5\n100000000,0,0,30.5,20.5", 3, "twice"),
        ("200000000,0,0,10.5,20.5\n100000000,0,0,30.5,20.5", 3, "goes back by 100.000 ms"),
        ("100000000,0,0,NaN,20.5", 2, "finite"),
        ("100000000,0,0,10.5", 2, "cut off"),
        ("100000000,-1,0,10.5,20.5", 2, "not a count"),
    ];
    for (tracks, line, word) in damaged {
        let folder = write(tracks);
        let fault = folder.open().map(|_| ()).unwrap_err();
        check(&fault, FaultKind::Malformed, &folder.root().join("tracks_cam0.csv"), Some(line));
        assert!(fault.to_string().contains(word), "{fault}");
    }
    std::fs::remove_file(whole.root().join("imu0.csv")).unwrap();
    check(&whole.open().map(|_| ()).unwrap_err(), FaultKind::Missing, &whole.root().join("imu0.csv"), None);
}
