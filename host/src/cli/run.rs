//! `libella run`

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use libella_core::estimator::{Health, Waiting};
use libella_host::config::{Config, Scalar};
use libella_host::dataset::{self, Recording};
use libella_host::eval::Evaluation;
use libella_host::fault::{Fault, FaultKind};
use libella_host::network::{DepthNetwork, ModelChoice, Spoil, Spoiled};
use libella_host::pipeline::{self, DepthFigures, Ended, Figure, Report, Run, Watch};
use libella_host::planes;
use libella_host::report::{self, Snapshots};

use super::input::Input;
use super::{Exit, finish, say, smooth, viewer};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// Configuration file; `libella config` prints one to start from.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Folder for the results [default: out/ and the name of the recording].
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Number type of the estimator, `f64` or `f32`; overrides the configuration.
    #[arg(long, value_parser = parse_scalar)]
    scalar: Option<Scalar>,
    /// Planes: `off`, `find` them, or `use` them in the estimator as well; overrides the configuration.
    #[arg(long, value_name = "MODE")]
    planes: Option<PlanesMode>,
    /// What gives depth beside the images: none, indoor (part of this program), euroc (for non-commercial use), an ONNX file with its
    /// .toml, recorded (maps of the recording) or recorded:FOLDER; overrides the configuration.
    #[arg(long, visible_alias = "model", value_name = "SOURCE")]
    depth: Option<String>,
    /// Images a second that get a depth, at most; a rate above the camera's gives it to every image. Overrides the configuration.
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    depth_rate: Option<f64>,
    /// Spoils the depth to see that it does no harm: noise, doubled, constant, inverted, nan, random, frozen.
    #[arg(long, value_name = "HOW")]
    spoil_depth: Option<Spoil>,
    /// Seed of everything random; overrides the configuration.
    #[arg(long)]
    seed: Option<u64>,
    /// Afterwards adjusts the whole flight at once and writes `trajectory_smooth.*` beside the causal trajectory.
    #[arg(long)]
    smooth: bool,
    #[command(flatten)]
    viewer: viewer::Shown,
    /// Writes no report.html.
    #[arg(long)]
    no_html: bool,
    /// Prints report.json, and nothing else on standard output; progress and warnings stay on standard error.
    #[arg(long)]
    json: bool,
    /// Prints nothing but errors, and what --json asks for.
    #[arg(long, short)]
    quiet: bool,
}

/// What is done about planes.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PlanesMode {
    /// Nothing.
    Off,
    /// They are found and shown.
    Find,
    /// Landmarks are drawn to them besides.
    Use,
}

/// So many images on which vision and inertial samples disagree are no accident: a second of most recordings.
const CONTRADICTIONS: usize = 20;

