//! Figures of the odometry on simulated flights against a reviewed table, `golden/ate.txt`.
//!
//! A change of the algorithm shows as a diff of that file. `cargo test --test system golden::` runs the rows marked `fast`. All rows, in about ten minutes:
//! ```sh
//! cargo test --release --test system golden:: -- --ignored --nocapture
//! ```
//! `LIBELLA_ACCEPT=1` in front of either writes the figures of the rows it ran into the table instead, for review.
//!
//! Figures agree on one machine to the last digit. On another the mathematics library may round differently, and an outlier or
//! a keyframe that is decided the other way moves the figures; [`Tolerance`] says by how much they may.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use libella_host::config::{Config, Scalar};
use libella_host::dataset::Recording;
use libella_host::eval::evaluate;
use libella_host::pipeline::{self, Ended};
use libella_host::sim::{
    AnalyticConfig, FeatureConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight, SimulationConfig, simulate,
};

/// How far a figure may be from the table.
struct Tolerance;

impl Tolerance {
    /// A tenth of the error, and a millimetre where the error itself is a few.
    fn ate_m(reviewed: f64) -> f64 {
        0.1 * reviewed + 0.001
    }
    /// Scale is decided in the first seconds, by what has been tracked then.
    const SCALE_PERCENT: f64 = 0.15;
    /// Initialisation an image earlier or later in 300.
    const COVERAGE_PERCENT: f64 = 0.7;
}

/// One flight.
struct Case {
    world: &'static str,
    scene_seed: u64,
    motion: &'static str,
    duration_s: f64,
    noise: &'static str,
    scalar: Scalar,
    fast: bool,
}

/// The columns that name a row.
impl Case {
    fn key(&self) -> String {
        let (scalar, fast) = (if self.scalar == Scalar::F64 { "f64" } else { "f32" }, if self.fast { "fast" } else { "-" });
        let world = format!("{}-{}", self.world, self.scene_seed);
        format!("{world:<11} {:<14} {:>5.0}  {:<6} {scalar}  {fast:<5}", self.motion, self.duration_s, self.noise)
    }

    /// Standard deviation (px) and share of outliers of the corners.
    fn corners(&self) -> (f64, f64) {
        match self.noise {
            "none" => (0.0, 0.0),
            "high" => (1.0, 0.05),
            _ => (0.35, 0.01),
        }
    }

    fn recording(&self) -> Recording {
        let kind = MotionKind::from_name(self.motion).unwrap();
        let motion = AnalyticConfig { kind, duration_s: self.duration_s, ..AnalyticConfig::default() };
        let quiet = self.noise == "none";
        let imu = if quiet { ImuConfig { noise: None, ..ImuConfig::default() } } else { ImuConfig::default() };
        if self.world == "points" {
            let (sigma_px, outlier_share) = self.corners();
            let features = FeatureConfig { sigma_px, outlier_share, ..FeatureConfig::default() };
            let config = SimulationConfig { motion, imu, features, ..SimulationConfig::default() };
            return pipeline::tracked_recording(self.motion, simulate(&config, self.scene_seed).unwrap());
        }
        let source = MotionSource::Analytic(motion, imu);
        let flight = RenderedFlight::new(&source, &RenderConfig::default(), self.scene_seed, self.scene_seed).unwrap();
        pipeline::rendered_recording(self.motion, &Arc::new(flight)).0
    }

    fn figures(&self) -> Figures {
        let recording = self.recording();
        let mut config = Config { scalar: self.scalar, ..Config::default() };
        // Whoever brings corners knows how good they are.
        config.estimator.sigma_px = config.estimator.sigma_px.max(self.corners().0);
        let run = pipeline::run(&recording, &config, &AtomicBool::new(false), |_| ()).unwrap();
        assert_eq!(run.ended, Ended::Complete, "{}", self.key());
        let found = evaluate(&run.trajectory(), recording.truth.as_ref().unwrap(), &config.evaluation).ok();
        Figures {
            ate_m: found.as_ref().map(|found| found.ate_rmse_m),
            // A scale needs a path: standing still or turning on the spot has none.
            scale_percent: found.filter(|found| found.path_length_m > 0.5).map(|found| found.scale_error_percent),
            coverage_percent: 100.0 * run.poses().count() as f64 / recording.listed_frames as f64,
        }
    }
}

/// The columns that are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Figures {
    ate_m: Option<f64>,
    scale_percent: Option<f64>,
    coverage_percent: f64,
}

impl Figures {
    fn text(&self) -> String {
        let or_dash = |value: Option<f64>, digits| value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
        format!("{:>8}  {:>7}  {:>6.1}", or_dash(self.ate_m, 4), or_dash(self.scale_percent, 2), self.coverage_percent)
    }

    fn parse(text: &str) -> Self {
        let values: Vec<_> = text.split_whitespace().map(|word| (word != "-").then(|| word.parse().unwrap())).collect();
        let [ate_m, scale_percent, Some(coverage_percent)] = values[..] else { panic!("no figures: {text}") };
        Self { ate_m, scale_percent, coverage_percent }
    }

    /// What differs by more than the tolerance.
    fn contradiction(&self, reviewed: &Self) -> Option<&'static str> {
        let apart = |a: Option<f64>, b: Option<f64>, tolerance: f64| match (a, b) {
            (Some(a), Some(b)) => (a - b).abs() > tolerance,
            (None, None) => false,
            _ => true,
        };
        let (found, wanted) = (Self::parse(&self.text()), reviewed);
        if apart(found.ate_m, wanted.ate_m, Tolerance::ate_m(wanted.ate_m.unwrap_or_default())) {
            return Some("ATE");
        }
        if apart(found.scale_percent, wanted.scale_percent, Tolerance::SCALE_PERCENT) {
            return Some("scale error");
        }
        ((found.coverage_percent - wanted.coverage_percent).abs() > Tolerance::COVERAGE_PERCENT).then_some("coverage")
    }
}

