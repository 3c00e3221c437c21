//! Simulated corner tracks on the recorded motion and with the recorded inertial samples of EuRoC flights.
//!
//! The data are looked for in `LIBELLA_DATA`, or in `../shared/data` beside the workspace. Without them the tests say so and pass.
//!
//! One sequence is flown by default. All of them, five seeds each, in both scalars:
//! ```text
//! cargo test --release --test system real_motion:: -- --ignored --nocapture
//! ```

use std::path::PathBuf;

use crate::support::flight::{Flown, fly, on_all_cores, real_config};
use crate::support::recordings::data;
use crate::support::tolerance::{ATE_GRAIN_M, ATE_MACHINE_HALL_M, ATE_VICON_ROOM_M, SCALAR_SHARE};
use libella_core::real::Real;
use libella_host::sim::{RealMotionConfig, Recording, real_motion};

const SEQUENCES: [(&str, f64); 4] = [
    ("V1_01_easy", ATE_VICON_ROOM_M),
    ("V1_02_medium", ATE_VICON_ROOM_M),
    ("V2_01_easy", ATE_VICON_ROOM_M),
    ("MH_04_difficult", ATE_MACHINE_HALL_M),
];

/// The folder of a sequence, or `None` with a word about it.
fn folder(sequence: &str) -> Option<PathBuf> {
    data(&format!("euroc_motion/{sequence}"))
}

/// One row of the table: position error, scale error, losses, time of initialisation, coverage.
struct Row {
    ate_m: f64,
    losses: usize,
    coverage: f64,
    text: String,
}

fn row<T: Real>(name: &str, seed: u64, recording: &Recording) -> Row {
    let flown: Flown = fly(recording, real_config::<T>(recording));
    let accuracy = flown.accuracy(recording);
    let (ate_m, scale) = accuracy.map_or((f64::INFINITY, f64::NAN), |found| (found.ate_m, found.scale_error_percent));
    let text = format!(
        "{name:16} seed {seed} {:3}  ATE {ate_m:.4} m  scale {scale:+.2} %  lost {}  initialised after {:.2} s  coverage {:.3}",
        std::any::type_name::<T>(),
        flown.losses(),
        flown.initialised_after_s().unwrap_or(f64::NAN),
        flown.coverage(),
    );
    println!("{text}");
    Row { ate_m, losses: flown.losses(), coverage: flown.coverage(), text }
}

/// Flies sequences with seeds in both scalars and returns what is wrong with them.
fn faults(jobs: &[(&str, f64, PathBuf, u64)]) -> Vec<String> {
    let rows = on_all_cores(jobs, |(name, bound_m, folder, seed)| {
        let recording = real_motion(folder, &RealMotionConfig::default(), *seed).unwrap_or_else(|error| panic!("{error}"));
        (row::<f64>(name, *seed, &recording), row::<f32>(name, *seed, &recording), *bound_m)
    });
    let mut faults = Vec::new();
    for (wide, narrow, bound_m) in &rows {
        for row in [wide, narrow] {
            if row.losses > 0 || row.coverage < 0.9 {
                faults.push(format!("lost, or without a pose for long: {}", row.text));
            }
            if row.ate_m > *bound_m {
                faults.push(format!("more than {bound_m} m off: {}", row.text));
            }
        }
    }
    // Of each sequence the mean over the seeds: which corners pass for outliers alone changes one flight by some percent.
    for sequence in SEQUENCES.map(|(name, _)| name) {
        let flights: Vec<_> = jobs.iter().zip(&rows).filter(|((name, ..), _)| *name == sequence).map(|(_, row)| row).collect();
        let mean = |pick: fn(&(Row, Row, f64)) -> f64| flights.iter().map(|row| pick(row)).sum::<f64>() / flights.len() as f64;
        let (wide, narrow) = (mean(|row| row.0.ate_m), mean(|row| row.1.ate_m));
        if narrow > wide * (1.0 + SCALAR_SHARE) + ATE_GRAIN_M {
            faults.push(format!("{sequence}: {wide:.4} m in f64, {narrow:.4} m in f32"));
        }
    }
    faults
}

#[test]
fn one_room_is_flown_accurately_in_both_scalars() {
    let (name, bound_m) = SEQUENCES[1];
    let Some(folder) = folder(name) else { return };
    let faults = faults(&[(name, bound_m, folder, 1)]);
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Measured, ATE in m over the five seeds, nothing lost anywhere:
/// ```text
///         V1_01           V1_02           V2_01           MH_04
/// f64     .033 to .056    .036 to .049    .048 to .058    .104 to .143, mean .126
/// f32     .034 to .056    .037 to .049    .045 to .057    .102 to .143, mean .125
/// ```
#[test]
#[ignore = "40 flights of two minutes: run in release, see the head of this file"]
fn all_sequences_are_flown_accurately_with_five_seeds() {
    let known = SEQUENCES.into_iter().filter_map(|(name, bound_m)| Some((name, bound_m, folder(name)?)));
    let jobs: Vec<_> = known.flat_map(|(name, bound, folder)| (1..=5).map(move |seed| (name, bound, folder.clone(), seed))).collect();
    let faults = faults(&jobs);
    assert!(faults.is_empty(), "{faults:#?}");
}
