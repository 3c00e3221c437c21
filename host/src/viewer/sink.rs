//! The stream to a file or a viewer: times, names, and the first thing that went wrong.

use std::path::Path;
use std::time::Duration;

use libella_core::time::Timestamp;
use re_sdk::{AsComponents, RecordingStream, RecordingStreamBuilder};

use super::Target;
use crate::fault::{Fault, FaultKind};

/// How long an open viewer may take to answer, and to take what it was sent.
const PATIENCE: Duration = Duration::from_secs(10);
const LONG_PATIENCE: Duration = Duration::from_secs(120);

/// Timelines: since the first image, and its number.
const TIME: &str = "time";
const IMAGE: &str = "image";

/// A stream that remembers its first fault.
pub(super) struct Sink {
    stream: RecordingStream,
    target: Target,
    begun: Option<Timestamp>,
    fault: Option<String>,
}

impl Sink {
    /// # Errors
    /// When the file cannot be made, the address is none, or no viewer answers there.
    pub fn open(target: &Target, name: &str) -> Result<Self, Fault> {
        let builder = RecordingStreamBuilder::new("libella").recording_name(name).enabled(true);
        let stream = match target {
            Target::File(path) => builder.save(path).map_err(|error| unwritable(path, &error))?,
            Target::Connect(url) => builder.connect_grpc_opts(url.as_str()).map_err(|error| {
                let what = format!("{url} is no address of a viewer ({error})");
                Fault::new(FaultKind::Configuration, what, format!("give one such as {}", super::DEFAULT_URL))
            })?,
        };
        if let Target::Connect(url) = target
            && let Err(error) = stream.flush_with_timeout(PATIENCE)
        {
            let what = format!("no viewer answers at {url} ({error})");
            return Err(Fault::new(FaultKind::Output, what, "start one with `rerun`, or record into a file with --rerun FILE.rrd"));
        }
        Ok(Self { stream, target: target.clone(), begun: None, fault: None })
    }

    /// The stream itself.
    pub fn stream(&self) -> &RecordingStream {
        &self.stream
    }

    /// From here on everything belongs to an image.
    pub fn set_image(&mut self, stamp: Timestamp, number: usize) {
        let begun = *self.begun.get_or_insert(stamp);
        self.stream.set_duration_secs(TIME, (stamp - begun).as_seconds::<f64>());
        self.stream.set_time_sequence(IMAGE, i64::try_from(number).unwrap_or(i64::MAX));
    }

    /// Something at the time of the image.
    pub fn log(&mut self, entity: &str, what: &impl AsComponents) {
        let done = self.stream.log(entity, what);
        self.keep(done);
    }

    /// Something that holds all the time.
    pub fn log_static(&mut self, entity: &str, what: &impl AsComponents) {
        let done = self.stream.log_static(entity, what);
        self.keep(done);
    }

    pub fn keep(&mut self, done: Result<(), impl std::fmt::Display>) {
        if let Err(error) = done {
            self.fault.get_or_insert_with(|| error.to_string());
        }
    }

    /// Waits until all has arrived.
    ///
    /// # Errors
    /// The first thing that went wrong since it was opened.
    pub fn close(mut self) -> Result<(), Fault> {
        let done = self.stream.flush_with_timeout(LONG_PATIENCE);
        self.keep(done);
        self.stream.disconnect();
        match (self.fault, &self.target) {
            (None, _) => Ok(()),
            (Some(error), Target::File(path)) => Err(unwritable(path, &error)),
            (Some(error), Target::Connect(url)) => {
                let what = format!("the viewer at {url} did not take everything ({error})");
                Err(Fault::new(FaultKind::Output, what, "keep it open until the run ends, or record into a file"))
            }
        }
    }
}

fn unwritable(path: &Path, error: &dyn std::fmt::Display) -> Fault {
    let what = format!("cannot be written ({error})");
    Fault::new(FaultKind::Output, what, "give another file with --rerun, or free the disk").at(path)
}
