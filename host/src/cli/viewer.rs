//! Where `run` and `demo` are shown while they go on.

use std::path::PathBuf;

use libella_host::dataset::Recording;
use libella_host::fault::Fault;
use libella_host::viewer::{DEFAULT_URL, Target, Viewer};

/// A viewer beside the results.
#[derive(clap::Args)]
pub(crate) struct Shown {
    /// Records the run for the viewer rerun: images, tracks, depth, points, planes, the way, figures over time. Needs a program built
    /// with `--features rerun`.
    #[arg(long, value_name = "FILE.rrd", conflicts_with = "rerun_connect")]
    rerun: Option<PathBuf>,
    /// Shows the same in a viewer that is open, while the run goes on [default URL: that of a viewer of this machine].
    #[arg(long, value_name = "URL", num_args = 0..=1, require_equals = true, default_missing_value = DEFAULT_URL)]
    rerun_connect: Option<String>,
}

impl Shown {
    fn target(&self) -> Option<Target> {
        let file = self.rerun.clone().map(Target::File);
        file.or_else(|| self.rerun_connect.clone().map(Target::Connect))
    }

    /// Refuses at once what this program cannot do, before anything is read.
    pub(crate) fn check(&self) -> Result<(), Fault> {
        if self.target().is_some() { Viewer::check() } else { Ok(()) }
    }

    /// The viewer, where one is asked for.
    pub(crate) fn open(&self, recording: &Recording, has_depth: bool) -> Result<Option<Viewer>, Fault> {
        self.target().map(|target| Viewer::open(&target, recording, has_depth)).transpose()
    }
}
