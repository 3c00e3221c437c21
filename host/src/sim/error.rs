//! Why a simulation cannot be made.

use std::fmt;
use std::path::{Path, PathBuf};

/// Why a simulation cannot be made. Nothing has been written.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum SimError {
    /// A parameter is outside of what can be simulated.
    OutOfRange {
        /// Its name.
        name: &'static str,
        /// What was asked for.
        value: f64,
        /// The least allowed value.
        low: f64,
        /// The greatest allowed value.
        high: f64,
    },
    /// Too few samples to make a motion of.
    TooShort {
        /// Of what.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many are needed.
        least: usize,
    },
    /// Times that stand still or go back.
    NotRising {
        /// Of what.
        what: &'static str,
        /// The first sample that is not newer than its predecessor.
        index: usize,
    },
    /// A pixel that the camera model cannot turn into a ray to the front.
    NoRay {
        /// Column, px.
        x: f64,
        /// Row, px.
        y: f64,
    },
    /// No place is left for something that moves.
    Crowded {
        /// How many found their place.
        placed: usize,
        /// How many were asked for.
        wanted: usize,
    },
    /// A file that cannot be read or written.
    File {
        /// Which.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// A line that does not say what it should.
    Line {
        /// Of which file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
}

impl SimError {
    /// `Ok` when `value` is finite and within `low..=high`.
    ///
    /// # Errors
    /// `OutOfRange` otherwise.
    pub fn check(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), Self> {
        if value >= low && value <= high { Ok(()) } else { Err(Self::OutOfRange { name, value, low, high }) }
    }

    pub(super) fn file(path: &Path, reason: impl fmt::Display) -> Self {
        Self::File { path: path.to_owned(), reason: reason.to_string() }
    }
}

impl fmt::Display for SimError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { name, value, low, high } => write!(f, "{name} = {value} is outside of the allowed range {low} to {high}"),
            Self::TooShort { what, count, least } => write!(f, "{count} {what} are too few, at least {least} are needed"),
            Self::NotRising { what, index } => write!(f, "the times of the {what} do not rise at sample {index}"),
            Self::NoRay { x, y } => write!(f, "the camera has no ray to the front at pixel {x} {y}"),
            Self::Crowded { placed, wanted } => write!(f, "the room has space for {placed} of {wanted} moving objects"),
            Self::File { path, reason } => write!(f, "{}: {reason}", path.display()),
            Self::Line { path, line, reason } => write!(f, "{} line {line}: {reason}", path.display()),
        }
    }
}

impl std::error::Error for SimError {}
