//! The program's pipeline from code: runs a recording and prints its causal poses in TUM's format while they come.
//!
//! `cargo run --release -p libella-host --example run_recording -- MH_01_easy`

use std::error::Error;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use libella_host::config::Config;
use libella_host::dataset;
use libella_host::eval::evaluate;
use libella_host::pipeline;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map(PathBuf::from).ok_or("usage: run_recording RECORDING")?;
    // Every number that may be tuned; `Config::read` takes them from a file.
    let config = Config::default();
    // A folder, a zip archive, a bag or an MCAP file: told by its content. Images are read one by one while the estimator runs.
    let recording = dataset::open(&path, &config.dataset)?;
    for remark in &recording.remarks {
        eprintln!("{} ({} times)", remark.first, remark.count);
    }

    // Whoever sets this ends the run after the next image, and still gets what there is.
    let stop = AtomicBool::new(false);
    let run = pipeline::run(&recording, &config, &stop, |frame| {
        let Some(pose) = &frame.pose else { return };
        let (position, rotation) = (pose.world_from_body.translation, pose.world_from_body.rotation);
        let seconds = pose.stamp.as_nanos() as f64 * 1e-9;
        let [x, y, z, w] = [rotation.i, rotation.j, rotation.k, rotation.w];
        println!("{seconds:.6} {:.6} {:.6} {:.6} {x:.6} {y:.6} {z:.6} {w:.6}", position.x, position.y, position.z);
    })?;

    eprintln!("{} poses of {} images in {:.1} s", run.poses().count(), recording.frames.len(), run.wall_s);
    match &recording.truth {
        Some(truth) => {
            let found = evaluate(&run.trajectory(), truth, &config.evaluation)?;
            eprintln!("ATE {:.4} m over {:.1} m", found.ate_rmse_m, found.path_length_m);
        }
        None => eprintln!("no ground truth in the recording: errors are not measured"),
    }
    Ok(())
}
