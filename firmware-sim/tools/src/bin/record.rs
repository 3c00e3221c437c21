//! Renders a flight through a furnished room and writes it as the firmware's recording, with its truth beside it.
//!
//! ```sh
//! cargo run --release --manifest-path firmware-sim/Cargo.toml -p libella-firmware-tools --bin record -- firmware-sim/replay/flight.bin
//! ```
//! The truth, `flight.truth.csv`, has the positions of the body in metres at the images, in milliseconds since the first sample.

use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;

use libella_firmware_tools::{recording, small};
use libella_host::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight, euroc};

/// Kind, seconds in all, seconds of rest: a rest long enough to be found, then a flight; just below 3 MB.
const MOTION: (MotionKind, f64, f64) = (MotionKind::Medium, 7.45, 1.0);
const SEED: u64 = 1;

fn main() -> Result<(), Box<dyn Error>> {
    let path = PathBuf::from(std::env::args_os().nth(1).ok_or("give the file to write")?);
    let (kind, duration_s, rest_s) = MOTION;
    let motion = AnalyticConfig { kind, duration_s, rest_s, ..AnalyticConfig::default() };
    let rendered = RenderedFlight::new(&MotionSource::Analytic(motion, ImuConfig::default()), &RenderConfig::default(), SEED, SEED)?;
    let flight = &rendered.flight;
    let camera = small::camera(&euroc::camera(0)).ok_or("the rig has no pinhole camera")?;
    let began = flight.imu.first().ok_or("a flight without samples")?.stamp;
    let mut bytes = recording::header(&camera, &euroc::body_from_camera(0), &flight.imu_noise, flight.imu.len(), flight.frame_stamps.len());
    bytes.extend(flight.imu.iter().flat_map(recording::sample));
    let renderer = rendered.renderer(0)?;
    let mut truth = String::from("#ms,x_m,y_m,z_m\n");
    for (index, stamp) in flight.frame_stamps.iter().enumerate() {
        let image = rendered.image(&renderer, index).ok_or("an image is missing")?;
        bytes.extend(recording::image(*stamp, &small::shrink(&image)));
        let position = flight.trajectory.at((*stamp - flight.epoch).as_seconds()).position_in_world;
        let millis = (*stamp - began).as_nanos() / 1_000_000;
        writeln!(truth, "{millis},{:.4},{:.4},{:.4}", position.x, position.y, position.z)?;
    }
    std::fs::write(&path, &bytes)?;
    std::fs::write(path.with_extension("truth.csv"), truth)?;
    println!("{}: {} samples, {} images, {} bytes", path.display(), flight.imu.len(), flight.frame_stamps.len(), bytes.len());
    Ok(())
}
