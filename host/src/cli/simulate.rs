//! `libella simulate`

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use libella_host::fault::{Fault, FaultKind};
use libella_host::sim::{self, AslOptions, Furnishing, MotionKind, MotionSource, RenderConfig, RenderedFlight, SimError};

use super::run::{progress, stop_on_interrupt};
use super::{Exit, say};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Seed of the room, its furniture and its textures.
    #[arg(long, default_value_t = 1)]
    scene_seed: u64,
    /// easy, medium, difficult, still, pure-rotation, fast-yaw, or the folder of a EuRoC recording whose motion is flown.
    #[arg(long, value_name = "MOTION", default_value = "easy")]
    trajectory: String,
    /// Folder for the recording; it must not hold one already.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Seconds of flight, 1 to 3600; a recorded motion ends with its recording.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, allow_negative_numbers = true)]
    duration: f64,
    /// Moving objects in the room, 0 to 20: carts, swinging boards, turntables. They are in the images and depth maps; planes.json
    /// and the room itself are the same without them.
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    dynamic: i32,
    /// A room poor in texture: plain plaster on floor and walls, nothing on them, boxes as ever.
    #[arg(long)]
    bare: bool,
    /// Seed of the motion and of all noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Leaves out the depth maps.
    #[arg(long)]
    no_depth: bool,
    /// Also renders the right camera.
    #[arg(long)]
    right: bool,
    /// Prints nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let source = motion(&arguments.trajectory, arguments.duration)?;
    let movers = movers(arguments.dynamic)?;
    if arguments.out.join("mav0").exists() {
        let remedy = "give another folder with --out, or delete it";
        return Err(Fault::new(FaultKind::Output, "holds a recording already", remedy).at(&arguments.out));
    }
    let stop = stop_on_interrupt();
    let (room, seed) = (arguments.scene_seed, arguments.seed);
    let furnishing = Furnishing { movers, is_bare: arguments.bare };
    let rendered = RenderedFlight::furnished(&source, &RenderConfig::default(), room, seed, furnishing).map_err(unusable)?;
    let options = AslOptions { right_camera: arguments.right, depth: !arguments.no_depth };
    let all = rendered.flight.frame_stamps.len();
    let bar = progress(all, arguments.quiet);
    let mut written = 0;
    sim::write_asl(&arguments.out, &rendered, &options, &mut |done, _| {
        bar.set_position(done as u64);
        written = done;
        !stop.load(Ordering::Relaxed)
    })
    .map_err(unwritable)?;
    bar.finish_and_clear();
    if written < all {
        eprintln!("libella: interrupted after {written} of {all} images; what is written can be read");
        return Ok(Exit::Interrupted);
    }
    if !arguments.quiet {
        let name = &arguments.trajectory;
        let seconds = bar.elapsed().as_secs_f64();
        say(&format!("recording       {}\nmotion          {name}, room {room}, {all} images in {seconds:.1} s\n", arguments.out.display()));
    }
    Ok(Exit::Done)
}

/// What a name on the command line stands for.
pub(super) fn motion(name: &str, duration_s: f64) -> Result<MotionSource, Fault> {
    if MotionKind::from_name(name).is_none() && !std::path::Path::new(name).is_dir() {
        let what = format!("`{name}` is neither a motion nor a folder");
        let remedy = "give easy, medium, difficult, still, pure-rotation, fast-yaw, or the folder of a EuRoC recording";
        return Err(Fault::new(FaultKind::Configuration, what, remedy));
    }
    MotionSource::parse(name, duration_s).map_err(unusable)
}

/// The number of moving objects.
pub(super) fn movers(count: i32) -> Result<usize, Fault> {
    SimError::check("--dynamic", f64::from(count), 0.0, sim::MOST_MOVERS as f64).map_err(unusable)?;
    Ok(usize::try_from(count).unwrap_or(0))
}

/// A parameter out of range, or a recorded motion that cannot be flown.
pub(super) fn unusable(error: SimError) -> Fault {
    match error {
        SimError::File { path, reason } => Fault::missing(&path, format!("cannot be read ({reason})"), "give the folder that holds `mav0`"),
        SimError::Line { path, line, reason } => Fault::malformed(&path, reason, "copy the recording again").line(line as u64),
        SimError::OutOfRange { .. } => Fault::new(FaultKind::Configuration, error.to_string(), "choose a value within it"),
        SimError::Crowded { .. } => {
            Fault::new(FaultKind::Configuration, error.to_string(), "ask for fewer with --dynamic, or choose another room")
        }
        _ => Fault::new(FaultKind::Malformed, error.to_string(), "give another recording"),
    }
}

pub(super) fn unwritable(error: SimError) -> Fault {
    match error {
        SimError::File { path, reason } => {
            let what = format!("cannot be written ({reason})");
            Fault::new(FaultKind::Output, what, "give another folder with --out, or free the disk").at(&path)
        }
        other => unusable(other),
    }
}
