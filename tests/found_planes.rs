//! The planes of whole flights: found from the corners of one camera, against the room that was flown through.

use std::sync::atomic::AtomicBool;

use libella_core::plane::PlaneClass;
use libella_host::config::Config;
use libella_host::eval::{Evaluation, evaluate};
use libella_host::pipeline::{self, Run};
use libella_host::planes::{FoundPlane, Planes};
use libella_host::sim::{AnalyticConfig, FeatureConfig, Flight, ImuConfig, MotionKind, RoomConfig, Scene};
use nalgebra::{Point3, Vector3};

/// For maps that were aligned to the truth.
const MOST_ANGLE_DEG: f64 = 1.5;
const MOST_OFFSET_M: f64 = 0.05;

struct Flown {
    run: Run,
    evaluation: Evaluation,
    scene: Scene,
}

fn fly(seed: u64, config: &Config) -> Flown {
    let motion = AnalyticConfig { kind: MotionKind::from_name("medium").unwrap(), duration_s: 40.0, ..AnalyticConfig::default() };
    let flight = Flight::analytic(&motion, &ImuConfig::default(), 20.0, seed).unwrap();
    let room = RoomConfig::vicon(&flight.path());
    let scene = Scene::room(&room, &flight.path(), seed).unwrap();
    let features = FeatureConfig { sigma_px: 0.35, outlier_share: 0.01, ..FeatureConfig::default() };
    let (recording, _) = flight.record(&room, &features, seed).unwrap();
    let recording = pipeline::tracked_recording("medium", recording);
    let run = pipeline::run(&recording, config, &AtomicBool::new(false), |_| ()).unwrap();
    let evaluation = evaluate(&run.trajectory(), recording.truth.as_ref().unwrap(), &config.evaluation).unwrap();
    Flown { run, evaluation, scene }
}

impl Flown {
    fn planes(&self) -> &Planes {
        self.run.planes.as_ref().unwrap()
    }

    fn standing(&self) -> impl Iterator<Item = &FoundPlane> {
        self.planes().planes.iter().filter(|plane| plane.gone_into.is_none())
    }

    /// Angle (degrees) and distance (m, at the middle of what was found) from the rectangle of the room that is nearest.
    fn nearest(&self, plane: &FoundPlane) -> (f64, f64) {
        let truth_from_world = self.evaluation.truth_from_estimate;
        let normal = truth_from_world.rotation * plane.normal_in_world;
        let middle = plane.polygon_in_world.iter().sum::<Vector3<f64>>() / plane.polygon_in_world.len() as f64;
        let middle = (truth_from_world * Point3::from(middle)).coords;
        let quads = self.scene.quads.iter().map(|quad| {
            let angle = quad.normal.dot(&normal).abs().min(1.0).acos().to_degrees();
            (angle, quad.normal.dot(&(middle - quad.corner)).abs())
        });
        quads.min_by(|a, b| (a.0 / MOST_ANGLE_DEG + a.1 / MOST_OFFSET_M).total_cmp(&(b.0 / MOST_ANGLE_DEG + b.1 / MOST_OFFSET_M))).unwrap()
    }
}

fn using(used: bool) -> Config {
    let mut config = Config::default();
    config.planes.used = used;
    config
}

#[test]
fn floor_and_walls_are_found_where_they_are_and_nothing_else() {
    let (mut planes, mut walls) = (0, 0);
    for seed in 1..=3 {
        let flown = fly(seed, &using(false));
        for plane in flown.standing() {
            let (angle_deg, offset_m) = flown.nearest(plane);
            println!("seed {seed}: {:?} {} points, {angle_deg:.2} deg, {:.1} cm", plane.class, plane.support, offset_m * 100.0);
            assert!(angle_deg < MOST_ANGLE_DEG && offset_m < MOST_OFFSET_M, "seed {seed}: a plane that is not there: {plane:?}");
            planes += 1;
            walls += usize::from(plane.class == PlaneClass::Wall);
        }
        assert_eq!(flown.standing().filter(|plane| plane.class == PlaneClass::Floor).count(), 1, "seed {seed}: the floor");
    }
    assert!(walls >= 3, "{walls} walls and {planes} planes in three rooms");
}

#[test]
fn planes_do_not_harm_the_trajectory_and_it_is_the_same_again() {
    let mut ratios = Vec::new();
    for seed in 1..=3 {
        let (without, with) = (fly(seed, &using(false)), fly(seed, &using(true)));
        println!(
            "seed {seed}: {:.4} m, with planes {:.4} m, {:?}",
            without.evaluation.ate_rmse_m,
            with.evaluation.ate_rmse_m,
            with.planes().share_on_planes
        );
        assert!(with.planes().share_on_planes.unwrap() > 0.05, "seed {seed}: nothing was drawn to a plane");
        ratios.push(with.evaluation.ate_rmse_m / without.evaluation.ate_rmse_m);
        if seed == 1 {
            let again = fly(seed, &using(true));
            assert_eq!(with.run.trajectory(), again.run.trajectory());
            assert_eq!(with.planes(), again.planes());
        }
    }
    let mean = ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / ratios.len() as f64;
    assert!(mean.exp() < 1.1, "the error with planes is {:.2} times that without", mean.exp());
}

/// Finding planes changes nothing for the estimator: the poses are those of a run that does not look for any.
#[test]
fn finding_is_not_using() {
    let mut off = Config::default();
    off.planes.find = false;
    let (with, without) = (fly(2, &using(false)), fly(2, &off));
    assert_eq!(with.run.trajectory(), without.run.trajectory());
    assert!(without.run.planes.is_none() && with.run.planes.is_some());
}
