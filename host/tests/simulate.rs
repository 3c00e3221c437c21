//! The commands that need no data, as a user meets them.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Output};

use libella_host::config::DatasetSection;
use libella_host::dataset::{self, Frames};

fn libella(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_libella")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn said(folder: &Path) -> &str {
    folder.to_str().unwrap()
}

#[test]
fn parameters_out_of_range_are_refused_with_the_range_and_leave_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("recording");
    for command in ["simulate", "demo"] {
        for duration in ["0", "-5", "3601", "nan"] {
            let done = libella(&[command, "--duration", duration, "--out", said(&out)]);
            assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
            let message = text(&done.stderr);
            assert!(message.contains("duration_s") && message.contains("1 to 3600") && message.lines().count() == 1, "{message}");
        }
        for count in ["-1", "21"] {
            let done = libella(&[command, "--dynamic", count, "--out", said(&out)]);
            assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
            let message = text(&done.stderr);
            assert!(message.contains(&format!("--dynamic = {count}")) && message.contains("0 to 20"), "{message}");
        }
        let done = libella(&[command, "--trajectory", "loopings", "--out", said(&out)]);
        assert_eq!(done.status.code(), Some(2));
        assert!(text(&done.stderr).contains("`loopings`") && text(&done.stderr).contains("fast-yaw"), "{}", text(&done.stderr));
    }
    // A folder that is no recording of a motion.
    let done = libella(&["simulate", "--trajectory", said(folder.path()), "--out", said(&out)]);
    assert_eq!(done.status.code(), Some(3), "{}", text(&done.stderr));
    assert!(!out.exists());
}

#[test]
fn a_simulated_recording_is_read_like_any_other_and_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("recording");
    let done = libella(&["simulate", "--scene-seed", "4", "--duration", "1", "--right", "--trajectory", "medium", "--out", said(&out)]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let recording = dataset::open(&out, &DatasetSection::default()).unwrap();
    assert_eq!((recording.frames.len(), recording.imu.len(), recording.remarks.len()), (21, 201, 0));
    assert!(recording.truth.is_some());
    for file in ["planes.json", "cam1/data.csv", "cam1/sensor.yaml"] {
        assert!(out.join("mav0").join(file).is_file(), "{file}");
    }
    let images = |below: &str| std::fs::read_dir(out.join("mav0").join(below)).unwrap().count();
    assert_eq!([images("cam0/data"), images("cam0/depth"), images("cam1/data")], [21; 3]);
    // One second at rest may or may not be enough to start from.
    let results = folder.path().join("results");
    let done = libella(&["run", said(&out), "--out", said(&results)]);
    assert!(matches!(done.status.code(), Some(0 | 4)), "{}", text(&done.stderr));

    let again = libella(&["simulate", "--duration", "1", "--out", said(&out)]);
    assert_eq!(again.status.code(), Some(5));
    assert!(text(&again.stderr).contains("holds a recording already"), "{}", text(&again.stderr));
}

#[test]
fn moving_objects_change_the_images_and_neither_planes_nor_motion() {
    let folder = tempfile::tempdir().unwrap();
    let simulated = ["0", "8"].map(|count| {
        let out = folder.path().join(count);
        let done = libella(&["simulate", "--scene-seed", "4", "--duration", "1", "--dynamic", count, "--out", said(&out)]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        out.join("mav0")
    });
    let same = |below: &str| std::fs::read(simulated[0].join(below)).unwrap() == std::fs::read(simulated[1].join(below)).unwrap();
    for file in ["planes.json", "imu0/data.csv", "cam0/data.csv", "state_groundtruth_estimate0/data.csv"] {
        assert!(same(file), "{file}");
    }
    let images: Vec<_> = std::fs::read_dir(simulated[0].join("cam0/data")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    let below = |kind: &str, name: &std::ffi::OsString| format!("cam0/{kind}/{}", name.to_string_lossy());
    assert!(images.iter().any(|name| !same(&below("data", name)) && !same(&below("depth", name))));
}

#[test]
#[cfg(unix)]
fn an_interrupted_simulation_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("recording");
    let child = Command::new(env!("CARGO_BIN_EXE_libella"))
        .args(["simulate", "--quiet", "--no-depth", "--duration", "600", "--out", said(&out)])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let written = || std::fs::read_dir(out.join("mav0/cam0/data")).map_or(0, Iterator::count);
    while written() < 3 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let done = child.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(130), "{}", text(&done.stderr));
    let recording = dataset::open(&out, &DatasetSection::default()).unwrap();
    let Frames::Images(images) = &recording.frames else { unreachable!() };
    assert!(images.len() >= 3 && images.len() == written());
    assert!(images.iter().all(|image| image::open(&image.path).is_ok()));
    assert!(!out.join("mav0/cam0/depth").exists());
}

#[test]
fn the_demo_leaves_its_pictures_and_figures() {
    let folder = tempfile::tempdir().unwrap();
    let done = libella(&["demo", "--duration", "4", "--trajectory", "medium", "--scalar", "f32", "--out", said(folder.path())]);
    assert!(matches!(done.status.code(), Some(0 | 4)), "{}", text(&done.stderr));
    let printed = text(&done.stdout);
    for word in ["ATE", "scale", "core", "rendering", "ms per image"] {
        assert!(printed.contains(word), "{word} is missing:\n{printed}");
    }
    for file in ["trajectory.tum", "trajectory.svg", "trajectory.png", "demo.png"] {
        assert!(folder.path().join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(folder.path().join("report.json")).unwrap()).unwrap();
    assert_eq!((&report["scalar"], &report["layout"], &report["frames"]), (&"f32".into(), &"simulated".into(), &81.into()));
    let sheet = image::open(folder.path().join("demo.png")).unwrap();
    assert_eq!(sheet.width(), 1200);
}
