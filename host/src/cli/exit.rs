//! What a command ended with, as a number.

use std::process::ExitCode;

use libella_host::fault::{Fault, FaultKind};

/// What `libella --help` says of the exit codes.
pub(super) const EXIT_CODES: &str = "\
Exit codes:
    0  done
    2  wrong command line or configuration
    3  the data are missing or cannot be used
    4  no trajectory came out
    5  results cannot be written
    6  `check` found a fault in the recording
    7  a figure is above the threshold of `evaluate --fail-above`
   70  the estimator failed: please report it
  130  interrupted; results so far are written

`libella COMMAND --help` ends with examples.";

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

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        match exit {
            Exit::Done => Self::SUCCESS,
            Exit::NoResult => Self::from(4),
            Exit::Faulty => Self::from(6),
            Exit::AboveThreshold => Self::from(7),
            Exit::EstimatorFailed => Self::from(70),
            Exit::Interrupted => Self::from(130),
        }
    }
}

/// The code of a failure.
pub(super) fn code(fault: &Fault) -> u8 {
    match fault.kind {
        FaultKind::Configuration => 2,
        FaultKind::Missing | FaultKind::Malformed => 3,
        FaultKind::NoResult => 4,
        _ => 5,
    }
}
