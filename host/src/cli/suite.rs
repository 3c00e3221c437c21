//! `libella evaluate --suite` and `--euroc`

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use libella_host::config::Config;
use libella_host::fault::{Fault, FaultKind};
use libella_host::suite::{self, Plan, Step, Style, Summary, Variant};

use super::run::stop_on_interrupt;
use super::{Exit, say};

#[derive(clap::Args)]
#[command(next_help_heading = "Suites")]
pub(crate) struct SuiteArguments {
    /// Makes the table of a paper: runs the sequences, variants and runs that a TOML file names.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "euroc")]
    suite: Option<PathBuf>,
    /// The same for a download of EuRoC: V1_01 to V2_03 and MH_01 to MH_05, whichever are in the folder.
    #[arg(long, value_name = "DIR")]
    euroc: Option<PathBuf>,
    /// Folder for table.md, runs.csv, suite.json and one result per run; what is there already is not run again [default: out/suite/
    /// and the name of the suite].
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Folder that relative recordings and motions are looked for in [default: beside the file, then LIBELLA_DATA].
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for rendered flights, used again by whoever names it [default: `recordings` in the output folder].
    #[arg(long, value_name = "DIR")]
    recordings: Option<PathBuf>,
    /// Runs of each variant on each sequence; overrides the suite.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    runs: Option<u32>,
    /// Variants, separated by commas: mono, cnn, cnn+p, cnn+u, cnn+u+p; overrides the suite.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = variant)]
    variants: Vec<Variant>,
    /// What gives depth, as for `libella run`; overrides the suite.
    #[arg(long, visible_alias = "model", value_name = "SOURCE")]
    depth: Option<String>,
    /// Configuration that all variants start from; overrides the suite.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Runs at the same time [default: one per core].
    #[arg(long, value_name = "N")]
    workers: Option<usize>,
    /// Ends with code 7 when a median is above so many metres, or lost.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    fail_above: Option<f64>,
    /// Takes results of another build of this program for its own: after a change that cannot move a figure.
    #[arg(long)]
    any_build: bool,
    /// Prints nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

fn variant(name: &str) -> Result<Variant, String> {
    Variant::from_name(name).ok_or_else(|| "give mono, cnn, cnn+p, cnn+u or cnn+u+p".into())
}

impl SuiteArguments {
    /// Whether a suite is asked for.
    pub(super) fn is_given(&self) -> bool {
        self.suite.is_some() || self.euroc.is_some()
    }

    fn plan(&self) -> Result<Plan, Fault> {
        let mut plan = match (&self.suite, &self.euroc) {
            (Some(file), _) => Plan::read(file, self.data.as_deref())?,
            (None, Some(folder)) => Plan::euroc(folder)?,
            (None, None) => return Err(Fault::new(FaultKind::Configuration, "no suite is given", "give --suite or --euroc")),
        };
        plan.runs = self.runs.unwrap_or(plan.runs);
        plan.depth = self.depth.clone().unwrap_or(plan.depth);
        if !self.variants.is_empty() {
            plan.variants.clone_from(&self.variants);
        }
        if let Some(config) = &self.config {
            plan.config = Config::read(config)?;
        }
        plan.check().map_err(|fault| match (&self.suite, &fault.path) {
            (Some(file), None) => fault.at(file),
            _ => fault,
        })?;
        if let Some(metres) = self.fail_above.filter(|metres| !(*metres > 0.0 && metres.is_finite())) {
            return Err(Fault::new(FaultKind::Configuration, format!("--fail-above is {metres}"), "give a positive number of metres"));
        }
        Ok(plan)
    }
}

pub(super) fn run(arguments: &SuiteArguments, json: bool) -> Result<Exit, Fault> {
    let plan = arguments.plan()?;
    let folder = arguments.out.clone().unwrap_or_else(|| Path::new("out/suite").join(plan.name.replace(['/', '\\', ' '], "_")));
    let made = std::fs::create_dir_all(&folder);
    made.map_err(|error| Fault::new(FaultKind::Output, format!("cannot be made ({error})"), "give another folder with --out").at(&folder))?;
    let recordings = arguments.recordings.clone().unwrap_or_else(|| folder.join("recordings"));
    let stop = stop_on_interrupt();
    let bar = Bar::new(arguments.quiet);
    let observe = |step: Step<'_>| bar.show(step);
    let Some(sequences) = suite::prepare(&plan, &recordings, &stop, &observe)? else {
        bar.clear();
        eprintln!("libella: interrupted while rendering; the same command begins with that flight again");
        return Ok(Exit::Interrupted);
    };
    let workers = arguments.workers.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let outcome = suite::execute(&plan, &sequences, &folder, workers, arguments.any_build, &stop, &observe)?;
    bar.clear();
    let summary = Summary { plan: &plan, sequences: &sequences, outcome: &outcome };
    let written = suite::write_outputs(&folder, &summary)?;
    if json {
        say(&written);
    } else if !arguments.quiet {
        let made = outcome.results.len() - outcome.found;
        say(&summary.render(Style::Plain));
        say(&format!("\nruns      {made} made, {} found in {}\n", outcome.found, folder.join("runs").display()));
        say(&format!("results   {}, runs.csv and suite.json beside it\n", folder.join("table.md").display()));
    }
    if stop.load(Ordering::Relaxed) && !outcome.is_complete() {
        let (done, all) = (outcome.results.len(), outcome.all);
        eprintln!("libella: interrupted after {done} of {all} runs; the same command makes the others");
        return Ok(Exit::Interrupted);
    }
    let above = arguments.fail_above.map(|metres| (metres, summary.above(metres))).filter(|(_, above)| !above.is_empty());
    if let Some((metres, above)) = above {
        for place in &above {
            let found = place.ate_rmse_m.map_or("lost".into(), |ate| format!("{ate:.4} m"));
            eprintln!("libella: {}, {}: {found}, and {metres} m is the most allowed", place.sequence, place.variant.label());
        }
        return Ok(Exit::AboveThreshold);
    }
    Ok(if outcome.results.iter().all(|run| run.ate_rmse_m.is_none()) { Exit::NoResult } else { Exit::Done })
}

/// Progress over all images of all runs.
struct Bar(ProgressBar);

impl Bar {
    fn new(quiet: bool) -> Self {
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(4) };
        let bar = ProgressBar::with_draw_target(None, target);
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len} images  {per_sec}  {eta} left  {msg}");
        Self(bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())))
    }

    fn show(&self, step: Step<'_>) {
        match step {
            Step::Rendering { sequence, done, all } => {
                self.0.set_length(all as u64);
                self.0.set_position(done as u64);
                self.0.set_message(format!("renders {sequence}"));
            }
            Step::Begins { found, all, images } => {
                self.0.reset();
                self.0.set_length(images as u64);
                self.0.set_message(format!("{found} of {all} runs done"));
            }
            Step::Image => self.0.inc(1),
            Step::Finished { result, done } => {
                let figure = result.ate_rmse_m.map_or("lost".into(), |ate| format!("{ate:.4} m"));
                let (sequence, label, run) = (&result.sequence, result.variant.label(), result.run);
                self.0.set_message(format!("{done} runs done, last {sequence}, {label}, run {run}: {figure}"));
            }
        }
    }

    fn clear(&self) {
        self.0.finish_and_clear();
    }
}
