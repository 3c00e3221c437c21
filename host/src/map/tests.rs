//! From simulated corners through the estimator to the smooth trajectory.

use std::sync::atomic::AtomicBool;

use libella_core::time::Span;

use super::{FlightRecord, Smooth, smooth};
use crate::config::Config;
use crate::dataset::Recording;
use crate::eval::evaluate;
use crate::pipeline::{self, Run, Watch, tracked_recording};
use crate::sim::{AnalyticConfig, FeatureConfig, ImuConfig, MotionKind, SimulationConfig, simulate};

struct Flown {
    recording: Recording,
    config: Config,
    run: Run,
    record: FlightRecord,
}

fn fly(imu: ImuConfig, sigma_px: f64) -> Flown {
    let simulation = SimulationConfig {
        motion: AnalyticConfig { kind: MotionKind::Medium, duration_s: 20.0, rest_s: 1.0, ..AnalyticConfig::default() },
        imu,
        features: FeatureConfig { sigma_px, outlier_share: if sigma_px > 0.0 { 0.01 } else { 0.0 }, ..FeatureConfig::default() },
        ..SimulationConfig::default()
    };
    let recording = tracked_recording("simulated", simulate(&simulation, 4).unwrap());
    let mut config = Config::default();
    config.estimator.sigma_px = sigma_px.max(0.4);
    let stop = AtomicBool::new(false);
    let (run, record) =
        pipeline::run_with(&recording, &config, None, Watch { record: true, ..Watch::default() }, &stop, |_, _| ()).unwrap();
    Flown { recording, config, run, record }
}

impl Flown {
    fn smooth(&self) -> Smooth {
        smooth(&self.record, &self.recording, &self.config, &[], &AtomicBool::new(false), |_| ()).unwrap().unwrap()
    }

    /// Causal and smooth, m.
    fn ate_m(&self, smooth: &Smooth) -> (f64, f64) {
        let truth = self.recording.truth.as_ref().unwrap();
        let of = |trajectory| evaluate(&trajectory, truth, &self.config.evaluation).unwrap().ate_rmse_m;
        (of(self.run.trajectory()), of(smooth.trajectory()))
    }
}

#[test]
fn a_noisy_flight_becomes_better_and_the_causal_pass_is_not_touched() {
    let flown = fly(ImuConfig::default(), 1.0);
    let smooth = flown.smooth();
    let stamps = flown.run.poses().map(|pose| pose.stamp);
    assert!(smooth.poses.iter().map(|pose| pose.stamp).eq(stamps), "one pose for every causal one");
    let (causal, smoothed) = flown.ate_m(&smooth);
    eprintln!("causal {causal:.4} m, smooth {smoothed:.4} m, {:?}", smooth.epochs);
    assert!(smoothed < 0.7 * causal, "{smoothed} {causal}");
    let plain = pipeline::run(&flown.recording, &flown.config, &AtomicBool::new(false), |_| ()).unwrap();
    assert!(plain.poses().eq(flown.run.poses()));
}

#[test]
fn without_noise_the_flight_is_found_exactly() {
    let flown = fly(ImuConfig { noise: None, ..ImuConfig::default() }, 0.0);
    let smooth = flown.smooth();
    let (_, smoothed) = flown.ate_m(&smooth);
    let cost = smooth.epochs[0].cost[1] / smooth.epochs[0].observations as f64;
    // The biases of the sensor are not those expected, and the midpoint rule errs by microns.
    eprintln!("smooth {smoothed:.6} m, {cost:.2e} per corner");
    assert!(smoothed < 1e-3 && cost < 1e-3, "{smoothed} {cost}");
}

#[test]
fn images_between_keyframes_lie_on_the_truth() {
    let flown = fly(ImuConfig { noise: None, ..ImuConfig::default() }, 0.0);
    let smooth = flown.smooth();
    let truth = flown.recording.truth.as_ref().unwrap();
    let found = evaluate(&smooth.trajectory(), truth, &flown.config.evaluation).unwrap();
    assert!(found.ate_m.max < 2e-3, "{:?}", found.ate_m);
    // Velocities are those of the positions.
    for pair in smooth.poses.windows(2) {
        let dt = (pair[1].stamp - pair[0].stamp).as_seconds::<f64>();
        let moved = (pair[1].state.position_in_world - pair[0].state.position_in_world) / dt;
        let mean = (pair[0].state.velocity_in_world + pair[1].state.velocity_in_world) / 2.0;
        assert!((moved - mean).norm() < 0.02, "{moved} {mean}");
    }
}

#[test]
fn what_cannot_be_smoothed_is_said_with_its_reason() {
    let flown = fly(ImuConfig::default(), 1.0);
    let attempt = |record: &FlightRecord| {
        let stop = AtomicBool::new(false);
        smooth(record, &flown.recording, &flown.config, &[], &stop, |_| ()).map(|found| found.map(|found| found.poses.len()))
    };
    let nothing = attempt(&FlightRecord::default()).unwrap_err();
    assert!(nothing.to_string().contains("there is no causal trajectory"), "{nothing}");
    let mut blind = flown.record.clone();
    for frame in &mut blind.epochs[0].frames {
        frame.corners.clear();
    }
    assert!(attempt(&blind).unwrap_err().to_string().contains("no landmark is seen well enough"));
    let mut single = flown.record.clone();
    single.epochs[0].frames.truncate(1);
    assert!(attempt(&single).unwrap_err().to_string().contains("only 1 keyframes"));
    let mut late = flown.record.clone();
    for frame in &mut late.epochs[0].frames {
        frame.known.stamp = frame.known.stamp + Span::from_millis(1_000_000);
    }
    assert!(attempt(&late).unwrap_err().to_string().contains("no inertial samples"));
    // One epoch that cannot be adjusted does not spoil the other.
    let mut both = flown.record.clone();
    both.epochs.insert(0, single.epochs[0].clone());
    assert!(attempt(&both).unwrap().is_some_and(|poses| poses > 300));
    let stop = AtomicBool::new(true);
    assert_eq!(smooth(&flown.record, &flown.recording, &flown.config, &[], &stop, |_| ()), Ok(None));
}
