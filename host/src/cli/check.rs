//! `libella check`

use std::path::PathBuf;

use libella_host::check::{CheckOptions, Severity, check};
use libella_host::config::Config;
use libella_host::dataset;
use libella_host::fault::Fault;

use super::input::Input;
use super::{Exit, say};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// Configuration file, for the magnitude of gravity; `libella config` prints one to start from.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Images read at most; of a longer recording those of the most varied motion.
    #[arg(long, value_name = "N", default_value_t = 600)]
    images: usize,
    /// Prints findings and figures as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let config = arguments.config.as_deref().map_or_else(|| Ok(Config::default()), Config::read)?;
    let recording = dataset::open_to_check_with(&arguments.input.dataset, &config.dataset, &arguments.input.hints())?;
    let options =
        CheckOptions { images: arguments.images, images_ahead: config.dataset.images_ahead, gravity_m_s2: config.estimator.gravity_m_s2 };
    let report = check(&recording, &options)?;
    if arguments.json {
        say(&(serde_json::to_string_pretty(&report).unwrap_or_default() + "\n"));
    } else {
        say(&report.to_string());
    }
    Ok(if report.worst == Severity::Fault { Exit::Faulty } else { Exit::Done })
}
