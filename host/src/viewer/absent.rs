//! What there is without the feature `rerun`: one sentence.

use std::convert::Infallible;

use super::Target;
use crate::config::Config;
use crate::dataset::Recording;
use crate::eval::Evaluation;
use crate::fault::{Fault, FaultKind};
use crate::pipeline::{FrameResult, Run, View};

/// Shows a run; of a program without the feature `rerun` there is none.
#[derive(Debug)]
pub struct Viewer(Infallible);

impl Viewer {
    /// # Errors
    /// Always: it says how to build a program that can.
    pub fn open(_target: &Target, _recording: &Recording, _has_depth: bool) -> Result<Self, Fault> {
        Err(missing())
    }

    /// # Errors
    /// Always, as [`open`](Self::open).
    pub fn check() -> Result<(), Fault> {
        Err(missing())
    }

    /// Shows one image of the run.
    pub fn add(&mut self, _frame: &FrameResult, _view: Option<&View>) {
        match self.0 {}
    }

    /// Shows what is known at the end of the run only.
    ///
    /// # Errors
    /// Never.
    pub fn finish(self, _recording: &Recording, _config: &Config, _run: &Run, _evaluation: Option<&Evaluation>) -> Result<(), Fault> {
        match self.0 {}
    }
}

fn missing() -> Fault {
    Fault::new(
        FaultKind::Configuration,
        "this program was built without the viewer rerun",
        "build it in with `cargo build --release -p libella-host --features rerun`",
    )
}
