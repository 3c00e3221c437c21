//! The command as a user meets it: exit codes, messages, files.
#![allow(clippy::unwrap_used)]

#[allow(dead_code)] // what the tests of the whole system need beside
#[path = "../../tests/support/folder.rs"]
mod folder;

use std::path::Path;
use std::process::{Command, Output};

use folder::Folder;

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

#[test]
fn a_recording_at_rest_leaves_its_files_and_a_report_with_the_promised_names() {
    let folder = Folder::new();
    let out = folder.root().join("results");
    let done = libella(&["run", folder.root().to_str().unwrap(), "--out", out.to_str().unwrap(), "--scalar", "f32", "--seed", "5"]);
    // One second of rest in front of a chessboard may or may not be enough to start from.
    assert!(matches!(done.status.code(), Some(0 | 4)), "{}", text(&done.stderr));
    for file in ["trajectory.tum", "trajectory.csv", "trajectory.svg", "trajectory.png"] {
        assert!(out.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    for name in [
        "configuration",
        "coverage",
        "initialised_after_s",
        "metric_after_s",
        "ate_rmse_m",
        "scale_error_percent",
        "rpe",
        "wall_s",
        "rss_peak_mb",
    ] {
        assert!(report.get(name).is_some(), "{name}");
    }
    for name in ["median", "p95", "max", "stages"] {
        assert!(report["core_ms"].get(name).is_some(), "{name}");
    }
    assert_eq!((&report["scalar"], &report["seed"], &report["frames"]), (&"f32".into(), &5.into(), &10.into()));
    assert_eq!(report["poses"].as_u64().unwrap() == 0, done.status.code() == Some(4));
}

#[test]
fn a_folder_that_cannot_be_written_is_found_out_before_the_run() {
    let folder = Folder::new();
    let taken = folder.root().join("taken");
    std::fs::write(&taken, "a file").unwrap();
    let done = libella(&["run", folder.root().to_str().unwrap(), "--out", taken.to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(5), "{}", text(&done.stderr));
    assert!(text(&done.stdout).is_empty() && text(&done.stderr).contains("taken"));
}

#[test]
fn a_wrong_command_line_ends_with_2() {
    for wrong in [&["fly"][..], &["run"], &["run", "a", "--no-such-option"], &["run", "a", "--scalar", "f16"], &["completions", "cmd"], &[]]
    {
        let done = libella(wrong);
        assert_eq!(done.status.code(), Some(2), "{wrong:?}: {}", text(&done.stderr));
        assert!(done.stdout.is_empty() && !done.stderr.is_empty(), "{wrong:?}");
    }
}

#[test]
fn the_help_lists_the_exit_codes_and_ends_with_examples() {
    let help = text(&libella(&["--help"]).stdout);
    for code in ["0  done", "2  wrong command line", "3  the data", "4  no trajectory", "5  results cannot", "6  ", "7  ", "70  ", "130  "]
    {
        assert!(help.lines().any(|line| line.trim_start().starts_with(code)), "{code}: {help}");
    }
    assert!(text(&libella(&["run", "--help"]).stdout).contains("\nExamples:\n  libella run "));
}

#[test]
fn completions_name_every_subcommand() {
    let listed = ["demo", "check", "run", "report", "simulate", "rooms", "evaluate", "depth", "config", "completions"];
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let done = libella(&["completions", shell]);
        let script = text(&done.stdout);
        assert!(done.status.success() && done.stderr.is_empty(), "{shell}");
        assert!(listed.iter().all(|name| script.contains(name)) && script.contains("spoil-depth"), "{shell}");
    }
    // The shell itself reads its script.
    let script = libella(&["completions", "bash"]).stdout;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("libella.bash");
    std::fs::write(&path, script).unwrap();
    match Command::new("bash").arg("-n").arg(&path).output() {
        Ok(read) => assert!(read.status.success(), "{}", text(&read.stderr)),
        Err(_) => println!("skipped: there is no bash"),
    }
}

/// A recording whose estimator never starts: it turns, and half a second is too short for a start in motion.
fn turning() -> Folder {
    let folder = Folder::new();
    folder.edit_lines("imu0/data.csv", |lines| {
        for (index, line) in lines.iter_mut().enumerate().skip(1) {
            let stamp = line.split(',').next().unwrap().to_owned();
            *line = format!("{stamp},0.8{index:03},-0.5,0.6,9.2,0.3,-3.0{index:03}");
        }
    });
    folder
}

#[test]
fn json_is_the_report_and_nothing_else() {
    let folder = turning();
    let out = folder.root().join("results");
    let done = libella(&["run", folder.root().to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"]);
    assert_eq!(done.status.code(), Some(4), "{}", text(&done.stderr));
    let printed: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let written: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(printed, written);
    assert_eq!((&printed["poses"], &printed["frames"]), (&0.into(), &10.into()));
    assert!(text(&done.stderr).contains("no trajectory came out"));
    // Quiet is about words.
    let quiet = libella(&["run", folder.root().to_str().unwrap(), "--out", out.to_str().unwrap(), "--json", "--quiet"]);
    assert!(serde_json::from_slice::<serde_json::Value>(&quiet.stdout).is_ok());
}

#[test]
fn a_recording_without_truth_is_told_so_once() {
    let folder = turning();
    std::fs::remove_dir_all(folder.path("state_groundtruth_estimate0")).unwrap();
    let (root, out) = (folder.root().to_str().unwrap().to_owned(), folder.root().join("results"));
    let said = "no ground truth in the recording: errors are not measured";
    let done = libella(&["run", &root, "--out", out.to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(4), "{}", text(&done.stderr));
    assert_eq!(text(&done.stdout).matches(said).count(), 1, "{}", text(&done.stdout));
    // No terminal, no colours, no summary.
    assert!(!done.stdout.contains(&0x1b) && !text(&done.stdout).contains("tracked none"));
    let json = libella(&["run", &root, "--out", out.to_str().unwrap(), "--json"]);
    assert!(!text(&json.stdout).contains(said) && text(&json.stderr).contains(said), "{}", text(&json.stderr));
    let quiet = libella(&["run", &root, "--out", out.to_str().unwrap(), "--quiet"]);
    assert!(quiet.stdout.is_empty() && !text(&quiet.stderr).contains(said), "{}", text(&quiet.stderr));
}

#[cfg(not(feature = "rerun"))]
#[test]
fn a_viewer_that_is_not_built_in_is_said_before_anything_is_read() {
    for option in ["--rerun=flight.rrd", "--rerun-connect"] {
        for command in [&["run", "nowhere", option][..], &["demo", option]] {
            let done = libella(command);
            let said = text(&done.stderr);
            assert_eq!((done.status.code(), said.lines().count()), (Some(2), 1), "{said}");
            assert!(said.contains("without the viewer rerun") && said.contains("--features rerun"), "{said}");
        }
    }
}