const HEADER: &str = "\
# Causal trajectories of simulated flights. world-seed: `points` flies through point features, `room` through rendered images.
# noise: none | euroc (0.35 px, 1 % outliers; the sensor's datasheet) | high (1 px, which
# the estimator is told, 5 % outliers; same sensor). ATE after SE(3) alignment.
# `-`: no figure (no pose, or no path). tests/golden.rs says what may differ, and how to accept new figures.
# world     motion         secs   noise  type  rows    ATE [m]  scale %  cover %
";

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut add = |world, scene_seed, motion, duration_s, noise, scalar, fast| {
        cases.push(Case { world, scene_seed, motion, duration_s, noise, scalar, fast });
    };
    use Scalar::{F32, F64};
    for motion in ["easy", "medium", "difficult"] {
        add("points", 1, motion, 20.0, "euroc", F64, true);
    }
    add("points", 1, "medium", 20.0, "euroc", F32, true);
    add("points", 1, "still", 10.0, "euroc", F64, true);
    add("room", 1, "easy", 8.0, "euroc", F64, true);
    for motion in ["easy", "medium", "difficult"] {
        for (noise, scalar) in [("none", F64), ("euroc", F64), ("euroc", F32), ("high", F64), ("high", F32)] {
            for seed in [2, 3] {
                add("points", seed, motion, 30.0, noise, scalar, false);
            }
        }
    }
    for motion in ["pure-rotation", "fast-yaw", "still"] {
        add("points", 2, motion, 30.0, "euroc", F64, false);
    }
    for motion in ["easy", "medium", "difficult", "fast-yaw"] {
        add("room", 2, motion, 30.0, "euroc", F64, false);
    }
    add("room", 2, "medium", 30.0, "euroc", F32, false);
    add("room", 3, "medium", 30.0, "euroc", F64, false);
    cases
}

fn table() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/ate.txt")
}

/// Runs some rows and compares them with the table, or writes them into it.
fn check(wanted: impl Fn(&Case) -> bool) {
    // Both tests may run at once and accept.
    static TABLE: Mutex<()> = Mutex::new(());
    let mut found = Vec::new();
    for case in cases().into_iter().filter(wanted) {
        let figures = case.figures();
        eprintln!("{}{}", case.key(), figures.text());
        found.push((case.key(), figures));
    }
    let _guard = TABLE.lock();
    let reviewed = std::fs::read_to_string(table()).unwrap_or_default();
    let row = |key: &str| reviewed.lines().find_map(|line| line.strip_prefix(key));
    if std::env::var_os("LIBELLA_ACCEPT").is_some() {
        let mut text = HEADER.to_owned();
        for case in cases() {
            let key = case.key();
            let new = found.iter().find(|(known, _)| *known == key).map(|(_, figures)| figures.text());
            if let Some(figures) = new.or_else(|| row(&key).map(str::to_owned)) {
                writeln!(text, "{key}{figures}").unwrap();
            }
        }
        std::fs::write(table(), text).unwrap();
        return;
    }
    let faults: Vec<_> = found
        .iter()
        .filter_map(|(key, figures)| {
            let Some(reviewed) = row(key) else { return Some(format!("{key}{} is not in the table", figures.text())) };
            let what = figures.contradiction(&Figures::parse(reviewed))?;
            Some(format!("{key}{reviewed}  reviewed\n{key}{}  now: {what} differs", figures.text()))
        })
        .collect();
    assert!(faults.is_empty(), "\n{}\nLIBELLA_ACCEPT=1 writes new figures for review", faults.join("\n"));
}

#[test]
fn fast_rows_are_those_of_the_table() {
    check(|case| case.fast);
}

#[test]
#[ignore = "ten minutes in release: cargo test --release --test system golden:: -- --ignored"]
fn all_rows_are_those_of_the_table() {
    check(|_| true);
}

/// The comparison itself: within the tolerance it agrees, beyond it names the column.
#[test]
fn a_figure_beyond_its_tolerance_is_named() {
    let reviewed = Figures::parse("  0.0200  0.50    90.0");
    let with = |ate, scale, coverage| Figures { ate_m: ate, scale_percent: scale, coverage_percent: coverage };
    assert_eq!(with(Some(0.0229), Some(0.6), 90.5).contradiction(&reviewed), None);
    assert_eq!(with(Some(0.0232), Some(0.5), 90.0).contradiction(&reviewed), Some("ATE"));
    assert_eq!(with(Some(0.0168), Some(0.5), 90.0).contradiction(&reviewed), Some("ATE"));
    assert_eq!(with(Some(0.02), Some(0.7), 90.0).contradiction(&reviewed), Some("scale error"));
    assert_eq!(with(Some(0.02), None, 90.0).contradiction(&reviewed), Some("scale error"));
    assert_eq!(with(Some(0.02), Some(0.5), 91.0).contradiction(&reviewed), Some("coverage"));
}

/// The table holds every row, and no other.
#[test]
fn the_table_is_complete() {
    if std::env::var_os("LIBELLA_ACCEPT").is_some() {
        return; // it is being written
    }
    let reviewed = std::fs::read_to_string(table()).unwrap();
    let keys: Vec<_> = cases().iter().map(Case::key).collect();
    let rows: Vec<_> = reviewed.lines().filter(|line| !line.starts_with('#')).collect();
    assert_eq!(rows.len(), keys.len());
    assert!(rows.iter().zip(&keys).all(|(row, key)| row.starts_with(key.as_str())));
}
