//! `libella config`

use std::io::Write as _;

use libella_host::config::DEFAULT_TOML;
use libella_host::fault::Fault;

use super::Exit;

pub(crate) fn run() -> Result<Exit, Fault> {
    // A reader that closes the pipe early has seen what it wanted.
    let _ = std::io::stdout().write_all(DEFAULT_TOML.as_bytes());
    Ok(Exit::Done)
}
