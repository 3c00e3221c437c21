//! `libella evaluate`

use std::path::PathBuf;

use libella_host::config::EvaluationSection;
use libella_host::eval::{Evaluation, Trajectory, evaluate};
use libella_host::fault::Fault;

use super::Exit;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Estimated trajectory, TUM or EuRoC format.
    estimate: PathBuf,
    /// True trajectory, TUM or EuRoC format.
    truth: PathBuf,
    /// Prints the figures as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let (estimate, truth) = (Trajectory::read(&arguments.estimate)?, Trajectory::read(&arguments.truth)?);
    let found = evaluate(&estimate, &truth, &EvaluationSection::default()).map_err(|fault| fault.at(&arguments.estimate))?;
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&found).unwrap_or_default());
    } else {
        println!("matched poses   {} of {}", found.matched_poses, found.matched_poses + found.unmatched_poses);
        print(&found);
    }
    Ok(Exit::Done)
}

/// Error figures for a reader.
pub(crate) fn print(found: &Evaluation) {
    println!("path            {:.2} m", found.path_length_m);
    let ate = &found.ate_m;
    println!("ATE             {:.6} m RMSE (mean {:.4}, median {:.4}, max {:.4})", ate.rmse, ate.mean, ate.median, ate.max);
    println!("scale           {:.5} (error {:.2} %)", found.scale, found.scale_error_percent);
    for error in &found.rpe {
        println!(
            "RPE over {:>4} m {:.4} m RMSE ({:.2} %), {:.3} deg, {} pairs",
            error.distance_m, error.translation_rmse_m, error.translation_rmse_percent, error.rotation_rmse_deg, error.pairs
        );
    }
}
