//! `libella completions`

use clap::CommandFactory as _;
use clap_complete::Shell;
use libella_host::fault::Fault;

use super::{Exit, say};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The shell.
    shell: Shell,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut super::Arguments::command(), "libella", &mut script);
    say(&String::from_utf8_lossy(&script));
    Ok(Exit::Done)
}
