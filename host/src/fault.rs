//! What went wrong, where, and what to do about it: one sentence each.

use std::fmt;
use std::path::{Path, PathBuf};

/// The kind of a [`Fault`]; it decides the exit code of the command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum FaultKind {
    /// A setting that is unknown or out of range.
    Configuration,
    /// A file or folder that is absent.
    Missing,
    /// A file that is there and cannot be used.
    Malformed,
    /// A result that could not be written.
    Output,
    /// The data were read, and gave no trajectory.
    NoResult,
}

/// One failure with its place and its remedy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Fault {
    /// What kind of failure.
    pub kind: FaultKind,
    /// The file or folder it is about.
    pub path: Option<PathBuf>,
    /// The line of that file, counted from 1.
    pub line: Option<u64>,
    /// What is wrong.
    pub what: String,
    /// What the reader can do.
    pub remedy: String,
}

impl Fault {
    /// A fault without a place.
    pub fn new(kind: FaultKind, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { kind, path: None, line: None, what: what.into(), remedy: remedy.into() }
    }

    /// A file or folder that is absent.
    pub fn missing(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(FaultKind::Missing, what, remedy).at(path)
    }

    /// A file whose content cannot be used.
    pub fn malformed(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(FaultKind::Malformed, what, remedy).at(path)
    }

    /// A result for which there is no room, or no permission.
    pub fn unwritable(path: &Path, error: &dyn fmt::Display) -> Self {
        Self::new(FaultKind::Output, format!("cannot be written ({error})"), "give another folder with --out, or free the disk").at(path)
    }

    /// Names the file.
    #[must_use]
    pub fn at(mut self, path: &Path) -> Self {
        self.path = Some(path.to_path_buf());
        self
    }

    /// Names the line, counted from 1.
    #[must_use]
    pub fn line(mut self, line: u64) -> Self {
        self.line = Some(line);
        self
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(path) = &self.path {
            write!(f, "{}", path.display())?;
            if let Some(line) = self.line {
                write!(f, " line {line}")?;
            }
            write!(f, ": ")?;
        }
        write!(f, "{}", self.what)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "; {}", self.remedy) }
    }
}

/// The text of a file.
///
/// # Errors
/// When it is absent, unreadable, or no UTF-8 text.
pub(crate) fn read_text(path: &Path, remedy: &str) -> Result<String, Fault> {
    let bytes = std::fs::read(path).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => Fault::missing(path, "there is no such file", remedy),
        _ => Fault::malformed(path, format!("cannot be read ({error})"), "check its permissions and the disk"),
    })?;
    text_of(path, bytes)
}

/// The text that bytes are.
///
/// # Errors
/// When they are no UTF-8 text.
pub(crate) fn text_of(path: &Path, bytes: Vec<u8>) -> Result<String, Fault> {
    String::from_utf8(bytes).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        let line = 1 + error.as_bytes().iter().take(valid).filter(|byte| **byte == b'\n').count() as u64;
        Fault::malformed(path, "holds bytes that are not text", "the file is damaged: copy it again").line(line)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_reads_as_one_sentence() {
        let fault = Fault::malformed(Path::new("imu0/data.csv"), "time stamp goes back by 5 ms", "sort the file").line(17);
        assert_eq!(fault.to_string(), "imu0/data.csv line 17: time stamp goes back by 5 ms; sort the file");
    }
}
