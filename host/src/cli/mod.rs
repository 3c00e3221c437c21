//! One file per subcommand; here is what they share: arguments and exit codes.

mod check;
mod config;
mod demo;
mod depth;
mod evaluate;
mod input;
mod report;
mod rooms;
mod run;
mod simulate;
mod smooth;
mod suite;

use std::io::Write as _;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use libella_host::fault::{Fault, FaultKind};

/// Monocular visual-inertial odometry in fixed memory.
///
/// Exit codes: 0 done, 2 wrong command line or configuration, 3 the data cannot be used, 4 no trajectory came out,
/// 5 results cannot be written, 6 `check` found a fault, 7 a figure is above the threshold of `evaluate --fail-above`, 70 the estimator failed,
/// 130 interrupted (results so far are written).
#[derive(Parser)]
#[command(name = "libella", version, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Renders a flight and runs the odometry on it at once: needs no data.
    Demo(demo::Arguments),
    /// Finds out what is wrong with a recording before it is run: units, axes, stamps, calibration, noise, motion.
    Check(check::Arguments),
    /// Runs a recording through the estimator and writes trajectory, report and picture.
    Run(run::Arguments),
    /// Makes report.html of an output folder, or one page that compares several.
    Report(report::Arguments),
    /// Renders a flight through a room into a EuRoC/ASL folder with exact truth.
    Simulate(simulate::Arguments),
    /// Renders single views of many different rooms with their depth: data to train a network with.
    Rooms(rooms::Arguments),
    /// Compares a trajectory with the truth (TUM or EuRoC files), or runs a whole suite of recordings and makes its table.
    Evaluate(evaluate::Arguments),
    /// Draws what a network says of one image: depth and uncertainty beside it.
    Depth(depth::Arguments),
    /// Prints the default configuration with the unit of every key.
    Config,
}

/// What a command ended with.
pub(crate) enum Exit {
    Done,
    NoResult,
    /// `check` found a fault in the recording.
    Faulty,
    /// A figure of a suite is above the threshold.
    AboveThreshold,
    EstimatorFailed,
    Interrupted,
}

/// Prints results. A reader that closes the pipe early has seen what it wanted.
pub(crate) fn say(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

pub(crate) fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Run(arguments) => run::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Rooms(arguments) => rooms::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Depth(arguments) => depth::run(&arguments),
        Command::Config => config::run(),
    };
    match done {
        Ok(Exit::Done) => ExitCode::SUCCESS,
        Ok(Exit::NoResult) => ExitCode::from(4),
        Ok(Exit::Faulty) => ExitCode::from(6),
        Ok(Exit::AboveThreshold) => ExitCode::from(7),
        Ok(Exit::EstimatorFailed) => ExitCode::from(70),
        Ok(Exit::Interrupted) => ExitCode::from(130),
        Err(fault) => {
            eprintln!("libella: {fault}");
            ExitCode::from(code(&fault))
        }
    }
}

fn code(fault: &Fault) -> u8 {
    match fault.kind {
        FaultKind::Configuration => 2,
        FaultKind::Missing | FaultKind::Malformed => 3,
        FaultKind::NoResult => 4,
        _ => 5,
    }
}
