//! Renders a flight through a furnished room and writes it as the firmware's recording, with coarse depth maps, and its truth beside it.
//!
//! ```sh
//! cargo run --release -p libella-firmware-tools --bin record -- firmware-sim/replay/flight.bin
//! ```
//! The truth, `flight.truth.csv`, has the positions of the body in metres at the images, in milliseconds since the first sample.

use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;

use libella_firmware_tools::{coarse, recording, small};
use libella_host::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight, euroc};
use nalgebra::Isometry3;

/// Kind, seconds in all, seconds of rest: a rest long enough to be found, then a flight; just below 3 MB.
const MOTION: (MotionKind, f64, f64) = (MotionKind::Medium, 7.45, 1.0);
const SEED: u64 = 1;
/// Images from one depth map to the next: 4 Hz.
const DEPTH_EVERY: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let path = PathBuf::from(std::env::args_os().nth(1).ok_or("give the file to write")?);
    let (kind, duration_s, rest_s) = MOTION;
    let motion = AnalyticConfig { kind, duration_s, rest_s, ..AnalyticConfig::default() };
    let rendered = RenderedFlight::new(&MotionSource::Analytic(motion, ImuConfig::default()), &RenderConfig::default(), SEED, SEED)?;
    let flight = &rendered.flight;
    let camera = small::camera(&euroc::camera(0)).ok_or("the rig has no pinhole camera")?;
    let began = flight.imu.first().ok_or("a flight without samples")?.stamp;
    let body_from_camera = euroc::body_from_camera(0);
    let (samples, images) = (flight.imu.len(), flight.frame_stamps.len());
    let mut bytes = recording::header(&camera, &body_from_camera, &flight.imu_noise, samples, images, images.div_ceil(DEPTH_EVERY));
    bytes.extend(flight.imu.iter().flat_map(recording::sample));
    let renderer = rendered.renderer(0)?;
    let mut depths = Vec::new();
    let mut truth = String::from("#ms,x_m,y_m,z_m\n");
    for (index, stamp) in flight.frame_stamps.iter().enumerate() {
        let image = rendered.image(&renderer, index).ok_or("an image is missing")?;
        bytes.extend(recording::image(*stamp, &small::shrink(&image)));
        let seconds = (*stamp - flight.epoch).as_seconds();
        let motion = flight.trajectory.at(seconds);
        let position = motion.position_in_world;
        if index % DEPTH_EVERY == 0 {
            let world_from_camera = Isometry3::from_parts(position.into(), motion.world_from_body) * body_from_camera;
            let map = coarse::network(&renderer.depth(&world_from_camera, seconds), SEED, index as u64);
            depths.extend(recording::depth(*stamp, &map));
        }
        let millis = (*stamp - began).as_nanos() / 1_000_000;
        writeln!(truth, "{millis},{:.4},{:.4},{:.4}", position.x, position.y, position.z)?;
    }
    bytes.extend(depths);
    std::fs::write(&path, &bytes)?;
    std::fs::write(path.with_extension("truth.csv"), truth)?;
    println!("{}: {samples} samples, {images} images, {} bytes", path.display(), bytes.len());
    Ok(())
}
