//! Whether the estimator knows how wrong it is.
//!
//! # Model
//! Vision and inertial samples observe neither position nor heading of the world: the estimator fixes both by a prior of known
//! strength on the first frame. Truth is moved into that world by the heading and position of the first frame, where the
//! estimate has no such error by definition; so what the prior claims to be uncertain of the gauge is taken off the covariance,
//! ```text
//! e = [ Log(R_estᵀ R_truth)   p_truth − p_est ]          J = [ R_estᵀ ẑ   0 ]     6×4
//! P' = P − J Σ Jᵀ     ε = eᵀ P'⁻¹ e                          [ ẑ × (p − p₀)   I ]
//! ```
//! and ε is χ² distributed with 6 degrees of freedom for a consistent estimator: the mean over N runs lies within
//! `6 ± 2.576 √(12/N)` in 99 of 100 cases.
//!
//! # Measured
//! Over 50 runs from rest, 6 ± 1.26 expected: 6.8 while the body leaves its rest (1.5 s after the start), 5.0 after 4 s, 5.4 after 7 s.
//! With corners of 1 px most of these flights are started in motion, because the image never seems to stand still; where they are made to start at
//! rest, the first figure is 28: a linear model of motion times depth claims to know both while the body hardly moved.
//! Over 100 runs, 5, 10, 20 and 40 s after the start, 6 ± 0.89 expected:
//! ```text
//! from rest      5.98   5.98   5.86   5.66
//! in motion      5.06   5.53   5.80   6.13
//! ```

use crate::support::flight::{Flown, Knowledge, fly, on_all_cores, simulated_config, truth_at};
use crate::support::tolerance::{NEES_GAUGE_SIGMA, NEES_SHARE_LEAST, NEES_SHARE_MOST};
use libella_core::imu::NavState;
use libella_core::time::{Span, Timestamp};
use libella_host::sim::{AnalyticConfig, FeatureConfig, MotionKind, Recording, SimulationConfig, simulate};
use nalgebra::{Matrix4, Matrix6, SMatrix, UnitQuaternion, Vector3, Vector6};

/// When the error is looked at, s after initialisation; the last one has to lie in the 99 % band, the others near it.
const LOOKS_S: [f64; 2] = [4.0, 7.0];
/// Time for initialisation on top, s.
const START_S: f64 = 5.0;

fn recording(seed: u64, rest_s: f64, duration_s: f64) -> Recording {
    let kind = if seed.is_multiple_of(2) { MotionKind::Medium } else { MotionKind::Difficult };
    let config = SimulationConfig {
        motion: AnalyticConfig { kind, duration_s, rest_s, ..AnalyticConfig::default() },
        features: FeatureConfig { count: 80, outlier_share: 0.0, ..FeatureConfig::default() },
        frame_rate_hz: 10.0,
        ..SimulationConfig::default()
    };
    simulate(&config, seed).unwrap_or_else(|error| panic!("{error}"))
}

/// The transform of four degrees of freedom from the estimate's world to that of the truth.
struct World {
    heading: UnitQuaternion<f64>,
    shift_m: Vector3<f64>,
    origin_m: Vector3<f64>,
}

impl World {
    fn new(estimate: &NavState<f64>, truth: &NavState<f64>) -> Self {
        // R = Rz(ψ) is nearest to R_truth R_estᵀ where ψ is twice the angle of its quaternion's (w, z) part.
        let whole = truth.world_from_body * estimate.world_from_body.inverse();
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.0 * whole.k.atan2(whole.w));
        Self { heading, shift_m: truth.position_in_world - heading * estimate.position_in_world, origin_m: estimate.position_in_world }
    }

    /// Error and covariance in the estimate's world, the gauge taken off.
    ///
    /// The gauge's directions are those at the states where the solver linearised: a millimetre beside them, and what is known
    /// of the relative pose (1e-7 m²) drowns in what is not (1e-4 m²).
    fn error(&self, known: &Knowledge, truth: &NavState<f64>) -> (Vector6<f64>, Matrix6<f64>) {
        let (estimate, covariance, predicted) = (&known.state, &known.pose_covariance, &known.predicted);
        let back = self.heading.inverse();
        let turn = (estimate.world_from_body.inverse() * (back * truth.world_from_body)).scaled_axis();
        let shift = back * (truth.position_in_world - self.shift_m) - estimate.position_in_world;
        let mut gauge = SMatrix::<f64, 6, 4>::zeros();
        gauge.fixed_view_mut::<3, 1>(0, 0).copy_from(&(predicted.world_from_body.inverse() * Vector3::z()));
        gauge.fixed_view_mut::<3, 1>(3, 0).copy_from(&Vector3::z().cross(&(predicted.position_in_world - self.origin_m)));
        gauge.fixed_view_mut::<3, 3>(3, 1).fill_with_identity();
        let claimed = Matrix4::identity() * (NEES_GAUGE_SIGMA * NEES_GAUGE_SIGMA);
        (Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z), covariance - gauge * claimed * gauge.transpose())
    }
}

const WHY: &str = "see `Measured` at the head of this test";
const INDEFINITE: &str = "more is claimed to be known of the world's place than the prior says";

