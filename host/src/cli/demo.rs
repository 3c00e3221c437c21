//! `libella demo`

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use libella_host::config::{Config, Scalar};
use libella_host::fault::Fault;
use libella_host::pipeline::{self, ContactSheet, Figure, Report};
use libella_host::planes;
use libella_host::report::{Snapshots, write_data, write_page};
use libella_host::sim::{Furnishing, RenderConfig, RenderedFlight};

use super::run::{describe, exit, parse_scalar, progress, stop_on_interrupt, subtitle, word};
use super::simulate::{motion, movers, unusable};
use super::{Exit, finish, say, viewer};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder for the results.
    #[arg(long, value_name = "FOLDER", default_value = "out/demo")]
    out: PathBuf,
    /// Number type of the estimator, `f64` or `f32`.
    #[arg(long, value_parser = parse_scalar, default_value = "f64")]
    scalar: Scalar,
    /// Seed of the room, its furniture and its textures.
    #[arg(long, default_value_t = 1)]
    scene_seed: u64,
    /// easy, medium, difficult, still, pure-rotation, fast-yaw, or the folder of a EuRoC recording whose motion is flown.
    #[arg(long, value_name = "MOTION", default_value = "medium")]
    trajectory: String,
    /// Seconds of flight, 1 to 3600.
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, allow_negative_numbers = true)]
    duration: f64,
    /// Moving objects in the room, 0 to 20: carts, swinging boards, turntables.
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    dynamic: i32,
    /// Seed of the motion and of all noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    viewer: viewer::Shown,
    /// Prints nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    arguments.viewer.check()?;
    let source = motion(&arguments.trajectory, arguments.duration)?;
    let movers = movers(arguments.dynamic)?;
    let config = Config { scalar: arguments.scalar, seed: arguments.seed, ..Config::default() };
    pipeline::prepare_outputs(&arguments.out)?;
    let stop = stop_on_interrupt();
    let begun = Instant::now();
    let furnishing = Furnishing { movers, is_bare: false };
    let flight =
        RenderedFlight::furnished(&source, &RenderConfig::default(), arguments.scene_seed, arguments.seed, furnishing).map_err(unusable)?;
    let room_s = begun.elapsed().as_secs_f64();
    let motion = PathBuf::from(&arguments.trajectory).file_name().map(|name| name.to_string_lossy().into_owned());
    let crowd = if movers > 0 { format!(", {movers} moving objects") } else { String::new() };
    let name = format!("{}, room {}{crowd}", motion.unwrap_or_default(), arguments.scene_seed);
    let (recording, clock) = pipeline::rendered_recording(&name, &Arc::new(flight));

    let mut viewer = arguments.viewer.open(&recording, false)?;
    let bar = progress(recording.frames.len(), arguments.quiet);
    let mut sheet = ContactSheet::new(recording.frames.len());
    let mut snapshots = Snapshots::new(recording.frames.len());
    let run = pipeline::run_watched(&recording, &config, &stop, |frame, view| {
        if let Some(viewer) = &mut viewer {
            viewer.add(frame, view.as_ref());
        }
        if let Some(view) = view {
            snapshots.add(frame, &view);
            sheet.add(frame.stamp, view);
        }
        bar.set_message(word(frame.health));
        bar.inc(1);
    })?;
    bar.finish_and_clear();

    let estimate = run.trajectory();
    let evaluation = pipeline::evaluated(&estimate, &recording, &config);
    let report = Report::new(&recording, &config, &run, evaluation.as_ref());
    pipeline::write_outputs(&arguments.out, &run, &report)?;
    let title = format!("libella · rendered flight, {name} · {}", if config.scalar == Scalar::F64 { "f64" } else { "f32" });
    let figure = Figure {
        title: &title,
        subtitle: &subtitle(&report),
        estimate: &estimate,
        truth: recording.truth.as_ref(),
        evaluation: evaluation.as_ref(),
    };
    pipeline::draw(&arguments.out, &figure)?;
    // Without the times, so that the same flight gives the same picture.
    let lasting = subtitle(&Report { core_ms: None, ..report.clone() });
    sheet.draw(&arguments.out.join("demo.png"), &Figure { subtitle: &lasting, ..figure })?;
    if let Some(found) = &run.planes {
        planes::write(&arguments.out, found)?;
    }
    write_data(&arguments.out, &recording, &config, &run, evaluation.as_ref(), Some(&snapshots))?;
    write_page(&arguments.out)?;
    if let Some(viewer) = viewer {
        viewer.finish(&recording, &config, &run, evaluation.as_ref())?;
    }
    if !arguments.quiet {
        let rendering = clock.mean_ms().map(|mean| format!(", {mean:.1} ms per image while the odometry runs")).unwrap_or_default();
        say(&describe(&recording, &report, evaluation.as_ref(), &arguments.out));
        say(&format!(
            "rendering       room painted in {room_s:.1} s{rendering}\npicture         {}\n",
            arguments.out.join("demo.png").display()
        ));
        finish::summarise(&arguments.out)?;
    }
    Ok(exit(&run, &report))
}
