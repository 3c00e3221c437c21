//! The report of a run for people: one HTML file that needs nothing beside it.
//!
//! ```text
//! run ─▶ frames.csv, views/ ┐
//!        report.json, ... ──┴▶ folder ─▶ verdict, chart, space ─▶ page ─▶ report.html
//! several folders ──────────────────────────────────────────────▶ comparison ─▶ compare.html
//! ```
//! A page is made of what lies in the output folder and of nothing else, so that it can be made again later, of older runs as well: what
//! they did not write is left out, and the page says so.

mod chart;
mod comparison;
mod curves;
mod facts;
mod first;
mod folder;
mod frames;
mod html;
mod page;
mod sight;
mod snapshots;
mod space;
mod stages;
mod summary;
mod verdict;
mod words;

use std::path::{Path, PathBuf};

pub use snapshots::Snapshots;
pub use summary::{NO_TRUTH, Summary};
pub use verdict::Light;

use crate::config::Config;
use crate::dataset::Recording;
use crate::eval::Evaluation;
use crate::fault::{Fault, FaultKind};
use crate::pipeline::Run;
use folder::Output;

/// Writes what a report needs beside the other results of a run: `frames.csv`, and `views/` where snapshots were taken.
///
/// # Errors
/// When a file cannot be written.
pub fn write_data(
    folder: &Path,
    recording: &Recording,
    config: &Config,
    run: &Run,
    evaluation: Option<&Evaluation>,
    snapshots: Option<&Snapshots>,
) -> Result<(), Fault> {
    write(&folder.join("frames.csv"), &frames::write(recording, config, run, evaluation))?;
    snapshots.map_or(Ok(()), |snapshots| snapshots.write(folder))
}

/// Makes `report.html` of an output folder, in it.
///
/// # Errors
/// When the folder is none of a run, or a file cannot be read or written.
pub fn write_page(folder: &Path) -> Result<PathBuf, Fault> {
    let path = folder.join("report.html");
    write(&path, &page::page(&Output::read(folder)?))?;
    Ok(path)
}

/// Makes a page that compares the runs of several output folders.
///
/// # Errors
/// When a folder is none of a run, or a file cannot be read or written.
pub fn write_comparison(folders: &[PathBuf], path: &Path) -> Result<(), Fault> {
    let outputs: Vec<Output> = folders.iter().map(|folder| Output::read(folder)).collect::<Result<_, _>>()?;
    if outputs.is_empty() {
        return Err(Fault::new(FaultKind::Configuration, "there is nothing to compare", "give output folders of `libella run`"));
    }
    write(path, &comparison::page(&outputs))
}

fn write(path: &Path, text: &str) -> Result<(), Fault> {
    std::fs::write(path, text).map_err(|error| Fault::unwritable(path, &error))
}