pub(super) fn parse_scalar(text: &str) -> Result<Scalar, String> {
    match text {
        "f64" => Ok(Scalar::F64),
        "f32" => Ok(Scalar::F32),
        _ => Err("give `f64` or `f32`".into()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    arguments.viewer.check()?;
    let mut config = arguments.config.as_deref().map_or_else(|| Ok(Config::default()), Config::read)?;
    config.scalar = arguments.scalar.unwrap_or(config.scalar);
    config.seed = arguments.seed.unwrap_or(config.seed);
    if let Some(mode) = arguments.planes {
        config.planes.find = !matches!(mode, PlanesMode::Off);
        config.planes.used = matches!(mode, PlanesMode::Use);
    }
    config.depth.source = arguments.depth.clone().unwrap_or(config.depth.source);
    config.depth.rate_hz = arguments.depth_rate.unwrap_or(config.depth.rate_hz);
    config.check()?;
    let recording = dataset::open_with(&arguments.input.dataset, &config.dataset, &arguments.input.hints())?;
    let network = network(arguments, &config, &recording)?;
    let folder = arguments.out.clone().unwrap_or_else(|| Path::new("out").join(&recording.name));
    if !arguments.quiet {
        for remark in &recording.remarks {
            let times = if remark.count > 1 { format!(" ({} times)", remark.count) } else { String::new() };
            eprintln!("warning: {}{times}", remark.first);
        }
    }
    pipeline::prepare_outputs(&folder)?;
    let mut viewer = arguments.viewer.open(&recording, network.is_some())?;
    let stop = stop_on_interrupt();
    let bar = progress(recording.frames.len(), arguments.quiet);
    let mut contradictions = 0;
    let mut snapshots = Snapshots::new(recording.frames.len());
    let watch = Watch { view: !arguments.no_html || viewer.is_some(), record: arguments.smooth };
    let (run, record) = pipeline::run_with(&recording, &config, network, watch, &stop, |frame, view| {
        if let Some(viewer) = &mut viewer {
            viewer.add(frame, view.as_ref());
        }
        if let Some(view) = view {
            snapshots.add(frame, &view);
        }
        contradictions += usize::from(frame.health == Health::Initialising(Waiting::Agreement));
        if contradictions == CONTRADICTIONS && !arguments.quiet {
            contradictions += 1;
            bar.suspend(|| eprintln!("warning: {}", word(frame.health)));
        }
        if let Some(reason) = frame.refused.as_ref().filter(|_| !arguments.quiet) {
            bar.suspend(|| eprintln!("warning: image at {} is left out: {reason}", frame.stamp));
        }
        bar.set_message(word(frame.health));
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    let estimate = run.trajectory();
    let evaluation = pipeline::evaluated(&estimate, &recording, &config);
    let mut figures = Report::new(&recording, &config, &run, evaluation.as_ref());
    pipeline::write_outputs(&folder, &run, &figures)?;
    let title = format!("{} · {}", recording.name, if config.scalar == Scalar::F64 { "f64" } else { "f32" });
    let figure = Figure {
        title: &title,
        subtitle: &subtitle(&figures),
        estimate: &estimate,
        truth: recording.truth.as_ref(),
        evaluation: evaluation.as_ref(),
    };
    pipeline::draw(&folder, &figure)?;
    if let Some(found) = &run.planes {
        planes::write(&folder, found)?;
        pipeline::draw_planes(&folder, &figure, found)?;
    }
    report::write_data(&folder, &recording, &config, &run, evaluation.as_ref(), Some(&snapshots))?;
    let page = || if arguments.no_html { Ok(()) } else { report::write_page(&folder).map(|_| ()) };
    page()?;
    if let Some(viewer) = viewer {
        viewer.finish(&recording, &config, &run, evaluation.as_ref())?;
    }
    let talkative = !arguments.quiet && !arguments.json;
    if talkative {
        say(&describe(&recording, &figures, evaluation.as_ref(), &folder));
    }
    let done = exit(&run, &figures);
    if matches!(done, Exit::NoResult) {
        eprintln!("libella: `libella check {}` looks for the cause", arguments.input.dataset.display());
    }
    let ending = |done: Exit| -> Result<Exit, Fault> {
        if arguments.json {
            let remark = finish::unmeasured(&recording, evaluation.as_ref()).filter(|_| !arguments.quiet);
            finish::print_json(&folder, remark)?;
        } else if talkative {
            finish::summarise(&folder)?;
        }
        Ok(done)
    };
    if !(arguments.smooth && matches!(done, Exit::Done)) {
        return ending(done);
    }
    let Some(smooth) = smooth::run(&recording, &config, (&run, &record), &stop, arguments.quiet)? else {
        eprintln!("libella: interrupted; the causal trajectory is written, the smooth one is not");
        return ending(Exit::Interrupted);
    };
    smooth::write(&recording, &config, &smooth, &mut figures, &folder, !talkative)?;
    page()?;
    ending(done)
}

/// What gives depth, ready for the images of the recording.
fn network(arguments: &Arguments, config: &Config, recording: &Recording) -> Result<Option<Box<dyn DepthNetwork>>, Fault> {
    let Ok(choice) = config.depth.source.parse::<ModelChoice>();
    let network = choice.open(&recording.rig.camera, Some(&arguments.input.dataset))?;
    match (network, arguments.spoil_depth) {
        (network, None) => Ok(network),
        (Some(network), Some(spoil)) => Ok(Some(Box::new(Spoiled::new(network, spoil, config.seed)))),
        (None, Some(_)) => Err(Fault::new(FaultKind::Configuration, "--spoil-depth without depth", "give --depth as well")),
    }
}

/// The first Ctrl-C ends the run and lets the results be written; the second ends the program.
pub(super) fn stop_on_interrupt() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let heard = Arc::clone(&stop);
    // Without a handler Ctrl-C still ends the program, only without results.
    let _ = ctrlc::set_handler(move || {
        if heard.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
    stop
}

pub(super) fn progress(frames: usize, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(frames as u64), target);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} images  {per_sec}  {msg}");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

pub(super) fn word(health: Health) -> &'static str {
    match health {
        Health::Initialising(waiting) => match waiting {
            Waiting::Imu => "initialising: waits for inertial samples",
            Waiting::Tracks => "initialising: waits for corners followed long enough",
            Waiting::Parallax => "initialising: waits for motion",
            Waiting::Excitation => "initialising: waits for acceleration",
            Waiting::Gravity => "initialising: specific force is far from gravity, check units and axes",
            Waiting::Agreement => "initialising: vision and inertial samples contradict each other, check T_BS, time stamps and sigma_px",
            Waiting::Computation => "initialising: computes the start",
            _ => "initialising",
        },
        Health::Tracking => "tracking",
        Health::Degraded => "degraded: too few corners",
        Health::Lost => "lost",
        _ => "",
    }
}

pub(super) fn subtitle(report: &Report) -> String {
    let mut parts = Vec::new();
    if let (Some(ate), Some(scale)) = (report.ate_rmse_m, report.scale_error_percent) {
        parts.push(format!("ATE {:.1} mm RMSE", ate * 1e3));
        parts.push(format!("scale error {scale:.2} %"));
    }
    if let Some(path) = report.path_length_m {
        parts.push(format!("path {path:.1} m"));
    }
    parts.push(format!("{} poses of {} images ({:.1} %)", report.poses, report.frames, 100.0 * report.coverage));
    if let Some(after) = report.initialised_after_s {
        parts.push(format!("initialised after {after:.2} s"));
    }
    if let Some(core) = &report.core_ms {
        parts.push(format!("{:.2} ms per image", core.total.median));
    }
    parts.join("  ·  ")
}

pub(super) fn describe(recording: &Recording, report: &Report, evaluation: Option<&Evaluation>, folder: &Path) -> String {
    let mut lines = vec![
        format!("recording       {} ({:.1} s)", recording.name, recording.span().as_seconds::<f64>()),
        format!("poses           {} of {} images ({:.1} %)", report.poses, report.frames, 100.0 * report.coverage),
        match report.initialised_after_s {
            Some(after) => format!("initialised     {after:.2} s after the first image"),
            None => "initialised     never".into(),
        },
    ];
    if evaluation.is_some() {
        lines.push(match report.metric_after_s {
            Some(after) => {
                format!("metric          {after:.2} s after the first image: from then on the scale of every 2 s is right within 10 %")
            }
            None => "metric          never: no 2 s tell the scale, or the last that do are off by more than 10 %".into(),
        });
    }
    lines.extend(evaluation.map(|found| super::evaluate::describe(found).trim_end().to_owned()));
    lines.extend(finish::unmeasured(recording, evaluation).map(|remark| format!("truth           {remark}")));
    if let Some(nees) = &report.pose_nees {
        lines.push(format!("pose NEES       {:.2} mean, {:.2} median (6 is consistent)", nees.mean, nees.median));
    }
    if let Some(core) = &report.core_ms {
        let stages: Vec<_> = core.stages.iter().map(|(name, timing)| format!("{name} {:.2}", timing.median)).collect();
        let (total, stages) = (core.total, stages.join(", "));
        lines.push(format!(
            "core            {:.2} ms per image (median), {:.2} p95, {:.2} max; {stages}",
            total.median, total.p95, total.max
        ));
    }
    if let Some(planes) = &report.planes {
        let classes: Vec<_> = planes.by_class.iter().map(|(class, count)| format!("{count} {class}")).collect();
        let classes = if classes.is_empty() { "none".into() } else { classes.join(", ") };
        let share = planes.share_on_planes.map(|share| format!("; {:.0} % of the landmarks lay on one", 100.0 * share)).unwrap_or_default();
        lines.push(format!("planes          {classes}, among {} points{share}", planes.points));
    }
    let memory = report.rss_peak_mb.map(|peak| format!(", {peak:.0} MB at most")).unwrap_or_default();
    lines.push(format!("run             {:.2} s wall, {:.0} images/s{memory}", report.wall_s, report.images_per_s));
    lines.extend(report.depth.as_ref().map(describe_depth));
    for (name, left_out) in [("images", &report.images_left_out), ("inertial samples", &report.imu_left_out)] {
        if let Some(reason) = &left_out.first {
            lines.push(format!("left out        {} {name}, first: {reason}", left_out.count));
        }
    }
    lines.push(format!("results         {}\n", folder.display()));
    lines.join("\n")
}

fn describe_depth(depth: &DepthFigures) -> String {
    let mut lines = vec![format!("depth           {}", depth.source)];
    if let (Some(network), Some(wait)) = (&depth.network_ms, &depth.wait_ms) {
        lines.push(format!(
            "network         {:.1} ms per map (median), {:.1} p95, {:.1} max; the estimator waited {:.1} ms for it, {:.1} p95",
            network.median, network.p95, network.max, wait.median, wait.p95
        ));
    }
    let mut maps = vec![format!("{} of {} believed", depth.believed, depth.images)];
    for (count, what) in [
        (depth.rejected_other_scale, "rejected: not of the scale known so far"),
        (depth.rejected_no_depth, "rejected: no depth of this image"),
        (depth.rejected_unusable, "rejected: no usable depth where the corners are"),
    ] {
        maps.extend((count > 0).then(|| format!("{count} {what}")));
    }
    if let Some(reason) = &depth.failed.first {
        maps.push(format!("{} absent, first: {reason}", depth.failed.count));
    }
    lines.push(format!("depth maps      {}", maps.join("; ")));
    if let Some(scale) = &depth.scale {
        lines.push(format!(
            "depth scale     {:.3} at first, {:.3} at last, {:.3} to {:.3} in between",
            scale.first, scale.last, scale.min, scale.max
        ));
    }
    lines.extend(depth.observation_share.map(|share| format!("depth priors    {:.0} % of the landmarks seen", 100.0 * share)));
    lines.join("\n")
}

pub(super) fn exit(run: &Run, report: &Report) -> Exit {
    match &run.ended {
        Ended::Failed(said) => {
            eprintln!("libella: the estimator failed ({said}); results up to there are written, please report it with the recording");
            Exit::EstimatorFailed
        }
        Ended::Interrupted => {
            eprintln!("libella: interrupted after {} images; results up to there are written", run.frames.len());
            Exit::Interrupted
        }
        Ended::Complete if report.poses == 0 => {
            let last = run.frames.last().map_or("there was no image", |frame| word(frame.health));
            eprintln!("libella: no trajectory came out; at the end it was {last}");
            Exit::NoResult
        }
        Ended::Complete => Exit::Done,
    }
}
