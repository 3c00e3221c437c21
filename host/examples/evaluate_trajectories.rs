//! Two trajectories, TUM or EuRoC format, compared: absolute and relative errors after alignment by a rigid transform.
//!
//! `cargo run -p libella-host --example evaluate_trajectories -- out/MH_01_easy/trajectory.tum truth.csv`

use std::error::Error;
use std::path::PathBuf;

use libella_host::config::EvaluationSection;
use libella_host::eval::{Trajectory, evaluate};

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(estimate), Some(truth)) = (paths.next(), paths.next()) else {
        return Err("usage: evaluate_trajectories ESTIMATE TRUTH".into());
    };
    let (estimate, truth) = (Trajectory::read(&estimate)?, Trajectory::read(&truth)?);

    // Distances of the relative errors, and how far apart two true poses may be to be interpolated.
    let options = EvaluationSection::default();
    let found = evaluate(&estimate, &truth, &options)?;

    println!("{} of {} poses have a truth", found.matched_poses, estimate.poses().len());
    println!("ATE {:.4} m RMSE, {:.4} m at most, over {:.1} m", found.ate_rmse_m, found.ate_m.max, found.path_length_m);
    println!("best scale {:.4}: {:.2} % off", found.scale, found.scale_error_percent);
    for error in &found.rpe {
        println!(
            "RPE over {} m: {:.4} m, {:.2} deg RMSE of {} pairs",
            error.distance_m, error.translation_rmse_m, error.rotation_rmse_deg, error.pairs
        );
    }
    // The transform that was used, to draw both in one world.
    let shift = found.truth_from_estimate.translation.vector;
    println!("the estimate was moved by ({:.3}, {:.3}, {:.3}) m", shift.x, shift.y, shift.z);
    // What was farthest off, and when.
    if let Some((stamp_ns, error_m)) = found.errors.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
        println!("worst at {stamp_ns} ns: {error_m:.4} m");
    }
    Ok(())
}
