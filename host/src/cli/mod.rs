//! One file per subcommand; here is what they share: arguments and exit codes.

mod check;
mod completions;
mod config;
mod demo;
mod depth;
mod evaluate;
mod examples;
mod exit;
mod finish;
mod input;
mod report;
mod rooms;
mod run;
mod simulate;
mod smooth;
mod suite;
mod viewer;

use std::io::Write as _;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

pub(crate) use exit::Exit;

/// Monocular visual-inertial odometry in fixed memory.
#[derive(Parser)]
#[command(name = "libella", version, arg_required_else_help = true, after_help = exit::EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Renders a flight and runs the odometry on it at once: needs no data.
    #[command(after_help = examples::DEMO)]
    Demo(demo::Arguments),
    /// Finds out what is wrong with a recording before it is run: units, axes, stamps, calibration, noise, motion.
    #[command(after_help = examples::CHECK)]
    Check(check::Arguments),
    /// Runs a recording through the estimator and writes trajectory, report and picture.
    #[command(after_help = examples::RUN)]
    Run(run::Arguments),
    /// Makes report.html of an output folder, or one page that compares several.
    #[command(after_help = examples::REPORT)]
    Report(report::Arguments),
    /// Renders a flight through a room into a EuRoC/ASL folder with exact truth.
    #[command(after_help = examples::SIMULATE)]
    Simulate(simulate::Arguments),
    /// Renders single views of many different rooms with their depth: data to train a network with.
    #[command(after_help = examples::ROOMS)]
    Rooms(rooms::Arguments),
    /// Compares a trajectory with the truth (TUM or EuRoC files), or runs a whole suite of recordings and makes its table.
    #[command(after_help = examples::EVALUATE)]
    Evaluate(evaluate::Arguments),
    /// Draws what a network says of one image: depth and uncertainty beside it.
    #[command(after_help = examples::DEPTH)]
    Depth(depth::Arguments),
    /// Prints the default configuration with the unit of every key.
    #[command(after_help = examples::CONFIG)]
    Config,
    /// Prints a script that lets a shell complete the command line.
    #[command(after_help = examples::COMPLETIONS)]
    Completions(completions::Arguments),
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
        Command::Completions(arguments) => completions::run(&arguments),
    };
    match done {
        Ok(exit) => exit.into(),
        Err(fault) => {
            eprintln!("libella: {fault}");
            ExitCode::from(exit::code(&fault))
        }
    }
}
