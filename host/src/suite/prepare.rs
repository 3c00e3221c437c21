//! Recordings of a suite, each opened once before the first run, so that what is missing is said before hours of work.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use super::truths::{OtherTruth, others};
use super::{Plan, Sequence, Simulation, Source, Step, euroc_name, fingerprint};
use crate::config::DatasetSection;
use crate::dataset;
use crate::fault::{Fault, FaultKind};
use crate::sim::{AslOptions, Furnishing, MotionKind, MotionSource, RenderConfig, RenderedFlight, SimError, write_asl};

/// Seconds of a drawn flight without a duration, as of `libella simulate`.
const DRAWN_S: f64 = 60.0;
/// Longer than any recorded motion.
const WHOLE_S: f64 = 3600.0;

/// A sequence whose recording is there.
#[derive(Debug, Clone)]
pub struct PreparedSequence {
    /// The name of the row.
    pub name: String,
    /// Where the recording lies.
    pub path: PathBuf,
    /// Images in it.
    pub frames: usize,
    /// Whether its images were rendered by this program.
    pub is_rendered: bool,
    /// The sequence of EuRoC whose motion it is.
    pub euroc: Option<&'static str>,
    /// Seconds from the first to the last image.
    pub span_s: f64,
    pub(super) fingerprint: String,
    pub(super) other_truths: Vec<OtherTruth>,
}

/// Renders what is to be rendered into `cache`, opens everything; `None` where it was interrupted.
///
/// # Errors
/// When a recording is absent, damaged, or without truth.
pub fn prepare(
    plan: &Plan,
    cache: &Path,
    stop: &AtomicBool,
    observe: &(dyn Fn(Step<'_>) + Sync),
) -> Result<Option<Vec<PreparedSequence>>, Fault> {
    let with_depth = plan.depth == "recorded";
    let mut prepared = Vec::new();
    for sequence in &plan.sequences {
        let path = match &sequence.source {
            Source::Recording(path) => path.clone(),
            Source::Simulated(flight) => {
                let depth = if with_depth { "_depth" } else { "" };
                let path = cache.join(flight.folder_name() + depth);
                if !path.join("mav0").is_dir()
                    && !render(flight, &path, with_depth, stop, &|done, all| {
                        observe(Step::Rendering { sequence: &sequence.name, done, all });
                    })?
                {
                    return Ok(None);
                }
                path
            }
        };
        prepared.push(open(sequence, path, with_depth, &plan.config.dataset)?);
    }
    Ok(Some(prepared))
}

fn open(sequence: &Sequence, path: PathBuf, with_depth: bool, options: &DatasetSection) -> Result<PreparedSequence, Fault> {
    let recording = dataset::open(&path, options)?;
    if recording.truth.is_none() {
        let what = format!("sequence `{}` has no ground truth, and a table needs it", sequence.name);
        return Err(Fault::missing(&path, what, "add state_groundtruth_estimate0, or leave the sequence out"));
    }
    let yaml = std::fs::read_to_string(path.join("mav0/cam0/sensor.yaml")).unwrap_or_default();
    let motion = match &sequence.source {
        Source::Simulated(flight) => Path::new(&flight.motion).file_name().and_then(|name| euroc_name(&name.to_string_lossy())),
        Source::Recording(_) => None,
    };
    Ok(PreparedSequence {
        name: sequence.name.clone(),
        frames: recording.frames.len(),
        is_rendered: yaml.contains("comment: rendered"),
        euroc: motion.or_else(|| euroc_name(&sequence.name)).or_else(|| euroc_name(&recording.name)),
        span_s: recording.span().as_seconds::<f64>(),
        fingerprint: fingerprint::of_recording(&path, with_depth)?,
        other_truths: others(&path)?,
        path,
    })
}

/// Whether it came to its end. The folder has its name only once it is complete.
fn render(flight: &Simulation, folder: &Path, with_depth: bool, stop: &AtomicBool, observe: &dyn Fn(usize, usize)) -> Result<bool, Fault> {
    let seconds = flight.duration_s.unwrap_or(if MotionKind::from_name(&flight.motion).is_some() { DRAWN_S } else { WHOLE_S });
    let source = MotionSource::parse(&flight.motion, seconds).map_err(unusable)?;
    let seed = flight.scene_seed;
    let furnishing = Furnishing { movers: 0, is_bare: flight.is_bare };
    let rendered = RenderedFlight::furnished(&source, &RenderConfig::default(), seed, seed, furnishing).map_err(unusable)?;
    let unfinished = folder.with_extension(format!("{}.part", std::process::id()));
    let mut is_whole = true;
    let options = AslOptions { right_camera: false, depth: with_depth };
    let written = write_asl(&unfinished, &rendered, &options, &mut |done, all| {
        observe(done, all);
        is_whole = done == all;
        !stop.load(Ordering::Relaxed)
    });
    let placed = written.map_err(unwritable).and_then(|()| {
        let moved = if is_whole { std::fs::rename(&unfinished, folder) } else { Ok(()) };
        moved.map_err(|error| {
            Fault::new(FaultKind::Output, format!("cannot be written ({error})"), "give another folder for recordings").at(folder)
        })
    });
    if placed.is_err() || !is_whole {
        // What is left of it is of no use, and a later rendering does not meet it.
        let _ = std::fs::remove_dir_all(&unfinished);
    }
    placed.map(|()| is_whole)
}

fn unusable(error: SimError) -> Fault {
    Fault::new(FaultKind::Malformed, error.to_string(), "give another motion or duration")
}

fn unwritable(error: SimError) -> Fault {
    Fault::new(FaultKind::Output, error.to_string(), "give another folder with --recordings, or free the disk")
}
