//! The command as a user meets it: exit codes, messages, files.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Output};

fn libella(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_libella")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn an_unknown_key_is_refused_before_any_data_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("mine.toml");
    std::fs::write(&config, "seed = 3\n[estimator]\nsigma_pixel = 1.0\n").unwrap();
    // The recording does not exist either; the configuration is what is complained about.
    let done = libella(&["run", "nowhere", "--config", config.to_str().unwrap()]);
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{said}");
    assert!(said.contains("mine.toml line 3") && said.contains("sigma_pixel") && !said.contains("nowhere"), "{said}");
    let absent = libella(&["run", "nowhere", "--config", "absent.toml"]);
    assert_eq!(absent.status.code(), Some(2), "{}", text(&absent.stderr));
}

#[test]
fn a_missing_recording_is_named_in_one_line() {
    let done = libella(&["run", "nowhere"]);
    assert_eq!(done.status.code(), Some(3));
    assert_eq!(text(&done.stderr).lines().count(), 1);
    assert!(text(&done.stderr).starts_with("libella: nowhere: "), "{}", text(&done.stderr));
}

#[test]
fn the_printed_configuration_is_accepted_back() {
    let folder = tempfile::tempdir().unwrap();
    let printed = libella(&["config"]);
    assert!(printed.status.success());
    let config = folder.path().join("default.toml");
    std::fs::write(&config, &printed.stdout).unwrap();
    // Gets past the configuration, to the recording.
    assert_eq!(libella(&["run", "nowhere", "--config", config.to_str().unwrap()]).status.code(), Some(3));
}

#[test]
fn evaluate_prints_figures_a_program_can_read() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/evo");
    let (estimate, truth) = (golden.join("estimate.tum"), golden.join("truth.csv"));
    let done = libella(&["evaluate", estimate.to_str().unwrap(), truth.to_str().unwrap(), "--json"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let figures: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(figures["matched_poses"], 240);
    let done = libella(&["evaluate", truth.to_str().unwrap(), golden.join("make.py").to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(3));
    assert!(text(&done.stderr).contains("make.py line "), "{}", text(&done.stderr));
}

#[test]
fn trajectories_that_share_no_time_give_no_result() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.tum"), folder.path().join("b.tum"));
    std::fs::write(&a, "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
    std::fs::write(&b, "11.0 0 0 0 0 0 0 1\n12.0 1 0 0 0 0 0 1\n").unwrap();
    let done = libella(&["evaluate", a.to_str().unwrap(), b.to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(4), "{}", text(&done.stderr));
}
