//! `libella evaluate`

use std::fmt::Write as _;
use std::path::PathBuf;

use libella_host::config::EvaluationSection;
use libella_host::eval::{Evaluation, Trajectory, evaluate};
use libella_host::fault::Fault;

use super::suite::{self, SuiteArguments};
use super::{Exit, say};

#[derive(clap::Args)]
#[command(
    override_usage = "libella evaluate [--json] ESTIMATE TRUTH\n       libella evaluate --suite FILE.toml [OPTIONS]\n       libella evaluate --euroc DIR [OPTIONS]"
)]
pub(crate) struct Arguments {
    /// Estimated trajectory, TUM or EuRoC format.
    #[arg(required_unless_present_any = ["suite", "euroc"], conflicts_with_all = ["suite", "euroc"])]
    estimate: Option<PathBuf>,
    /// True trajectory, TUM or EuRoC format.
    #[arg(required_unless_present_any = ["suite", "euroc"], conflicts_with_all = ["suite", "euroc"])]
    truth: Option<PathBuf>,
    /// Prints the figures as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    suite: SuiteArguments,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let (Some(path), Some(truth), false) = (&arguments.estimate, &arguments.truth, arguments.suite.is_given()) else {
        return suite::run(&arguments.suite, arguments.json);
    };
    let (estimate, truth) = (Trajectory::read(path)?, Trajectory::read(truth)?);
    let found = evaluate(&estimate, &truth, &EvaluationSection::default()).map_err(|fault| fault.at(path))?;
    if arguments.json {
        say(&(serde_json::to_string_pretty(&found).unwrap_or_default() + "\n"));
    } else {
        say(&format!("matched poses   {} of {}\n{}", found.matched_poses, found.matched_poses + found.unmatched_poses, describe(&found)));
    }
    Ok(Exit::Done)
}

/// Error figures for a reader.
pub(crate) fn describe(found: &Evaluation) -> String {
    let ate = &found.ate_m;
    let mut text = format!(
        "path            {:.2} m\nATE             {:.6} m RMSE (mean {:.4}, median {:.4}, max {:.4})\nscale           {:.5} (error {:.2} %)\n",
        found.path_length_m, ate.rmse, ate.mean, ate.median, ate.max, found.scale, found.scale_error_percent
    );
    for error in &found.rpe {
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "RPE over {:>4} m {:.4} m RMSE ({:.2} %), {:.3} deg, {} pairs",
            error.distance_m, error.translation_rmse_m, error.translation_rmse_percent, error.rotation_rmse_deg, error.pairs
        );
    }
    text
}
