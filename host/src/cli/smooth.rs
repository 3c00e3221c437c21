//! `libella run --smooth`: what comes after the causal pass.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use libella_host::config::Config;
use libella_host::dataset::Recording;
use libella_host::fault::Fault;
use libella_host::map::{self, FlightRecord, Smooth};
use libella_host::pipeline::{self, Report, Run, SmoothReport};
use libella_host::planes::Planes;

use super::say;

/// Adjusts the flight; nothing where it was interrupted.
pub(super) fn run(
    recording: &Recording,
    config: &Config,
    (run, record): (&Run, &FlightRecord),
    stop: &AtomicBool,
    quiet: bool,
) -> Result<Option<Smooth>, Fault> {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(None, target);
    let style = ProgressStyle::with_template("smoothing  step {pos}  {msg}");
    let bar = bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
    let planes = run.planes.as_ref().filter(|_| config.planes.used).map(Planes::standing).unwrap_or_default();
    let smooth = map::smooth(record, recording, config, &planes, stop, |progress| {
        let (round, rounds) = progress.round;
        let (keyframes, landmarks) = progress.size;
        let epoch = if progress.epoch.1 > 1 { format!("part {} of {}, ", progress.epoch.0 + 1, progress.epoch.1) } else { String::new() };
        let cost = progress.cost;
        bar.set_message(format!("{epoch}round {} of {rounds}, {keyframes} keyframes, {landmarks} landmarks, cost {cost:.0}", round + 1));
        bar.inc(1);
    });
    bar.finish_and_clear();
    smooth
}

/// Writes the trajectory and the report, and prints the figures beside those of the causal trajectory.
pub(super) fn write(
    recording: &Recording,
    config: &Config,
    smooth: &Smooth,
    report: &mut Report,
    folder: &Path,
    quiet: bool,
) -> Result<(), Fault> {
    let evaluation = pipeline::evaluated(&smooth.trajectory(), recording, config);
    report.smooth = Some(SmoothReport::new(smooth, evaluation.as_ref()));
    pipeline::write_smooth(folder, smooth)?;
    pipeline::write_report(folder, report)?;
    if quiet {
        return Ok(());
    }
    let mut text = String::new();
    for epoch in &smooth.epochs {
        text += &match &epoch.left_out {
            Some(reason) => format!("smoothing       {:.1} s left out: {reason}\n", epoch.span_s),
            None => format!(
                "smoothing       {:.1} s in {:.2} s: {} keyframes, {} landmarks, {} corners, {} non-zeros, {} steps, cost {:.0} to {:.0}\n",
                epoch.span_s,
                epoch.wall_s,
                epoch.keyframes,
                epoch.landmarks,
                epoch.observations,
                epoch.factor_non_zeros,
                epoch.iterations,
                epoch.cost[0],
                epoch.cost[1]
            ),
        };
    }
    if let (Some(causal), Some(found)) = (report.ate_rmse_m, &evaluation) {
        let (ate, scale) = (found.ate_rmse_m, found.scale_error_percent);
        let before = report.scale_error_percent.unwrap_or_default();
        text += &format!("ATE             causal {causal:.6} m, smooth {ate:.6} m RMSE; scale error {before:.2} %, {scale:.2} %\n");
    }
    say(&text);
    Ok(())
}
