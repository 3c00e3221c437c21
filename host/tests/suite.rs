//! A suite as a user meets it: from nothing to a table, again without a run, after damage, with a threshold, interrupted.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn libella(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_libella")).args(arguments).env_remove("LIBELLA_DATA").output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Two flights of 4 s, with depth maps of the recordings themselves, so that no network is needed.
const TINY: &str = r#"
name = "tiny"
runs = 2
depth = "recorded"
variants = ["mono", "cnn+u"]

[[sequences]]
name = "medium, room 1"
simulate = { motion = "medium", scene_seed = 1, duration_s = 4 }

[[sequences]]
name = "easy"
simulate = { motion = "easy", scene_seed = 2, duration_s = 4.0 }
"#;

struct Tiny {
    folder: tempfile::TempDir,
}

impl Tiny {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
        Self { folder }
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    fn evaluate(&self, more: &[&str]) -> Output {
        let (suite, out) = (self.folder.path().join("tiny.toml"), self.out());
        let fixed = ["evaluate", "--suite", suite.to_str().unwrap(), "--out", out.to_str().unwrap()];
        libella(&[fixed.as_slice(), more].concat())
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.out().join(name)).unwrap()
    }

    fn results(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = std::fs::read_dir(self.out().join("runs")).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    }
}

#[test]
fn from_nothing_to_a_table_and_again_without_a_run() {
    let tiny = Tiny::new();
    let first = tiny.evaluate(&[]);
    assert!(first.status.success(), "{}", text(&first.stderr));
    let said = text(&first.stdout);
    assert!(said.contains("runs      8 made, 0 found"), "{said}");
    for word in ["RMSE ATE, m, median of 2 runs", "mono-inertial", "+ CNN + U", "medium, room 1", "mean", "causal", "without scale"] {
        assert!(said.contains(word), "{word} is missing:\n{said}");
    }
    assert!(!said.contains("**") && tiny.read("table.md").contains("**"), "the best is bold in the file alone");
    assert!(!said.contains("published"), "no figure of EuRoC belongs beside drawn flights");
    assert_eq!(tiny.results().len(), 8);

    // The files agree with each other.
    let suite: Value = serde_json::from_str(&tiny.read("suite.json")).unwrap();
    let results = suite["results"].as_array().unwrap();
    assert_eq!((results.len(), &suite["complete"]), (8, &Value::Bool(true)));
    assert_eq!((&results[0]["gravity_m_s2"], &results[0]["seed"]), (&Value::from(9.81), &Value::from(0)));
    assert!((results[1]["gravity_m_s2"].as_f64().unwrap() - 9.81 - 1e-9).abs() < 1e-13 && results[1]["seed"] == 1);
    let (first, second) = (&results[0], &results[1]);
    assert_eq!((&first["skipped_images"], &second["skipped_images"]), (&Value::from(0), &Value::from(1)));
    assert_eq!(first["frames"].as_u64().unwrap(), second["frames"].as_u64().unwrap() + 1, "the second begins an image later");
    let ate = |index: usize| results[index]["ate_rmse_m"].as_f64().unwrap();
    let median = suite["table"][0]["ate_rmse_m_median"].as_f64().unwrap();
    assert!((median - 0.5 * (ate(0) + ate(1))).abs() < 1e-12);
    assert!(said.contains(&format!("{median:.4}")), "{median}\n{said}");
    assert_eq!(tiny.read("runs.csv").lines().count(), 9);
    assert!(results[2]["depth_maps"][1].as_u64().unwrap() > 5 && results[0]["depth_maps"].is_null());

    // The first run of the first column is what `libella run` computes.
    let (recording, alone) = (tiny.out().join("recordings/medium_s1_4s_depth"), tiny.folder.path().join("alone"));
    let done = libella(&["run", recording.to_str().unwrap(), "--planes", "off", "--quiet", "--out", alone.to_str().unwrap()]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let report: Value = serde_json::from_str(&std::fs::read_to_string(alone.join("report.json")).unwrap()).unwrap();
    assert!((report["ate_rmse_m"].as_f64().unwrap() - ate(0)).abs() < 1e-12);

    // Nothing is run twice; what is gone or cut off is run again, and the table does not change.
    let table = tiny.read("table.md");
    let second = tiny.evaluate(&[]);
    assert!(text(&second.stdout).contains("runs      0 made, 8 found"), "{}", text(&second.stdout));
    assert_eq!(tiny.read("table.md"), table);
    let files = tiny.results();
    std::fs::remove_file(&files[0]).unwrap();
    std::fs::write(&files[5], &std::fs::read(&files[5]).unwrap()[..200]).unwrap();
    let third = tiny.evaluate(&[]);
    assert!(text(&third.stdout).contains("runs      2 made, 6 found"), "{}", text(&third.stdout));
    assert_eq!((tiny.read("table.md"), tiny.results()), (table, files));

    // Another configuration is another run.
    let config = tiny.folder.path().join("config.toml");
    std::fs::write(&config, "[estimator]\nsigma_px = 0.5\n").unwrap();
    let other = tiny.evaluate(&["--config", config.to_str().unwrap(), "--variants", "mono", "--runs", "1", "--json"]);
    assert!(other.status.success(), "{}", text(&other.stderr));
    let printed: Value = serde_json::from_slice(&other.stdout).unwrap();
    assert_eq!((printed["results"].as_array().unwrap().len(), tiny.results().len()), (2, 10));

    above_a_threshold(&tiny);
    #[cfg(unix)]
    interrupted(&tiny);
}

/// Works on what is there.
fn above_a_threshold(tiny: &Tiny) {
    let failed = tiny.evaluate(&["--fail-above", "0.000001", "--quiet"]);
    let said = text(&failed.stderr);
    assert_eq!((failed.status.code(), said.lines().count()), (Some(7), 4), "{said}");
    assert!(said.contains("libella: medium, room 1, + CNN + U: 0.") && said.contains("0.000001 m is the most allowed"), "{said}");
    assert!(tiny.evaluate(&["--fail-above", "100", "--quiet"]).status.success());
    for nonsense in ["0", "-1", "nan"] {
        assert_eq!(tiny.evaluate(&["--fail-above", nonsense]).status.code(), Some(2));
    }
}

#[cfg(unix)]
fn interrupted(tiny: &Tiny) {
    let out = tiny.folder.path().join("long");
    let (suite, recordings) = (tiny.folder.path().join("tiny.toml"), tiny.out().join("recordings"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_libella"))
        .args(["evaluate", "--runs", "100", "--variants", "mono", "--workers", "1", "--suite"])
        .arg(&suite)
        .arg("--out")
        .arg(&out)
        .arg("--recordings")
        .arg(&recordings)
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let finished = || {
        let files = std::fs::read_dir(out.join("runs")).into_iter().flatten().flatten();
        files.filter(|entry| entry.path().extension().is_some_and(|kind| kind == "json")).count()
    };
    while finished() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let done = child.wait_with_output().unwrap();
    let kept = finished();
    assert_eq!(done.status.code(), Some(130), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains(&format!("interrupted after {kept} of 200 runs")), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains(&format!("Not finished: {kept} of 200 runs")) && (2..200).contains(&kept));
}

#[test]
fn broken_suites_end_in_one_sentence_that_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    let evaluate = |path: &Path| {
        let done = libella(&["evaluate", "--suite", path.to_str().unwrap(), "--out", folder.path().join("out").to_str().unwrap()]);
        (done.status.code(), text(&done.stderr))
    };
    for (broken, said, code) in [
        ("name = \"x\"\nruns = \"many\"\n", "mine.toml line 2: ", 2),
        ("name = \"x\"\n[[sequence]]\n", "unknown field `sequence`", 2),
        ("name = \"x\"\n", "mine.toml: has no sequence", 2),
        ("name = \"x\"\n[[sequences]]\nname = \"a\"\npath = \"gone\"\n", "sequence `a`: there is no gone in ", 3),
        ("name = \"x\"\n[[sequences]]\nname = \"a\"\nsimulate = { motion = \"loopings\" }\n", "there is no loopings in ", 3),
        (
            "name = \"x\"\nconfig = \"c.toml\"\n[[sequences]]\nname = \"a\"\nsimulate = { motion = \"easy\" }\n",
            "c.toml: there is no such file",
            2,
        ),
    ] {
        std::fs::write(&file, broken).unwrap();
        let (found, message) = evaluate(&file);
        assert_eq!(found, Some(code), "{message}");
        assert!(message.starts_with("libella: ") && message.contains(said) && message.lines().count() == 1, "{message}");
    }
    let (code, message) = evaluate(&folder.path().join("absent.toml"));
    assert!(code == Some(2) && message.contains("absent.toml: there is no such file"), "{message}");
    let done = libella(&["evaluate", "--euroc", folder.path().to_str().unwrap()]);
    assert!(done.status.code() == Some(3) && text(&done.stderr).contains("none of V1_01 to V2_03"), "{}", text(&done.stderr));
}

#[test]
fn a_recording_without_truth_is_refused_before_the_first_run() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("recording");
    let done = libella(&["simulate", "--quiet", "--no-depth", "--duration", "1", "--out", out.to_str().unwrap()]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    std::fs::remove_dir_all(out.join("mav0/state_groundtruth_estimate0")).unwrap();
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, "name = \"x\"\nvariants = [\"mono\"]\n[[sequences]]\nname = \"a\"\npath = \"recording\"\n").unwrap();
    let done = libella(&["evaluate", "--suite", file.to_str().unwrap(), "--out", folder.path().join("out").to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(3));
    assert!(text(&done.stderr).contains("sequence `a` has no ground truth"), "{}", text(&done.stderr));
}

#[test]
fn a_suite_and_a_comparison_are_not_mixed() {
    for arguments in [
        vec!["evaluate", "a.tum"],
        vec!["evaluate", "a.tum", "b.tum", "--suite", "x.toml"],
        vec!["evaluate", "--suite", "x", "--euroc", "y"],
    ] {
        assert_eq!(libella(&arguments).status.code(), Some(2), "{arguments:?}");
    }
}