/// NEES of the whole pose (6), of the rotation alone (3) and of the position alone (3).
type Nees = [f64; 3];

fn nees(flown: &Flown, recording: &Recording, look: Timestamp) -> Result<Nees, &'static str> {
    let truth = |stamp| truth_at(recording, stamp).ok_or("no truth");
    let (first, origin) = flown.origin.ok_or("never initialised")?;
    let world = World::new(&origin, &truth(first)?);
    let known = flown.states.iter().find(|known| known.stamp >= look).ok_or("no pose that late")?;
    let (error, covariance) = world.error(known, &truth(known.stamp)?);
    let part = |at: usize| {
        let (e, p) = (error.fixed_rows::<3>(at).into_owned(), covariance.fixed_view::<3, 3>(at, at).into_owned());
        Ok(e.dot(&p.cholesky().ok_or(INDEFINITE)?.solve(&e)))
    };
    Ok([error.dot(&covariance.cholesky().ok_or(INDEFINITE)?.solve(&error)), part(0)?, part(3)?])
}

struct Study {
    /// Runs that never got a pose or were lost, or whose covariance is none.
    failures: Vec<(u64, &'static str)>,
    /// Mean NEES at each of the looks.
    means: Vec<Nees>,
}

fn study(seeds: std::ops::Range<u64>, rest_s: f64, looks_s: &[f64]) -> Study {
    let seeds: Vec<u64> = seeds.collect();
    let duration_s = START_S + rest_s + looks_s.iter().copied().fold(0.0, f64::max);
    let runs = on_all_cores(&seeds, |seed| {
        let recording = recording(*seed, rest_s, duration_s);
        let flown = fly::<f64>(&recording, simulated_config(&recording));
        let start = flown.states.first().ok_or("never initialised")?.stamp;
        let at = |seconds: f64| start + Span::from_millis((seconds * 1e3) as i64);
        if flown.losses() > 0 {
            return Err("lost");
        }
        looks_s.iter().map(|seconds| nees(&flown, &recording, at(*seconds))).collect::<Result<Vec<Nees>, _>>()
    });
    let failures = seeds.iter().zip(&runs).filter_map(|(seed, run)| Some((*seed, *run.as_ref().err()?))).collect();
    let good: Vec<_> = runs.iter().filter_map(|run| run.as_ref().ok()).collect();
    let mean = |look: usize, part: usize| good.iter().map(|run| run[look][part]).sum::<f64>() / good.len() as f64;
    let means = (0..looks_s.len()).map(|look| [0, 1, 2].map(|part| mean(look, part))).collect();
    Study { failures, means }
}

/// Whether the last look has to lie in the 99 % band.
#[derive(Clone, Copy, PartialEq)]
enum InTheEnd {
    Consistent,
    Near,
}

fn judge(name: &str, study: &Study, looks_s: &[f64], runs: usize, in_the_end: InTheEnd) {
    let half = 2.576 * (12.0 / runs as f64).sqrt();
    println!("{name}: failed {:?}", study.failures);
    assert!(study.failures.is_empty(), "runs without a usable estimate: {:?}", study.failures);
    for (look, (seconds, [pose, rotation, position])) in looks_s.iter().zip(&study.means).enumerate() {
        println!(
            "{name}: {runs} runs, {seconds:4.1} s after the start: mean NEES of the pose {pose:.2} (6 ± {half:.2}), rotation {rotation:.2} (3), position {position:.2} (3)"
        );
        let inside = (pose - 6.0).abs() <= half;
        if !inside {
            let share = (pose / 6.0).sqrt();
            println!("{name}: outside the 99 % band; errors are {share:.2} times those stated, {WHY}");
        }
        assert!(
            (6.0 * NEES_SHARE_LEAST..=6.0 * NEES_SHARE_MOST).contains(pose),
            "{name}: {seconds} s after the start the mean NEES is {pose:.2} where 6 is expected"
        );
        if in_the_end == InTheEnd::Consistent && look + 1 == looks_s.len() {
            assert!(inside, "{name}: in the end the mean NEES is {pose:.2}, outside 6 ± {half:.2}");
        }
    }
}

#[test]
fn the_stated_covariance_is_that_of_the_errors_made() {
    let runs = 50;
    judge("from rest", &study(0..runs, 1.5, &LOOKS_S), &LOOKS_S, runs as usize, InTheEnd::Consistent);
}

/// While a body leaves its rest, motion and depths explain each other.
#[test]
fn the_stated_covariance_holds_while_leaving_rest() {
    let runs = 50;
    judge("leaving rest", &study(0..runs, 1.5, &[1.5]), &[1.5], runs as usize, InTheEnd::Near);
}

#[test]
#[ignore = "200 runs of 40 s, from rest and in motion: cargo test --release --test system consistency:: -- --ignored --nocapture"]
fn the_stated_covariance_stays_that_of_the_errors_made() {
    let looks_s = [5.0, 10.0, 20.0, 40.0];
    judge("from rest", &study(1000..1100, 1.5, &looks_s), &looks_s, 100, InTheEnd::Near);
    judge("in motion", &study(2000..2100, 0.0, &looks_s), &looks_s, 100, InTheEnd::Near);
}
