//! `libella config`

use libella_host::config::DEFAULT_TOML;
use libella_host::fault::Fault;

use super::{Exit, say};

pub(crate) fn run() -> Result<Exit, Fault> {
    say(DEFAULT_TOML);
    Ok(Exit::Done)
}
