//! A few runs at the same time; what was done before is not done again.

use std::path::Path;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};

use super::run::{Job, jobs};
use super::{Plan, PreparedSequence, RunResult};
use crate::fault::{Fault, FaultKind};

/// What happens meanwhile, for whoever shows progress.
#[derive(Debug, Clone, Copy)]
pub enum Step<'a> {
    /// A flight is being rendered.
    Rendering {
        /// Of which row.
        sequence: &'a str,
        /// Images that are written.
        done: usize,
        /// Images there will be.
        all: usize,
    },
    /// So many runs are there already, and so many images lie ahead.
    Begins {
        /// Runs with a result.
        found: usize,
        /// All runs.
        all: usize,
        /// Images of the runs to be made.
        images: usize,
    },
    /// An image was worked on.
    Image,
    /// A run came to its end.
    Finished {
        /// What it gave.
        result: &'a RunResult,
        /// Runs with a result.
        done: usize,
    },
}

/// Results of a suite.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// In the order of rows, columns and runs; those that an interruption prevented are not among them.
    pub results: Vec<RunResult>,
    /// Runs that were found.
    pub found: usize,
    /// Runs of those found that another build of the program made.
    pub of_other_builds: usize,
    /// Runs there should be.
    pub all: usize,
}

impl Outcome {
    /// Whether no run is missing.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.results.len() == self.all
    }
}

/// Makes the runs of a plan that `folder` does not hold yet, `workers` at a time. With `any_build`, results of another build of the
/// program count as well.
///
/// # Errors
/// The first of a run that cannot be made or kept. Those that came to their end are kept.
pub fn execute(
    plan: &Plan,
    sequences: &[PreparedSequence],
    folder: &Path,
    workers: usize,
    any_build: bool,
    stop: &AtomicBool,
    observe: &(dyn Fn(Step<'_>) + Sync),
) -> Result<Outcome, Fault> {
    let folder = folder.join("runs");
    std::fs::create_dir_all(&folder).map_err(|error| {
        Fault::new(FaultKind::Output, format!("cannot be made ({error})"), "give another folder with --out").at(&folder)
    })?;
    let jobs = jobs(plan, sequences)?;
    let all = jobs.len();
    let mut results: Vec<(usize, RunResult)> = Vec::new();
    let mut left: Vec<(usize, Job)> = Vec::new();
    let mut of_other_builds = 0;
    for (index, job) in jobs.into_iter().enumerate() {
        match job.found(&folder, any_build) {
            Some(result) => {
                of_other_builds += usize::from(result.build != job.build);
                results.push((index, result));
            }
            None => left.push((index, job)),
        }
    }
    let found = results.len();
    observe(Step::Begins { found, all, images: left.iter().map(|(_, job)| job.sequence.frames).sum() });
    // From the end, so that taking one is cheap.
    left.reverse();
    let state = Mutex::new((left, results, None::<Fault>));
    let locked = || state.lock().unwrap_or_else(PoisonError::into_inner);
    let halt = AtomicBool::new(false);
    let work = || {
        while !stop.load(Ordering::Relaxed) && !halt.load(Ordering::Relaxed) {
            let Some((index, job)) = locked().0.pop() else { break };
            match job.work(&folder, stop, || observe(Step::Image)) {
                Ok(None) => break,
                Ok(Some(result)) => {
                    let mut state = locked();
                    state.1.push((index, result.clone()));
                    let done = state.1.len();
                    drop(state);
                    observe(Step::Finished { result: &result, done });
                }
                Err(fault) => {
                    locked().2.get_or_insert(fault);
                    halt.store(true, Ordering::Relaxed);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..workers.clamp(1, 256).min(all) {
            scope.spawn(work);
        }
    });
    let (_, mut results, fault) = state.into_inner().unwrap_or_else(PoisonError::into_inner);
    if let Some(fault) = fault {
        return Err(fault);
    }
    results.sort_by_key(|(index, _)| *index);
    Ok(Outcome { results: results.into_iter().map(|(_, result)| result).collect(), found, of_other_builds, all })
}
